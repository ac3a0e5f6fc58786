#!/usr/bin/env python3
"""Write the generic lights, filters and sensors that ship with Fluorspar: families of models, no measurements.

    write_generic_optics.py [--check]

A family is one equation whose parameters follow from the name (a peak, an edge). Names that a fitted file has already are
left alone. --check compares the files with what would be written, and writes nothing.
"""

import argparse
import sys
from pathlib import Path

DATA = Path(__file__).resolve().parent.parent / "crates" / "fluorspar-experiment" / "data"
FITTED = {"lights": {365, 385, 405, 415, 425, 450}, "long_pass": {475, 500, 520}, "short_pass": {425, 450, 475}}

# Width of LEDs at half maximum, nm, by peak: round numbers within what data sheets of chips of each material state
# (AlGaN below 365 nm, InGaN above: 9 to 10 nm in the near ultraviolet, 30 nm at 500 nm).
LED_WIDTHS = [(340, 10.0), (365, 10.0), (385, 11.5), (405, 14.0), (425, 16.0), (450, 20.0), (470, 24.0), (500, 30.0)]


def between(table, x):
    for (x0, y0), (x1, y1) in zip(table, table[1:]):
        if x <= x1:
            return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    return table[-1][1]


def heading(name, title, description, quantity, assumed, more=""):
    return (
        f"# {title}. {description}\n"
        f'name = "{name}"\ntitle = "{title}"\ndescription = "{description}"\nsource = "Own model, round numbers."\n'
        f'quantity = "{quantity}"\nvalid_nm = [300.0, 900.0]\nassumed = {assumed}\n{more}\n'
    )


def lights():
    for peak in range(340, 501, 5):
        if peak in FITTED["lights"]:
            continue
        width = round(between(LED_WIDTHS, peak), 1)
        # The long side is wider, and carriers that are not yet cooled down give an exponential tail.
        short, long = round(0.88 * width, 1), round(1.12 * width, 1)
        name = f"led_{peak}"
        text = heading(
            name,
            f"{peak} nm LED, generic",
            f"A generic LED of {width} nm at half maximum, bare. Round numbers for design studies; measure your own part.",
            "relative_spectral_power",
            '["curve"]',
        )
        text += f'[curve]\ntype = "led"\npeak_nm = {peak}.0\nfwhm_short_nm = {short}\nfwhm_long_nm = {long}\nshape = 1.9\n'
        for side, level, decay in [("short", 0.05, 6.0), ("long", 0.03, 18.0), ("long", 1e-4, 80.0)]:
            text += f'\n[[curve.tails]]\nside = "{side}"\nlevel = {level:g}\ndecay_nm = {decay}\n'
        yield f"lights/{name}.toml", text.replace("= 0.0001", "= 1e-4")


def edge(kind, cut, width):
    return f'\n[[curve.edges]]\npass = "{kind}"\ncut_nm = {cut:.1f}\nwidth_nm = {width:.1f}\n'


def filters():
    index = "effective_index = 1.8\n"
    curve = '[curve]\ntype = "edges"\npeak = 0.95\noptical_density = {density}\n'
    assumed = '["curve", "effective_index"]'
    for cut in [*range(400, 561, 10), *range(580, 681, 20)]:
        if cut in FITTED["long_pass"]:
            continue
        name = f"long_pass_{cut}"
        text = heading(
            name,
            f"Long-pass {cut} nm, generic",
            "Interference long-pass, half its peak at the wavelength of its name.",
            "transmittance",
            assumed,
            index,
        )
        text += curve.format(density="5.0") + edge("long", cut, 8.0)
        yield f"filters/{name}.toml", text
    # 655 nm parts porphyrin from plant pigment
    for cut in [*range(370, 541, 10), 655]:
        if cut in FITTED["short_pass"]:
            continue
        name = f"short_pass_{cut}"
        text = heading(
            name,
            f"Short-pass {cut} nm, generic",
            "Interference short-pass for a light, half its peak at the wavelength of its name.",
            "transmittance",
            assumed,
            index,
        )
        text += curve.format(density="4.0") + edge("short", cut, 6.0)
        yield f"filters/{name}.toml", text
    # Bands that fluorescence imagers of the mouth use, and common ones for NADH, flavins and porphyrin.
    bands = [(440, 40), (470, 20), (470, 40), (505, 20), (525, 20), (525, 45), (550, 20), (595, 20), (615, 20), (632, 22), (695, 30)]
    for center, width in bands:
        name = f"band_pass_{center}_{width}"
        text = heading(
            name,
            f"Band-pass {center} nm, {width} nm wide, generic",
            "Interference band-pass with steep edges, half its peak at both ends of its width.",
            "transmittance",
            assumed,
            "effective_index = 1.9\n",
        )
        low, high = center - width / 2, center + width / 2
        text += curve.format(density="5.0") + edge("long", low, 5.0) + edge("short", high, 5.0)
        yield f"filters/{name}.toml", text
    for cut in (450, 500, 550):
        name = f"absorbing_long_pass_{cut}"
        text = heading(
            name,
            f"Absorbing long-pass {cut} nm, generic",
            "Colored glass or plastic as in spectacles: a softer edge that does not move with the angle.",
            "transmittance",
            '["curve"]',
        )
        text += '[curve]\ntype = "edges"\npeak = 0.9\noptical_density = 4.0\n' + edge("long", cut, 20.0)
        yield f"filters/{name}.toml", text


def sensor(name, title, description, mosaic, pixels, channels):
    rows = ", ".join("[" + ", ".join(f'"{c}"' for c in row) + "]" for row in mosaic)
    text = (
        f"# {title}. {description}\n"
        f'format = 1\nname = "{name}"\ntitle = "{title}"\ndescription = "{description}"\nsource = "Round numbers."\n'
        f'assumed = ["every field"]\n\n[sensor]\ncolumns = {pixels[0]}\nrows = {pixels[1]}\nmosaic = [{rows}]\n'
        "pixel_size_um = 5.5\n\n[sensor.emva1288]\ngain_dn_per_e = 0.25\ndark_noise_e = 13.0\nsaturation_capacity_e = 13000.0\n"
        "bit_depth = 12\nblack_level_dn = 80.0\ndark_current_e_per_s = 125.0\ndsnu_e = 10.0\nprnu_percent = 1.0\n\n"
        "[sensor.quantum_efficiency]\n"
    )
    for channel, (peak, width, weight) in channels.items():
        band = f"peak_nm = {peak:.1f}, fwhm_short_nm = {width:.1f}, fwhm_long_nm = {width:.1f}, weight = {weight:.2f}"
        text += f'{channel} = {{ type = "bands", base = 0.0, bands = [{{ {band} }}] }}\n'
    return f"sensors/{name}.toml", text


def efficiency(nm):
    """Peak of a band of a silicon sensor behind an interference filter: that of `multispectral_3x3`."""
    return between([(420, 0.30), (450, 0.35), (510, 0.45), (570, 0.45), (690, 0.28), (750, 0.22)], nm)


def sensors():
    eight = [450, 480, 510, 540, 580, 620, 640, 690]
    cells = [eight[:4], eight[4:]]
    channels = {str(nm): (nm, 25.0, efficiency(nm)) for nm in eight}
    yield sensor(
        "multispectral_8_band",
        "Multispectral CMOS, eight bands of 25 nm",
        "Eight interference bands on a cell of 4 x 2 pixels, chosen for NADH, flavins and porphyrin. Bell-shaped, leak nothing.",
        [[str(nm) for nm in row] for row in cells],
        (1024, 1024),
        channels,
    )
    sixteen = list(range(430, 731, 20))
    channels = {str(nm): (nm, 16.0, efficiency(nm)) for nm in sixteen}
    yield sensor(
        "multispectral_16_band",
        "Multispectral CMOS, sixteen bands of 16 nm",
        "Sixteen interference bands from 430 to 730 nm on a cell of 4 x 4 pixels. Bell-shaped, leak nothing; real ones have side lobes.",
        [[str(nm) for nm in sixteen[4 * row : 4 * row + 4]] for row in range(4)],
        (1024, 1024),
        channels,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare only")
    check = parser.parse_args().check
    different = 0
    for name, text in [*lights(), *filters(), *sensors()]:
        path = DATA / name
        if check:
            different += not path.exists() or path.read_text(encoding="utf-8") != text
        else:
            path.write_text(text, encoding="utf-8")
    if different:
        sys.exit(f"{different} files differ from what {Path(__file__).name} writes")


if __name__ == "__main__":
    main()
