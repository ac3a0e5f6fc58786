#!/usr/bin/env python3
"""Fit the analytic fluorophore catalogue of Fluorspar.

    python3 fit_fluorophores.py REFERENCE [--out FOLDER] [--only nadh,elastin]

REFERENCE is the folder of reference spectra (the one that holds eem/ and
fluorophores/).  One TOML file per fluorophore is written to --out (default:
../crates/fluorspar-experiment/data/fluorophores next to this script).  Needs Python 3.11,
numpy and scipy; a single thread is enough (export OMP_NUM_THREADS=1).

Model, identical to the one the Rust code evaluates
---------------------------------------------------
    Y(lo|li) = scale * sum_k ex_k(li) * em_k(lo)            photons / nm / photon
every ex_k and em_k is a sum of log-normal bands in wavenumber nu = 1e7/nm
(Siano & Metzler 1969; Burstein & Emelyanenko 1996) with weights >= 0:
    band = weight * exp(-ln2/ln(rho)^2 * ln((a-nu)/(a-nu0))^2),
    a = nu0 + H*rho/(rho^2-1); zero where (a-nu)/(a-nu0) <= 0; Gaussian for rho = 1.

Method
------
1. Masked non-negative matrix factorization of the measured matrix gives start
   profiles (several seeds).
2. Every profile is described by a few bands.
3. All band parameters of all terms are refined together (bounded least squares,
   Jacobian from the product structure).
Columns are weighted by (column norm)^-alpha, so that weak excitation columns -
the ones that matter at 385-450 nm - are not ignored; the errors that are
reported are unweighted.  The model is pulled weakly to zero where em <= ex, so
that the part hidden by the Stokes mask stays small, and where far-UV excitation meets
red emission behind the second-order wedge, where nothing has been measured.
"""
import argparse
import pathlib
import tomllib

import numpy as np
from scipy.optimize import least_squares

LN2 = np.log(2.0)
RHO = 2.0                # skewness stays between 1/RHO and RHO
PRIOR = 0.01             # strength of the weak priors in the joint fit
STOKES_GAP = 15.0        # nm, cells that count in the reported error
SECOND_ORDER_GAP = 15.0  # nm
FIT_GAP = (25.0, 30.0)   # nm, the same two gaps for cells that pull the fit


# --------------------------------------------------------------------------- bands
def band(nu, nu0, h, rho):
    """Log-normal band of unit height; nu in 1/cm."""
    if abs(rho - 1.0) < 1e-4:
        return np.exp(-4 * LN2 * ((nu - nu0) / h) ** 2)
    a = nu0 + h * rho / (rho * rho - 1.0)
    r = (a - nu) / (a - nu0)
    out = np.zeros_like(nu)
    ok = r > 0
    out[ok] = np.exp(-LN2 / np.log(rho) ** 2 * np.log(r[ok]) ** 2)
    return out


def band_p(nu, p):
    """Band from (nu0/1000, ln H, ln rho, ln w)."""
    return np.exp(p[3]) * band(nu, p[0] * 1e3, np.exp(p[1]), np.exp(p[2]))


def band_and_grad(nu, p):
    f = band_p(nu, p)
    g = []
    for i, d in ((0, 1e-5), (1, 1e-5), (2, 1e-4)):
        q, r = p.copy(), p.copy()
        q[i] += d
        r[i] -= d
        g.append((band_p(nu, q) - band_p(nu, r)) / (2 * d))
    g.append(f)
    return f, g


class Layout:
    """Which parameters belong to which band of which term."""

    def __init__(self, shape):
        self.shape = shape                       # [(n_ex, n_em), ...]
        self.slots = []                          # (term, side, first index, weight is free)
        i = 0
        for k, (nx, nm) in enumerate(shape):
            for side, n in ((0, nx), (1, nm)):
                for b in range(n):
                    self.slots.append((k, side, i))
                    i += 4
        self.n = i

    def profiles(self, p, nux, num, grad=False):
        ex = [np.zeros(nux.size) for _ in self.shape]
        em = [np.zeros(num.size) for _ in self.shape]
        gr = []
        for k, side, i in self.slots:
            nu = num if side else nux
            if grad:
                f, g = band_and_grad(nu, p[i:i + 4])
                gr.append(g)
            else:
                f = band_p(nu, p[i:i + 4])
            (em if side else ex)[k] += f
        return ex, em, gr

    def model(self, p, nux, num):
        ex, em, _ = self.profiles(p, nux, num)
        return sum(np.outer(m, x) for x, m in zip(ex, em))


def bounds(layout, lim):
    lo, hi = np.zeros(layout.n), np.zeros(layout.n)
    for k, side, i in layout.slots:
        t = lim[k] if isinstance(lim, list) else lim
        (n0, n1), (h0, h1) = (t["em"], t["h_em"]) if side else (t["ex"], t["h_ex"])
        r = t.get("rho", RHO)
        lo[i:i + 4] = 1e4 / n1, np.log(h0), -np.log(r), -14
        hi[i:i + 4] = 1e4 / n0, np.log(h1), np.log(r), 6
    return lo, hi


# --------------------------------------------------------------------------- start values
def masked_nmf(d, w, k, rng, iters=1500):
    u = rng.random((d.shape[0], k)) + 0.05
    v = rng.random((k, d.shape[1])) + 0.05
    wd = w * d
    for _ in range(iters):
        u *= (wd @ v.T) / ((w * (u @ v)) @ v.T + 1e-12)
        v *= (u.T @ wd) / (u.T @ (w * (u @ v)) + 1e-12)
    s = u.max(0)
    return u / s, v * s[:, None]


def fit_profile(nu, y, n, lim_nm, lim_h, rho):
    """n bands for one profile: greedy, add a band at the largest residual."""
    scale = y.max() + 1e-12
    y = y / scale
    lo1 = np.array([1e4 / lim_nm[1], np.log(lim_h[0]), -np.log(rho), -9])
    hi1 = np.array([1e4 / lim_nm[0], np.log(lim_h[1]), np.log(rho), 4])
    p = np.zeros(0)
    for m in range(n):
        res = y - sum((band_p(nu, p[4 * j:4 * j + 4]) for j in range(m)), np.zeros_like(y))
        i = int(np.argmax(res))
        h = np.clip(4000 / (1 + m), *lim_h)
        new = np.array([nu[i] / 1e3, np.log(h * 1.01), 0.02, np.log(max(res[i], 1e-3))])
        p = np.concatenate([p, np.clip(new, lo1 + 1e-3, hi1 - 1e-3)])
        k = m + 1
        p = least_squares(
            lambda q: sum(band_p(nu, q[4 * j:4 * j + 4]) for j in range(k)) - y,
            p, bounds=(np.tile(lo1, k), np.tile(hi1, k)), max_nfev=60).x
    p = p.reshape(-1, 4)
    p[:, 3] += np.log(scale)
    return p


# --------------------------------------------------------------------------- joint fit
def joint_fit(layout, p0, ex, em, d, w, lim, nfev):
    nux, num = 1e7 / ex, 1e7 / em
    rows = w > 0
    ws = w[rows]
    target = (w * d)[rows]
    lo, hi = bounds(layout, lim)

    # weak priors (skewness near 1, ordinary widths, moderate weights): break ties between equivalent descriptions
    lam = PRIOR
    mean, sd = np.zeros(layout.n), np.ones(layout.n)
    for k, side, i in layout.slots:
        t = lim[k] if isinstance(lim, list) else lim
        mean[i:i + 4] = p0[i], np.log(t.get("h0", 3500.0)), 0.0, (-1.0 if side else -5.0)
        sd[i:i + 4] = 3.0, 0.6, 0.3, (2.0 if side else 3.0)
    prior = np.diag(lam / sd)

    def fun(p):
        return np.concatenate([layout.model(p, nux, num)[rows] * ws - target, lam * (p - mean) / sd])

    def jac(p):
        x, m, g = layout.profiles(p, nux, num, grad=True)
        j = np.empty((ws.size, layout.n))
        for (k, side, i), gg in zip(layout.slots, g):
            for c in range(4):
                o = np.outer(gg[c], x[k]) if side else np.outer(m[k], gg[c])
                j[:, i + c] = o[rows] * ws
        return np.concatenate([j, prior])

    p0 = np.clip(p0, lo + 1e-4, hi - 1e-4)
    s = least_squares(fun, p0, jac, bounds=(lo, hi), x_scale=1.0, max_nfev=nfev, ftol=1e-7, xtol=1e-7, gtol=1e-9)
    return s.x, 2 * s.cost


def rel(model, d, m):
    """Relative Frobenius error with one free overall scale."""
    a, b = model[m], d[m]
    s = (a @ b) / (a @ a)
    return float(np.linalg.norm(s * a - b) / np.linalg.norm(b))


def load_eem(path):
    lines = path.read_text().strip().split("\n")
    ex = np.array([float(t) for t in lines[0].split(",")[1:]])
    a = np.array([[float(t) if t else np.nan for t in ln.split(",")] for ln in lines[1:]])
    return ex, a[:, 0], a[:, 1:]


def load_xy(path):
    a = np.genfromtxt(path, delimiter=",", skip_header=1)
    return a[:, 0], a[:, 1]


def cell_mask(ex, em, d, gap=STOKES_GAP, gap2=SECOND_ORDER_GAP):
    e, x = em[:, None], ex[None, :]
    return (np.nan_to_num(d) > 0) & (e >= x + gap) & (np.abs(e - 2 * x) >= gap2)


def fit_eem(ex, em, d, mask, cfg):
    """Returns a list of terms: (ex bands, em bands), band = (nm, fwhm, skew, weight)."""
    d = np.where(mask, np.nan_to_num(d), 0.0)
    d = d / d.max()
    col = np.array([np.linalg.norm(d[:, j]) for j in range(ex.size)])
    cw = np.maximum(col / col.max(), cfg.get("floor", 0.02)) ** -cfg.get("alpha", 0.5)
    # cells that still carry a tail of scattered light count in the reported error but do not pull the fit
    g1, g2 = cfg.get("fit_gap", (STOKES_GAP, SECOND_ORDER_GAP))
    w = cell_mask(ex, em, np.where(mask, d, 0), g1, g2) * cw[None, :]
    anti = em[:, None] <= ex[None, :]
    w = np.where(anti, cfg.get("anti", 0.1) * cw[None, :], w)
    hidden = (em[:, None] > 620) & (em[:, None] > 2 * ex[None, :]) & (ex[None, :] < 330)
    w = np.where(hidden, 0.05 * cw[None, :], w)
    layout = Layout(cfg["shape"])
    nux, num = 1e7 / ex, 1e7 / em
    best = None
    for seed in cfg.get("seeds", range(4)):
        rng = np.random.default_rng(seed)
        p0 = np.zeros(layout.n)
        if seed % 2 and "start" in cfg:
            # start from bands spread around given (excitation, emission) centers
            for k, side, i in layout.slots:
                c = 1e4 / cfg["start"][k][side]
                h = np.exp(rng.normal(np.log(4000.0), 0.2))
                p0[i:i + 4] = c + rng.normal(0, 1.0), np.log(h), rng.normal(0, 0.1), np.log(0.3)
        else:
            u, v = masked_nmf(d, w * w, len(cfg["shape"]), rng)
            # terms with the largest share get the richest description
            order = np.argsort(-np.linalg.norm(u, axis=0) * np.linalg.norm(v, axis=1))
            i = 0
            for j, (k, (nx, nm)) in enumerate(zip(order, cfg["shape"])):
                lim = cfg["lim"][j] if isinstance(cfg["lim"], list) else cfg["lim"]
                r = lim.get("rho", RHO)
                a = fit_profile(nux, v[k], nx, lim["ex"], lim["h_ex"], r).ravel()
                b = fit_profile(num, u[:, k], nm, lim["em"], lim["h_em"], r).ravel()
                p0[i:i + a.size + b.size] = np.concatenate([a, b])
                i += a.size + b.size
        p, c = joint_fit(layout, p0, ex, em, d, w, cfg["lim"], cfg.get("nfev", 80))
        e = rel(layout.model(p, nux, num), d, mask)
        print(f"   seed {seed}: weighted cost {c:.5f}, relative Frobenius {e:.4f}", flush=True)
        if best is None or c < best[1]:
            best = (p, c)
    p, c = joint_fit(layout, best[0], ex, em, d, w, cfg["lim"], cfg.get("polish", 300))
    terms = []
    i = 0
    for nx, nm in cfg["shape"]:
        t = []
        for n in (nx, nm):
            t.append([(1e4 / q[0], np.exp(q[1]), np.exp(q[2]), np.exp(q[3])) for q in p[i:i + 4 * n].reshape(-1, 4)])
            i += 4 * n
        terms.append(t)
    return terms


# --------------------------------------------------------------------------- evaluation of a finished catalogue entry
def profile(bands, nm):
    nu = 1e7 / np.asarray(nm, float)
    return sum((b[3] * band(nu, 1e7 / b[0], b[1], b[2]) for b in bands), np.zeros(nu.shape))


def evaluate(terms, ex, em):
    return sum(np.outer(profile(m, em), profile(x, ex)) for x, m in terms)


def tidy(terms, digits=5):
    """Emission peak 1 in every term, largest excitation weight 1, tiny bands removed, numbers rounded."""
    grid = np.arange(200.0, 1000.5, 1.0)
    out = []
    for x, m in terms:
        s = profile(m, grid).max()
        m = [(b[0], b[1], b[2], b[3] / s) for b in m]
        x = [(b[0], b[1], b[2], b[3] * s) for b in x]
        out.append((x, m))
    top = max(b[3] for x, _ in out for b in x)
    out = [([(b[0], b[1], b[2], b[3] / top) for b in x if b[3] / top > 2e-5], [b for b in m if b[3] > 1e-3]) for x, m in out]
    out = [(x, m) for x, m in out if x and m]
    out.sort(key=lambda t: (grid * profile(t[0], grid))[(grid <= 560)].sum() / profile(t[0], grid)[(grid <= 560)].sum())
    rnd = lambda v, n: float(f"{v:.{n}g}")
    return [([(rnd(b[0], digits), rnd(b[1], digits), rnd(b[2], digits), rnd(b[3], digits)) for b in sorted(x)],
             [(rnd(b[0], digits), rnd(b[1], digits), rnd(b[2], digits), rnd(b[3], digits)) for b in sorted(m)]) for x, m in out]


def from_toml(path):
    t = tomllib.loads(path.read_text())
    f = lambda bs: [(b["peak_nm"], b["fwhm_per_cm"], b["skew"], b["weight"]) for b in bs]
    return t, [(f(k["excitation"]), f(k["emission"])) for k in t["term"]]


def absolute(t, terms):
    """Function (ex, em) -> Y in photons/nm/photon at concentration 1, Stokes mask included."""
    grid = np.arange(200.0, 1000.5, 1.0)
    x = np.arange(t["excitation_range_nm"][0], t["excitation_range_nm"][1] + 0.5, 1.0)
    is_energy = t.get("unit") == "energy"

    def photons(ex, em):
        m = evaluate(terms, ex, em)
        return m * em[:, None] / ex[None, :] if is_energy else m
    s = t["photon_yield"] / photons(x, grid).sum(0).max()

    def y(ex, em):
        m = s * photons(np.atleast_1d(ex), np.atleast_1d(em))
        return m * (np.atleast_1d(em)[:, None] > np.atleast_1d(ex)[None, :]) if t["stokes"] == "mask" else m
    return y


def write(path, meta, fit, terms, remarks=None):
    grid_x, grid_m = np.arange(250.0, 521.0), np.arange(260.0, 901.0)
    s385 = [profile(x, [385.0])[0] * profile(m, grid_m[grid_m > 385]).sum() for x, m in terms]
    tot = sum(s385) or 1.0
    q = lambda v: '"' + str(v).replace('"', "'") + '"'
    val = lambda v: q(v) if isinstance(v, str) else ("[" + ", ".join(val(t) for t in v) + "]" if isinstance(v, list) else repr(v))
    o = ["# " + ln for ln in wrap(meta.pop("header"))]
    py = wrap("photon_yield: " + meta.pop("yield_comment"))
    for k in ("name", "title", "description", "source", "excitation_range_nm", "emission_range_nm"):
        o.append(f"{k} = {val(meta[k])}")
    o += ["# " + ln for ln in py]
    for k in ("photon_yield", "stokes", "assumed"):
        o.append(f"{k} = {val(meta[k])}")
    o += ["", "[fit]"]
    for k, v in fit.items():
        if isinstance(v, dict):
            o.append(f"{k} = {{ " + ", ".join(f"{a} = {b!r}" for a, b in v.items()) + " }")
        else:
            o.append(f"{k} = {val(v)}")
    for i, (x, m) in enumerate(terms):
        gx = np.arange(250.0, 651.0) if remarks and "wide" in remarks else grid_x
        px, pm = gx[np.argmax(profile(x, gx))], grid_m[np.argmax(profile(m, grid_m))]
        o += ["", f"# excitation peak {px:.0f} nm, emission peak {pm:.0f} nm, {100 * s385[i] / tot:.1f} % of the yield at 385 nm (emission above 385 nm)"]
        r = (remarks or {}).get(i)
        if r:
            o += ["# " + ln for ln in wrap(r)]
        elif s385[i] / tot < 0.005 and px < 345:
            o.append("# ultraviolet only (impurity such as tryptophan, or far-UV excitation): no part in 385-450 nm use")
        o.append("[[term]]")
        for key, bs in (("excitation", x), ("emission", m)):
            o.append(f"{key} = [")
            o += [f"  {{ peak_nm = {b[0]!r}, fwhm_per_cm = {b[1]!r}, skew = {b[2]!r}, weight = {b[3]!r} }}," for b in bs]
            o.append("]")
    path.write_text("\n".join(o) + "\n")


def wrap(s, n=110):
    out, line = [], ""
    for w in s.split():
        if len(line) + len(w) + 1 > n:
            out.append(line)
            line = w
        else:
            line = (line + " " + w).strip()
    return out + [line]


# --------------------------------------------------------------------------- the catalogue
UV = {"ex": (255, 520), "em": (300, 600), "h_ex": (1500, 10000), "h_em": (1500, 10000)}


def limits(ex, em, **more):
    return {**UV, "ex": ex, "em": em, **more}


WEBFLUOR = {
    "nadh": dict(shape=[(4, 3), (2, 2)], seeds=range(0, 8, 2), lim=limits((260, 390), (400, 600))),
    "fad": dict(shape=[(5, 2), (4, 2), (3, 2), (2, 2)], seeds=range(8), lim={**UV, "h_ex": (1200, 10000)}, nfev=120,
                start=[(450, 525), (380, 525), (400, 550), (340, 450)]),
    "collagen": dict(shape=[(3, 2)] * 5, seeds=range(12), lim=UV, nfev=150, anti=0.07,
                     start=[(340, 390), (370, 430), (410, 470), (460, 520), (285, 330)]),
    "elastin": dict(shape=[(3, 2)] * 6, seeds=range(12), lim={**UV, "h_ex": (1500, 10000)}, nfev=150, anti=0.07,
                    start=[(340, 410), (370, 440), (400, 475), (440, 505), (480, 540), (300, 350)]),
    "protoporphyrin_ix": dict(shape=[(6, 5), (4, 4)], seeds=range(0, 8, 2),
                              lim=limits((345, 525), (610, 710), h_ex=(500, 9000), h_em=(200, 3000), h0=800.0)),
}
FILES = {"nadh": "webfluor_nadh", "fad": "webfluor_fad", "collagen": "webfluor_collagen1", "elastin": "webfluor_elastin",
         "protoporphyrin_ix": "webfluor_protoporphyrin"}
DACOSTA = ("DaCosta, Andersson, Wilson 2003, Molecular fluorescence excitation-emission matrices relevant to tissue "
           "spectroscopy, Photochem. Photobiol. 78(4):384, doi 10.1562/0031-8655(2003)078<0384:MFEMRT>2.0.CO;2 (WebFluor database)")
COMMON = ("The model is a fit by this project to the measured excitation-emission matrix of DaCosta et al. 2003 (WebFluor); no "
          "measured value is contained in this file. The unit of those data is not documented: they are taken as photons per nm "
          "per incident photon [assumption; if they were energy, the emission would have to be multiplied by the wavelength]. ")
YIELD = ("[assumed scale] photons out per photon in at the best excitation, concentration 1; a round number chosen so that "
         "concentrations of order 1 are ordinary mucosa (measured tongue: 2e-4 to 1e-3 photon per photon between 500 and 700 nm "
         "at 405 nm). It is an effective surface yield, not a quantum yield.")
TEXT = {
    "nadh": dict(title="NADH", description="Reduced nicotinamide adenine dinucleotide in solution: excitation 350 nm, emission 465 nm.",
                 ex=[250.0, 430.0], em=[380.0, 700.0],
                 header="NADH (free coenzyme in solution). Almost exactly separable; the second term is a small change of the emission "
                        "shape with excitation. Excitation above 430 nm is left out of the validity range: what the data hold there "
                        "(0.1 % of the maximum) follows the excitation light like scatter and is not fitted."),
    "fad": dict(title="FAD", description="Flavin adenine dinucleotide in solution: excitation 370 and 450 nm, emission 525 nm.",
                ex=[250.0, 520.0], em=[400.0, 750.0],
                header="Flavin adenine dinucleotide. The flavin bands (emission near 525 nm) need more than one term because the shape "
                       "of the emission changes slightly with excitation. The term with emission below 480 nm is what the sample "
                       "also showed (impurity, Raman line of the solvent). The fall of "
                       "the excitation between 470 and 480 nm is steeper than flavin absorption; elastin of the same database drops at "
                       "the same place, so part of it is the instrument."),
    "collagen": dict(title="Collagen I", description="Collagen type I powder: cross-links 340/390, 370/430 nm and a weak tail to 520 nm.",
                     ex=[250.0, 520.0], em=[290.0, 750.0],
                     header="Collagen type I (webfluor sample collagen1). Not separable: a rank-1 model is 27 % wrong. Several cross-link "
                            "species, whose emission slides to the red with excitation, plus aromatic amino acids below 310 nm. Cells "
                            "within 25 nm of the excitation carry a Rayleigh tail of the powder: they count in the errors below but do "
                            "not pull the fit, so that scattered light is not taken for fluorescence; the model is an extrapolation there."),
    "elastin": dict(title="Elastin", description="Elastin powder: emission slides from 420 nm (excitation 340) over 460 (385) to 515 nm (excitation 470).",
                    ex=[250.0, 520.0], em=[290.0, 750.0],
                    header="Elastin. Far from separable (a rank-1 model is 46 % wrong): the emission peak follows the excitation. Cells "
                           "within 25 nm of the excitation carry a Rayleigh tail of the powder: they count in the errors below but do not "
                           "pull the fit; the model is an extrapolation there. The measured yield drops between 470 and 480 nm as FAD of the same database does; part of that "
                           "is probably the instrument."),
    "protoporphyrin_ix": dict(title="Protoporphyrin IX", description="Protoporphyrin IX monomer: Soret excitation 410 nm, emission 631 and 700 nm.",
                              ex=[330.0, 640.0], em=[580.0, 750.0],
                              header="Protoporphyrin IX. The data end at 520 nm excitation and include the first Q band (507 nm); the other "
                                     "Q bands (541, 575, 630 nm) are added with peak absorption ratios to the 505 nm band of 0.82, 0.53, 0.38 (dimethyl "
                                     "ester in chloroform, 14.15 : 11.6 : 7.44 : 5.38 per mM cm, Falk 1964) [literature from memory, widths assumed]. "
                                     "Cells with excitation below 330 nm hold no porphyrin emission (the second-order wedge hides it) and a "
                                     "weak impurity near 320 nm; they count in the error and are not modeled. Bacterial porphyrin on "
                                     "tongues peaks near 635 nm, this sample at 631 nm."),
}


def share(a, b, m):
    return f"{rel(a, b, m):.4f}"


def peaks(terms, x, lo=None, gap=20):
    g = np.arange(lo or x + gap, 900.0, 1.0)
    y = evaluate(terms, [x], g)[:, 0]
    k = [i for i in range(1, g.size - 1) if y[i] > y[i - 1] and y[i] >= y[i + 1] and y[i] > 0.02 * y.max()]
    return [int(g[i]) for i in k] or [int(g[np.argmax(y)])]


def do_webfluor(name, ref, out):
    f = f"eem/{FILES[name]}.csv"
    ex, em, d = load_eem(ref / f)
    mask = cell_mask(ex, em, d)
    cfg = dict(WEBFLUOR[name], fit_gap=FIT_GAP, polish=600)
    terms = tidy(fit_eem(ex, em, d, mask, cfg))
    assumed = ["photon_yield", "units of the data (photons per nm)"]
    if name == "protoporphyrin_ix":
        k = int(np.argmax([profile(x, [507.0])[0] for x, _ in terms]))
        q4 = sum(profile(x, [507.0])[0] * profile(m, np.arange(560.0, 800.0)).sum() for x, m in terms) / profile(terms[k][1], np.arange(560.0, 800.0)).sum()
        add = [(541.0, 650.0, 1.0, 0.82), (576.0, 600.0, 1.0, 0.53), (630.0, 350.0, 1.0, 0.38)]
        terms[k][0].extend((p, h, r, float(f"{w * q4:.5g}")) for p, h, r, w in add)
        assumed += ["excitation bands at 541, 576 and 630 nm"]
    m = evaluate(terms, ex, em)
    vis = mask & (ex[None, :] >= 350)
    g20 = cell_mask(ex, em, d, 20.0)
    t = TEXT[name]
    fit = {"reference": f, "quantity": "eem", "cells": int(mask.sum()),
           "relative_frobenius": float(share(m, d, mask)), "relative_frobenius_350_520": float(share(m, d, vis)),
           "relative_frobenius_gap20": float(share(m, d, g20)),
           "relative_frobenius_gap20_350_520": float(share(m, d, g20 & vis)),
           "mask": {"stokes_gap_nm": STOKES_GAP, "second_order_gap_nm": SECOND_ORDER_GAP},
           "note": "cells that count: data > 0 and em - ex >= stokes_gap_nm and |em - 2 ex| >= second_order_gap_nm (zeros in the data are masked cells); "
                   "error = ||s*model - data|| / ||data||, unweighted, s = one free scale, no Stokes mask needed. "
                   f"The fit itself used em - ex >= {FIT_GAP[0]:.0f} and |em - 2 ex| >= {FIT_GAP[1]:.0f} nm with columns weighted by norm^-1/2; "
                   "the cells nearer to the excitation hold a tail of scattered light. gap20: the same error with stokes_gap_nm = 20."}
    write(out / f"{name}.toml",
          dict(header=t["header"] + " " + COMMON, name=name, title=t["title"], description=t["description"], source=DACOSTA,
               excitation_range_nm=t["ex"], emission_range_nm=t["em"], photon_yield=1e-3, yield_comment=YIELD, stokes="mask", assumed=assumed),
          fit, terms, {"wide": 1} if name == "protoporphyrin_ix" else None)


def do_keratin(ref, out):
    """Relative energy at six excitations -> photons per photon: times lambda_o / lambda_i (equal excitation energy)."""
    f = "eem/wuqu2006_keratin_6ex.csv"
    ex, em, d = load_eem(ref / f)
    d = d * em[:, None] / ex[None, :]
    d = d / np.nanmax(d)
    mask = cell_mask(ex, em, d, 0.0, 0.0)
    cfg = dict(shape=[(1, 2)] * 4, seeds=range(0, 16), nfev=200, polish=600, fit_gap=(0.0, 0.0), floor=0.05, anti=0.1,
               lim={"ex": (320, 490), "em": (390, 620), "h_ex": (4200, 9000), "h_em": (2000, 8000)},
               start=[(345, 410), (375, 450), (410, 490), (450, 530)])
    terms = tidy(fit_eem(ex, em, d, mask, cfg))
    m = evaluate(terms, ex, em)
    fit = {"reference": f, "quantity": "eem", "cells": int(mask.sum()), "relative_frobenius": float(share(m, d, mask)),
           "relative_frobenius_350_520": float(share(m, d, mask)), "mask": {"stokes_gap_nm": 0.0, "second_order_gap_nm": 0.0},
           "note": "cells that count: all that are not empty; data converted before the comparison: value * em_nm / ex_nm (energy to photons, see header); "
                   "one free overall scale, unweighted error. Columns weighted by norm^-1/2 in the fit. The first 5-10 nm of each curve "
                   "may be cut by the long-pass filter of the measurement."}
    write(out / "keratin.toml",
          dict(header="Keratin, the visible band (the 290/350 nm aromatic band has no part in 350 nm and above). Fitted to the six emission "
                      "curves of Wu & Qu 2006, display magnification removed. They are relative energy; they were converted to photons "
                      "(times emission wavelength). The normalization between excitations is not stated: curves are taken as emitted energy per "
                      "equal excitation ENERGY, therefore divided by the excitation wavelength to get photons per photon [assumption; with equal "
                      "excitation photons instead, 473 nm would be a factor 1.33 stronger relative to 355 nm]. Excitation between and "
                      "beyond the six wavelengths (355, 375, 405, 435, 457, 473 nm) is interpolation by smooth bands.",
               name="keratin", title="Keratin (visible band)", description="Keratin of epithelial tissue, excitation 355-473 nm, emission sliding from 415 to 530 nm.",
               source="Wu & Qu 2006, J. Biomed. Opt. 11(5):054023", excitation_range_nm=[350.0, 480.0],
               emission_range_nm=[385.0, 700.0], photon_yield=1e-3, yield_comment=YIELD, stokes="mask",
               assumed=["photon_yield", "excitation normalization (equal energy)", "emission unit (energy)"]), fit, terms)


def do_chlorophyll(ref, out):
    xa, ya = load_xy(ref / "fluorophores/raw/photochemcad_chlorophyll_a_absorption.csv")
    xm, ym = load_xy(ref / "fluorophores/raw/photochemcad_chlorophyll_a_emission.csv")
    gx, gm = np.arange(350.0, 700.5, 2.0), np.arange(600.0, 800.5, 2.0)
    ya, ym = np.interp(gx, xa, ya), np.interp(gm, xm, ym)
    x = fit_profile(1e7 / gx, np.maximum(ya, 0), 11, (330, 720), (250, 6000), 1.6)
    m = fit_profile(1e7 / gm, np.maximum(ym, 0), 5, (600, 800), (150, 3000), 1.8)
    conv = lambda p: [(1e4 / q[0], np.exp(q[1]), np.exp(q[2]), np.exp(q[3])) for q in p]
    terms = tidy([(conv(x), conv(m))])
    a, b = profile(terms[0][0], gx), profile(terms[0][1], gm)
    one = lambda u, v: float(np.linalg.norm((u @ v) / (u @ u) * u - v) / np.linalg.norm(v))
    full = rel(np.outer(b, a), np.outer(ym, ya), np.ones((gm.size, gx.size), bool))
    fit = {"reference": "fluorophores/raw/photochemcad_chlorophyll_a_absorption.csv", "quantity": "spectra", "cells": int(gx.size + gm.size),
           "relative_frobenius": float(f"{full:.4f}"), "relative_excitation": float(f"{one(a, ya):.4f}"), "relative_emission": float(f"{one(b, ym):.4f}"),
           "emission_reference": "fluorophores/raw/photochemcad_chlorophyll_a_emission.csv",
           "note": "both curves interpolated linearly to 2 nm (absorption 350-700, emission 600-800 nm), each with a free scale; "
                   "relative_frobenius is that of the outer product of the two"}
    write(out / "chlorophyll_a.toml",
          dict(header="Chlorophyll a in solution (food residue, coating; seen at 675 nm on some tongues). Excitation is taken as proportional to "
                      "absorption (thin layer, quantum yield independent of wavelength) [assumption], emission as photons per nm [assumption]. The absorption curve "
                      "behind the fit has its blue maximum at 417.75 nm with extra bands near 505 and 535 nm: signs of some pheophytin in the "
                      "sample; pure chlorophyll a lies at 430 nm. In leaves and coating the red emission is near 680 nm, here 671 nm.",
               name="chlorophyll_a", title="Chlorophyll a", description="Chlorophyll a (solution): excitation 418 and 660 nm, emission 671 and 719 nm.",
               source="PhotochemCAD (Du et al. 1998, Photochem. Photobiol. 68:141) by way of omlc.org, compound 122", excitation_range_nm=[350.0, 700.0],
               emission_range_nm=[600.0, 800.0], photon_yield=1e-3, yield_comment=YIELD, stokes="mask",
               assumed=["photon_yield", "excitation = absorption", "emission unit (photons)"]), fit, terms, {"wide": 1})


def spectra_of(file):
    x, y = load_xy(file)
    return x, np.maximum(y, 0.0)


def do_pair(name, out, ex, em, files, text, excitation_bands, emission_bands, limits):
    """One excitation and one emission spectrum, photons, each on a grid of its own, fitted by bands."""
    (gx, yx), (gm, ym) = ex, em
    x = fit_profile(1e7 / gx, yx, excitation_bands, limits["ex"], (250, 8000), 1.8)
    m = fit_profile(1e7 / gm, ym, emission_bands, limits["em"], (150, 6000), 1.8)
    conv = lambda p: [(1e4 / q[0], np.exp(q[1]), np.exp(q[2]), np.exp(q[3])) for q in p]
    terms = tidy([(conv(x), conv(m))])
    a, b = profile(terms[0][0], gx), profile(terms[0][1], gm)
    one = lambda u, v: float(np.linalg.norm((u @ v) / (u @ u) * u - v) / np.linalg.norm(v))
    full = rel(np.outer(b, a), np.outer(ym, yx), np.ones((gm.size, gx.size), bool))
    fit = {"reference": files[0], "quantity": "spectra", "cells": int(gx.size + gm.size),
           "relative_frobenius": float(f"{full:.4f}"), "relative_excitation": float(f"{one(a, yx):.4f}"),
           "relative_emission": float(f"{one(b, ym):.4f}"), "emission_reference": files[1], "note": text.pop("note")}
    write(out / f"{name}.toml", dict(text, name=name, photon_yield=1e-3, yield_comment=YIELD, stokes="mask"), fit, terms, {"wide": 1})


def photon_excitation(path, gx, gm):
    """Photons out per photon in against excitation, of a model of the catalogue, whatever its unit."""
    text, terms = from_toml(path)
    energy = text.get("unit", "photons") == "energy"
    emitted = lambda m: (profile(m, gm) * (gm if energy else 1.0)).sum()
    return sum(profile(x, gx) * emitted(m) for x, m in terms) / (gx if energy else 1.0)


def do_lipopigment(ref, out):
    """Relative energy -> photons: emission times its wavelength, excitation (signal per energy) over its wavelength."""
    files = ["derived/monici2005_lipopigments_excitation_axis_corrected.csv", "fluorophores/raw/monici2005_lipopigments_emission.csv"]
    xx, yx = spectra_of(ref / files[0])
    xm, ym = spectra_of(ref / files[1])
    gx, gm = np.arange(320.0, 480.5, 2.0), np.arange(452.0, 740.5, 2.0)
    slope = np.log(ym[-3] / ym[-1]) / (xm[-1] - xm[-3])
    tail = ym[-1] * np.exp(-slope * (gm - xm[-1]))
    e = np.where(gm <= xm[-1], np.interp(gm, xm, ym), tail)
    do_pair("lipopigment", out, (gx, np.interp(gx, xx, yx) / gx), (gm, e * gm), files,
            dict(header="Lipopigment (lipofuscin): the orange emitter that tongues show beside the five usual fluorophores. Emission and "
                        "excitation of Monici 2005, as digitized, the excitation on its corrected axis. Both are taken as energy and were converted to "
                        "photons [assumption]. The data end at 660 nm, at a tenth of the peak; the rest is an exponential tail of the "
                        "slope of the last points [assumption]. Aggregated flavin has nearly the same spectrum, so the name stands for "
                        "whatever emits there.",
                 title="Lipopigment", description="Lipopigment (orange emitter, assumed): excitation 346 and 430 nm, emission 560 nm.",
                 source="Monici 2005, Biotechnol. Annu. Rev. 11:227 (digitized)", excitation_range_nm=[320.0, 480.0],
                 emission_range_nm=[452.0, 740.0], assumed=["photon_yield", "emission and excitation unit (energy)", "emission above 660 nm"],
                 note="both curves interpolated linearly to 2 nm (excitation 320-480, emission 452-740 nm with the tail), in photons, each with a "
                      "free scale; relative_frobenius is that of the outer product of the two"),
            5, 4, {"ex": (300, 500), "em": (440, 760)})


def do_flavin_aggregate(ref, out):
    """Emission of FAD powder under 450 nm light, with the excitation of FAD in solution."""
    file = "fluorophores/raw/valdez2022_fad_450light_475filter_emission.csv"
    xm, ym = spectra_of(ref / file)
    gm = np.arange(500.0, 730.5, 2.0)
    gx = np.arange(340.0, 500.5, 2.0)
    do_pair("flavin_aggregate", out, (gx, photon_excitation(out / "fad.toml", gx, np.arange(490.0, 700.0))), (gm, np.interp(gm, xm, ym) * gm), ["eem/webfluor_fad.csv", file],
            dict(header="Flavin as a powder, an orange emitter: emission of FAD powder under 450 nm light behind a 475 nm long-pass (Valdez laboratory, "
                        "2022), taken as energy. Excitation is that of fad of this catalogue [assumption; under 450 nm the powder "
                        "gave 1.7 times the light that it gave under 405 nm, of lights whose powers are not known]. Aggregated flavin in "
                        "tissue is a guess; the name stands for whatever emits there.",
                 title="Aggregated flavin", description="Flavin powder (orange emitter, assumed): excitation 370 and 450 nm, emission 580 nm.",
                 source="S. Wang and J. Farrell, Valdez laboratory, 2022-12-20 (FAD powder); excitation as fad",
                 excitation_range_nm=[340.0, 500.0], emission_range_nm=[500.0, 730.0],
                 assumed=["photon_yield", "excitation = FAD in solution", "emission unit (energy)"],
                 note="emission interpolated linearly to 2 nm (500-730 nm) in photons; excitation: the model of fad, every 2 nm from 340 to 500 nm; each "
                      "with a free scale; relative_frobenius is that of the outer product of the two"),
            5, 4, {"ex": (320, 520), "em": (480, 760)})


def do_biofilm_porphyrin(ref, out):
    """Emission in the mouth, wider than in solution, with the excitation of protoporphyrin IX in solution."""
    file = "fluorophores/raw/bjurshammar2017_porphyrin_emission.csv"
    xm, ym = spectra_of(ref / file)
    gm = np.arange(604.0, 750.5, 2.0)
    gx = np.arange(340.0, 650.5, 2.0)
    do_pair("biofilm_porphyrin", out, (gx, photon_excitation(out / "protoporphyrin_ix.toml", gx, np.arange(560.0, 800.0))), (gm, np.interp(gm, xm, ym) * gm), ["eem/webfluor_protoporphyrin.csv", file],
            dict(header="Porphyrin of bacteria in a biofilm: emission as measured on oral bacteria (Bjurshammar 2017, digitized, taken as energy "
                        "[assumption]), 636 and 702 nm, redder and wider than protoporphyrin IX in solution. Excitation is that of "
                        "protoporphyrin_ix of this catalogue [assumption].",
                 title="Porphyrin of a biofilm", description="Porphyrin of oral biofilm: Soret excitation 410 nm, emission 636 and 702 nm.",
                 source="Bjurshammar 2017, Porphyrins and Phototherapy of Oral Bacteria (thesis, digitized); excitation as protoporphyrin_ix",
                 excitation_range_nm=[340.0, 640.0], emission_range_nm=[604.0, 750.0],
                 assumed=["photon_yield", "excitation = protoporphyrin IX in solution", "emission unit (energy)"],
                 note="emission interpolated linearly to 2 nm (604-750 nm) in photons; excitation: the model of protoporphyrin_ix, every 2 nm from "
                      "340 to 650 nm; each with a free scale; relative_frobenius is that of the outer product of the two"),
            11, 5, {"ex": (330, 660), "em": (600, 760)})


def do_biofilm_chlorophyll(ref, out):
    """chlorophyll_a of this catalogue with its emission 4 nm to the red."""
    text, terms = from_toml(out / "chlorophyll_a.toml")
    shifted = tidy([(x, [(p + 4.0, h, r, w) for p, h, r, w in m]) for x, m in terms])
    fit = {"reference": "", "quantity": "spectra", "cells": 0, "relative_frobenius": 0.0,
           "note": "not a fit of its own: the model of chlorophyll_a with its emission moved by 4 nm; 0 stands for 'no comparison'"}
    write(out / "biofilm_chlorophyll.toml",
          dict(header="Chlorophyll and pheophytin of plant food in the coating of a tongue: chlorophyll_a of this catalogue with its emission 4 nm "
                      "to the red, 675 nm, where tongues show it (strong in one of four people, clear in a second). [assumed]",
               name="biofilm_chlorophyll", title="Chlorophyll of a coating", description="Chlorophyll of food in a coating: excitation 418 and 660 nm, emission 675 nm.",
               source=text["source"], excitation_range_nm=text["excitation_range_nm"], emission_range_nm=text["emission_range_nm"],
               photon_yield=1e-3, yield_comment=YIELD, stokes="mask",
               assumed=["photon_yield", "excitation = absorption", "emission unit (photons)", "shift of the emission"]), fit, shifted, {"wide": 1})


# Teeth: no matrix has been measured; the model is a chain of bands that slide together.
TOOTH_EX = [322.6, 341.3, 362.3, 386.1, 413.2, 444.4, 480.8]   # steps of 1700 /cm
TOOTH = {
    "dentin": dict(amp=[0.85, 1.0, 1.0, 0.86, 0.66, 0.42, 0.18], em=[396, 410, 434, 461, 489, 515, 546], h=4200.0, rho=1.30, y=2e-2),
    "enamel": dict(amp=[0.9, 1.0, 0.98, 0.82, 0.62, 0.38, 0.15], em=[394, 409, 433, 460, 489, 517, 548], h=4600.0, rho=1.40, y=7e-3),
}


def do_tooth(name, out):
    t = TOOTH[name]
    terms = tidy([([(x, 2800.0, 1.0, a)], [(float(p), t["h"], t["rho"], 1.0)]) for x, a, p in zip(TOOTH_EX, t["amp"], t["em"])])
    fit = {"reference": "", "quantity": "eem", "cells": 0, "relative_frobenius": 0.0,
           "note": "not a fit: no matrix of teeth has been measured by the sources at hand; 0 stands for 'no comparison'"}
    write(out / f"{name}.toml",
          dict(header=f"Sound {name}: a model, not a fit. Tooth fluorescence is not separable: the emission peak follows the excitation by 50 to 75 nm "
                      "(red-edge effect, J. Biomed. Opt. 16:071411). Seven terms whose excitation bands are 1700 /cm apart (Gaussian, 2800 /cm wide, so "
                      "that their sum is smooth) and whose emission bands slide with them. Excitation envelope: broad maximum at 340-370 nm as in Wozniak & Moore 1978, "
                      "with a tail to 500 nm because teeth are bright under 405 nm and visible under 450 nm lights [assumed]. Emission near 440 nm under UV, "
                      "480 nm under 405 nm (one source reports 533 nm for enamel there; radiance of three subjects under a 395 nm LED shows 480-485 nm). Dentin is "
                      "about three times as bright as enamel (Lee 2015: 3x). Scale: the same radiances give 0.7e-2 to 1.3e-2 photons above 435 nm per "
                      "incident photon for whole front teeth (enamel over dentin), between the two values used here.",
               name=name, title=name.capitalize(), description=f"Sound {name}, emission follows excitation by 50-75 nm (model).",
               source="model after J. Biomed. Opt. 16:071411 (2011), Wozniak & Moore 1978 J. Dent. Res., Lee 2015; level from tooth radiance under a 395 nm LED",
               excitation_range_nm=[320.0, 490.0], emission_range_nm=[350.0, 750.0], photon_yield=t["y"],
               yield_comment="[assumed] photons out per photon in at the best excitation, concentration 1 = a sound tooth tissue in bulk. Two values so that whole teeth "
                             "fall between them and the ratio is three.",
               stokes="mask", assumed=["photon_yield", "excitation envelope", "emission peak and width of every term"]), fit, terms)


PAIRS = {"lipopigment": do_lipopigment, "flavin_aggregate": do_flavin_aggregate, "biofilm_porphyrin": do_biofilm_porphyrin,
         "biofilm_chlorophyll": do_biofilm_chlorophyll}
ALL = list(WEBFLUOR) + ["keratin", "chlorophyll_a", "dentin", "enamel"] + list(PAIRS)


def report(out):
    print(f"{'name':18s} {'all':>7s} {'350-520':>8s}  peaks at 385 / 405 / 450 nm,  500-700 nm yield at 405 nm (concentration 1)")
    for name in ALL:
        p = out / f"{name}.toml"
        if not p.exists():
            continue
        t, terms = from_toml(p)
        y = absolute(t, terms)
        g = np.arange(500.0, 700.5, 1.0)
        v = y([405.0], g)
        v = 0.5 * (v[1:] + v[:-1]).sum()
        f = t["fit"]
        print(f"{name:18s} {f['relative_frobenius']:7.4f} {f.get('relative_frobenius_350_520', float('nan')):8.4f}  "
              f"{peaks(terms, 385.0)} {peaks(terms, 405.0)} {peaks(terms, 450.0)}  {v:.3e}")


def main():
    ap = argparse.ArgumentParser(description="Fit the analytic fluorophore catalogue.")
    ap.add_argument("reference", type=pathlib.Path, help="folder of reference spectra")
    ap.add_argument("--out", type=pathlib.Path,
                    default=pathlib.Path(__file__).resolve().parent.parent / "crates/fluorspar-experiment/data/fluorophores")
    ap.add_argument("--only", default="", help="comma-separated names; 'none' only reports")
    a = ap.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    for name in a.only.split(",") if a.only else ALL:
        if name == "none":
            continue
        print(name, flush=True)
        if name in WEBFLUOR:
            do_webfluor(name, a.reference, a.out)
        elif name == "keratin":
            do_keratin(a.reference, a.out)
        elif name == "chlorophyll_a":
            do_chlorophyll(a.reference, a.out)
        elif name in PAIRS:
            PAIRS[name](a.reference, a.out)
        else:
            do_tooth(name, a.out)
    report(a.out)


if __name__ == "__main__":
    main()
