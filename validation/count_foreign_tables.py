#!/usr/bin/env python3
"""Count how many measured spectra and filter tables in folders of other people are read right.

    count_foreign_tables.py [--list] FLUORSPAR FOLDER...

Every text file is shown by the program FLUORSPAR, as a filter where its words speak of transmission, reflection or absorbance,
as a light where they speak of irradiance or a response, else as one that takes it, and read a second time here: the longest run of lines of numbers, the first rising or falling column of them
that may hold wavelengths, and each other column. A file is right where the program's curve is that of one of these columns, in the
unit that the file names (percent, optical density, photons, micrometers), to 1 % of the largest value in the median of all wavelengths,
and to 3 % in nine of ten; the program tells which column it took.
Files without such lines, without five of them between 300 and 900 nm, and those of refractive indices, do not count. --list prints the files that are not read right, with what the program says.
"""

import json
import re
import statistics
import subprocess
import sys
from collections import Counter
from pathlib import Path

LEAST_LINES = 8
SKIPPED = {".r", ".py", ".md", ".rd", ".rmd", ".html", ".svg", ".yml", ".yaml", ".png", ".pdf", ".gif", ".json", ".toml", ".xlsx", ".zip", ".rda"}
WAYS = [("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", "."), (None, "."), (None, ",")]


def number(cell, decimal):
    text = cell.strip().strip('"')
    if decimal == ",":
        text = text.replace(",", ".")
    try:
        value = float(text)
    except ValueError:
        return float("nan") if text.lower() in ("", "na", "nan") else None
    return value


def longest_run(lines, mark, decimal):
    best, run = [], []
    for line in lines:
        cells = [number(cell, decimal) for cell in line.strip().rstrip(";,\t").split(mark)]
        good = len(cells) > 1 and None not in cells and cells[0] == cells[0]
        run = run + [cells] if good and (not run or len(run[0]) == len(cells)) else [cells] if good else []
        best = run if len(run) > len(best) else best
    return best


def table(text):
    lines = [line for line in re.split(r"\r\n|\n|\r", text) if line.strip() and not line.startswith("#")]
    runs = [longest_run(lines, *way) for way in WAYS]
    best = max(runs, key=len)
    return best if len(best) >= LEAST_LINES else None


def columns(rows, scale):
    """Wavelengths, nm, and every other column."""
    for place in range(len(rows[0])):
        nm = [scale * row[place] for row in rows]
        steps = [b - a for a, b in zip(nm, nm[1:])]
        ordered = sum(step > 0 for step in steps) > 0.9 * len(steps) or sum(step < 0 for step in steps) > 0.9 * len(steps)
        if ordered and all(100 <= value <= 20000 for value in nm):
            others = [[row[other] for row in rows] for other in range(len(rows[0])) if other != place]
            # Bands side by side: the next column begins each where the one before ended
            ends = [row[place + 1] * scale for row in rows] if place + 1 < len(rows[0]) else []
            if ends and all(abs(end - begin) <= 1e-9 * end for end, begin in zip(ends, nm[1:])):
                nm = [0.5 * (begin + end) for begin, end in zip(nm, ends)]
            return nm, others
    return None


def at(nm, samples):
    """Straight lines between samples; none beyond them."""
    for (x0, y0), (x1, y1) in zip(samples, samples[1:]):
        if x0 <= nm <= x1:
            return y0 if x1 == x0 else y0 + (y1 - y0) * (nm - x0) / (x1 - x0)
    return None


def conversions(words, is_filter):
    """What the values may mean by the words of the file."""
    if re.search(r"absorban|\bOD\b", words) and is_filter:
        return [lambda nm, value: 10.0**-value]
    if is_filter and ("%" in words or re.search("percent", words, re.I)):
        return [lambda nm, value: 0.01 * value]
    if is_filter:
        return [lambda nm, value: value, lambda nm, value: 0.01 * value]
    if re.search(r"mol|photon|quanta|QNTM|counts|scope", words, re.I):
        return [lambda nm, value: value / nm, lambda nm, value: value]
    return [lambda nm, value: value]


def agrees(found_nm, found, nm, values, convert, is_filter):
    samples = sorted((x, convert(x, y)) for x, y in zip(nm, values) if y == y)
    pairs = [(y, at(x, samples)) for x, y in zip(found_nm, found)]
    pairs = [(mine, max(theirs, 0.0)) for mine, theirs in pairs if theirs is not None]
    if is_filter:
        pairs = [(mine, min(theirs, 1.0)) for mine, theirs in pairs]
    largest = max((theirs for _, theirs in pairs), default=0.0)
    if largest <= 0.0 or len(pairs) < 5:
        return False
    off = sorted(abs(mine - theirs) / largest for mine, theirs in pairs)
    return statistics.median(off) <= 0.01 and off[int(0.9 * (len(off) - 1))] <= 0.03


def verdict(program, path):
    data = path.read_bytes()
    text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig", errors="replace")
    rows = table(text)
    words = re.sub(r"(?i)humid.*", "", text[:6000]) + str(path)
    scale = 1000.0 if re.search(r"micromet|µm|\bum\b", words) else 1.0
    own = rows and columns(rows, scale)
    is_refractive_index = re.search(r"refractive|\b(wl|nm|um)\W+n\W+k\b|-n-k-", words, re.I)
    in_view = own and sum(300 <= nm <= 900 for nm in own[0]) > 5
    if not in_view or len(rows) == len(rows[0]) or is_refractive_index:
        return None, ""
    named = re.search(r"transmi|reflec|absorb|filter|_?tfr|rfr|Reference Spectrum Present: Yes", words, re.I)
    is_light = re.search(r"irrad|response", words, re.I)
    kinds = ["light"] if is_light else ["filter"] if named else ["light", "filter"]
    for kind in kinds:
        answer = subprocess.run([program, "catalog", "show", kind, str(path), "--json"], capture_output=True, text=True, check=False)
        if answer.returncode == 0:
            break
    else:
        return "refused", answer.stderr.strip()
    is_filter = kind == "filter"
    shown = json.loads(answer.stdout)
    curve = shown["curves"][0]
    has_data = [curve["data_from_nm"] <= nm <= curve["data_to_nm"] for nm in shown["wavelength_nm"]]
    found_nm, found = ([x for x, has in zip(xs, has_data) if has] for xs in (shown["wavelength_nm"], curve["value"]))
    nm, others = own
    for values in others:
        if any(agrees(found_nm, found, nm, values, convert, is_filter) for convert in conversions(words, is_filter)):
            return "right", ""
    return "wrong", answer.stderr.strip()


def main():
    arguments = sys.argv[1:]
    listed = "--list" in arguments
    program, *folders = [argument for argument in arguments if argument != "--list"]
    count = Counter()
    for folder in folders:
        for path in sorted(p for p in Path(folder).rglob("*") if p.is_file() and p.suffix.lower() not in SKIPPED):
            said, why = verdict(program, path)
            if said:
                count[said] += 1
                if listed and said != "right":
                    print(f"{said}\t{path}\t{why[-200:]}")
    print(f"{count['right']} right, {count['wrong']} wrong, {count['refused']} refused of {sum(count.values())}")


if __name__ == "__main__":
    main()
