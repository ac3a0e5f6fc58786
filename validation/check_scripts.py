#!/usr/bin/env python3
"""Check the Python scripts of the repository.

    check_scripts.py VALUES

Every script must compile. Those that fit the catalogue repeat equations of the library: VALUES, what
`cargo run -p fluorspar-experiment --example catalogue_values` prints, is compared with what they make of the same files.
That comparison needs numpy and scipy and is skipped without them, with a line that says so.
"""

import importlib.util
import json
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "crates" / "fluorspar-experiment" / "data"

# The library evaluates the same equations in double precision at the same wavelengths.
CURVE_TOLERANCE = 1e-9
# The library keeps fluorophores as samples 0.5 nm apart, normalized by the integral over those. A band of the width w is
# off by (0.5 / w)^2 ln 2 at most; the narrowest has 12 nm.
EEM_TOLERANCE = 2e-3


def compile_all():
    scripts = sorted(p for p in ROOT.rglob("*.py") if "target" not in p.relative_to(ROOT).parts)
    for script in scripts:
        compile(script.read_text(encoding="utf-8"), str(script), "exec")
    print(f"{len(scripts)} scripts compile")


def load(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "validation" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compare(values):
    import numpy as np

    optical, fluorophores = load("fit_optical_data"), load("fit_fluorophores")
    nm = np.array(values["wavelength_nm"])
    worst = {"curves": 0.0, "fluorophores": 0.0}
    skipped = []
    for key, expected in values["curves"].items():
        folder, name, *channel = key.split("/")
        model = tomllib.loads((DATA / folder / f"{name}.toml").read_text(encoding="utf-8"))["curve"]
        model = model[channel[0]] if channel else model
        if model["type"] == "table":
            skipped.append(key)
            continue
        error = np.abs(optical.evaluate(model, nm) - expected).max()
        worst["curves"] = max(worst["curves"], error)
        if not error <= CURVE_TOLERANCE * max(1.0, np.abs(expected).max()):
            raise SystemExit(f"{key}: fit_optical_data.py and the library differ by {error:.3g}")
    for name, expected in values["fluorophores"].items():
        entry, terms = fluorophores.from_toml(DATA / "fluorophores" / f"{name}.toml")
        expected = np.array(expected)
        error = np.abs(fluorophores.absolute(entry, terms)(nm, nm) - expected).max() / expected.max()
        worst["fluorophores"] = max(worst["fluorophores"], error)
        if not error <= EEM_TOLERANCE:
            raise SystemExit(f"{name}: fit_fluorophores.py and the library differ by {error:.3g} of the peak")
    for kind, error in worst.items():
        print(f"{len(values[kind])} {kind} agree with the library, worst {error:.2g}")
    if skipped:
        print(f"not compared, tables have no equation: {', '.join(skipped)}")


def main():
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    values = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    compile_all()
    missing = [name for name in ("numpy", "scipy") if importlib.util.find_spec(name) is None]
    if missing:
        print(f"skipped: equations of the scripts against the library, for want of {' and '.join(missing)}")
    else:
        compare(values)


if __name__ == "__main__":
    main()
