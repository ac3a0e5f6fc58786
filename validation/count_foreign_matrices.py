#!/usr/bin/env python3
"""Count how many excitation-emission matrices in folders of other people become a dye.

    count_foreign_matrices.py [--list] FLUORSPAR FOLDER...

Every matrix is imported by the program FLUORSPAR: by `fluorophore import --yield-unit photons`, and by the command that a refusal
prints, to the end. The file is read a second time here: a row of excitation wavelengths above rows of an emission wavelength and
values, or pairs of columns below names that end in the excitation. It is right where the dye's largest value lies where the
matrix has four fifths of its largest off the lines of scattered light (30 nm about orders 1 to 3 and the Raman line of water, and
whatever the program says that it cut, if that is less), and above its excitation. Blanks, which hold no more than that light, are told by
their names (`BEM`, `blank`, `nano`) and counted apart: for them a refusal is as right as a dye.
"""

import re
import shlex
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

SKIPPED = {".r", ".py", ".md", ".qmd", ".rd", ".yml", ".yaml", ".nix", ".lock", ".toml", ".xlsx", ".rdata", ".bib"}
OFF_NM = 30.0
WATER_RAMAN_PER_CM = 3400.0


def number(cell):
    try:
        return float(cell.strip().strip('"'))
    except ValueError:
        return None


def cells_of(line):
    mark = "\t" if "\t" in line else ";" if ";" in line else ","
    return [cell.strip() for cell in line.rstrip("\r\n").split(mark)]


def pairs(lines):
    """Samples of a file of pairs of columns: {name: {(excitation, emission): value}}."""
    names = cells_of(lines[0])
    columns = [(place, re.fullmatch(r"(.*?)_?EX_([\d.]+).*", name)) for place, name in enumerate(names)]
    columns = [(place, found.group(1), float(found.group(2))) for place, found in columns if found]
    samples = {}
    for line in lines[2:]:
        cells = [number(cell) for cell in cells_of(line)]
        for place, name, excitation in columns:
            if place + 1 < len(cells) and None not in (cells[place], cells[place + 1]):
                samples.setdefault(name, {})[excitation, cells[place]] = cells[place + 1]
    return samples if len(columns) > 2 else {}


def matrix(lines):
    """The one matrix of a file: rows of numbers, below one that names their columns."""
    found, header = {}, None
    for line in lines:
        cells = [number(cell) for cell in cells_of(line)]
        if len(cells) < 8:
            continue
        values = [cell for cell in cells[1:] if cell is not None]
        rises = all(a < b for a, b in zip(values, values[1:])) or all(a > b for a, b in zip(values, values[1:]))
        if header is None:
            if len(values) > 6 and rises and all(150 <= nm <= 1200 for nm in values):
                header = cells[1:]
        elif cells[0] is not None:
            for excitation, value in zip(header, cells[1:]):
                if excitation is not None and value is not None:
                    found[excitation, cells[0]] = value
    return {"": found} if len(found) > 100 else {}


def peak(samples, is_off):
    return max((value for (ex, em), value in samples.items() if is_off(ex, em)), default=0.0)


def off_lines(nm):
    def is_off(excitation, emission):
        raman = 1e7 / (1e7 / excitation - WATER_RAMAN_PER_CM)
        return emission > excitation and all(abs(emission - line) > nm for line in (excitation, 2 * excitation, 3 * excitation, raman))

    return is_off


def imported(program, path, sample, folder):
    """Excitation and emission of the dye's largest value, or None and what the program says."""
    command = [program, "fluorophore", "import", str(path), "--yield-unit", "photons", "--out", "dye.toml"]
    command += ["--sample", sample] if sample else []
    for _ in range(3):
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        said = done.stdout + done.stderr
        at = re.search(r"peak\s+excitation ([\d.]+) nm, emission ([\d.]+)", said)
        if done.returncode == 0:
            return (float(at.group(1)), float(at.group(2))) if at else None, said
        printed = re.search(r"run: `(fluorspar .*?)`", said)
        if not printed:
            return None, said
        command = [program, *shlex.split(printed.group(1))[1:]]
    return None, said


def verdict(program, path):
    data = path.read_bytes()
    text = data.decode("utf-8-sig", errors="replace")
    lines = [line for line in re.split(r"\r\n|\n|\r", text) if line.strip()]
    samples = (pairs(lines) or matrix(lines)) if lines else {}
    for name, values in samples.items():
        axes = ({ex for ex, _ in values}, {em for _, em in values})
        if min(map(len, axes)) < 5:
            continue
        with tempfile.TemporaryDirectory() as folder:
            place, said = imported(program, path.resolve(), name if len(samples) > 1 else "", folder)
        is_blank = re.search(r"BEM|blank|nano", f"{path.name} {name}", re.I)
        if place is None:
            yield ("blank refused" if is_blank else "refused"), name, said
            continue
        cut = re.search(r"--cut-scatter ([\d.]+)", said)
        is_off = off_lines(min(OFF_NM, float(cut.group(1))) if cut else OFF_NM)
        near = (min(axes[0], key=lambda nm: abs(nm - place[0])), min(axes[1], key=lambda nm: abs(nm - place[1])))
        value = values.get(near) or max((v for (ex, _), v in values.items() if ex == near[0]), default=0.0)
        is_right = value >= 0.8 * peak(values, is_off) and place[1] > place[0]
        yield ("right" if is_right else "blank wrong" if is_blank else "wrong"), name, said


def main():
    arguments = sys.argv[1:]
    listed = "--list" in arguments
    program, *folders = [argument for argument in arguments if argument != "--list"]
    count = Counter()
    for folder in folders:
        for path in sorted(p for p in Path(folder).rglob("*") if p.is_file() and p.suffix.lower() not in SKIPPED):
            for said, name, why in verdict(str(Path(program).resolve()), path):
                count[said] += 1
                if listed and said != "right":
                    print(f"{said}\t{path} {name}\t{' '.join(why.split())[-300:]}")
    print(", ".join(f"{count[key]} {key}" for key in sorted(count)), "of", sum(count.values()))


if __name__ == "__main__":
    main()
