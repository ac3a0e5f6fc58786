"""By hand: Blender opens a mouth with its camera and lights. Needs `pip install bpy`, for the Python that it is built for.

    fluorspar scene convert oraleye-2021 --capture blue --out mouth.glb
    python validation/check_blender.py mouth.glb [PICTURE.png]

Prints what Blender has found; PICTURE is what its own renderer makes of it, in clay. Ends with 1 where something is missing.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import bpy


def document(path: Path) -> dict:
    """The JSON of a .glb."""
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def main() -> int:
    path = Path(sys.argv[1])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path))
    told, found = document(path), bpy.data
    lights = told["extensions"]["KHR_lights_punctual"]["lights"]
    camera = told["cameras"][0]["perspective"]
    corners = [part.matrix_world @ vertex.co for part in found.objects if part.type == "MESH" for vertex in part.data.vertices]
    size = [max(c[axis] for c in corners) - min(c[axis] for c in corners) for axis in range(3)]
    print(f"{len(found.meshes)} meshes of {len(corners)} vertices, {size[0]:.3f} x {size[1]:.3f} x {size[2]:.3f} m, {len(found.materials)} materials")
    angles = [camera.angle_y for camera in found.cameras]
    powers = [light.energy for light in found.lights]
    print(f"camera {math.degrees(angles[0]):.2f} degrees high, {len(powers)} lights of {sum(powers):.4g} W in all directions")
    wrong = []
    if len(found.meshes) != len(told["meshes"]) or "tongue_dorsum" not in found.objects:
        wrong.append("meshes")
    if len(angles) != 1 or not math.isclose(angles[0], camera["yfov"], rel_tol=1e-5):
        wrong.append(f"camera: {math.degrees(camera['yfov'])} degrees are told")
    # A lamp of Blender has the power that it would send if it shone in all directions alike
    expected = [4 * math.pi * light["extras"]["radiant_intensity_w_per_sr"] for light in lights]
    if not math.isclose(sum(powers), sum(expected), rel_tol=1e-3) or not lights:
        wrong.append(f"lights: {sum(expected)} W are told")
    if len(sys.argv) > 2:
        scene = bpy.context.scene
        scene.camera = next(part for part in found.objects if part.type == "CAMERA")
        scene.render.engine, scene.cycles.samples = "CYCLES", 4
        scene.render.resolution_x, scene.render.resolution_y = 240, 160
        scene.render.filepath = str(Path(sys.argv[2]).resolve())
        bpy.ops.render.render(write_still=True)
    print("\n".join(f"missing or other: {what}" for what in wrong) or "all is there")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
