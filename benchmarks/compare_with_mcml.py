#!/usr/bin/env python3
"""Photons per second and core of our Monte Carlo of layered tissue and of the original MCML, side by side.

MCML (L. Wang, S. L. Jacques, L. Zheng, 1995) is not part of this project. Give the path of its program, version 1.2.2 or
another that reads the same `.mci` files, compiled with the same optimization as our release build (level 3):

    benchmarks/compare_with_mcml.py PATH/OF/MCML [--runs 5] [--binary target/release/examples/tissue_photons]

Both trace the same photons through the same media and bins, on one core, in turns. Times are CPU seconds of the whole program
less those of a run with 256 photons; the median of the runs and the range are printed, as rows of the table of
docs/performance.md. MCML scores absorption by depth and radius, ours by depth. Reflectance and transmittance are compared as
well: MCML prints no errors, so those of its mean come from its runs; they must agree within four standard errors.

Needs Python 3.9 or newer and a Unix system.
"""
import argparse
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
FEW = 256


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mcml", help="the program")
    parser.add_argument("--runs", type=int, default=5, help="runs of each program, at least 3 (default 5)")
    parser.add_argument("--medium", action="append", help="only this medium; may be repeated")
    parser.add_argument("--binary", help="tissue_photons, if it is built already")
    options = parser.parse_args()
    if options.runs < 3:
        parser.error("--runs must be at least 3: standard errors come from their scatter")
    options.mcml = os.path.abspath(options.mcml)
    if not os.access(options.mcml, os.X_OK) or os.path.isdir(options.mcml):
        parser.error(f"{options.mcml} is not a program; build MCML and give the path of what comes out")
    return options


def our_program(options):
    if options.binary:
        return os.path.abspath(options.binary)
    build = ["cargo", "build", "--release", "-p", "fluorspar", "--example", "tissue_photons"]
    subprocess.run(build, cwd=ROOT, check=True)
    target = os.environ.get("CARGO_TARGET_DIR", ROOT / "target")
    return str(pathlib.Path(target) / "release" / "examples" / "tissue_photons")


def timed(command, folder):
    """What a program printed, and its CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)} failed:\n{done.stdout}")
    return done.stdout, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def run_ours(program, medium, photons, seed, folder):
    text, seconds = timed([program, medium["name"], str(photons), str(seed)], folder)
    result = json.loads(text)
    return seconds, (result["reflectance"][0], result["transmittance"][0])


def run_mcml(program, medium, grid, photons, folder):
    layers = "\n".join("{} {} {} {} {}".format(*layer) for layer in medium["layers"])
    step, depths, rings = grid["step_cm"], int(grid["depth_bins"]), grid["radial_bins"]
    (folder / "input.mci").write_text(
        f"1.0\n1\noutput.mco A\n{photons}\n{step} {step}\n{depths} {rings} 1\n{len(medium['layers'])}\n1.0\n{layers}\n1.0\n")
    _, seconds = timed([program, "input.mci"], folder)
    found = {}
    for line in (folder / "output.mco").read_text().splitlines():
        value, _, name = line.partition("#")
        for key in ["Diffuse reflectance", "Transmittance"]:
            if name.startswith(key):
                found[key] = float(value)
    return seconds, (found["Diffuse reflectance"], found["Transmittance"])


def mean_and_error(values):
    return statistics.mean(values), statistics.stdev(values) / len(values) ** 0.5


def compare(options, program, medium, grid, folder):
    """Prints the row of a medium. Returns whether the programs agree."""
    photons = medium["photons"]
    ours, theirs = [], []
    for run in range(options.runs):
        base_ours = run_ours(program, medium, FEW, run, folder)[0]
        base_mcml = run_mcml(options.mcml, medium, grid, FEW, folder)[0]
        for results, base, (seconds, shares) in [
                (ours, base_ours, run_ours(program, medium, photons, run, folder)),
                (theirs, base_mcml, run_mcml(options.mcml, medium, grid, photons, folder))]:
            results.append(((photons - FEW) / max(seconds - base, 1e-9), shares))

    def speed(results):
        rates = sorted(rate / 1e3 for rate, _ in results)
        return statistics.median(rates), f"{statistics.median(rates):.0f} ({rates[0]:.0f} to {rates[-1]:.0f})"
    (our_rate, our_text), (their_rate, their_text) = speed(ours), speed(theirs)
    agree = True
    differences = []
    for place, name in enumerate(["R", "T"]):
        (a, a_error), (b, b_error) = (mean_and_error([shares[place] for _, shares in r]) for r in (ours, theirs))
        error = (a_error ** 2 + b_error ** 2) ** 0.5
        agree &= abs(a - b) <= 4 * error + 1e-6
        differences.append(f"{name} {a:.5f}, {b:.5f} ± {error:.5f}")
    print(f"| {medium['name']} | {our_text} | {their_text} | {our_rate / their_rate:.2f} | {'; '.join(differences)} |", flush=True)
    return agree


def main():
    options = arguments()
    program = our_program(options)
    described = json.loads(subprocess.run([program, "media"], check=True, stdout=subprocess.PIPE, text=True).stdout)
    print("| medium | thousand photons per second and core, here | MCML | ratio | shares here, MCML, error of the difference |")
    print("|---|---|---|---|---|", flush=True)
    agree = True
    with tempfile.TemporaryDirectory() as folder:
        for medium in described["media"]:
            if not options.medium or medium["name"] in options.medium:
                agree &= compare(options, program, medium, described["grid"], pathlib.Path(folder))
    if not agree:
        sys.exit("the programs disagree by more than four standard errors")


if __name__ == "__main__":
    main()
