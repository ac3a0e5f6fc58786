#!/usr/bin/env python3
"""Fit the analytic optical data that ship with Fluorspar: lights, filters, reflectances, quantum efficiencies.

    fit_optical_data.py REFERENCE [--write] [--plots FOLDER]

REFERENCE is a folder of measured spectra as CSV (first column wavelength_nm, then values). It is read and never
copied: what is written are the parameters of equations. Without --write the script only fits, prints the errors
and the leak of the default filter pairs; with --write it replaces the TOML files under
crates/fluorspar-experiment/data. Everything that is not fitted is typed in below, with its source.

Needs numpy and scipy; matplotlib for --plots.
"""

import argparse
import re
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "crates" / "fluorspar-experiment" / "data"
HEMOGLOBIN = ROOT / "crates" / "fluorspar" / "src" / "spectral" / "hemoglobin.rs"
LN2 = np.log(2.0)
GRID = np.arange(350.0, 750.5, 0.5)


# ---------------------------------------------------------------- the equations (curve_model.rs has the same)


def read_hemoglobin():
    text = HEMOGLOBIN.read_text().split("MOLAR_EXTINCTION: ")[1].split("];\n")[0]
    rows = re.findall(r"\[([\d_.]+), ([\d_.]+), ([\d_.]+)\]", text)
    return np.array([[float(v.replace("_", "")) for v in row] for row in rows])


HB = read_hemoglobin()


def bell(x, fwhm, exponent=2.0):
    return np.exp(-LN2 * np.abs(2.0 * x / fwhm) ** exponent)


def logistic(x, width):
    return 1.0 / (1.0 + np.exp(-np.clip(x * 2.0 * np.log(9.0) / width, -500, 500)))


def blood_diffuse(c, nm):
    hb_g = c.get("hemoglobin_g_per_l", 150.0)
    n = c.get("refractive_index", 1.4)
    oxy, deoxy = np.interp(nm, HB[:, 0], HB[:, 1]), np.interp(nm, HB[:, 0], HB[:, 2])
    s = c["saturation"]
    blood = np.log(10.0) * hb_g / 64500.0 * (s * oxy + (1 - s) * deoxy)

    def packaging(radius_um):
        depth = 2.0 * blood * max(radius_um, 1e-9) * 1e-4
        return -np.expm1(-depth) / depth

    mua = c["background_per_cm"] * np.exp(-(nm - 500.0) / c["background_decay_nm"])
    mua = mua + c["blood_fraction"] * blood * packaging(c["vessel_radius_um"])
    mus = c["scattering_per_cm"] * (nm / 500.0) ** -c["scattering_power"]
    albedo = mus / (mus + mua)
    inside = -1.440 / n**2 + 0.710 / n + 0.668 + 0.0636 * n
    k = (1 + inside) / (1 - inside)
    lost = 1 - albedo
    deep = albedo / (1 + 2 * k * lost + (1 + 2 * k / 3) * np.sqrt(3 * lost))
    superficial = 4 * blood * packaging(4.0) * c.get("superficial_blood_um", 0.0) * 1e-4
    melanin = c.get("melanin_depth", 0.0) * (nm / 500.0) ** -3.5
    return deep * np.exp(-superficial - melanin)


def evaluate(c, nm):
    nm = np.asarray(nm, float)
    kind = c["type"]
    if kind == "constant":
        return np.full(nm.shape, c["value"])
    if kind == "led":
        x = nm - c["peak_nm"]
        core = bell(x, np.where(x < 0, c["fwhm_short_nm"], c["fwhm_long_nm"]), c.get("shape", 2.0))
        tail = np.zeros(nm.shape)
        for t in c.get("tails", []):
            on = x < 0 if t["side"] == "short" else x >= 0
            tail += np.where(on, t["level"] * np.exp(-np.abs(x) / t["decay_nm"]), 0.0)
        return core + (1 - core) * tail
    if kind == "bands":
        total = np.full(nm.shape, c.get("base", 0.0))
        for b in c["bands"]:
            x = nm - b["peak_nm"]
            total += b["weight"] * bell(x, np.where(x < 0, b["fwhm_short_nm"], b["fwhm_long_nm"]))
        return total
    if kind == "edges":
        floor = 10.0 ** -c["optical_density"]
        passed = np.ones(nm.shape)
        for e in c.get("edges", []):
            x = nm - e["cut_nm"]
            passed *= logistic(x if e["pass"] == "long" else -x, e["width_nm"])
        for m in c.get("notches", []):
            passed *= 1 - bell(nm - m["center_nm"], m["fwhm_nm"], 6.0)
        return floor + (c["peak"] - floor) * passed
    if kind == "sigmoids":
        total = np.full(nm.shape, c["base"])
        for s in c["steps"]:
            total += s["height"] * logistic(nm - s["center_nm"], s["width_nm"])
        return np.maximum(total, 0.0)
    if kind == "blackbody":
        c2 = 1.438776877e7 / c["temperature_k"]
        r = c["reference_nm"]
        return (r / nm) ** 5 * np.expm1(c2 / r) / np.expm1(c2 / nm)
    if kind == "blood_diffuse":
        return blood_diffuse(c, nm)
    raise ValueError(kind)


# ---------------------------------------------------------------- small constructors


def rounded(c, digits=4):
    """The same curve with every number rounded, so that what is written is what was judged."""
    if isinstance(c, dict):
        return {k: rounded(v, digits) for k, v in c.items()}
    if isinstance(c, list):
        return [rounded(v, digits) for v in c]
    return float(f"{c:.{digits}g}") if isinstance(c, (float, np.floating)) else c


def led(peak, short, long, shape=2.0, tails=()):
    tails = [{"side": s, "level": float(v), "decay_nm": float(d)} for s, v, d in tails]
    return {
        "type": "led",
        "peak_nm": float(peak),
        "fwhm_short_nm": float(short),
        "fwhm_long_nm": float(long),
        "shape": float(shape),
        "tails": tails,
    }


def bands(*rows, base=0.0):
    keys = ("peak_nm", "fwhm_short_nm", "fwhm_long_nm", "weight")
    return {"type": "bands", "base": float(base), "bands": [dict(zip(keys, map(float, r))) for r in rows]}


def edges(peak, optical_density, *rows, notches=()):
    c = {"type": "edges", "peak": float(peak), "optical_density": float(optical_density)}
    c["edges"] = [{"pass": p, "cut_nm": float(cut), "width_nm": float(w)} for p, cut, w in rows]
    if notches:
        c["notches"] = [{"center_nm": float(m), "fwhm_nm": float(w)} for m, w in notches]
    return c


def sigmoids(base, *rows):
    keys = ("center_nm", "width_nm", "height")
    return {"type": "sigmoids", "base": float(base), "steps": [dict(zip(keys, map(float, r))) for r in rows]}


TISSUE_KEYS = (
    "background_per_cm",
    "background_decay_nm",
    "blood_fraction",
    "saturation",
    "vessel_radius_um",
    "superficial_blood_um",
)


def tissue(values, scattering_per_cm=22.46, scattering_power=1.205, melanin_depth=0.0):
    c = {
        "type": "blood_diffuse",
        "scattering_per_cm": scattering_per_cm,
        "scattering_power": scattering_power,
    }
    c.update({k: float(v) for k, v in zip(TISSUE_KEYS, values)})
    c.update(hemoglobin_g_per_l=150.0, refractive_index=1.4, melanin_depth=melanin_depth)
    return c


# ---------------------------------------------------------------- fits


class Reference:
    def __init__(self, folder):
        self.folder = Path(folder)

    def read(self, name, columns=None):
        """Wavelengths and the mean of the named columns (all where none is named)."""
        path = self.folder / name
        with open(path, encoding="utf-8") as file:
            head = file.readline().strip().split(",")
        rows = np.genfromtxt(path, delimiter=",", skip_header=1)
        take = range(1, len(head)) if columns is None else [head.index(c) for c in columns]
        return rows[:, 0], np.mean([rows[:, i] for i in take], axis=0)


class Fit:
    """A fitted curve, its error and the points it was judged at."""

    def __init__(self, reference, curve, nm, data, note, digits=4):
        self.reference, self.nm, self.data, self.note = reference, nm, data, note
        self.curve = rounded(curve, digits)
        self.residual = evaluate(self.curve, nm) - data
        self.rms = float(np.sqrt(np.mean(self.residual**2)))
        self.range_nm = [float(nm.min()), float(nm.max())]


def solve(residual, starts, low, high):
    best = None
    scale = np.maximum(np.abs(np.array(high) - np.array(low)) * 0.1, 1e-9)
    for start in starts:
        start = np.clip(start, np.array(low) + 1e-9, np.array(high) - 1e-9)
        got = least_squares(residual, start, bounds=(low, high), x_scale=scale, max_nfev=3000)
        if best is None or got.cost < best.cost:
            best = got
    return best.x


def fit_led(
    name, nm, data, peak, note, far=(1e-4, 80.0), long_decay=(8.0, 40.0), long_level=(0.0, 0.3), trust=1.0
):
    """LED with one tail per side; errors are weighted so that four decades count."""

    def curve(p):
        return led(p[0], p[1], p[2], p[3], [("short", p[4], p[5]), ("long", p[6], p[7]), ("long", *far)])

    def residual(p):
        scaled = data / p[8]
        return trust * (evaluate(curve(p), nm) - scaled) / (2e-4 + 0.03 * scaled**0.85)

    top = data.max()
    starts = [[peak, 14, 16, s, 0.05, 4, 0.05, 18, top] for s in (1.6, 2.0)]
    low = [peak - 3, 6, 6, 1.2, 0, 2, long_level[0], long_decay[0], 0.9 * top]
    high = [peak + 3, 30, 30, 3.0, 0.6, 12, long_level[1], long_decay[1], 1.2 * top]
    p = solve(residual, starts, low, high)
    return Fit(name, curve(p), nm, data / p[8], note)


def fit_led_385(ref):
    nm, y = ref.read("lights/oraleye_led385.csv")
    keep = (nm >= 380) & (nm <= 475)
    nm, y = nm[keep], y[keep]
    gnm, gy = ref.read("derived/led385_second_order_reconstruction.csv", ["second_order_over_0.133"])
    ghost = np.isfinite(gy) & (gnm < 380)
    both = np.concatenate([gnm[ghost], nm]), np.concatenate([gy[ghost], y])
    note = (
        "Measured values from 380 nm (end of the instrument) to 475 nm, joined below 380 nm to the short side that "
        "the second diffraction order of the same LED shows at twice its wavelength (730 to 760 nm); relative to "
        "the peak of the model. The rms is over the measured points; the inferred ones below 380 nm count a third and differ by up to 0.12 at 377.5 nm."
    )
    # the ghost is an inference: a third of the weight
    trust = np.where(both[0] < 380, 0.33, 1.0)
    fit = fit_led("lights/oraleye_led385.csv", both[0], both[1], 382.5, note, trust=trust)
    measured = fit.nm >= 380
    fit.rms = float(np.sqrt(np.mean(fit.residual[measured] ** 2)))
    fit.range_nm = [380.0, 475.0]
    return fit


def fit_edges(ref, name, low_nm, high_nm, optical_density, passes, starts, note):
    nm, y = ref.read(name)
    keep = (nm >= low_nm) & (nm <= high_nm)
    nm, y = nm[keep], y[keep]

    def curve(p):
        return edges(p[0], optical_density, *[(s, p[1 + 2 * i], p[2 + 2 * i]) for i, s in enumerate(passes)])

    start = [0.95] + [v for pair in starts for v in pair]
    low = [0.5] + [v for cut, _ in starts for v in (cut - 40, 1.0)]
    high = [1.0] + [v for cut, _ in starts for v in (cut + 40, 150.0)]
    p = solve(lambda p: evaluate(curve(p), nm) - y, [start], low, high)
    return Fit(name, curve(p), nm, y, note)


def fit_tissue(name, nm, y, note):
    keep = (nm >= 390) & (nm <= 740)
    grid = np.arange(390.0, 740.5, 5.0)
    y = np.interp(grid, nm[keep], y[keep])
    starts = [[1.0, d, 0.06, 0.85, r, 0.7] for d in (100.0, 250.0) for r in (25.0, 60.0)]
    p = solve(
        lambda p: evaluate(tissue(p), grid) - y, starts, [0.05, 40, 1e-3, 0.4, 2, 0], [5, 600, 0.4, 1, 120, 5]
    )
    return Fit(name, tissue(p), grid, y, note)


def fit_uv_ir(ref):
    """Three logistic steps: the infrared edge has a shoulder that one edge cannot follow."""
    name = "filters/hoya_uvir_digitised.csv"
    nm, y = ref.read(name)
    keep = nm <= 750
    nm, y = nm[keep], y[keep]

    def curve(p):
        first, second = np.round([p[2] * p[5], p[2] * (1 - p[5])], 3)
        return sigmoids(0.01, (p[0], p[1], first + second), (p[3], p[4], -first), (p[6], p[7], -second))

    start = [388, 8, 0.98, 686, 15, 0.7, 708, 20]
    low, high = [380, 2, 0.9, 675, 4, 0.3, 695, 5], [395, 30, 0.99, 695, 40, 1, 730, 60]

    def smooth(p):
        return sigmoids(
            0.01, (p[0], p[1], p[2]), (p[3], p[4], -p[2] * p[5]), (p[6], p[7], -p[2] * (1 - p[5]))
        )

    p = solve(lambda p: evaluate(smooth(p), nm) - y, [start], low, high)
    return Fit(name, curve(p), nm, y, "The data were digitized from a plot, +-1 nm and +-0.02.")


def fit_bands(name, nm, y, rows, note, anchors=(), ridge=2e-3):
    """Bands near the given ones (peak +-25 nm, widths within a factor of 2.2); anchors are assumed points that
    steer the fit outside the data and do not count in its error."""
    rows = np.array(rows, float)
    low = np.column_stack([rows[:, 0] - 25, rows[:, 1] / 2.2, rows[:, 2] / 2.2, rows[:, 3] * 0]).ravel()
    high = np.column_stack([rows[:, 0] + 25, rows[:, 1] * 2.2, rows[:, 2] * 2.2, rows[:, 3] * 0 + 1]).ravel()
    start = rows.ravel()
    pull = ridge / (high - low)
    fit_nm = np.concatenate([nm, [a[0] for a in anchors]])
    fit_y = np.concatenate([y, [a[1] for a in anchors]])

    def residual(p):
        return np.concatenate([evaluate(bands(*p.reshape(-1, 4)), fit_nm) - fit_y, pull * (p - start)])

    p = solve(residual, [start], low, high)
    return Fit(name, bands(*p.reshape(-1, 4)), nm, y, note)


# ---------------------------------------------------------------- the items

OWN = "Own model."
JACQUES = (
    "Equation: Flock et al. 1989 with the packaging correction of Verkruysse et al. 1997; hemoglobin: Prahl's "
    "compilation; scattering prior: Jacques, Phys. Med. Biol. 58:R37 (2013)."
)
WIDE = [350.0, 750.0]


class Item:
    def __init__(
        self,
        folder,
        name,
        title,
        description,
        source,
        quantity,
        curve,
        assumed=(),
        fit=None,
        extra=None,
        valid_nm=None,
    ):
        self.folder, self.name, self.title, self.description = folder, name, title, description
        self.source, self.quantity, self.assumed, self.extra = source, quantity, list(assumed), extra or {}
        self.valid_nm = valid_nm or WIDE
        self.fits = fit if isinstance(fit, dict) else {"": fit} if fit else {}
        self.curves = curve if "type" not in curve else {"": rounded(curve)}


def fitted(folder, name, title, description, source, quantity, fit, **more):
    return Item(folder, name, title, description, source, quantity, fit.curve, fit=fit, **more)


def lights(ref):
    q = "relative_spectral_power"
    far = "The far tail (the one with decay 80 nm) is assumed: LEDs of this kind keep a defect emission four to five decades down, below what the measurement could see."
    yield fitted(
        "lights",
        "led_385",
        "385 nm LED of the OralEye camera",
        "The excitation light of Lyu et al. 2021, bare, before any filter. Its true peak lies near 382 nm. The lobe that "
        "the measurement shows at 730 to 780 nm is its own second diffraction order in the spectroradiometer (twice the "
        "peak wavelength, the same shape) and is left out: this LED has no near-infrared emission here.",
        "Own model fitted to the published measurement of the LED (385 nm LEDs of the OralEye camera, PR-670).",
        q,
        fit_led_385(ref),
        assumed=["curve.tails[2].level", "curve.tails[2].decay_nm"],
    )

    def measured(name, columns, peak, low, high, note, **more):
        nm, y = ref.read(name, columns)
        keep = (nm >= low) & (nm <= high)
        return fit_led(name, nm[keep], y[keep], peak, note + " " + far, **more)

    oe = "lights/oe_tongue_lip_excitation_lights.csv"
    relative = "Relative to the peak of the model."
    cut = relative + " Measured behind a 450 nm short-pass filter, so only the part below it counts."
    yield fitted(
        "lights",
        "led_405",
        "405 nm LED",
        "True peak near 408 nm. Bare LED, before any filter.",
        "Own model fitted to the published measurement of the 405 nm LED of the OralEye camera.",
        q,
        measured("lights/oraleye_led405.csv", None, 408.0, 380, 490, relative),
        assumed=["curve.tails[2].level", "curve.tails[2].decay_nm"],
    )
    yield fitted(
        "lights",
        "led_415",
        "415 nm LED",
        "True peak 414 to 416 nm (it moves with the current). Bare LED, filter removed.",
        "Own model fitted to the published lights of the tongue and lip study (500 mA).",
        q,
        measured(oe, ["calibrate_415nm_500mA"], 414.5, 390, 440, cut, long_decay=(11.0, 14.0)),
        assumed=["curve above 440 nm", "curve.tails[2].level", "curve.tails[2].decay_nm"],
    )
    yield fitted(
        "lights",
        "led_425",
        "425 nm LED",
        "True peak near 424 nm at 500 mA. Bare LED, filter removed.",
        "Own model fitted to the published lights of the tongue and lip study (500 mA).",
        q,
        measured(oe, ["calibrate_425nm_500mA"], 424.0, 396, 440, cut, long_decay=(11.0, 14.0)),
        assumed=["curve above 440 nm", "curve.tails[2].level", "curve.tails[2].decay_nm"],
    )
    yield fitted(
        "lights",
        "led_450",
        "450 nm LED",
        "True peak near 444 nm. Bare LED, filter removed.",
        "Own model fitted to the published measurement of the laboratory LED of 2019.",
        q,
        measured(
            "lights/lab2019_led405_led425_led450.csv",
            ["led450_m1", "led450_m2", "led450_m3"],
            444.8,
            405,
            470,
            relative + " Measured behind a 475 nm short-pass filter, so only the part below it counts.",
            long_level=(0.02999, 0.03),
            long_decay=(17.999, 18.0),
        ),
        assumed=[
            "curve above 470 nm",
            "curve.tails[1].level",
            "curve.tails[1].decay_nm",
            "curve.tails[2].level",
            "curve.tails[2].decay_nm",
        ],
    )
    yield Item(
        "lights",
        "led_365",
        "365 nm LED",
        "A generic UV LED, bare. Not measured: its widths are those of catalogue parts "
        "(about 10 nm), its tails those of led_385.",
        OWN,
        q,
        led(365, 9.0, 12.0, 1.9, [("short", 0.1, 6.0), ("long", 0.035, 20.0), ("long", 1e-4, 80.0)]),
        assumed=["curve"],
    )
    yield Item(
        "lights",
        "white_led",
        "White LED, phosphor-converted, 5500 K",
        "Stands for the white LED ring of the OralEye camera, whose spectrum is not public. Blue 450 nm die and a broad "
        "yellow phosphor; chromaticity x = 0.332, y = 0.347.",
        OWN,
        q,
        bands((450, 20, 24, 0.990), (559, 90, 130, 0.577)),
        assumed=["curve"],
    )
    yield Item(
        "lights",
        "room_led",
        "Room light, neutral-white LED, 4000 K",
        "Ambient light of a room, for scenes with stray light; chromaticity x = 0.381, y = 0.377.",
        OWN,
        q,
        bands((450, 20, 24, 0.993), (570, 90, 130, 0.862)),
        assumed=["curve"],
    )
    yield Item(
        "lights",
        "halogen",
        "Halogen lamp, 3000 K",
        "A black body of 3000 K, scaled to 1 at 750 nm. The absorption of the bulb in the ultraviolet is left out.",
        "Planck's law.",
        q,
        {"type": "blackbody", "temperature_k": 3000.0, "reference_nm": 750.0},
        assumed=["curve.temperature_k"],
    )
    yield Item(
        "lights",
        "equal_energy",
        "Equal-energy light",
        "The same power in every nanometer.",
        "Definition.",
        q,
        {"type": "constant", "value": 1.0},
    )


def filters(ref):
    q = "transmittance"
    dichroic = {"effective_index": 1.8}
    coating = ("effective_index",)
    yield Item(
        "filters",
        "short_pass_425",
        "Short-pass 425 nm, on the LEDs",
        "Interference filter in front of the blue LEDs (Lyu et al. 2021, Fig. 5b: blocks wavelengths above 425 nm). The "
        "part and its curve are not public.",
        OWN + " Cut-off: Lyu et al. 2021.",
        q,
        edges(0.95, 4, ("short", 425, 6)),
        assumed=["curve.peak", "curve.optical_density", "curve.edges[0].width_nm", *coating],
        extra=dichroic,
    )
    yield Item(
        "filters",
        "short_pass_450",
        "Short-pass 450 nm, on the LEDs",
        "Interference filter on the LEDs of the later tongue and lip study; only its nominal cut-off is known.",
        OWN,
        q,
        edges(0.95, 4, ("short", 450, 6)),
        assumed=["curve", *coating],
        extra=dichroic,
    )
    yield fitted(
        "filters",
        "short_pass_475",
        "Short-pass 475 nm, on the LEDs",
        "Interference filter like the catalogue part 475 nm of Edmund Optics.",
        "Own model fitted to a digitized curve.",
        q,
        fit_edges(
            ref,
            "filters/edmund_475_shortpass_digitised.csv",
            350,
            660,
            4.0,
            ["short"],
            [(475, 3)],
            "The data are digitized from a plot and scaled to a maximum of 1; their ripple of 0.02 is not modeled.",
        ),
        assumed=["curve.optical_density", *coating],
        extra=dichroic,
    )
    glass = (
        "Absorbing glass, so it does not shift with angle. The measured values in its blocking band (0.01 to 0.08) are "
        "stray light of the instrument and are clamped: the floor is an optical density instead."
    )
    yield fitted(
        "filters",
        "long_pass_441_y44",
        "Long-pass 441 nm, Hoya Y44",
        glass,
        "Own model fitted to a published measurement of the Y44 glass.",
        q,
        fit_edges(
            ref,
            "filters/hoya_y44_measured.csv",
            430,
            750,
            4.0,
            ["long", "long"],
            [(441, 12), (440, 60)],
            "Only 430 to 750 nm is compared; below is stray light.",
        ),
        assumed=["curve.optical_density"],
    )
    yield fitted(
        "filters",
        "long_pass_488_k2",
        "Long-pass 488 nm, Hoya K2",
        glass + " 50 % lies at 488 nm although the glass is often called a 475 nm filter.",
        "Own model fitted to a published measurement of the K2 glass.",
        q,
        fit_edges(
            ref,
            "filters/hoya_k2_measured.csv",
            460,
            750,
            4.0,
            ["long", "long"],
            [(488, 12), (485, 60)],
            "Only 460 to 750 nm is compared; below is stray light.",
        ),
        assumed=["curve.optical_density"],
    )
    for cut in (475, 500, 520):
        yield Item(
            "filters",
            f"long_pass_{cut}",
            f"Long-pass {cut} nm",
            "Generic interference long-pass in front of a camera.",
            OWN,
            q,
            edges(0.95, 5, ("long", cut, 8)),
            assumed=["curve", *coating],
            extra=dichroic,
        )
    yield Item(
        "filters",
        "view_475_700",
        "Viewing filter 475 to 700 nm",
        "The filter in front of the lens by the text of Lyu et al. 2021, 3.3.2: blocks below 475 and above 700 nm. Its "
        "curve is not public.",
        OWN + " Pass band: Lyu et al. 2021, text.",
        q,
        edges(0.95, 5, ("long", 475, 8), ("short", 700, 14)),
        assumed=[
            "curve.peak",
            "curve.optical_density",
            "curve.edges[0].width_nm",
            "curve.edges[1].width_nm",
            *coating,
        ],
        extra=dichroic,
    )
    yield Item(
        "filters",
        "view_425_700",
        "Viewing filter 425 to 700 nm",
        "The filter in front of the lens by the caption of Lyu et al. 2021, Fig. 5: limits light below 425 nm, nearly "
        "transparent from 450 nm. Read here as 10 % at 425 nm and 98 % of the peak at 442 nm, since a 50 % point at 425 nm would "
        "meet the short-pass of the LEDs half-way.",
        OWN + " Pass band: Lyu et al. 2021, Fig. 5 caption.",
        q,
        edges(0.95, 5, ("long", 430, 10), ("short", 700, 14)),
        assumed=[
            "curve.peak",
            "curve.optical_density",
            "curve.edges[0].cut_nm",
            "curve.edges[0].width_nm",
            "curve.edges[1].width_nm",
            *coating,
        ],
        extra=dichroic,
    )
    yield Item(
        "filters",
        "ir_cut_700",
        "Infrared cut 700 nm",
        "Generic interference filter in front of a color sensor.",
        OWN,
        q,
        edges(0.97, 3, ("long", 390, 10), ("short", 700, 20)),
        assumed=["curve", *coating],
        extra=dichroic,
    )
    yield Item(
        "filters",
        "band_pass_635_50",
        "Band-pass 635 nm, 50 nm wide",
        "Generic interference band-pass in front of a camera, about the red emission of porphyrin.",
        OWN,
        q,
        edges(0.95, 5, ("long", 610, 6), ("short", 660, 6)),
        assumed=["curve", *coating],
        extra=dichroic,
    )
    yield Item(
        "filters",
        "notch_405",
        "Notch 405 nm",
        "Generic interference notch, 24 nm wide, that stops a violet laser or LED and passes the rest.",
        OWN,
        q,
        edges(0.95, 4) | {"notches": [{"center_nm": 405.0, "fwhm_nm": 24.0}]},
        assumed=["curve", *coating],
        extra=dichroic,
    )
    yield Item(
        "filters",
        "dichroic_450",
        "Dichroic 450 nm, long-pass",
        "Generic dichroic beam splitter in transmission at normal incidence; at 45 degrees its edge lies at 414 nm. Dichroics "
        "block less than filters.",
        OWN,
        q,
        edges(0.95, 2, ("long", 450, 12)),
        assumed=["curve", *coating],
        extra=dichroic,
    )
    yield fitted(
        "filters",
        "uv_ir",
        "UV and infrared cut, Hoya UV&IR",
        "50 % at 388 and 691 nm. Floor 0.01 (optical density 2): "
        "its leak at 725 to 750 nm is real in the data.",
        "Own model fitted to a digitized curve.",
        q,
        fit_uv_ir(ref),
        assumed=["curve.base", *coating],
        extra=dichroic,
    )
    yield Item(
        "filters",
        "none",
        "No filter",
        "Passes everything.",
        "Definition.",
        q,
        {"type": "constant", "value": 1.0},
    )


def reflectances(ref):
    q = "reflectance"
    nm, y = ref.read("reflectance/tongue_mean_350_780.csv")
    yield fitted(
        "reflectances",
        "tongue_dorsum",
        "Dorsum of the tongue",
        "Mean of 12 subjects. The numbers describe the curve, they do not measure the tissue: diffuse reflectance fixes "
        "only absorption over scattering. Below 390 nm and above 740 nm the data are extrapolated and the model stands alone.",
        "Own model fitted to the published mean reflectance of 12 tongues. " + JACQUES,
        q,
        fit_tissue(
            "reflectance/tongue_mean_350_780.csv",
            nm,
            y,
            "Scattering is held at the prior. 0.148 at 390 nm may contain gloss. The 12 subjects differ by 0.06 (rms) from their mean at "
            "700 nm, far more than the model does.",
        ),
        assumed=[
            "curve.scattering_per_cm",
            "curve.scattering_power",
            "curve.refractive_index",
            "curve.hemoglobin_g_per_l",
        ],
    )
    lip = [ref.read(f"reflectance/oe_s{i}_lip.csv") for i in (2, 3, 4)]
    yield fitted(
        "reflectances",
        "lip",
        "Inner lip",
        "Mean of three subjects.",
        "Own model fitted to the published lip reflectance of three subjects. " + JACQUES,
        q,
        fit_tissue(
            "reflectance/oe_s2_lip.csv, oe_s3_lip.csv, oe_s4_lip.csv",
            lip[0][0],
            np.mean([v[1] for v in lip], axis=0),
            "Scattering is held at the prior. The three subjects differ by a factor of 2 in the blue.",
        ),
        assumed=[
            "curve.scattering_per_cm",
            "curve.scattering_power",
            "curve.refractive_index",
            "curve.hemoglobin_g_per_l",
        ],
    )
    varied = "Assumed: the fitted tongue with other amounts of blood and scattering. "
    sites = [
        (
            "tongue_ventral",
            "Underside of the tongue",
            "Thin epithelium, more superficial blood.",
            [0.9, 150, 0.06, 0.85, 50, 1.5],
            {},
        ),
        (
            "gingiva",
            "Attached gingiva",
            "Paler: less blood, dense fibrous tissue. L* 58.",
            [0.9, 130, 0.035, 0.80, 45, 1.0],
            {"scattering_per_cm": 30.0},
        ),
        (
            "palate",
            "Hard palate",
            "Palest mucosa: thick keratin, tight fibrous tissue.",
            [0.8, 130, 0.03, 0.80, 45, 0.6],
            {"scattering_per_cm": 32.0},
        ),
        ("soft_palate", "Soft palate", "Redder than the hard palate.", [0.8, 130, 0.045, 0.80, 50, 1.4], {}),
        ("cheek", "Cheek (buccal mucosa)", "", [0.8, 130, 0.05, 0.80, 50, 0.9], {}),
        (
            "floor_of_mouth",
            "Floor of the mouth",
            "Thinnest epithelium over wide veins: dark.",
            [0.9, 130, 0.07, 0.75, 60, 1.6],
            {"scattering_per_cm": 20.0},
        ),
    ]
    for name, title, text, values, more in sites:
        yield Item(
            "reflectances",
            name,
            title,
            (varied + text).strip(),
            OWN + " " + JACQUES,
            q,
            tissue(values, **more),
            assumed=["curve"],
        )
    yield Item(
        "reflectances",
        "skin",
        "Skin, fair",
        "Assumed: the lightly pigmented skin of the face around the mouth. Raise melanin_depth for darker skin.",
        OWN + " " + JACQUES,
        q,
        tissue(
            [0.6, 110, 0.008, 0.65, 40, 0.25],
            scattering_per_cm=46.0,
            scattering_power=1.421,
            melanin_depth=0.3,
        ),
        assumed=["curve"],
    )
    teeth = (
        "Assumed from the color of natural teeth (L* 75 to 85, b* 10 to 20). Measured tooth radiances exist but their "
        "absolute scale is wrong by a factor of about 2 (geometry), so only the slope was compared."
    )
    yield Item(
        "reflectances",
        "enamel",
        "Enamel over dentin (sound tooth crown)",
        teeth,
        OWN,
        q,
        sigmoids(0.29, (420, 125, 0.27), (560, 220, 0.13)),
        assumed=["curve"],
    )
    yield Item(
        "reflectances",
        "dentin",
        "Dentin, exposed",
        "Yellower than enamel. " + teeth,
        OWN,
        q,
        sigmoids(0.24, (440, 140, 0.28), (570, 200, 0.16)),
        assumed=["curve"],
    )
    for name, title, text, curve in [
        (
            "tooth_incisor",
            "Upper incisor, middle of its face",
            "Reflectance of the tissue tooth, which has the measured color of front teeth (CIELAB 79, 0, 16).",
            sigmoids(0.039, (358, 260, 0.363), (509, 215, 0.231)),
        ),
        (
            "tooth_neck",
            "Tooth with much dentin, as at its neck",
            "Reflectance of the tissue tooth moved twice as far as to that of the tissue canine (CIELAB 68, 2, 29): half "
            "and half of both is a canine.",
            sigmoids(0.0, (389, 168, 0.1), (506, 226, 0.4)),
        ),
    ]:
        yield Item("reflectances", name, title, text, OWN, q, curve, assumed=["curve"])
    yield Item(
        "reflectances",
        "white_reference",
        "White reference, 99 %",
        "Sintered PTFE standard.",
        "Nominal value.",
        q,
        {"type": "constant", "value": 0.99},
    )
    yield Item(
        "reflectances",
        "gray_18",
        "Gray card, 18 %",
        "Photographic gray.",
        "Nominal value.",
        q,
        {"type": "constant", "value": 0.18},
    )
    yield Item(
        "reflectances",
        "black",
        "Matt black, 3 %",
        "Matt black paint; velvet is darker (about 0.5 %).",
        OWN,
        q,
        {"type": "constant", "value": 0.03},
        assumed=["curve.value"],
    )


def quantum_efficiencies(ref):
    q = "quantum_efficiency"
    name = "sensors/imx363_public_qe.csv"
    start = {
        "R": (
            [
                (375, 40, 70, 0.13),
                (532, 30, 30, 0.05),
                (600, 22, 110, 0.55),
                (690, 80, 80, 0.1),
                (770, 60, 70, 0.2),
            ],
            (0.10, 0.07, 0.045),
        ),
        "G": (
            [
                (375, 40, 60, 0.05),
                (480, 30, 30, 0.06),
                (541, 50, 80, 0.6),
                (590, 50, 40, 0.1),
                (715, 60, 40, 0.1),
                (800, 60, 80, 0.15),
            ],
            (0.038, 0.028, 0.018),
        ),
        "B": (
            [
                (400, 50, 60, 0.2),
                (455, 80, 60, 0.5),
                (490, 40, 60, 0.1),
                (560, 120, 120, 0.04),
                (700, 80, 50, 0.04),
                (825, 50, 80, 0.18),
            ],
            (0.055, 0.028, 0.014),
        ),
    }
    fits = {}
    for channel, (rows, short) in start.items():
        nm, y = ref.read(name, [channel.lower()])
        keep = nm <= 780
        fits[channel] = fit_bands(
            name,
            nm[keep],
            y[keep],
            rows,
            "380 to 780 nm, electrons per photon; the reference calls itself dummy data for public sharing.",
            anchors=list(zip((370.0, 360.0, 350.0), short)),
        )
    yield Item(
        "qe",
        "consumer_rgb_cmos",
        "Generic consumer color CMOS, no infrared filter",
        "A stand-in for a small-pixel RGB sensor without its infrared filter: put ir_cut_700, uv_ir or a viewing filter in "
        "front of it. The quantum efficiency of the OralEye sensor is not public. Below 380 nm the curves fall, as assumed, to about 0.04, 0.02 and 0.01 at 350 nm.",
        "Own model fitted to public stand-in data of a Sony-like sensor.",
        q,
        {k: f.curve for k, f in fits.items()},
        assumed=["curve below 380 nm"],
        fit=fits,
    )
    nm, y = ref.read("sensors/vita1300_qe.csv")
    keep = nm <= 780
    fit = fit_bands(
        "sensors/vita1300_qe.csv",
        nm[keep],
        y[keep],
        [(380, 60, 60, 0.15), (500, 150, 150, 0.4), (600, 120, 250, 0.3)],
        "380 to 780 nm; the ripple of the cover layers (0.02) is not modeled.",
    )
    yield Item(
        "qe",
        "monochrome_cmos",
        "Generic monochrome CMOS with global shutter",
        "Like a VITA 1300 of about 2012. Newer parts reach 0.7 to 0.9.",
        "Own model fitted to public data.",
        q,
        {"mono": fit.curve},
        assumed=["curve below 380 nm"],
        fit={"mono": fit},
    )


# ---------------------------------------------------------------- writing


def toml_value(v):
    if isinstance(v, str):
        return '"' + v.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(v, (list, tuple)):
        return "[" + ", ".join(toml_value(x) for x in v) + "]"
    text = np.format_float_positional(float(v), trim="0")
    return text if 1e-4 <= abs(v) or v == 0 else f"{v:.4g}".replace("e-0", "e-")


def curve_lines(table, c):
    lines = [f"[{table}]"] + [f"{k} = {toml_value(v)}" for k, v in c.items() if not isinstance(v, list)]
    for key, rows in c.items():
        if isinstance(rows, list):
            for row in rows:
                lines += ["", f"[[{table}.{key}]]"] + [f"{k} = {toml_value(v)}" for k, v in row.items()]
    return lines


def wrap(text, width=108, prefix="# "):
    lines, line = [], prefix.rstrip()
    for word in text.split():
        if len(line) + 1 + len(word) > width:
            lines.append(line)
            line = prefix.rstrip()
        line += " " + word
    return lines + [line]


def to_toml(item):
    lines = wrap(item.title + ". " + item.description)
    for key in ("name", "title", "description", "source", "quantity"):
        lines.append(f"{key} = {toml_value(getattr(item, key))}")
    lines += [f"valid_nm = {toml_value(item.valid_nm)}", f"assumed = {toml_value(item.assumed)}"]
    lines += [f"{k} = {toml_value(v)}" for k, v in item.extra.items()]
    if item.fits:
        fits = list(item.fits.values())
        worst = max(fits, key=lambda f: f.rms)
        lines += [
            "",
            "[fit]",
            f"reference = {toml_value(worst.reference)}",
            f"rms = {toml_value(float(f'{worst.rms:.2g}'))}",
            f"range_nm = {toml_value(worst.range_nm)}",
        ]
        note = worst.note + (" The rms is that of the worst channel." if len(fits) > 1 else "")
        lines.append(f"note = {toml_value(note)}")
    for channel, c in item.curves.items():
        lines += [""] + curve_lines(f"curve.{channel}" if channel else "curve", c)
    return "\n".join(lines) + "\n"


FOLDERS = ("lights", "filters", "reflectances", "qe")


# ---------------------------------------------------------------- judging


def leak(get, light, on_light, on_lens, reflectance="tongue_dorsum", photon_yield=5e-4):
    """Reflected photons per fluorescence photon behind the viewing filter, normal incidence.

    `photon_yield`: fluorescence photons from 500 to 700 nm per photon that arrives (tongue: 5e-4)."""
    photons = get(light) * get(on_light) * GRID
    band = (GRID >= 500) & (GRID <= 690)
    view = get(on_lens)
    reflected = photons * get(reflectance) * view
    fluorescent = photon_yield * photons.sum() * view[band].mean()
    parts = [
        reflected[m].sum() / fluorescent for m in (GRID < 420, (GRID >= 420) & (GRID < 480), GRID >= 480)
    ]
    return parts


def plot(items, folder):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    for name in FOLDERS:
        group = [(i, c) for i in items if i.folder == name for c in i.curves]
        columns = 4
        rows = -(-len(group) // columns)
        fig, axes = plt.subplots(rows, columns, figsize=(columns * 4.5, rows * 3.2), squeeze=False)
        for axis, (item, channel) in zip(axes.ravel(), group):
            draw = axis.semilogy if name in ("lights", "filters") else axis.plot
            draw(GRID, evaluate(item.curves[channel], GRID), "k")
            if channel in item.fits:
                draw(item.fits[channel].nm, item.fits[channel].data, "r.", ms=4)
            axis.set_title(f"{item.name} {channel}")
            if name in ("lights", "filters"):
                axis.set_ylim(3e-6, 2)
            axis.grid(alpha=0.3)
        for axis in axes.ravel()[len(group) :]:
            axis.axis("off")
        fig.tight_layout()
        fig.savefig(Path(folder) / f"{name}.png", dpi=60)
        plt.close(fig)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("reference", help="folder of measured spectra")
    parser.add_argument("--write", action="store_true", help="replace the files under crates/fluorspar-experiment/data")
    parser.add_argument("--plots", metavar="FOLDER", help="draw models and data into this folder")
    arguments = parser.parse_args()
    ref = Reference(arguments.reference)
    items = [*lights(ref), *filters(ref), *reflectances(ref), *quantum_efficiencies(ref)]
    for item in items:
        for channel, fit in item.fits.items():
            label = item.name + (f".{channel}" if channel else "")
            print(
                f"{label:24s} rms {fit.rms:.4f}  worst {np.abs(fit.residual).max():.4f}  {fit.range_nm[0]:.0f}-{fit.range_nm[1]:.0f} nm  {fit.reference}"
            )
    values = {i.name: evaluate(next(iter(i.curves.values())), GRID) for i in items}
    print(
        "\nReflected photons per fluorescence photon (tongue, yield 5e-4): total = below 420 + 420 to 480 + above 480 nm"
    )
    for light, on_light, on_lens in [
        ("led_385", "short_pass_425", "view_475_700"),
        ("led_385", "short_pass_425", "view_425_700"),
        ("led_385", "none", "view_475_700"),
        ("led_385", "none", "long_pass_441_y44"),
        ("led_385", "none", "long_pass_488_k2"),
        ("led_385", "short_pass_425", "long_pass_441_y44"),
        ("led_385", "short_pass_475", "view_475_700"),
        ("led_405", "short_pass_425", "view_475_700"),
        ("led_405", "short_pass_450", "long_pass_475"),
        ("led_450", "short_pass_450", "long_pass_475"),
    ]:
        parts = leak(values.__getitem__, light, on_light, on_lens)
        print(
            f"{light} {on_light:16s} {on_lens:18s} {sum(parts):.2e} = "
            + " + ".join(f"{p:.1e}" for p in parts)
        )
    if arguments.plots:
        plot(items, arguments.plots)
    if arguments.write:
        for item in items:
            path = DATA / item.folder / f"{item.name}.toml"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(to_toml(item), encoding="utf-8")
        print(f"\nwrote {len(items)} files")


if __name__ == "__main__":
    main()
