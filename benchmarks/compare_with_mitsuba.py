#!/usr/bin/env python3
"""Fluorspar against Mitsuba 3 on the same elastic scenes, in one run: cost per band and agreement of band means.

cost = relative variance x net CPU seconds; lower is better, and it does not depend on the number of samples.
Relative variance: over independent renders, variance / mean^2 of every pixel and band, with the mean not below 5 % of
the band's, averaged over pixels and bands. Net: CPU seconds at N samples less those at one sample, scaled to N.
Renders of the two programs take turns. Mitsuba renders with `path`, `independent` sampler, four hero wavelengths, the
same depth and resolution, and a film with one box response per band.

    benchmarks/compare_with_mitsuba.py [--scene cornell_box] [--bands 31] [--spp 64] [--mitsuba-spp 256] [--runs 4]

Needs Python 3.9 or newer and a network: mitsuba and numpy are installed into a temporary virtual environment, unless
the interpreter has them (or --venv names one). The LLVM variant needs the LLVM library (Debian: libllvm19); without
it the scalar variant is used, and the output says so. Mitsuba's LLVM must know this processor: old LLVMs fail.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="cornell_box", choices=["cornell_box", "closed_cavity", "matte_cavity"])
    parser.add_argument("--bands", type=int, default=31, help="31, 69 or any number of 5 nm bins (default 31)")
    parser.add_argument("--side", type=int, default=128, help="columns and rows (default 128)")
    parser.add_argument("--depth", type=int, default=8, help="surfaces that a path visits (default 8)")
    parser.add_argument("--spp", type=int, default=64, help="samples a pixel of Fluorspar (default 64)")
    parser.add_argument("--mitsuba-spp", type=int, default=64, help="samples a pixel of Mitsuba (default 64)")
    parser.add_argument("--runs", type=int, default=4, help="independent renders of each (default 4)")
    parser.add_argument("--variant", default="llvm_ad_spectral", help="Mitsuba variant (default llvm_ad_spectral)")
    parser.add_argument("--sampler", default="independent", help="Mitsuba sampler (default independent)")
    parser.add_argument("--binary", help="render_benchmark, if it is built already")
    parser.add_argument("--venv", help="a virtual environment that has mitsuba and numpy")
    return parser.parse_args()


def in_environment(options):
    """Runs this script again where mitsuba is installed."""
    if options.venv:
        folder, temporary = options.venv, None
    else:
        temporary = tempfile.TemporaryDirectory(prefix="fluorspar-mitsuba-")
        folder = temporary.name
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        subprocess.run([f"{folder}/bin/pip", "install", "--quiet", "mitsuba", "numpy"], check=True)
    command = [f"{folder}/bin/python", __file__, *sys.argv[1:]]
    status = subprocess.run(command, env={**os.environ, "FLUORSPAR_BENCHMARK_CHILD": "1"}).returncode
    if temporary:
        temporary.cleanup()
    sys.exit(status)


def llvm_library():
    """The newest LLVM library in the usual places; DRJIT_LIBLLVM_PATH, if set, wins."""
    if "DRJIT_LIBLLVM_PATH" in os.environ:
        return os.environ["DRJIT_LIBLLVM_PATH"]
    found = []
    for pattern in ["usr/lib/*/libLLVM*.so*", "usr/lib/llvm-*/lib/libLLVM*.so*", "usr/lib64/libLLVM*.so*"]:
        for path in pathlib.Path("/").glob(pattern):
            digits = path.name.replace("libLLVM", "").strip("-.").replace("so.", "").split(".")[0]
            if digits.isdigit():
                found.append((int(digits), str(path)))
    return max(found)[1] if found else None


def mitsuba_scene(mi, np, folder, sampler, depth):
    """The exported scene, and the edges of its bands."""
    description = json.loads((folder / "scene.json").read_text())
    edges = description["edges_nm"]
    start, step = description["start_nm"], description["step_nm"]

    def spectrum(values):
        return {"type": "regular", "wavelength_min": start, "wavelength_max": start + step * (len(values) - 1),
                "values": ", ".join(f"{v:.9g}" for v in values)}

    # One box per band; neighbors meet halfway in a ramp of a hundredth of a nanometer.
    film = {"type": "specfilm", "width": description["camera"]["width"], "height": description["camera"]["height"],
            "component_format": "float32", "rfilter": {"type": "box"}}
    ramp = 0.005
    for band, (low, high) in enumerate(zip(edges[:-1], edges[1:])):
        film[f"band_{band:03}"] = {
            "type": "irregular",
            "wavelengths": f"{low - ramp}, {low + ramp}, {high - ramp}, {high + ramp}",
            "values": "0, 1, 1, 0",
        }
    camera = description["camera"]
    position, forward = np.array(camera["position"]), np.array(camera["forward"])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth + 1, "rr_depth": 4},
        "sensor": {
            "type": "perspective", "fov": camera["field_deg"], "fov_axis": "x", "near_clip": 1e-4, "far_clip": 1e4,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=position.tolist(), target=(position + forward).tolist(), up=camera["up"]),
            "film": film, "sampler": {"type": sampler},
        },
    }
    materials = []
    for material in description["materials"]:
        base, *rest = material["reflectance"]
        if rest:
            columns, rows = material["checker"]
            reflectance = {
                "type": "checkerboard", "color0": spectrum(base),
                "color1": spectrum([a + b for a, b in zip(base, rest[0])]),
                "to_uv": mi.ScalarTransform4f().scale([columns / 2, rows / 2, 1]),
            }
        else:
            reflectance = spectrum(base)
        if material["coat"]:
            bsdf = {"type": "roughplastic", "distribution": "ggx", "alpha": material["coat"]["roughness"],
                    "int_ior": material["coat"]["refractive_index"], "ext_ior": 1.0,
                    "diffuse_reflectance": reflectance, "nonlinear": False}
        else:
            bsdf = {"type": "diffuse", "reflectance": reflectance}
        materials.append({"type": "twosided", "bsdf": bsdf})
    for item in description["objects"]:
        def read(attribute, kind, width, name=item["name"]):
            return np.fromfile(folder / f"{name}.{attribute}", dtype=kind).reshape(-1, width)
        positions, uvs = read("positions", "<f4", 3), read("uvs", "<f4", 2)
        triangles = read("triangles", "<u4", 3)
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(materials[item["material"]])
        mesh = mi.Mesh(item["name"], len(positions), len(triangles), has_vertex_normals=False,
                       has_vertex_texcoords=True, props=properties)
        data = mi.traverse(mesh)
        data["vertex_positions"] = positions.ravel()
        data["vertex_texcoords"] = uvs.ravel()
        data["faces"] = triangles.ravel()
        data.update()
        scene[item["name"]] = mesh
    for number, light in enumerate(description["lights"]):
        emitter = light["emitter"]
        radiance = [p / (np.pi * emitter["area"]) for p in light["power_w_per_nm"]]
        if emitter["shape"] == "disc":
            center, normal = np.array(emitter["center"]), np.array(emitter["normal"])
            up = [0, 1, 0] if abs(normal[1]) < 0.9 else [1, 0, 0]
            place = mi.ScalarTransform4f().look_at(
                origin=center.tolist(), target=(center + normal).tolist(), up=up)
            shape = {"type": "disk", "to_world": place @ mi.ScalarTransform4f().scale(emitter["radius"])}
        else:
            corner, u, v = (np.array(emitter[k]) for k in ("corner", "edge_u", "edge_v"))
            normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
            matrix = np.eye(4)
            matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = u / 2, v / 2, normal, corner + (u + v) / 2
            shape = {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix)}
        scene[f"light_{number}"] = {**shape, "emitter": {"type": "area", "radiance": spectrum(radiance)}}
    return mi.load_dict(scene), np.array(edges)


def relative_variance(np, images):
    """Mean over pixels and bands, and of the median pixel."""
    images = np.asarray(images, dtype=np.float64)
    mean = images.mean(axis=0)
    floor = 0.05 * mean.mean(axis=(0, 1))
    relative = images.var(axis=0, ddof=1) / np.maximum(mean, floor) ** 2
    return relative.mean(), np.median(relative.mean(axis=2))


def main():
    options = arguments()
    if "FLUORSPAR_BENCHMARK_CHILD" not in os.environ:
        try:
            import mitsuba, numpy  # noqa: F401
        except ImportError:
            in_environment(options)
    library = llvm_library()
    if library:
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    import mitsuba as mi
    import numpy as np

    variant = options.variant
    if variant.startswith("llvm"):
        probe = f"import mitsuba as mi; mi.set_variant('{variant}'); import drjit as dr; dr.eval(mi.Float([1, 2]) + 1)"
        if subprocess.run([sys.executable, "-c", probe], capture_output=True).returncode != 0:
            print(f"{variant} does not run here (is a recent LLVM library installed?): using scalar_spectral")
            variant = "scalar_spectral"
    mi.set_variant(variant)
    # One thread, as for Fluorspar.
    if variant.startswith("llvm"):
        import drjit as dr
        dr.set_thread_count(1)

    binary = options.binary
    if not binary:
        subprocess.run(["cargo", "build", "--release", "-p", "fluorspar-benchmarks"], cwd=ROOT, check=True)
        binary = str(ROOT / "target/release/render_benchmark")
    shared = [options.scene, "--bands", str(options.bands), "--side", str(options.side), "--depth", str(options.depth)]
    with tempfile.TemporaryDirectory(prefix="fluorspar-benchmark-") as name:
        folder = pathlib.Path(name)
        subprocess.run([binary, *shared, "--export", str(folder / "scene")], check=True)
        before = time.process_time()
        scene, edges = mitsuba_scene(mi, np, folder / "scene", options.sampler, options.depth)

        def mitsuba(spp, seed):
            start = time.process_time()
            image = np.array(mi.render(scene, spp=spp, seed=seed))
            return image, time.process_time() - start

        for warm_up in (1, options.mitsuba_spp):  # compiles the kernels
            mitsuba(warm_up, 0)
        setup = time.process_time() - before
        ours, theirs, our_cpu, their_cpu = [], [], [], []
        for run in range(options.runs):
            command = [binary, *shared, "--spp", str(options.spp), "--runs", "1", "--seed", str(run + 1),
                       "--images", str(folder / f"images_{run}")]
            report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            our_cpu.append(report["cpu_s"])
            raw = np.fromfile(folder / f"images_{run}" / "0.f32", dtype="<f4")
            ours.append(raw.reshape(options.side, options.side, -1))
            base = mitsuba(1, 1000 + run)[1]
            image, cpu = mitsuba(options.mitsuba_spp, 1 + run)
            theirs.append(image)
            their_cpu.append((cpu - base) * options.mitsuba_spp / (options.mitsuba_spp - 1))

    ours, theirs = np.array(ours), np.array(theirs)
    rows = []
    for label, images, cpu, spp in [("Fluorspar", ours, np.median(our_cpu), options.spp),
                                    (f"Mitsuba {mi.__version__} {variant} {options.sampler}", theirs,
                                     np.median(their_cpu), options.mitsuba_spp)]:
        mean, median = relative_variance(np, images)
        rows.append((mean * cpu, median * cpu))
        print(f"{label}: {spp} spp, {cpu:.2f} CPU s, {1e6 * cpu / (spp * options.side ** 2):.2f} us a path, "
              f"relative variance {mean:.4g} (median pixel {median:.4g}), cost {mean * cpu:.4g} ({median * cpu:.4g})")
    print(f"Mitsuba's set-up: {setup:.1f} CPU s, not counted")
    print(f"{options.scene}, {options.bands} bands: cost ratio Mitsuba / Fluorspar "
          f"{rows[1][0] / rows[0][0]:.1f} (mean), {rows[1][1] / rows[0][1]:.1f} (median pixel)")

    # Mitsuba's film integrates over the band: divide by its width.
    widths = np.diff(edges)
    our_means = ours.mean(axis=(0, 1, 2), dtype=np.float64)
    their_means = theirs.mean(axis=(0, 1, 2), dtype=np.float64)
    candidates = {"integral": their_means / widths, "average": their_means}
    kind = min(candidates, key=lambda k: abs(np.log(candidates[k].mean() / our_means.mean())))
    ratio = candidates[kind] / our_means
    error, own_error = (
        images.mean(axis=(1, 2), dtype=np.float64).std(axis=0, ddof=1) / np.sqrt(len(images)) / means
        for images, means in [(theirs, their_means), (ours, our_means)])
    print(f"band means, Mitsuba ({kind} over the band) / Fluorspar: mean {ratio.mean():.5f}, "
          f"least {ratio.min():.5f}, greatest {ratio.max():.5f}; standard errors a band: Mitsuba {error.mean():.5f}, "
          f"Fluorspar {own_error.mean():.5f}")
    worst = np.abs(ratio - 1).max()
    limit = 0.005 + 4 * error.max()
    print(f"largest difference of a band {100 * worst:.2f} %, allowed 0.5 % + 4 standard errors = {100 * limit:.2f} %")
    if options.scene == "closed_cavity":
        print("(the glossy cavity is not compared: Mitsuba's roughplastic is another model of a coat)")
    elif worst > limit:
        sys.exit("band means disagree")


if __name__ == "__main__":
    main()
