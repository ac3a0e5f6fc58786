#!/usr/bin/env python3
"""Makes what an intraoral scanner would: one mesh of some parts, in millimeters (glTF: meters), in a frame of its own.

    scanner_frame.py MOUTH.obj OUT.stl|.ply|.obj|.gltf PART... [--chip TOOTH]

PART may end in `*`. The biting edges of the upper teeth are turned up (+z) and the incisors to +y. `--chip` breaks a
corner off a tooth, so that the scan differs from the mouth it was made of. Needs Python only.
"""

import fnmatch
import json
import os
import struct
import sys


def read_obj(path):
    """Vertices, mm, with texture coordinates, and triangles by part, of a file in meters."""
    vertices, uvs, parts, name = [], [], {}, None
    for line in open(path):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append(tuple(1e3 * float(word) for word in words[1:4]))
        elif words[0] == "vt":
            uvs.append(tuple(map(float, words[1:3])))
        elif words[0] == "o":
            name = words[1]
            parts[name] = []
        elif words[0] == "f":
            corners = [tuple(int(i) - 1 for i in word.split("/")[:2]) for word in words[1:4]]
            parts[name].append(corners)
    return vertices, uvs, parts


def chip(point, edge_y, corner_x, side):
    """Moves what lies beyond a slanted plane through the mesial corner of the edge onto that plane."""
    x, y, z = point
    beyond = 3.5 - side * (x - corner_x) - (y - edge_y)
    return (x, y + max(0.0, 0.8 * beyond), z)


def main():
    arguments = sys.argv[1:]
    chipped = None
    if "--chip" in arguments:
        at = arguments.index("--chip")
        chipped = arguments[at + 1]
        del arguments[at : at + 2]
    source, target, patterns = arguments[0], arguments[1], arguments[2:]
    vertices, uvs, parts = read_obj(source)
    chosen = [name for name in parts if any(fnmatch.fnmatch(name, pattern) for pattern in patterns)]
    if not chosen:
        sys.exit(f"{source} has no part like {' '.join(patterns)}; it has {' '.join(parts)}")
    points, coordinates, triangles, numbers = [], [], [], {}
    for name in chosen:
        own = [vertices[v] for corners in parts[name] for v, _ in corners]
        edge_y = min(y for _, y, _ in own)
        side = 1.0 if sum(x for x, _, _ in own) > 0 else -1.0
        corner_x = side * min(side * x for x, _, _ in own)
        for corners in parts[name]:
            triangle = []
            for v, t in corners:
                key = (name, v, t)
                if key not in numbers:
                    numbers[key] = len(points)
                    x, y, z = vertices[v]
                    if name == chipped:
                        x, y, z = chip((x, y, z), edge_y, corner_x, side)
                    points.append((x, z, -y))
                    coordinates.append(uvs[t])
                triangle.append(numbers[key])
            triangles.append(triangle)
    write(target, points, coordinates, triangles)
    print(f"{target}: {', '.join(chosen)}; {len(triangles)} triangles")


def write(target, points, coordinates, triangles):
    ending = target.rsplit(".", 1)[-1]
    if ending == "stl":
        with open(target, "wb") as file:
            file.write(bytes(80) + struct.pack("<I", len(triangles)))
            for triangle in triangles:
                file.write(struct.pack("<3f", 0, 0, 0))
                for i in triangle:
                    file.write(struct.pack("<3f", *points[i]))
                file.write(bytes(2))
    elif ending == "ply":
        with open(target, "w") as file:
            file.write("ply\nformat ascii 1.0\n")
            file.write(f"element vertex {len(points)}\n")
            file.write("".join(f"property float {p}\n" for p in ["x", "y", "z", "u", "v"]))
            file.write(f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
            for (x, y, z), (u, v) in zip(points, coordinates):
                file.write(f"{x:.5f} {y:.5f} {z:.5f} {u:.6f} {v:.6f}\n")
            for a, b, c in triangles:
                file.write(f"3 {a} {b} {c}\n")
    elif ending == "obj":
        with open(target, "w") as file:
            for x, y, z in points:
                file.write(f"v {x:.5f} {y:.5f} {z:.5f}\n")
            for u, v in coordinates:
                file.write(f"vt {u:.6f} {v:.6f}\n")
            for triangle in triangles:
                file.write("f " + " ".join(f"{i + 1}/{i + 1}" for i in triangle) + "\n")
    elif ending == "gltf":
        # glTF has meters as its unit; v runs downwards.
        buffers = [
            b"".join(struct.pack("<3f", *(1e-3 * c for c in p)) for p in points),
            b"".join(struct.pack("<2f", u, 1.0 - v) for u, v in coordinates),
            b"".join(struct.pack("<3I", *t) for t in triangles),
        ]
        starts = [sum(map(len, buffers[:i])) for i in range(3)]
        low = [1e-3 * min(p[i] for p in points) for i in range(3)]
        high = [1e-3 * max(p[i] for p in points) for i in range(3)]
        document = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3", "min": low, "max": high},
                {"bufferView": 1, "componentType": 5126, "count": len(points), "type": "VEC2"},
                {"bufferView": 2, "componentType": 5125, "count": 3 * len(triangles), "type": "SCALAR"},
            ],
            "bufferViews": [
                {"buffer": 0, "byteOffset": start, "byteLength": len(data)} for start, data in zip(starts, buffers)
            ],
            "buffers": [
                {
                    "byteLength": sum(map(len, buffers)),
                    "uri": os.path.basename(target) + ".bin",
                }
            ],
        }
        with open(target + ".bin", "wb") as file:
            file.write(b"".join(buffers))
        with open(target, "w") as file:
            json.dump(document, file)
    else:
        sys.exit(f"{target}: the name must end in .stl, .ply, .obj or .gltf")


main()
