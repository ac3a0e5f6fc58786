#!/usr/bin/env python3
"""Compares mean radiance with that of pbrt-v3-spectral in 31 bands: a Cornell box and a rough sphere of gold.

    python benchmarks/same_light_as_pbrt.py PBRT [--program target/release/fluorspar] [--spp 256] [--out FOLDER]

PBRT is the program of pbrt-v3-spectral, built with sampled spectra (31 bands of 10 nm from 395 to 705 nm), which you bring. Both read
the same .pbrt file; ours with `--single-scattering`. The band means of the image must agree within 0.5 % and four standard errors of
their difference, which halves of each render give. Needs numpy.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

SIDE = 48
BANDS = "400:700:10"


def spectrum(*pairs):
    return " ".join(f"{nm} {value}" for nm, value in pairs)


WHITE = spectrum((390, 0.6), (500, 0.75), (710, 0.72))
RED = spectrum((390, 0.05), (570, 0.06), (620, 0.6), (710, 0.65))
GREEN = spectrum((390, 0.08), (480, 0.12), (530, 0.5), (590, 0.15), (710, 0.1))
LAMP = spectrum((390, 4), (450, 12), (560, 18), (710, 15))
SKY = spectrum((390, 0.9), (550, 0.6), (710, 0.4))
# Real and imaginary part of the index, about those of gold.
ETA = spectrum((390, 1.67), (450, 1.50), (500, 0.97), (550, 0.43), (600, 0.25), (710, 0.13))
K = spectrum((390, 1.94), (450, 1.88), (500, 1.87), (550, 2.46), (600, 3.11), (710, 4.07))


def scene(eye, field, content):
    return f"""LookAt {eye}  0 0 0  0 1 0
Camera "perspective" "float fov" {field}
Film "image" "integer xresolution" {SIDE} "integer yresolution" {SIDE} "string filename" "theirs.exr" "bool spectralFlag" "true"
Sampler "random" "integer pixelsamples" SAMPLES
PixelFilter "box" "float xwidth" 0.5 "float ywidth" 0.5
Integrator "path" "integer maxdepth" 8
WorldBegin
{content}
WorldEnd
"""


def quad(color, *corners):
    points = " ".join(str(c) for corner in corners for c in corner)
    return (f'Material "matte" "spectrum Kd" [{color}]\n'
            f'Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point P" [{points}]\n')


def cornell_box():
    """A closed room with a light in its ceiling, a box and a ball, all matte."""
    x0, y0, z0, x1, y1, z1 = -0.6, -1.0, -0.6, -0.1, 0.2, -0.1
    content = "".join([
        quad(WHITE, (-1, -1, -1), (-1, -1, 1), (1, -1, 1), (1, -1, -1)),
        quad(WHITE, (-1, 1, -1), (1, 1, -1), (1, 1, 1), (-1, 1, 1)),
        quad(WHITE, (-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)),
        quad(RED, (-1, -1, 1), (-1, -1, -1), (-1, 1, -1), (-1, 1, 1)),
        quad(GREEN, (1, -1, -1), (1, -1, 1), (1, 1, 1), (1, 1, -1)),
        quad(WHITE, (x0, y1, z0), (x0, y1, z1), (x1, y1, z1), (x1, y1, z0)),
        quad(WHITE, (x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)),
        quad(WHITE, (x1, y0, z0), (x0, y0, z0), (x0, y1, z0), (x1, y1, z0)),
        quad(WHITE, (x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)),
        quad(WHITE, (x1, y0, z1), (x1, y0, z0), (x1, y1, z0), (x1, y1, z1)),
        f'Material "matte" "spectrum Kd" [{WHITE}]\n',
        'AttributeBegin Translate 0.4 -0.6 0.2 Shape "sphere" "float radius" 0.4 AttributeEnd\n',
        f'AttributeBegin AreaLightSource "diffuse" "spectrum L" [{LAMP}]\n',
        quad(WHITE, (-0.3, 0.99, -0.3), (0.3, 0.99, -0.3), (0.3, 0.99, 0.3), (-0.3, 0.99, 0.3)),
        "AttributeEnd",
    ])
    return scene("0 0 3.4", 38, content)


def metal_sphere():
    """A rough sphere of gold in an even sky, which is a large sphere that shines inward, and a lamp."""
    content = f"""Material "metal" "spectrum eta" [{ETA}] "spectrum k" [{K}] "float roughness" 0.3 "bool remaproughness" "false"
Shape "sphere" "float radius" 1
Material "matte" "spectrum Kd" [390 0 710 0]
AttributeBegin AreaLightSource "diffuse" "spectrum L" [{LAMP}] Translate 2 2 4 Shape "sphere" "float radius" 0.5 AttributeEnd
AttributeBegin AreaLightSource "diffuse" "spectrum L" [{SKY}] ReverseOrientation Shape "sphere" "float radius" 30 AttributeEnd"""
    return scene("0 0 6", 24, content)


def ours(program, folder, spp, seed):
    image = folder / "ours.npy"
    subprocess.run(
        [program, "render", folder / "scene.pbrt", "--unit", "m", "--bands", BANDS, "--single-scattering", "--spp", str(spp),
         "--seed", str(seed), "--out", image, "-q"], check=True)
    return np.load(image).reshape(-1, 31).astype(float).mean(0)


def theirs(program, folder, text, spp):
    """Values of all bands and pixels. The file holds sums over samples."""
    (folder / "theirs.pbrt").write_text(text.replace("SAMPLES", str(spp)))
    subprocess.run([program, "--quiet", "--nthreads", "1", "theirs.pbrt"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    data = (folder / "theirs.dat").read_bytes()
    size, rest = data.split(b"\n", 1)
    columns, rows, bands = map(int, size.split())
    values = np.frombuffer(rest.split(b"\n", 1)[1], "<f8").reshape(bands, rows, columns)
    return values.reshape(bands, -1) / spp


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pbrt")
    parser.add_argument("--program", default="target/release/fluorspar")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel of each half here; pbrt takes four times as many")
    parser.add_argument("--out", help="folder that keeps the scenes and images")
    options = parser.parse_args()
    good = True
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(options.out or temporary)
        folder.mkdir(exist_ok=True)
        pbrt = pathlib.Path(options.pbrt).resolve()
        for name, text in {"cornell box": cornell_box(), "metal sphere": metal_sphere()}.items():
            (folder / "scene.pbrt").write_text(text.replace("SAMPLES", "16"))
            a = np.array([ours(options.program, folder, options.spp, seed) for seed in (1, 2)])
            # pbrt takes no seed: another sampler gives the other half
            halves = [text, text.replace('Sampler "random"', 'Sampler "halton"')]
            b = np.array([theirs(pbrt, folder, half, 4 * options.spp).mean(1) for half in halves])
            mean_a, mean_b = a.mean(0), b.mean(0)
            error = 0.5 * np.hypot(a[0] - a[1], b[0] - b[1]) / mean_b
            off = mean_a / mean_b - 1
            print(f"{name}: ours over pbrt, least {off.min():+.4%}, mean {off.mean():+.4%}, greatest {off.max():+.4%}; "
                  f"standard error of a band {np.sqrt((error ** 2).mean()):.4%}")
            good &= bool(np.all(np.abs(off) < 0.005 + 4 * error))
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
