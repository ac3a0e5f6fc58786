#!/usr/bin/env python3
"""What a day with Fluorspar takes, command by command: from the first run to a report of what was changed.

    benchmarks/measure_day.py [--runs 3] [--experiment oraleye-2021] [--binary target/release/fluorspar] [--quick]

Each run starts with an empty cache and an empty folder. Printed are medians, as rows of a table of docs/performance.md: elapsed and
CPU seconds, and the most memory of each command. `--quick` hands `--quick` to the runs.

Needs Python 3.9 or newer and a Unix system.
"""
import argparse
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="days, 1 or more (default 3)")
    parser.add_argument("--experiment", default="oraleye-2021", help="an experiment with the captures and lights of oraleye-2021")
    parser.add_argument("--binary", help="fluorspar, if it is built already")
    parser.add_argument("--quick", action="store_true", help="runs of fewer pixels and samples")
    return parser.parse_args()


def our_program(options):
    if options.binary:
        return os.path.abspath(options.binary)
    subprocess.run(["cargo", "build", "--release", "-p", "fluorspar-cli"], cwd=ROOT, check=True)
    return str(pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "fluorspar")


def day(options):
    """Names of the commands with what is typed."""
    run = ["run", options.experiment] + ["--quick"] * options.quick
    capture = ["capture", "run/components.exr"]
    return [
        ("first run, empty cache", run + ["--out=run"]),
        ("the same run again", run + ["--out=again"]),
        ("another exposure", capture + ["--set=capture.blue.exposure_ms=15", "--out=exposure"]),
        ("another viewing filter", capture + ['--set=view_filter.filters=["view_425_700"]', "--out=filter"]),
        ("its report", ["analyze", "filter", "--component-image=run/components.exr", "--out=filter-report"]),
        ("another LED", run + ['--set=light.blue.spectrum="led_405"', "--out=led"]),
        ("both compared", ["compare", "run", "led", "--out=compared"]),
        ("`check` of the experiment", ["check", options.experiment]),
        ("`design optimize two-lights-tissue`", ["design", "optimize", "two-lights-tissue", "--out=design"]),
        ("`mouth generate`, a mouth of its own", ["mouth", "generate", "--person=7", "--out=mouth.glb"]),
        ("`mouth view`, thirteen views", ["mouth", "view", "--person=7"]),
    ]


def timed(command, folder, cache):
    """Elapsed seconds, CPU seconds and MiB of a command."""
    with open(folder / "said.txt", "w+") as said:
        started = time.monotonic()
        child = subprocess.Popen(
            command, cwd=folder, stdout=said, stderr=said, env={**os.environ, "XDG_CACHE_HOME": str(cache)}
        )
        _, status, used = os.wait4(child.pid, 0)
        elapsed = time.monotonic() - started
        if status != 0:
            said.seek(0)
            sys.exit(f"{' '.join(command)} failed:\n{said.read()}")
    mib = used.ru_maxrss / (1 << 20 if sys.platform == "darwin" else 1 << 10)
    return elapsed, used.ru_utime + used.ru_stime, mib


def main():
    options = arguments()
    program = our_program(options)
    measured = {name: [] for name, _ in day(options)}
    for _ in range(options.runs):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            for name, typed in day(options):
                measured[name].append(timed([program] + typed, folder, folder / "cache"))
    print("| command | elapsed s | CPU s | memory MiB |\n|---|---|---|---|")
    for name, times in measured.items():
        elapsed, cpu, mib = (statistics.median(values) for values in zip(*times))
        print(f"| {name} | {elapsed:.2f} | {cpu:.2f} | {mib:.0f} |")


if __name__ == "__main__":
    main()
