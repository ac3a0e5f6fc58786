#!/usr/bin/env python3
"""Compares mean radiance with that of Mitsuba 3 on scenes written for pbrt: a Cornell box and a rough metal sphere.

    python benchmarks/same_light_as_mitsuba.py [--program target/release/fluorspar] [--spp 256] [--out FOLDER]

Writes each scene as .pbrt, for `fluorspar render --single-scattering`, and as a Mitsuba scene of three linear channels, which
stand for three bands of 100 nm. The band means of the image must agree within 0.5 % and four standard errors of their difference, which
halves of each render give. Needs numpy and mitsuba (`pip install numpy mitsuba`).
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
T = mi.ScalarTransform4f
SIDE = 48
BANDS = "450:650:100"


def spectrum(values):
    """Three bands with steps between them, as pairs of wavelength and value."""
    edges = [(399.0, 499.999), (500.001, 599.999), (600.001, 701.0)]
    return " ".join(f"{a} {v} {b} {v}" for (a, b), v in zip(edges, values))


def rgb(values):
    return {"type": "rgb", "value": list(values)}


def cornell_box():
    """A closed room with a light in its ceiling, a box and a ball, all matte."""
    white, red, green = (0.7, 0.72, 0.74), (0.6, 0.08, 0.06), (0.1, 0.5, 0.12)
    emitted = (10.0, 14.0, 18.0)
    # Name, corners in order around the side that faces the room, reflectance.
    quads = [
        ("floor", [(-1, -1, -1), (-1, -1, 1), (1, -1, 1), (1, -1, -1)], white),
        ("ceiling", [(-1, 1, -1), (1, 1, -1), (1, 1, 1), (-1, 1, 1)], white),
        ("back", [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)], white),
        ("left", [(-1, -1, 1), (-1, -1, -1), (-1, 1, -1), (-1, 1, 1)], red),
        ("right", [(1, -1, -1), (1, -1, 1), (1, 1, 1), (1, 1, -1)], green),
    ]
    light = [(-0.3, 0.99, -0.3), (0.3, 0.99, -0.3), (0.3, 0.99, 0.3), (-0.3, 0.99, 0.3)]
    low, high = (-0.6, -1.0, -0.6), (-0.1, 0.2, -0.1)
    x0, y0, z0, x1, y1, z1 = *low, *high
    box = [
        [(x0, y1, z0), (x0, y1, z1), (x1, y1, z1), (x1, y1, z0)],
        [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        [(x1, y0, z0), (x0, y0, z0), (x0, y1, z0), (x1, y1, z0)],
        [(x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)],
        [(x1, y0, z1), (x1, y0, z0), (x1, y1, z0), (x1, y1, z1)],
    ]
    quads += [(f"box_{i}", corners, white) for i, corners in enumerate(box)]

    def mesh(corners):
        points = " ".join(str(c) for corner in corners for c in corner)
        return f'Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [{points}]'

    text = f"""LookAt 0 0 3.4  0 0 0  0 1 0
Camera "perspective" "float fov" 38
Film "image" "integer xresolution" {SIDE} "integer yresolution" {SIDE}
Integrator "path" "integer maxdepth" 8
WorldBegin
"""
    for _, corners, color in quads:
        text += f'Material "matte" "spectrum Kd" [{spectrum(color)}]\n{mesh(corners)}\n'
    text += f'Material "matte" "spectrum Kd" [{spectrum(white)}]\n'
    text += 'AttributeBegin Translate 0.4 -0.6 0.2 Shape "sphere" "float radius" 0.4 AttributeEnd\n'
    text += f'AttributeBegin AreaLightSource "diffuse" "spectrum L" [{spectrum(emitted)}]\n{mesh(light)} AttributeEnd\n'

    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 9, "rr_depth": 100},
        "sensor": sensor((0, 0, 3.4), 38),
        "ball": {
            "type": "sphere", "center": [0.4, -0.6, 0.2], "radius": 0.4,
            "bsdf": {"type": "twosided", "b": {"type": "diffuse", "reflectance": rgb(white)}},
        },
    }
    for name, corners, color in quads + [("light", light, white)]:
        shape = quad(corners)
        shape["bsdf"] = {"type": "twosided", "b": {"type": "diffuse", "reflectance": rgb(color)}}
        if name == "light":
            shape["emitter"] = {"type": "area", "radiance": rgb(emitted)}
        scene[name] = shape
    return text, scene


def quad(corners):
    """A rectangle of Mitsuba with these corners, which faces as the triangles of pbrt do."""
    a, b, _, d = (np.array(c, float) for c in corners)
    u, v = (b - a) / 2, (d - a) / 2
    n, m = np.cross(u, v), np.eye(4)
    m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = u, v, n / np.linalg.norm(n), a + u + v
    return {"type": "rectangle", "to_world": T(m.tolist())}


def metal_sphere():
    """A rough sphere of gold below an even sky and a lamp."""
    eta, k, alpha = (1.43, 0.64, 0.16), (1.85, 1.99, 3.27), 0.3
    sky, lamp = (0.5, 0.6, 0.8), (40.0, 30.0, 20.0)
    text = f"""LookAt 0 0 6  0 0 0  0 1 0
Camera "perspective" "float fov" 24
Film "image" "integer xresolution" {SIDE} "integer yresolution" {SIDE}
Integrator "path" "integer maxdepth" 8
WorldBegin
LightSource "infinite" "spectrum L" [{spectrum(sky)}]
Material "metal" "spectrum eta" [{spectrum(eta)}] "spectrum k" [{spectrum(k)}] "float roughness" {alpha} "bool remaproughness" false
Shape "sphere" "float radius" 1
Material "matte" "spectrum Kd" [{spectrum((0, 0, 0))}]
AttributeBegin AreaLightSource "diffuse" "spectrum L" [{spectrum(lamp)}] Translate 2 2 4 Shape "sphere" "float radius" 0.5 AttributeEnd
"""
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 9, "rr_depth": 100},
        "sensor": sensor((0, 0, 6), 24),
        "sky": {"type": "constant", "radiance": rgb(sky)},
        "metal": {
            "type": "sphere", "radius": 1.0,
            "bsdf": {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, "eta": rgb(eta), "k": rgb(k)},
        },
        "lamp": {
            "type": "sphere", "center": [2, 2, 4], "radius": 0.5,
            "bsdf": {"type": "diffuse", "reflectance": rgb((0, 0, 0))},
            "emitter": {"type": "area", "radiance": rgb(lamp)},
        },
    }
    return text, scene


def sensor(origin, field):
    return {
        "type": "perspective", "fov": field,
        "to_world": T().look_at(origin=list(origin), target=[0, 0, 0], up=[0, 1, 0]),
        "film": {
            "type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"},
            "pixel_format": "rgb", "component_format": "float32",
        },
        "sampler": {"type": "independent"},
    }


def ours(program, folder, text, spp, seed):
    path, image = folder / "scene.pbrt", folder / "image.npy"
    path.write_text(text)
    subprocess.run(
        [program, "render", path, "--unit", "m", "--bands", BANDS, "--single-scattering", "--spp", str(spp), "--seed", str(seed),
         "--out", image, "-q"], check=True)
    return np.load(image).reshape(-1, 3).astype(float).mean(0)


def theirs(scene, spp, seed):
    return np.array(mi.render(scene, spp=spp, seed=seed)).reshape(-1, 3).astype(float).mean(0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/fluorspar")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel of each half here; Mitsuba takes four times as many")
    parser.add_argument("--out", help="folder that keeps the scenes and images")
    options = parser.parse_args()
    good = True
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(options.out or temporary)
        folder.mkdir(exist_ok=True)
        for name, (text, scene) in {"cornell box": cornell_box(), "metal sphere": metal_sphere()}.items():
            loaded = mi.load_dict(scene)
            a = np.array([ours(options.program, folder, text, options.spp, seed) for seed in (1, 2)])
            b = np.array([theirs(loaded, 4 * options.spp, seed) for seed in (1, 2)])
            mean_a, mean_b = a.mean(0), b.mean(0)
            error = 0.5 * np.hypot(a[0] - a[1], b[0] - b[1]) / mean_b
            off = mean_a / mean_b - 1
            print(f"{name}: band means {mean_a}, Mitsuba {mean_b}, off by {100 * off} %, standard error {100 * error} %")
            good &= bool(np.all(np.abs(off) < 0.005 + 4 * error))
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
