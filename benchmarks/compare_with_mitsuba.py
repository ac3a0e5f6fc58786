#!/usr/bin/env python3
"""Fluorspar against Mitsuba 3 on the same elastic scenes, in one run: cost per band and agreement of band means.

cost = relative variance x net CPU seconds; lower is better, and it does not depend on the number of samples.
Relative variance: over independent renders, variance / mean^2 of every pixel and band, with the mean not below 5 % of
the band's, averaged over pixels and bands. Net: CPU seconds at N samples less those at the fewest, scaled to N; the
mean of the runs. Renders of the two programs alternate. Standard errors are jackknifed: run i of both programs is left
out together.

Mitsuba renders with `path`, four hero wavelengths, the same depth and resolution, a film with one box response per
band, and one or both of its samplers: `independent` random numbers and the low-discrepancy `ldsampler`, whose numbers
of samples are powers of four. Fluorspar draws Owen-scrambled Sobol points: `ldsampler` is the like-for-like peer.

    benchmarks/compare_with_mitsuba.py [--scene cornell_box] [--bands 31] [--spp 64] [--mitsuba-spp 256] [--runs 8]
                                       [--sampler independent|ldsampler]

`--sampler` may be repeated; without it both samplers are compared. The last lines are rows of the table of
docs/performance.md.

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
# Samplers of Mitsuba and the fewest samples per pixel that each can render: the time of those is set-up.
FEWEST_SAMPLES = {"independent": 1, "ldsampler": 4}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="cornell_box", choices=["cornell_box", "closed_cavity", "matte_cavity"])
    parser.add_argument("--bands", type=int, default=31, help="31, 69 or any number of 5 nm bins (default 31)")
    parser.add_argument("--side", type=int, default=128, help="columns and rows (default 128)")
    parser.add_argument("--depth", type=int, default=8, help="maximum path depth, surface interactions (default 8)")
    parser.add_argument("--spp", type=int, default=64, help="samples a pixel of Fluorspar (default 64)")
    parser.add_argument("--mitsuba-spp", type=int, default=64, help="samples a pixel of Mitsuba (default 64)")
    parser.add_argument("--runs", type=int, default=8, help="independent renders of each, at least 3 (default 8)")
    parser.add_argument("--variant", default="llvm_ad_spectral", help="Mitsuba variant (default llvm_ad_spectral)")
    parser.add_argument("--sampler", action="append", choices=list(FEWEST_SAMPLES),
                        help="Mitsuba sampler; may be repeated (default both)")
    parser.add_argument("--binary", help="render_benchmark, if it is built already")
    parser.add_argument("--venv", help="a virtual environment that has mitsuba and numpy")
    options = parser.parse_args()
    options.sampler = list(dict.fromkeys(options.sampler or FEWEST_SAMPLES))
    if options.runs < 3:
        parser.error("--runs must be at least 3: the standard errors come from leaving runs out")
    for sampler in options.sampler:
        if options.mitsuba_spp <= FEWEST_SAMPLES[sampler]:
            parser.error(f"--mitsuba-spp must be more than {FEWEST_SAMPLES[sampler]}")
    if "ldsampler" in options.sampler and options.mitsuba_spp not in [4 ** k for k in range(1, 16)]:
        parser.error("--mitsuba-spp must be a power of four with ldsampler, which rounds up to one: 64, 256, 1024")
    return options


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


class Renders:
    """Independent renders of one program: images, [run, row, column, band], and net CPU seconds."""

    def __init__(self, name, spp):
        self.name, self.spp, self.images, self.cpu_s = name, spp, [], []

    def add(self, image, cpu_s):
        self.images.append(image)
        self.cpu_s.append(cpu_s)

    def cost(self, np, left_out=None):
        """Relative variance x CPU seconds, of the mean over pixels and of the median pixel; both variances; the seconds."""
        kept = [run for run in range(len(self.images)) if run != left_out]
        images = np.asarray([self.images[run] for run in kept], dtype=np.float64)
        mean = images.mean(axis=0)
        floor = 0.05 * mean.mean(axis=(0, 1))
        relative = images.var(axis=0, ddof=1) / np.maximum(mean, floor) ** 2
        variances = np.array([relative.mean(), np.median(relative.mean(axis=2))])
        cpu_s = np.mean([self.cpu_s[run] for run in kept])
        return variances * cpu_s, variances, cpu_s

    def microseconds(self, np):
        """CPU time of a path, us, and its standard error."""
        pixels = self.images[0].shape[0] * self.images[0].shape[1]
        us = 1e6 * np.array(self.cpu_s) / (self.spp * pixels)
        return us.mean(), us.std(ddof=1) / np.sqrt(len(us))


def jackknife(np, runs, statistic):
    """A statistic of all runs, and its standard error from leaving out one run after the other."""
    parts = np.array([statistic(run) for run in range(runs)])
    error = np.sqrt((runs - 1) / runs * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0))
    return np.asarray(statistic(None)), error


def print_band_means(np, ours, theirs, edges, compared):
    """Ratios of the band means of the two programs. Returns whether they agree."""
    # Mitsuba's film integrates over the band: divide by its width.
    our_images, their_images = np.array(ours.images), np.array(theirs.images)
    our_means = our_images.mean(axis=(0, 1, 2), dtype=np.float64)
    their_means = their_images.mean(axis=(0, 1, 2), dtype=np.float64)
    candidates = {"integral": their_means / np.diff(edges), "average": their_means}
    kind = min(candidates, key=lambda k: abs(np.log(candidates[k].mean() / our_means.mean())))
    ratio = candidates[kind] / our_means
    error, own_error = (
        images.mean(axis=(1, 2), dtype=np.float64).std(axis=0, ddof=1) / np.sqrt(len(images)) / means
        for images, means in [(their_images, their_means), (our_images, our_means)])
    print(f"band means, {theirs.name} ({kind} over the band) / Fluorspar: mean {ratio.mean():.5f}, "
          f"least {ratio.min():.5f}, greatest {ratio.max():.5f}; standard errors of a band: Mitsuba {error.mean():.5f}, "
          f"Fluorspar {own_error.mean():.5f}")
    worst = np.abs(ratio - 1).max()
    limit = 0.005 + 4 * error.max()
    print(f"largest difference of a band {100 * worst:.2f} %, allowed 0.5 % + 4 standard errors = {100 * limit:.2f} %")
    if not compared:
        print("(band means of the glossy cavity are not compared: Mitsuba's roughplastic is another model of a coat)")
    return worst <= limit or not compared


def report(np, options, ours, peers, edges):
    """Prints costs and band means, and the rows of the table. Returns whether the band means agree."""
    compared = options.scene != "closed_cavity"
    agree, rows = True, []
    for renders in [ours, *peers]:
        cost, variance, cpu_s = renders.cost(np)
        us, us_error = renders.microseconds(np)
        print(f"{renders.name}: {renders.spp} spp, {cpu_s:.2f} CPU s, {us:.2f} ± {us_error:.2f} us a path, relative "
              f"variance {variance[0]:.4g} (median pixel {variance[1]:.4g}), cost {cost[0]:.4g} ({cost[1]:.4g})")
    our_us = "{:.2f} ± {:.2f}".format(*ours.microseconds(np))
    for sampler, theirs in zip(options.sampler, peers):
        ratio, error = jackknife(
            np, options.runs, lambda run, theirs=theirs: theirs.cost(np, run)[0] / ours.cost(np, run)[0])
        their_us = "{:.2f} ± {:.2f}".format(*theirs.microseconds(np))
        coat = {"closed_cavity": "ours; Mitsuba `roughplastic`"}.get(options.scene, "none")
        rows.append(f"| {options.scene}, {ours.spp} samples here, {theirs.spp} there, {options.runs} runs | {coat} "
                    f"| {options.bands} | {sampler} | {our_us} | {their_us} "
                    f"| {ratio[0]:.1f} ± {error[0]:.1f} | {ratio[1]:.1f} ± {error[1]:.1f} |")
        agree &= print_band_means(np, ours, theirs, edges, compared)
    print("\n| scene | coat | bands | Mitsuba's sampler | us a path, here | us a path, Mitsuba | cost ratio, mean "
          "| cost ratio, median pixel |\n|---|---|---|---|---|---|---|---|")
    print("\n".join(rows))
    return agree


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
        scenes = {}
        for sampler in options.sampler:
            scenes[sampler], edges = mitsuba_scene(mi, np, folder / "scene", sampler, options.depth)

        def mitsuba(sampler, spp, seed):
            start = time.process_time()
            image = np.array(mi.render(scenes[sampler], spp=spp, seed=seed))
            return image, time.process_time() - start

        # Compile the kernels
        for sampler in options.sampler:
            for spp in (FEWEST_SAMPLES[sampler], options.mitsuba_spp):
                mitsuba(sampler, spp, 0)
        print(f"Mitsuba's set-up: {time.process_time() - before:.1f} CPU s, not counted")

        # Alternate the programs, so that disturbances of the machine affect all of them
        ours = Renders("Fluorspar", options.spp)
        peers = [Renders(f"Mitsuba {mi.__version__} {variant} {sampler}", options.mitsuba_spp)
                 for sampler in options.sampler]
        for run in range(options.runs):
            command = [binary, *shared, "--spp", str(options.spp), "--runs", "1", "--seed", str(run + 1),
                       "--images", str(folder / f"images_{run}")]
            result = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            raw = np.fromfile(folder / f"images_{run}" / "0.f32", dtype="<f4")
            ours.add(raw.reshape(options.side, options.side, -1), result["cpu_s"])
            for sampler, theirs in zip(options.sampler, peers):
                fewest = FEWEST_SAMPLES[sampler]
                base = mitsuba(sampler, fewest, 1000 + run)[1]
                image, cpu = mitsuba(sampler, options.mitsuba_spp, 1 + run)
                theirs.add(image, (cpu - base) * options.mitsuba_spp / (options.mitsuba_spp - fewest))
    if not report(np, options, ours, peers, edges):
        sys.exit("band means disagree")


if __name__ == "__main__":
    main()
