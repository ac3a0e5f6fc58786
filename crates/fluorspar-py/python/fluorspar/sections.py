"""Sections of an experiment as nested dictionaries, for editors and type checkers, and the names of the catalogue.

``e: fs.sections.Experiment = {"format": 1, "base": "oraleye-2021", "render": {"samples_per_pixel": 4}}``; :func:`fluorspar.experiment`
takes it. Which fields are needed, and which go together, depends on the base and is checked there. Written by generate_sections.py.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, TypedDict

DesignProblemName: TypeAlias = Literal[
    'devices',
    'tongue-camera',
    'two-lights',
    'two-lights-tissue',
]

ExperimentName: TypeAlias = Literal[
    'bioscreen-like',
    'dark-spots',
    'flat-patch',
    'fluorescent-sphere',
    'goccles-like',
    'identafi-like',
    'oraleye-2021',
    'oraleye-2021-surface',
    'oraleye-pi-2025',
    'oralid-like',
    'qlf-like',
    'smartphone-405',
    'velscope-like',
]

FilterName: TypeAlias = Literal[
    'absorbing_long_pass_450',
    'absorbing_long_pass_500',
    'absorbing_long_pass_550',
    'band_pass_440_40',
    'band_pass_470_20',
    'band_pass_470_40',
    'band_pass_505_20',
    'band_pass_525_20',
    'band_pass_525_45',
    'band_pass_550_20',
    'band_pass_595_20',
    'band_pass_615_20',
    'band_pass_632_22',
    'band_pass_635_50',
    'band_pass_695_30',
    'dichroic_450',
    'ir_cut_700',
    'long_pass_400',
    'long_pass_410',
    'long_pass_420',
    'long_pass_430',
    'long_pass_440',
    'long_pass_441_y44',
    'long_pass_450',
    'long_pass_460',
    'long_pass_470',
    'long_pass_475',
    'long_pass_480',
    'long_pass_488_k2',
    'long_pass_490',
    'long_pass_500',
    'long_pass_510',
    'long_pass_520',
    'long_pass_530',
    'long_pass_540',
    'long_pass_550',
    'long_pass_560',
    'long_pass_580',
    'long_pass_600',
    'long_pass_620',
    'long_pass_640',
    'long_pass_660',
    'long_pass_680',
    'none',
    'notch_405',
    'short_pass_370',
    'short_pass_380',
    'short_pass_390',
    'short_pass_400',
    'short_pass_410',
    'short_pass_420',
    'short_pass_425',
    'short_pass_430',
    'short_pass_440',
    'short_pass_450',
    'short_pass_460',
    'short_pass_470',
    'short_pass_475',
    'short_pass_480',
    'short_pass_490',
    'short_pass_500',
    'short_pass_510',
    'short_pass_520',
    'short_pass_530',
    'short_pass_540',
    'short_pass_655',
    'uv_ir',
    'view_425_700',
    'view_475_700',
]

FlatSampleName: TypeAlias = Literal[
    'tongue-385nm',
    'tongue-tissue-385nm',
]

FluorophoreName: TypeAlias = Literal[
    'aged_varnish',
    'biofilm_chlorophyll',
    'biofilm_porphyrin',
    'chlorophyll_a',
    'collagen',
    'dental_composite',
    'dentin',
    'egfp',
    'elastin',
    'enamel',
    'fad',
    'flavin_aggregate',
    'fluorescein',
    'indocyanine_green',
    'keratin',
    'lipopigment',
    'nadh',
    'protoporphyrin_ix',
    'protoporphyrin_ix_in_tissue',
    'quinine_sulfate',
    'rhodamine_6g',
    'rhodamine_b',
    'riboflavin',
]

GlassName: TypeAlias = Literal[
    'caf2',
    'f2',
    'f5',
    'fused_silica',
    'n_baf10',
    'n_bak4',
    'n_bk7',
    'n_k5',
    'n_lak22',
    'n_lak9',
    'n_lasf9',
    'n_sf1',
    'n_sf10',
    'n_sf11',
    'n_sf5',
    'n_sk16',
    'n_sk2',
    'n_ssk2',
    'pmma',
    'polycarbonate',
    'sf5',
]

LensName: TypeAlias = Literal[
    'descartes_50mm',
    'double_gauss_100mm',
    'doublet_100mm',
    'macro_105mm',
    'tessar_100mm',
    'wide_3_5mm',
]

LightSpectrumName: TypeAlias = Literal[
    'equal_energy',
    'halogen',
    'led_340',
    'led_345',
    'led_350',
    'led_355',
    'led_360',
    'led_365',
    'led_370',
    'led_375',
    'led_380',
    'led_385',
    'led_390',
    'led_395',
    'led_400',
    'led_405',
    'led_410',
    'led_415',
    'led_420',
    'led_425',
    'led_430',
    'led_435',
    'led_440',
    'led_445',
    'led_450',
    'led_455',
    'led_460',
    'led_465',
    'led_470',
    'led_475',
    'led_480',
    'led_485',
    'led_490',
    'led_495',
    'led_500',
    'room_led',
    'white_led',
]

MetalName: TypeAlias = Literal[
    'aluminum',
    'copper',
    'gold',
    'iron',
    'silver',
    'stainless_steel',
]

QuantumEfficiencyName: TypeAlias = Literal[
    'consumer_rgb_cmos',
    'monochrome_cmos',
    'rgb_nir_cmos',
]

ReflectanceName: TypeAlias = Literal[
    'black',
    'cheek',
    'dental_amalgam',
    'dental_composite',
    'dentin',
    'enamel',
    'floor_of_mouth',
    'fungiform_papilla',
    'gingiva',
    'gray_18',
    'lip',
    'mucosa_pale',
    'mucosa_red',
    'palate',
    'skin',
    'soft_palate',
    'tongue_dorsum',
    'tongue_ventral',
    'tooth_incisor',
    'tooth_neck',
    'white_reference',
]

SensorName: TypeAlias = Literal[
    'lyu_2021_table_1',
    'monochrome_3_45um',
    'monochrome_4_8um',
    'multispectral_16_band',
    'multispectral_3x3',
    'multispectral_8_band',
    'pi_camera_3',
    'rgb_nir_3um',
]

StateOfTissueName: TypeAlias = Literal[
    'amalgam_tattoo',
    'candidiasis',
    'carcinoma',
    'dysplasia_mild',
    'dysplasia_moderate',
    'dysplasia_severe',
    'hemangioma',
    'hyperemia',
    'inflammation',
    'keratosis',
    'leukoplakia_homogeneous',
    'leukoplakia_nonhomogeneous',
    'ulcer',
]

TissueName: TypeAlias = Literal[
    'buccal_mucosa',
    'canine',
    'dorsal_tongue',
    'dorsal_tongue_b',
    'facial_skin',
    'floor_of_mouth',
    'gingiva',
    'hard_palate',
    'lateral_tongue',
    'lip',
    'soft_palate',
    'tooth',
    'ventral_tongue',
]

SpectralSection: TypeAlias = "EdgeBins | UniformBins"
"""Wavelength bins: `first_nm`, `last_nm` and `step_nm`, or `edges_nm`."""

StatisticsKind: TypeAlias = "Literal['none', 'light_groups', 'components']"
"""Sums whose statistics a render keeps besides the components."""

ComponentBands: TypeAlias = "Literal['all', 'basis']"
"""How a render keeps the spectra of each component."""

LensOrNumber: TypeAlias = "float | Literal['from_lens']"
"""A number, or "from_lens"."""

LensSection: TypeAlias = "LensSectionIdeal | LensSectionTraced"
"""The types of lenses, each with its fields."""

SpectrumReference: TypeAlias = "float | NameOrTable | SpectrumTable | MatlabSpectrum | CurveModel"
"""A spectrum: a number, a name of the catalogue, the path of a CSV or MATLAB file, a table with `csv` or `mat` (one column of
a file), or an equation such as { type = "led", ... }."""

NameOrTable: TypeAlias = "str"
"""A name of the catalogue or the path of a CSV file."""

FilePath: TypeAlias = "str"
"""Path of a file, relative to the file that names it."""

TableUnit: TypeAlias = "Literal['fraction', 'percent', 'od', 'db', 'a_per_w', 'photons', 'counts', 'energy']"
"""Unit of the values of a table."""

CurveModel: TypeAlias = "CurveModelConstant | CurveModelTable | CurveModelLed | CurveModelBands | CurveModelEdges | CurveModelSigmoids | CurveModelBlackbody | CurveModelBloodDiffuse"
"""A spectral curve given by an equation. All wavelengths and widths are in nm, in vacuum and at normal incidence. The value
has the unit that the file around the curve states (relative power, transmittance, reflectance, electrons per photon)."""

Side: TypeAlias = "Literal['short', 'long']"
"""The short-wavelength or the long-wavelength side."""

Vignetting: TypeAlias = "Literal['none', 'cos4']"
"""How irradiance falls off away from the optical axis."""

NameOrFile: TypeAlias = "str"
"""A name of the catalogue or the path of a file."""

ImageFormation: TypeAlias = "Literal['rendered', 'point_spread']"
"""How a traced lens makes its image."""

FilterAngles: TypeAlias = "Literal['fixed', 'lens']"
"""At which angles light passes the viewing filters."""

FilterPosition: TypeAlias = "Literal['front', 'rear']"
"""Where the viewing filters are."""

EfficiencyReference: TypeAlias = "NameOrTable | EfficiencyColumns | dict[str, SpectrumReference]"
"""A name of the catalogue, the path of a CSV file with one column per channel, or a table with one spectrum per channel."""

ShutterKind: TypeAlias = "Literal['global', 'rolling']"
"""How rows begin and end their exposure."""

BinningKind: TypeAlias = "Literal['charge', 'digital_sum', 'digital_average']"
"""How pixels are joined."""

SensorMode: TypeAlias = "SensorModePhysical | SensorModeNoiseFree | SensorModeIsetcam"
"""Which equations turn mean electrons into digital numbers."""

LightFrame: TypeAlias = "Literal['scene', 'camera']"
"""Frame of positions and directions of a light."""

Aim: TypeAlias = "AimDirection | AimLookAtMm"
"""Where a light shines: a `direction` or a point, `look_at_mm`."""

SourceStrength: TypeAlias = "SourceStrengthPowerMw | SourceStrengthIrradianceWPerM2AtDistanceMm"
"""Strength of a light: `power_mw`, or `irradiance_w_per_m2` with `at_distance_mm`."""

ConeEdge: TypeAlias = "Literal['smooth_step', 'fourth_power']"
"""How the intensity falls between the angles of a cone, over `t`, which falls from 1 to 0 evenly in the cosine."""

EnvironmentMapReference: TypeAlias = "FilePath | TurnedMap"
"""The path of an equirectangular map, or a table of `file` and `rotation_deg`. Rows from the top (+y); the middle lies toward
-z, the right half toward +x."""

FluorophoreSource: TypeAlias = "str | MatrixSource | TableSource | MatSource | SpectraSource"
"""A name of the catalogue, or a table with `eem_csv`, `csv`, `mat`, or `excitation_csv` and `emission_csv`."""

YieldUnit: TypeAlias = "Literal['photons', 'energy']"
"""Unit of the values of a measured matrix or emission spectrum."""

Stokes: TypeAlias = "Literal['mask', 'off']"
"""Whether light may be emitted at wavelengths shorter than those that excite it. Stokes' observation is a mask, not a law:
warm molecules have real anti-Stokes tails. It is on by default, as in the paper (section 3.2)."""

EmptyCells: TypeAlias = "Literal['refuse', 'zero', 'interpolate']"
"""Treatment of empty cells."""

TextureReference: TypeAlias = "float | TextureTable"
"""A number, or a map such as { image = "x.png" }, { checker = [8, 8] } or { noise = [5, 5] }."""

TextureTable: TypeAlias = "ImageMap | CheckerMap | NoiseMap | TongueMap | AnatomyMap"
"""A map over texture coordinates."""

SurfaceMap: TypeAlias = "Literal['redness', 'fungiform', 'pallor', 'porphyrin', 'plaque', 'dentin', 'crown', 'dryness']"
"""A map of the anatomy."""

Tissue: TypeAlias = "Literal['tongue_dorsum', 'tongue_ventral', 'gingiva', 'tooth', 'hard_palate', 'soft_palate', 'throat', 'floor_of_mouth', 'cheek', 'lip', 'skin']"
"""Tissue of a part, which selects its material."""

ReflectanceReference: TypeAlias = "SpectrumReference | list[ReflectanceTermSection]"
"""A reflectance: a number from 0 to 1, a name of the catalogue, the path of a CSV file, a table that describes a spectrum, or
a list of { spectrum, weight }."""

MetalReference: TypeAlias = "str | MetalIndex"
"""A metal of the catalogue, or a table of `n` and `k`."""

EmissionSides: TypeAlias = "Literal['both', 'front']"
"""Sides of a surface that emit."""

ConcentrationFactor: TypeAlias = "float | PaintedMask"
"""A factor on all concentrations of a fluorophore, or a mask that is painted on a finished render, such as { mask =
"patch.png", inside = 3.0 }."""

ExposureTime: TypeAlias = "float | Literal['auto']"
"""A number of milliseconds, or "auto"."""

Demosaicing: TypeAlias = "Literal['bilinear', 'gradient_corrected']"
"""How the colors that a pixel does not see are found."""

RegionReference: TypeAlias = "list[int] | SensorRegionSection"
"""A rectangle of the sensor, [column, row, width, height], or a table of parts and shapes, such as { mask = "spot.png" }."""

BulkReference: TypeAlias = "str | dict[str, float]"
"""The name of a material, or a table of concentrations."""


class EdgeBins(TypedDict, total=False):
    """Bins between edges."""

    edges_nm: list[float]
    """Edges of the bins, nm, increasing; one more than there are bins."""


class UniformBins(TypedDict, total=False):
    """Bins of one width."""

    first_nm: float
    """Center of the first bin, nm, 200 to 1200. Default 350."""
    last_nm: float
    """Center of the last bin, nm, 200 to 1200. Default 750."""
    step_nm: float
    """Width of a bin, nm. Default 5."""


class RenderSection(TypedDict, total=False):
    """Image size, samples and limits of the render."""

    width_px: int
    """Columns of the radiance image, 1 to 16384. Default 320."""
    height_px: int
    """Rows of the radiance image, 1 to 16384. Default 240."""
    samples_per_pixel: int
    """Light paths per pixel, 1 to 1 000 000. Default 64."""
    max_depth: int
    """Most surfaces that a path may meet, 1 to 1000. 1 is direct light only. Default 8."""
    seed: int
    """Seed of all random numbers of the render and of the noise. Default 1."""
    time_limit_s: float
    """Seconds after which rendering stops with the samples it has. Default: no limit."""
    memory_limit_gib: float
    """Most memory that the images of the render may take, GiB, 0.001 to 1024. Default 8."""
    statistics: StatisticsKind
    """Statistics of the samples: `none`, `light_groups` or `components`. Two half-buffers and the variance of each; memory
    grows by 16 bytes per pixel and band for each. Default `none`."""
    relative_error: float
    """Relative error, 1e-4 to 0.5, at which a tile of 16 x 16 pixels gets no more samples; `samples_per_pixel` is the most
    that it gets. Default: none, all pixels get the same."""
    error_captures: list[str]
    """Names of captures whose sensor channels must all reach `relative_error`. Default: all captures that have light."""
    error_range_nm: list[float]
    """Range of wavelengths, nm, whose radiance must reach `relative_error`, for each light group alone. Instead of
    `error_captures`."""
    excitation_basis_nm: list[float]
    """First and last peak wavelength, nm, of light sources that shall be exchangeable after the render, such as [340, 500]:
    light groups whose light lies there are kept apart by excitation wavelength, so that `capture` and `analyze` follow a
    change of their spectrum, filters and power. Default: none."""
    component_bands: ComponentBands
    """How the spectra of each component are kept: `basis`, coefficients from which all bands follow to a tenth of a percent,
    in an eighth of the values, or `all` bands. With `statistics`, `relative_error` or `excitation_basis_nm` all are kept.
    Default `basis`."""
    regularize: bool
    """Mirror light that was scattered before no sharper than a roughness of 0.2 would, as pbrt's integrator does by the same
    name: few specks from wet surfaces, whose caustics are blurred. Default false: without bias."""


class CameraSection(TypedDict, total=False):
    """Where the radiance image is rendered from."""

    position_mm: list[float]
    """Position of the entrance pupil, mm. Default [0, 0, 100]."""
    look_at_mm: list[float]
    """Point in the middle of the image, mm. Default [0, 0, 0]."""
    up: list[float]
    """Direction that is up in the image. Default [0, 1, 0]."""
    horizontal_field_deg: LensOrNumber
    """Horizontal field of view, degrees, at least 1e-6 and below 179, or "from_lens": what `lens` and `sensor` see. Default
    "from_lens"."""
    aperture_mm: LensOrNumber
    """Diameter of the aperture, mm, or "from_lens": focal length over f-number of an ideal lens. What lies off the plane in
    focus blurs, and so does everything by diffraction (Airy pattern at 550 nm). The plane in focus is that of the lens, or
    else goes through `look_at_mm`. With "from_lens" another f-number or focus of the lens can be tried on a finished render,
    which keeps its blur. Default 0: a pinhole, all is sharp."""
    parallel_width_mm: float
    """Width of the image in the scene, mm, where all rays are parallel (an orthographic camera, for a scene without lens and
    sensor); takes the place of the field of view. Default: none."""


class LensSectionIdeal(TypedDict, total=False):
    """Without aberrations. The type of a lens that names none."""

    type: Literal['ideal']
    focal_length_mm: float
    """Focal length, mm, above 0. Default 3."""
    f_number: float
    """Focal length over the diameter of the axial beam, 0.5 to 1000. Default 4."""
    transmittance: SpectrumReference
    """Transmittance of the glass, without filters. Default 1."""
    vignetting: Vignetting
    """How irradiance falls off away from the axis. Default "cos4"."""
    focus_distance_mm: float
    """Distance of the plane in focus from the camera's position, mm, beyond the focal length. Default: the distance from
    camera to `look_at_mm`."""


class SpectrumTable(TypedDict, total=False):
    """One column of a table, as instruments and spreadsheets write it. The header names the unit of the values; transmittances
    and reflectances become fractions, lights power per nm, quantum efficiencies electrons per photon."""

    csv: FilePath
    """Path of the file."""
    column: str
    """Header of the column. Default: the only one, that which the instrument computed, or the first."""
    unit: TableUnit
    """Unit of the values. Default: what the header says."""
    scale: float
    """Factor on the values; without a unit, on those that the file holds, whatever its header says. Default 1."""
    outside: float
    """Value at wavelengths beyond the data, where else there is nothing. A viewing filter needs it where a light shines beyond
    its data."""


class MatlabSpectrum(TypedDict, total=False):
    """One column of a MATLAB file of spectra, as ISET saves them: variables `wavelength` (nm) and `data`, a column a spectrum."""

    mat: FilePath
    """Path of the file, version 5 to 7.3."""
    column: int
    """Number of the column of `data`, from 1 up. Default 1."""
    scale: float
    """Factor on the values, for instance 0.01 for percent. Default 1."""


class CurveModelConstant(TypedDict, total=False):
    """The same value at every wavelength."""

    type: Literal['constant']
    value: float
    """The value."""


class CurveModelTable(TypedDict, total=False):
    """Linear interpolation between points; 0 outside the first and the last one."""

    type: Literal['table']
    wavelength_nm: list[float]
    """Wavelengths in nm, rising."""
    value: list[float]
    """One value for each wavelength."""


class CurveModelLed(TypedDict, total=False):
    """Spectrum of a light-emitting diode, 1 at its peak. With `x = lambda - peak_nm` and `w` the full width of the side on
    which `x` lies, `core = exp(-ln 2 |2 x / w|^shape)` and `S = core + (1 - core) * sum of level * exp(-|x| / decay_nm)` over
    the tails of that side. A Gaussian (`shape` 2) with two widths is the usual model of an LED; the exponential tails stand
    for phonon-assisted and defect emission, which a Gaussian misses by orders of magnitude."""

    type: Literal['led']
    peak_nm: float
    """Wavelength of the peak in nm."""
    fwhm_short_nm: float
    """Twice the half width at half maximum of the core on the short-wavelength side, nm."""
    fwhm_long_nm: float
    """Twice the half width at half maximum of the core on the long-wavelength side, nm."""
    shape: float
    """Exponent of the core: 2 is a Gaussian, less is more pointed, more is flatter. 1 to 10."""
    tails: list[Tail]
    """Exponential tails; none leaves the core alone."""


class Tail(TypedDict, total=False):
    """One exponential tail of [`CurveModel::Led`]."""

    side: Side
    """Side of the peak on which the tail lies."""
    level: float
    """Height relative to the peak to which the tail extrapolates at the peak wavelength."""
    decay_nm: float
    """Distance in nm over which the tail falls to 1/e."""


class CurveModelBands(TypedDict, total=False):
    """Sum of Gaussians with two widths over a constant: `base + sum of weight * exp(-ln 2 (2 (lambda - peak) / w)^2)`, `w` by
    the side of the peak."""

    type: Literal['bands']
    base: float
    """Constant below the bands."""
    bands: list[Band]
    """The bands."""


class Band(TypedDict, total=False):
    """One band of [`CurveModel::Bands`]."""

    peak_nm: float
    """Wavelength of the peak in nm."""
    fwhm_short_nm: float
    """Twice the half width at half maximum on the short-wavelength side, nm."""
    fwhm_long_nm: float
    """Twice the half width at half maximum on the long-wavelength side, nm."""
    weight: float
    """Value at the peak."""


class CurveModelEdges(TypedDict, total=False):
    """Transmittance of a filter made of edges and notches: `T = floor + (peak - floor) * product of edges * product of (1 -
    notch)`, `floor = 10^-optical_density`. A long-pass edge is `1 / (1 + exp(-(lambda - cut) / s))` with `s = width / (2 ln
    9)`, so that `cut` is its 50 % point and `width` reaches from 10 % to 90 %; a short-pass edge is its mirror image. A notch
    is `exp(-ln 2 (2 (lambda - center) / fwhm)^6)`."""

    type: Literal['edges']
    peak: float
    """Transmittance in the middle of a wide pass band."""
    optical_density: float
    """Optical density of the blocking bands; the transmittance never falls below `10^-optical_density`."""
    edges: list[Edge]
    """The edges; a long-pass and a short-pass one make a band-pass."""
    notches: list[Notch]
    """Stop bands inside the pass band."""


Edge = TypedDict(
    "Edge",
    {
        'pass': "Side",
        'cut_nm': "float",
        'width_nm': "float",
    },
    total=False,
)


class Notch(TypedDict, total=False):
    """One stop band of [`CurveModel::Edges`]."""

    center_nm: float
    """Middle of the stop band in nm."""
    fwhm_nm: float
    """Full width at half depth in nm."""


class CurveModelSigmoids(TypedDict, total=False):
    """Sum of logistic steps over a constant: `base + sum of height / (1 + exp(-(lambda - center) / s))`, `s = width / (2 ln
    9)`; never below 0."""

    type: Literal['sigmoids']
    base: float
    """Value far below the first step."""
    steps: list[Step]
    """The steps; a negative height steps down."""


class Step(TypedDict, total=False):
    """One step of [`CurveModel::Sigmoids`]."""

    center_nm: float
    """Wavelength in nm at which half of the step is done."""
    width_nm: float
    """Distance in nm between 10 % and 90 % of the step."""
    height: float
    """Change of the value across the step; may be negative."""


class CurveModelBlackbody(TypedDict, total=False):
    """Spectral radiance of a black body by Planck's law, relative to its value at `reference_nm`: `(reference / lambda)^5 *
    (exp(c2 / (reference T)) - 1) / (exp(c2 / (lambda T)) - 1)`."""

    type: Literal['blackbody']
    temperature_k: float
    """Temperature in K."""
    reference_nm: float
    """Wavelength in nm at which the value is 1."""


class CurveModelBloodDiffuse(TypedDict, total=False):
    """Diffuse reflectance of tissue perfused with blood, see [`BloodDiffuse`]."""

    type: Literal['blood_diffuse']
    scattering_per_cm: float
    """Reduced scattering coefficient at 500 nm in 1/cm."""
    scattering_power: float
    """Exponent with which scattering falls with wavelength."""
    background_per_cm: float
    """Absorption of the bloodless tissue at 500 nm in 1/cm."""
    background_decay_nm: float
    """Distance in nm over which the background absorption falls to 1/e."""
    blood_fraction: float
    """Volume fraction of blood (and myoglobin, as blood) in the deep tissue, 0 to 1."""
    saturation: float
    """Oxygen saturation, 0 to 1."""
    vessel_radius_um: float
    """Effective radius of the deep vessels in um; 0 spreads the blood evenly."""
    superficial_blood_um: float
    """Thickness in um to which the blood of the superficial capillaries would add up."""
    hemoglobin_g_per_l: float
    """Hemoglobin in whole blood, g/L."""
    refractive_index: float
    """Refractive index of the tissue, 1 to 2."""
    melanin_depth: float
    """Optical depth of the melanin at 500 nm for the way in and out together."""


class LensSectionTraced(TypedDict, total=False):
    """Surfaces and glasses, traced."""

    type: Literal['traced']
    prescription: NameOrFile
    """A lens of the catalogue, or the path of a lens file (.toml, .dat of pbrt, .json of ISET, .zmx of Zemax)."""
    focal_length_mm: float
    """Focal length, mm, above 0, to which the lens is scaled. Default: that of the prescription."""
    f_number: float
    """Focal length over the diameter of the axial beam, 0.5 to 1000. Default: wide open."""
    transmittance: SpectrumReference
    """Transmittance of the glass, without filters. Default 1."""
    focus_distance_mm: float
    """Distance of the plane in focus from the camera's position, mm, beyond the focal length. Default: the distance from
    camera to `look_at_mm`."""
    film_shift_mm: float
    """Shift of the film from the paraxial focus, away from the lens, mm. Default 0."""
    image_formation: ImageFormation
    """How it makes its image. Default "rendered"."""
    band_groups: int
    """Groups of bands that are traced apart, 1 to 64, to see dispersion; a render takes as many times as long. Default 1: all
    bands at the design wavelength."""


class ViewFilterSection(TypedDict, total=False):
    """Filters in front of the lens, or behind it."""

    filters: list[SpectrumReference]
    """Transmittances that are multiplied. Default: none."""
    angle_deg: float
    """Angle at which light passes them, degrees, 0 to 60; interference filters pass shorter wavelengths there. Default 0."""
    angles: FilterAngles
    """At which angles light passes them. Default "fixed"."""
    position: FilterPosition
    """Where they are; has an effect with `angles = "lens"` only. Default "front"."""
    effective_index: float
    """Effective refractive index, 1 to 4, of those filters that have none of their own (CSV files and equations). Default:
    they do not move with the angle."""
    autofluorescence: AutofluorescenceSection
    """Fluorescence of the filters themselves. Default: none."""


class AutofluorescenceSection(TypedDict, total=False):
    """Fluorescence of the viewing filter itself."""

    photon_yield: float
    """Photons emitted per photon that the filters stop, 0 to 1."""
    spectrum: SpectrumReference
    """Emission spectrum, photons per nm, any scale."""


class SensorSection(TypedDict, total=False):
    """Sensor: a preset of the catalogue and fields that override it."""

    preset: str
    """Sensor of the catalogue whose fields hold where this section gives none. On a base or by an override, another preset
    than before takes the place of the whole section: size, quantum efficiency and all. Default: Table 1 of Lyu et al. 2021."""
    quantum_efficiency: EfficiencyReference
    """Quantum efficiency: a name of the catalogue, the path of a CSV file with one column per channel of the mosaic, { csv =
    "FILE", unit = "percent" } of one in another unit, or a table of spectra by channel. Default "consumer_rgb_cmos"."""
    filters: list[SpectrumReference]
    """Filters on the sensor, for instance an infrared cut. Default: none."""
    columns: int
    """Columns of pixels."""
    rows: int
    """Rows of pixels."""
    mosaic: list[list[str]] | str
    """Repeating cell of the color filter array: channel names by row, or letters such as "grbg", or "mono"."""
    pixel_size_um: float
    """Side of a (square) pixel, um."""
    fill_factor: float
    """Share of the pixel's area that collects light."""
    aperture_um: float
    """Side of the square that collects light, um, for its share in the sharpness; the sensitivity is that of the fill factor
    (physical mode only). Default: the pixel size, as behind microlenses."""
    well_capacity_e: float
    """Electrons that a pixel holds (physical mode only; ISETCam clips at the voltage swing)."""
    well_knee: float
    """Share of the well up to which every electron is collected; above it fewer and fewer are (physical mode only). 1 is a
    hard limit."""
    voltage_swing_v: float
    """Voltage that spans the converter at gain 1, V."""
    conversion_gain_mv_per_e: float
    """Voltage per electron, mV/e-. Default: voltage swing over well capacity."""
    analog_gain: float
    """Analog gain of the base exposure. Physical mode multiplies by it, ISETCam divides by it."""
    analog_offset_mv: float
    """Voltage added by the analog stage, mV (physical mode after the gain, ISETCam before it)."""
    bit_depth: int
    """Bits of the converter."""
    black_level_dn: float
    """Digital number of no light (physical mode only; ISETCam has no pedestal)."""
    read_noise_mv: float
    """Temporal noise before the gain, mV rms. Default 1.39."""
    read_noise_e: float
    """Temporal noise before the gain, e- rms; instead of `read_noise_mv`."""
    post_gain_noise_mv: float
    """Temporal noise after the gain, mV rms at the converter, quantization excluded (physical mode only)."""
    dsnu_mv: float
    """Standard deviation of the pixels' offsets, mV. Default 0.2536."""
    dsnu_e: float
    """Standard deviation of the pixels' offsets, e-; instead of `dsnu_mv`."""
    prnu_percent: float
    """Standard deviation of the pixels' responsivities, percent."""
    column_offset_mv: float
    """Standard deviation of the columns' offsets, mV."""
    column_gain_percent: float
    """Standard deviation of the columns' gains, percent."""
    row_offset_mv: float
    """Standard deviation of the rows' offsets, mV (physical mode only)."""
    column_noise_mv: float
    """Temporal noise that all pixels of a column share, drawn anew for each frame, mV rms before the gain (physical mode
    only)."""
    row_noise_mv: float
    """Temporal noise that all pixels of a row share, drawn anew for each frame, mV rms before the gain (physical mode only)."""
    dark_voltage_mv_per_s: float
    """Dark signal at the reference temperature, mV/s. Default 0.15."""
    dark_current_e_per_s: float
    """Dark signal at the reference temperature, e-/s; instead of `dark_voltage_mv_per_s`."""
    dark_current_log_spread: float
    """Spread of the pixels' dark currents: standard deviation of the logarithm of a log-normal distribution whose mean is the
    dark current (physical mode only)."""
    hot_pixels_per_million: float
    """Hot pixels, in a million (physical mode only)."""
    hot_pixel_dark_current_e_per_s: float
    """Mean of the additional dark currents of hot pixels, which are exponentially distributed, at the reference temperature,
    e-/s."""
    dead_pixels_per_million: float
    """Pixels that do not respond to light, in a million (physical mode only)."""
    temperature_c: float
    """Temperature of the sensor, degrees Celsius."""
    dark_reference_temperature_c: float
    """Temperature at which the dark signal holds, degrees Celsius."""
    dark_doubling_temperature_k: float
    """Temperature step that doubles the dark signal, K (6 to 9 for silicon)."""
    relative_illumination: dict[str, list[float]]
    """Relative illumination by channel name, or by "all": coefficients a1, a2, ... of 1 + a1 x + a2 x^2 + ..., x the squared
    distance from the center over that of a corner. It comes on top of the lens (physical and noise-free mode only)."""
    crosstalk: Crosstalk
    """Crosstalk between neighbors. Default: none."""
    shutter: Shutter
    """Shutter and readout timing. Default: all rows at once."""
    strobe: Strobe
    """Pulsed light. Default: steady light."""
    region_px: list[int]
    """Part of the sensor that is read: column, row, width, height. Default: all of it."""
    binning: Binning
    """Joining of pixels. Default: none."""
    emva1288: Emva1288
    """Electronics and noise as a data sheet after EMVA 1288, in place of the fields that say the same."""
    mode: SensorMode
    """Which equations to use."""
    device_seed: int
    """Seed of everything that belongs to the device and stays from frame to frame."""


class EfficiencyColumns(TypedDict, total=False):
    """A CSV file with one column per channel: `{ csv = "FILE", unit = "percent", scale = 0.9 }`."""

    csv: FilePath
    """Path of the file."""
    unit: TableUnit
    """Unit of the values. Default: what the header says."""
    scale: float
    """Factor on the values, above 0. Default 1."""


class Crosstalk(TypedDict, total=False):
    """Shares of a pixel's electrons that end in its neighbors (physical and noise-free mode only)."""

    optical_side_percent: float
    """Optical crosstalk into each of the four side neighbors at the center of the sensor, percent. Default 0."""
    optical_corner_percent: float
    """Optical crosstalk into each of the four corner neighbors at the center of the sensor, percent. Default 0."""
    optical_edge_factor: float
    """Optical crosstalk in the corners of the sensor over that at its center, 0 to 100. Default 1."""
    electrical_side_percent: list[list[float]]
    """Electrical crosstalk into each of the four side neighbors: pairs of wavelength in nm and percent, wavelengths rising;
    linear between them, constant outside. Default: none."""
    electrical_corner_ratio: float
    """Electrical crosstalk into each of the four corner neighbors over that into a side neighbor, 0 to 1. Default 0."""


class Shutter(TypedDict, total=False):
    """Shutter and readout timing (physical and noise-free mode only). Time 0 is the start of the first row's exposure."""

    type: ShutterKind
    """Global or rolling. Default "global"."""
    row_time_us: float
    """Time from reading one row to reading the next, us, 0 to 1e6. Default 0."""
    parasitic_light_sensitivity: float
    """Parasitic light sensitivity of a global shutter: response of the storage node, in which a row waits to be read, over
    that of the photodiode; 0 to 1. Default 0."""


class Strobe(TypedDict, total=False):
    """Pulsed light, driven by the sensor: all light of a frame is on only then (physical and noise-free mode only)."""

    delay_ms: float
    """Time from the start of the first row's exposure to the pulse, ms; may be negative. Default 0."""
    duration_ms: float
    """Length of the pulse, ms. Default: until the end."""
    frequency_hz: float
    """Pulse width modulation within the pulse, Hz; it begins switched on. Default: none."""
    duty: float
    """Share of each period that the light is on, above 0 and at most 1. Default 1."""


class Binning(TypedDict, total=False):
    """Joining of neighboring pixels of one color (physical and noise-free mode only). Pixels of the same place in the
    repeating cells of the color filter array are joined, so that the result has the same array. Numbers of rows and columns
    must be multiples of the cell times the binning."""

    type: BinningKind
    """Charge, digital_sum or digital_average."""
    columns: int
    """Columns that are joined, 1 to 16."""
    rows: int
    """Rows that are joined, 1 to 16."""
    well_capacity_e: float
    """Electrons that the node holds on which charges are added (charge binning). Default: as many as the pixels do."""


class Emva1288(TypedDict, total=False):
    """A data sheet in the terms of EMVA 1288 (release 4), at gain 1. It takes the place of the fields of the model that say
    the same; geometry, mosaic and everything else stay. Values that follow from others (the reciprocal gain, noise in both
    units, dynamic range, signal-to-noise ratio, threshold) may be given for a check: a sheet that contradicts itself is
    refused."""

    gain_e_per_dn: float
    """Inverse system gain 1/K, e-/DN."""
    gain_dn_per_e: float
    """System gain K, DN/e-; instead of `gain_e_per_dn`."""
    dark_noise_e: float
    """Temporal dark noise, e- rms, quantization excluded."""
    dark_noise_dn: float
    """Temporal dark noise as measured, DN rms, quantization included; instead of `dark_noise_e`."""
    saturation_capacity_e: float
    """Saturation capacity, e-: the mean signal at which the temporal variance is largest. The well that gives it is a little
    larger and is found by calculation."""
    bit_depth: int
    """Bits of the converter, 1 to 16."""
    black_level_dn: float
    """Digital number of no light. Default 64."""
    dark_current_e_per_s: float
    """Dark current, e-/s. Default 0."""
    dark_current_temperature_c: float
    """Temperature of the dark current, degrees Celsius. Default 25."""
    doubling_temperature_k: float
    """Temperature step that doubles the dark current, K. Default 8."""
    dsnu_e: float
    """Dark signal non-uniformity DSNU1288, e-."""
    dsnu_dn: float
    """Dark signal non-uniformity, DN; instead of `dsnu_e`."""
    prnu_percent: float
    """Photo response non-uniformity PRNU1288, percent."""
    quantum_efficiency_percent: float
    """Quantum efficiency of the best channel at `quantum_efficiency_nm`, percent; checked against the curves."""
    quantum_efficiency_nm: float
    """Wavelength of `quantum_efficiency_percent`, nm."""
    dynamic_range_db: float
    """Dynamic range, dB; checked to 1 dB."""
    snr_max_db: float
    """Largest temporal signal-to-noise ratio, dB; checked to 0.5 dB."""
    sensitivity_threshold_e: float
    """Absolute sensitivity threshold, e-; checked to 10 %."""


class SensorModePhysical(TypedDict, total=False):
    """Poisson electrons, full well, fixed patterns that stay, noise before and after the gain, black level."""

    type: Literal['physical']


class SensorModeNoiseFree(TypedDict, total=False):
    """The mean of many frames of the physical chain, as far as whole codes can tell: every random term at its mean, and
    rounding spread over the pixels so that means over them are right."""

    type: Literal['noise_free']


class SensorModeIsetcam(TypedDict, total=False):
    """ISETCam's formulas, peculiarities included; see `isetcam.rs`."""

    type: Literal['isetcam']
    noise_flag: int
    """ISETCam's noise flag: -2 photon noise only and no clipping, -1 nothing, 0 clipping and quantization, 1 also photon
    noise, 2 everything."""


class LightSection(TypedDict, total=False):
    """A light source, or a ring of equal ones."""

    name: str
    """Name, unique among the lights."""
    group: str
    """Lights of one group are switched together and form one excitation channel. Default: the name."""
    spectrum: SpectrumReference
    """Relative spectral power: its scale does not matter, the strength sets it."""
    filters: list[SpectrumReference]
    """Filters on the light, in any order. Default: none."""
    filter_angle_deg: float
    """Angle at which light passes the filters, degrees, 0 to 60; interference filters cut at shorter wavelengths there.
    Default 0."""
    crossed_polarizers: bool
    """Whether the light passes a polarizer, crossed with one of the camera that holds back what wet surfaces and enamel
    mirror, as in dental photography. The strength is then that of light which both let pass. Default false."""
    type: Literal['ring', 'disc', 'annulus', 'rectangle', 'sphere', 'point', 'spot', 'distant', 'environment', 'spectral_environment']
    frame: LightFrame
    """Frame of position and direction. Default "scene"."""
    position_mm: list[float]
    """Center, mm. Default: the origin of its frame."""
    aim: Aim
    """Where it shines. Default: forward in the frame of the camera, otherwise needed."""
    count: int
    """Number of emitters, 1 to 10 000. Default 8."""
    ring_radius_mm: float
    """Radius of the circle on which the centers of the emitters lie, mm."""
    radius_mm: float
    """Radius of each emitter, mm."""
    start_angle_deg: float
    """Angle of the first emitter from the x axis of the ring, degrees. Default 0."""
    aim_distance_mm: float
    """Distance in front of the ring at which its emitters aim, mm. Default: they aim parallel to its axis."""
    half_angle_deg: float
    """Angle from the axis at which the radiant intensity is one half, degrees, 2.2 to 60. Default 60 (Lambertian)."""
    strength: SourceStrength | DistantStrength | EnvironmentStrength
    """Power or irradiance."""
    inner_radius_mm: float
    """Radius of the hole, mm; smaller than `radius_mm`."""
    size_mm: list[float]
    """Width and height, mm."""
    cone_deg: list[float]
    """A cone in place of a power of the cosine: angles from the axis up to which the radiant intensity is even, and from which
    on there is none, degrees, 0 to 180."""
    edge: ConeEdge
    """How the intensity falls between the angles of the cone. Default "smooth_step"."""
    map: EnvironmentMapReference
    """Gray map of the radiance. Default: the same everywhere."""


class AimDirection(TypedDict, total=False):
    """A direction."""

    direction: list[float]
    """The direction, of any length."""


class AimLookAtMm(TypedDict, total=False):
    """A point."""

    look_at_mm: list[float]
    """The point, mm."""


class SourceStrengthPowerMw(TypedDict, total=False):
    """By its power."""

    power_mw: float
    """Radiant power of each emitter before the filters, mW, over 200 to 1200 nm."""


class SourceStrengthIrradianceWPerM2AtDistanceMm(TypedDict, total=False):
    """By its effect."""

    irradiance_w_per_m2: float
    """Irradiance behind the filters on the axis, from all emitters together, W/m², over 200 to 1200 nm."""
    at_distance_mm: float
    """Distance at which it holds, mm from the center of the light."""


class DistantStrength(TypedDict, total=False):
    """Strength of parallel light."""

    irradiance_w_per_m2: float
    """Irradiance behind the filters on a surface that faces the light, W/m², over 200 to 1200 nm."""


class EnvironmentStrength(TypedDict, total=False):
    """Strength of light from everywhere."""

    radiance_w_per_sr_m2: float
    """Radiance behind the filters, W/(sr m²), over 200 to 1200 nm; with a map that of white."""


class TurnedMap(TypedDict, total=False):
    """A map and its turn."""

    file: FilePath
    """Path of the map: a gray PNG image, or a spectral image (.exr, .npy) for a spectral environment."""
    rotation_deg: float
    """Turn about +y, degrees: at 90 the middle lies toward -x. Default 0."""


class FluorophoreSection(TypedDict, total=False):
    """A fluorophore."""

    name: str
    """Name by which materials refer to it."""
    title: str
    """Name for people. Default: that of the source."""
    source: FluorophoreSource
    """Where its spectra come from."""
    photon_yield: float
    """Photons out per photon in at the best excitation, at concentration 1, before the Stokes mask; above 0, at most 1.
    Default: that of the catalogue; needed for files."""
    stokes: Stokes
    """Whether emission below the excitation wavelength is masked. Default: as in the catalogue, otherwise "mask"."""
    allow_negative: bool
    """Take negative values of its files as zero instead of refusing them. Default false."""
    allow_anti_stokes: bool
    """Accept values of a matrix below their excitation, scattered light for instance, which the Stokes mask then leaves out,
    instead of refusing them. Default false; with stokes = "off" they are part of the matrix."""
    empty_cells: EmptyCells
    """What becomes of empty cells of a matrix. Default "refuse"."""


class MatrixSource(TypedDict, total=False):
    """A matrix."""

    eem_csv: FilePath
    """Path of a matrix: rows emission, columns excitation, corner cell `em_nm\\ex_nm`."""
    unit: YieldUnit
    """Unit of its values; needed where the file does not state it. "energy" is energy out per energy in, and becomes photons
    by the factor emission over excitation wavelength."""
    sample: str
    """Name of the sample that is meant, of a file of several."""


class TableSource(TypedDict, total=False):
    """Excitation and emission in one table."""

    csv: FilePath
    """Path of a table with the columns `wavelength_nm`, `excitation`, `emission`; or `NAME ex`, `NAME em`."""
    unit: YieldUnit
    """Unit of the values, of emission and excitation alike. Default "photons"."""
    sample: str
    """Name of the dye that is meant, of a file of several."""


class MatSource(TypedDict, total=False):
    """A file of isetfluorescence."""

    mat: FilePath
    """Path of a MATLAB file of isetfluorescence."""
    unit: YieldUnit
    """Unit of the values. Default "photons"."""


class SpectraSource(TypedDict, total=False):
    """Excitation and emission in tables of their own."""

    excitation_csv: FilePath
    """Path of a table whose first column of values is the excitation spectrum."""
    emission_csv: FilePath
    """Path of a table whose first column of values is the emission spectrum."""
    unit: YieldUnit
    """Unit of the values, of emission and excitation alike. Default "photons"."""


class TissueSection(TypedDict, total=False):
    """Layered tissue with blood and depth: a site of the catalogue, in some state, with other parameters; or layers that are
    described one by one."""

    name: str
    """Name by which materials and samples refer to it."""
    site: NameOrFile
    """Site that it starts from: of the catalogue, for instance "dorsal_tongue", or the path of a site file (.toml). Without it
    `layer` describes the tissue."""
    states: list[str]
    """States of a site, for instance "inflammation", applied one after the other. Default: none."""
    parameters: dict[str, float]
    """Parameters of a site by name, each in the unit that ends its name, for instance `epithelium_thickness_um = 250.0`. They
    take the place of those of the site in its state. Default: none."""
    layer: list[TissueLayerSection]
    """The layers in place of a site, the uppermost first; with a site what its layers hold in addition, a dye for instance."""
    refractive_index: float
    """Refractive index of layers that do not state their own, 1 to 3. Default 1.4 (mucosa)."""
    index_below: float
    """Refractive index of what lies below the last layer, 1 to 3; nothing returns from there, but its surface reflects.
    Default: that of the last layer."""


class TissueLayerSection(TypedDict, total=False):
    """One homogeneous layer of tissue, or an addition to the layer of a site."""

    name: str
    """Name, unique in its tissue; with a site that of its layer, for instance "basal layer"."""
    thickness_um: float
    """Thickness, um, 0.1 to 1e6. 1 mm = 1000 um. Layers of a site have their own."""
    scattering: LayerScatteringSection
    """How it scatters. Layers of a site have their own."""
    absorption: LayerAbsorptionSection
    """What absorbs in it. Default: nothing."""
    fluorophores: dict[str, LayerFluorophoreSection]
    """What fluoresces in it, by the name of a `[[fluorophore]]` or of the catalogue. Default: nothing."""
    refractive_index: float
    """Refractive index, 1 to 3. Default: that of the tissue."""


class LayerScatteringSection(TypedDict, total=False):
    """Scattering of a layer: `scattering_per_mm` or `reduced_per_mm`, a number that follows a power law or a spectrum."""

    anisotropy: float
    """Anisotropy factor of Henyey and Greenstein, the mean cosine of the scattering angle, -0.99 to 0.995."""
    scattering_per_mm: SpectrumReference
    """Scattering coefficient, 1/mm, 0 to 40, not reduced by the anisotropy: the value at `at_nm`, or a spectrum."""
    reduced_per_mm: SpectrumReference
    """Reduced scattering coefficient, that times (1 - anisotropy), 1/mm, 0 to 10: the value at `at_nm`, or a spectrum."""
    at_nm: float
    """Wavelength of a coefficient that is a number, nm, 200 to 1200. Default 500."""
    power: float
    """A coefficient that is a number falls as (wavelength / at_nm)^-power, 0 to 4. Default 0."""


class LayerAbsorptionSection(TypedDict, total=False):
    """What absorbs in a layer; the coefficients add up."""

    blood: BloodSection
    """Blood in vessels. Default: none."""
    melanin: VolumeSection
    """Melanosomes (Jacques 2013). Default: none."""
    water: VolumeSection
    """Water. Default: none."""
    beta_carotene: CaroteneSection
    """Beta-carotene, as in hexane. Default: none."""
    background: BackgroundSection
    """Tissue without blood and pigment. Default: none."""
    curves: dict[str, SpectrumReference]
    """Absorption coefficients (natural logarithm) of anything else by name, spectra in 1/mm, 0 to 400; 1/cm = 0.1/mm. Default:
    none."""


class BloodSection(TypedDict, total=False):
    """Blood in vessels."""

    volume_fraction: float
    """Volume of blood per volume of tissue, 0 to 1; mucosa has 0.002 to 0.1."""
    saturation: float
    """Oxygen saturation, 0 to 1. Default 0.9 (assumed)."""
    hemoglobin_g_per_l: float
    """Hemoglobin in whole blood, g/l, 50 to 250. Default 150."""
    vessel_radius_um: float
    """Radius of the vessels, um, 0 (blood is spread evenly) to 1000. Default 4 (capillaries)."""


class VolumeSection(TypedDict, total=False):
    """Something that fills a share of the volume."""

    volume_fraction: float
    """Its volume per volume of tissue, 0 to 1."""


class CaroteneSection(TypedDict, total=False):
    """Beta-carotene."""

    concentration_umol_per_l: float
    """Concentration, umol/l, 0 to 100; plasma has 0.1 to 2."""


class BackgroundSection(TypedDict, total=False):
    """An absorption that falls exponentially with the wavelength."""

    absorption_per_mm: float
    """Absorption coefficient at `at_nm`, 1/mm, 0 to 0.8; soft tissue has 0.01 to 0.3."""
    at_nm: float
    """Wavelength of that value, nm, 200 to 1200. Default 420."""
    slope_per_nm: float
    """It falls as exp(-slope_per_nm (wavelength - at_nm)), 1/nm, 0 to 0.05. Default 0.00835 (fitted to tongues)."""


class LayerFluorophoreSection(TypedDict, total=False):
    """A fluorophore in a layer: `strength_per_mm`, or the concentration of a dye."""

    concentration_umol_per_l: float
    """Concentration, umol/l, of a dye of the catalogue whose molar absorption and quantum yield are published (`catalog show
    fluorophore`). Its own absorption is added to that of the layer."""
    strength_per_mm: float
    """Absorption coefficient of the fluorophore at `at_nm` times its quantum yield, 1/mm, 0 to 400; mucosa has 1e-5 to 1e-2."""
    at_nm: float
    """Wavelength of that value, nm, 200 to 1200; the fluorophore must be excited there. Default 405."""
    quantum_yield: float
    """Quantum yield, 0.001 to 1: the absorption that the emission implies is added to that of the layer. Default: the layer's
    absorption holds it already."""


class MaterialSection(TypedDict, total=False):
    """A material."""

    name: str
    """Name by which objects refer to it."""
    opacity: TextureReference
    """Opacity (alpha mask), 0 to 1; 0 is a hole. That of a mixture multiplies those of its parts. Default 1."""
    normal_map: NormalMapSection
    """Directions of the normal over the surface. That of a mixture holds for parts without one. Default: those of the shape."""
    type: Literal['diffuse', 'tissue', 'dielectric', 'conductor', 'mix', 'two_sided']
    reflectance: ReflectanceReference
    """Diffuse reflectance."""
    gloss: GlossSection
    """Clear layer on top. Default: none."""
    concentrations: dict[str, TextureReference]
    """Concentration of each fluorophore, relative to the unit of the catalogue, 0 or more. On a base, fluorophores that are
    not named here keep their concentration; give 0 to leave one out. Default: none."""
    tissue: str
    """Name of a `[[tissue]]`, or of a site of the catalogue."""
    vary: dict[str, TextureReference]
    """Factors on parameters of the tissue over the surface, by name, at most 3: `superficial_blood_fraction = { noise = [8,
    8], low = 0.5, high = 3.0 }`. Amounts of fluorophores are `concentrations`. Default: none."""
    translucent: bool
    """Whether light leaves at some distance from where it enters, so that edges are soft; otherwise it leaves where it enters.
    Default: true."""
    refractive_index: float
    """Refractive index against air, above 1 to 3; the same for all wavelengths."""
    roughness: TextureReference
    """GGX roughness, 0 to 1; below 0.01 the surface is smooth. Default 0."""
    transmittance: SpectrumReference
    """Share of light that crosses the surface without being absorbed there, a spectrum from 0 to 1. Default 1."""
    single_scattering: bool
    """Whether light is lost that a rough surface scatters more than once, as in renderers without it. Default false."""
    metal: MetalReference
    """Refractive index."""
    first: str
    """Name of the first material."""
    second: str
    """Name of the second material."""
    amount: TextureReference
    """Share of the second one, 0 to 1."""
    front: str
    """Name of the material on the side of the geometric normal."""
    back: str
    """Name of the material on the other side."""


class ImageMap(TypedDict, total=False):
    """A gray image."""

    image: FilePath
    """Path of a gray PNG image: black is `low`, white is `high`."""
    srgb: bool
    """Whether the image is stored with the sRGB curve; otherwise its numbers are linear. Default false."""
    low: float
    """Lowest value of the map. Default 0."""
    high: float
    """Highest value of the map. Default 1."""
    times: TextureReference
    """Another map by which this one is multiplied."""


class CheckerMap(TypedDict, total=False):
    """A checkerboard."""

    checker: list[int]
    """Fields along u and v, 1 to 10 000."""
    low: float
    """Value of the first field. Default 0."""
    high: float
    """Value of the field next to it. Default 1."""
    times: TextureReference
    """Another map by which this one is multiplied."""


class NoiseMap(TypedDict, total=False):
    """Smooth noise."""

    noise: list[float]
    """Cells along u and v, 0.1 to 10 000."""
    seed: int
    """Which noise. Default 1."""
    low: float
    """Lowest value of the map. Default 0."""
    high: float
    """Highest value of the map. Default 1."""
    times: TextureReference
    """Another map by which this one is multiplied."""


class TongueMap(TypedDict, total=False):
    """Porphyrin on the back of the tongue: most along the midline and far back, none at the tip and the sides."""

    dorsal_tongue: DorsalTongueMap
    """Where the porphyrin lies."""
    times: TextureReference
    """Another map by which this one is multiplied."""


class DorsalTongueMap(TypedDict, total=False):
    """Where porphyrin lies on the back of a tongue."""

    peak: float
    """Largest concentration, in the unit of the catalogue; 0.5 to 0.7 is a strong patch."""
    sigma: float
    """Standard deviation across the tongue, as a fraction of its width, 0.01 to 10. Default 0.3 (assumed)."""
    full_at: float
    """Fraction of the length from the tip at which the map reaches its full height, 0.01 to 1. Default 0.6."""
    patchiness: float
    """0 = smooth, 1 = broken into patches. Default 0.6 (assumed)."""
    seed: int
    """Which patches. Default 1."""


class AnatomyMap(TypedDict, total=False):
    """A map of the mouth's anatomy, on the texture coordinates of its parts. Needs a `[mouth]`."""

    anatomy: SurfaceMap
    """Which map: `redness` (vessels, margins), `fungiform` (papillae of the dorsal tongue), `pallor` (keratin, coating),
    `porphyrin` (dorsal tongue), `plaque`, `dentin` and `crown` (teeth), `dryness` (film of saliva)."""
    tissue: Tissue
    """Tissue whose map it is. Default: the tissue that uses the material."""
    seed: int
    """Seed of the map. Default: that of the mouth."""
    low: float
    """Lowest value of the map. Default 0."""
    high: float
    """Highest value of the map. Default 1."""
    times: TextureReference
    """Another map by which this one is multiplied."""


class NormalMapSection(TypedDict, total=False):
    """Directions of the normal over the surface, from an image."""

    image: FilePath
    """Path of an RGB PNG image in tangent space: x along u is red, y along v green, outward blue, each `2 value - 1`."""
    strength: float
    """Factor on the slopes, 0 to 10. Default 1."""


class ReflectanceTermSection(TypedDict, total=False):
    """One term of a reflectance."""

    spectrum: SpectrumReference
    """Reflectance spectrum, 0 to 1."""
    weight: TextureReference
    """Factor over the surface. Default 1."""


class GlossSection(TypedDict, total=False):
    """Clear rough layer on a surface: saliva, enamel gloss."""

    refractive_index: float
    """Refractive index against air, 1 to 3. Default 1.4 (wet mucosa, assumed)."""
    roughness: TextureReference
    """GGX roughness, 0.01 (mirror-like) to 1. Default 0.2 (assumed)."""
    smoothing_mm: float
    """Length over which a liquid film evens out the relief of a mesh, mm, 0.01 to 5: it mirrors by a normal of its own, while
    the surface below keeps its bumps. Of the parts of a mixture the longest counts. Default 0: it follows them."""


class MetalIndex(TypedDict, total=False):
    """Complex refractive index of a metal, `n + ik`."""

    n: SpectrumReference
    """Real part of the refractive index: a number, a table or a CSV file."""
    k: SpectrumReference
    """Extinction coefficient: a number, a table or a CSV file."""


class MouthSection(TypedDict, total=False):
    """A parametric mouth. Its frame: origin between the incisors, +z out of the mouth, +y up, +x to the patient's left."""

    materials: dict[str, str]
    """Material of each tissue (`tongue_dorsum`, `gingiva`, `tooth`, ...), of a kind of teeth (`incisor`, `canine`, `premolar`,
    `molar`) or of a single part (`tooth_11`, `upper_gingiva`, ...). Default: the material that has the name of the tissue."""
    lesion: list[LesionSection]
    """Spots, sores and stains on the parts. Default: none."""
    scan: list[ScanSection]
    """Own scans in place of parts. Default: none."""
    restoration: list[RestorationSection]
    """Fillings and artificial crowns. Default: none."""
    transform: TransformSection
    """Placement of the mouth. Default: in its own frame."""
    view: str
    """Name of a view of `fluorspar mouth view --list`, such as "tongue-out": pose of jaw, tongue and lips (drawn apart as by
    retractors) and place of the camera, as far as this file does not give them. Default: none."""
    person: int
    """Number of a person of `fluorspar mouth sample`, 1 to 4 000 000 000: shape of mouth and teeth, as far as this file does
    not give it, fillings, and tissues, which vary around those of this file. Default: none."""
    jaw_opening_mm: float
    """Distance between the edges of the upper and lower central incisors, mm (default 45, 14 to 60). Adults open to 45-57 mm
    at most; below 35 mm is a restricted opening."""
    overjet_mm: float
    """Distance of the upper incisors in front of the lower ones with the jaws closed, mm (default 2.5, 0 to 8)."""
    tongue_protrusion_mm: float
    """How far the tip of the tongue reaches in front of the lower incisors, mm (default 8, -10 to 25)."""
    tongue_elevation_mm: float
    """How far the middle of the tongue is raised above its resting place, mm (default 0, -5 to 12)."""
    tongue_shift_mm: float
    """How far the tip of the tongue is turned aside, positive to the patient's left, mm (default 0, -20 to 20)."""
    tongue_curl: float
    """How far the tip of the tongue is raised toward the upper incisors, so that its underside, the frenulum and the floor of
    the mouth show (default 0, 0 to 1; needs an opening of 30 mm or more)."""
    tongue_width_mm: float
    """Largest width of the tongue, mm (default 48, 36 to 58; adults 45 to 55, assumed)."""
    tongue_length_mm: float
    """Length of the back of the tongue from the tip to the epiglottis, along the midline, mm (default 82, 65 to 100; 85 in men
    and 79 in women)."""
    tongue_thickness_mm: float
    """Thickness of the tongue body, mm (default 21, 14 to 28; adults 20 to 30, assumed)."""
    lip_opening_width_mm: float
    """Distance between the corners of the mouth, mm (default 60, 42 to 72; 54.5 ± 3.0 in men and 50.2 ± 3.5 in women at rest,
    more when retracted; Farkas)."""
    lip_retraction_mm: float
    """How far the lips are drawn back from the edges of the incisors, mm (default 5, -3 to 11). Negative: the lips cover the
    edges."""
    upper_arch_width_mm: float
    """Width of the upper arch, mm (default 53.5, 44 to 64): distance between the ends of the line of contact points, at the
    distal faces of the second molars. The facial line of the same dental arch is about 8 mm wider."""
    upper_arch_depth_mm: float
    """Depth of the upper arch, mm (default 42, 34 to 54): from the incisors to the ends of the line of contact points. Width
    and depth together must leave room for the teeth."""
    lower_arch_width_mm: float
    """Width of the lower arch, mm (default 50.5, 42 to 62), measured as for the upper one."""
    lower_arch_depth_mm: float
    """Depth of the lower arch, mm (default 40.3, 32 to 52), measured as for the upper one."""
    arch_exponent: float
    """Exponent of the beta function that gives both arches their shape (default 0.5, 0.4 to 0.8): smaller is squarer in front,
    larger more pointed. Braun and others (1998) found 0.8 for a line along the outer faces; the line of contact points is 4 mm
    narrower on each side behind, but not in front, which 0.5 gives."""
    palate_height_mm: float
    """Height of the palate above the plane of the upper teeth at the first molars, mm (default 20, 14 to 26; about 42 % of the
    distance between the molars after Korkhaus)."""
    uvula_length_mm: float
    """Length of the uvula, mm (default 12, 6 to 18; 10 to 15, assumed)."""
    tonsil_size: float
    """Size of the palatine tonsils (default 0.4, 0 to 1): 0 hidden behind the arches, 1 well in front of them."""
    tooth_scale: float
    """Factor on the crown sizes of Wheeler's table (default 1, 0.85 to 1.15)."""
    lower_tooth_factor: float
    """Further factor on the widths of the lower teeth (default 1, 0.94 to 1.08): sets the overall Bolton ratio, which is 91.4
    % for Wheeler's table and 92.3 to 93.4 % in populations."""
    tooth_irregularity: float
    """Factor on the small differences between neighboring teeth in place, turn and size (default 1, 0 to 3)."""
    tooth_shade: float
    """How much more dentin shows through the enamel of all teeth, which makes them darker and yellower (default 0, -0.2 to
    0.8)."""
    plaque: float
    """Factor on the plaque at the gums (default 1, 0 to 3)."""
    missing_teeth: list[int]
    """Teeth that are not there, as FDI numbers (default: the wisdom teeth 18, 28, 38 and 48)."""
    papilla_scale: float
    """Factor on the height of the papillae of the tongue (default 1, 0 to 2; 0 gives a smooth tongue)."""
    seed: int
    """Seed of everything that varies at random (default 1)."""
    detail: float
    """Factor on the number of mesh rows and columns (default 1, 0.25 to 5). The number of triangles grows with its square: 0.4
    gives about 50 000, 1 about 300 000, 4 about 5 000 000."""


class LesionSection(TypedDict, total=False):
    """A spot on a part of the mouth with its own color and fluorophores: an ellipse, or a painted mask."""

    name: str
    """Name, unique among lesions."""
    part: str
    """Part that it is on: `tongue_dorsum`, `cheek_left`, ..."""
    center: list[float]
    """Middle of the ellipse in texture coordinates of the part, 0 to 1. The parts of the back of the tongue share one map.
    Default [0.5, 0.5]."""
    size_mm: list[float]
    """Lengths of the axes of the ellipse, mm, 0.1 to 200. Default [8, 6]."""
    angle_deg: float
    """Turn of the first axis from the direction of u toward that of v, degrees. Default 0."""
    edge_mm: float
    """Width over which it fades out, mm, 0 or more. Default 1."""
    border_irregularity: float
    """Standard deviation of the distance of its border from the middle over that of the ellipse, 0 to 0.5; the area stays.
    Default 0."""
    satellites: int
    """Number of small spots of the same kind around it, 0 to 50. Default 0."""
    seed: int
    """Seed of border and satellites. Default 0."""
    mask: FilePath
    """Path of a gray PNG on the texture coordinates of the part instead of the ellipse: white is inside. Of colors the mean of
    red, green and blue is taken, with a warning."""
    reflectance: SpectrumReference
    """Reflectance inside. Default: that of the part."""
    blood_um: float
    """Extra blood above the reflecting layer, as a layer of whole blood of this thickness, µm, 0 to 200; fluorescence stays.
    Default 0."""
    states: list[str]
    """States of layered tissue inside, for instance "dysplasia_moderate". Default: none."""
    tissue: dict[str, float]
    """Factors on parameters of layered tissue inside, for instance `superficial_blood_fraction = 10.0`. Default: none."""
    concentrations: dict[str, float]
    """Concentrations inside, in the unit of the catalogue, or as factors on what layered tissue holds; fluorophores that are
    not named stay as they are around."""


class ScanSection(TypedDict, total=False):
    """A mesh of one's own in place of parts of the mouth, for instance an intraoral scan."""

    name: str
    """Name of the new part."""
    mesh: FilePath
    """Path of a .ply, .stl, .obj, .gltf or .glb file."""
    replaces: list[str]
    """Parts that it replaces; `tooth_*` stands for all whose names begin so. Default: none."""
    material: str
    """Name of its material."""
    unit_mm: float
    """Length of one unit of the file, mm; 1000 for meters. Default 1."""
    transform: TransformSection
    """Its placement in the frame of the mouth. Default: as given."""


class TransformSection(TypedDict, total=False):
    """Scales, then turns, then moves."""

    translate_mm: list[float]
    """Displacement, mm. Default [0, 0, 0]."""
    rotate_deg: list[float]
    """Turns about the x, then the y, then the z axis, degrees. Default [0, 0, 0]."""
    axis: list[float]
    """Turn about `axis` by `angle_deg`, applied after `rotate_deg`: the axis, of any length. Default: none."""
    angle_deg: float
    """Angle of the turn about `axis`, degrees."""
    scale: float
    """Factor on all lengths, above 0. Default 1."""


class RestorationSection(TypedDict, total=False):
    """A filling or an artificial crown on a tooth, a part of its own."""

    name: str
    """Name of the new part."""
    tooth: int
    """FDI number of the tooth."""
    surfaces: str
    """Its surfaces that are restored, by their letters: m mesial, o occlusal (i incisal), d distal, b buccal (f facial), l
    lingual (p palatal); "mobdl" is a crown."""
    material: str
    """Name of its material."""


class ObjectSection(TypedDict, total=False):
    """A named surface."""

    name: str
    """Name, unique among objects and parts of the mouth."""
    material: str
    """Name of its material."""
    transform: TransformSection
    """Its placement. Default: as given."""
    emission: EmissionSection
    """Light that it emits. Default: none."""
    type: Literal['mesh', 'sphere', 'quad', 'disc', 'box']
    file: FilePath
    """Path of a .ply, .stl, .obj, .gltf or .glb file."""
    unit_mm: float
    """Length of one unit of the file, mm; 1000 for meters. Default 1."""
    displacement: DisplacementSection
    """Relief of the surface. Default: none."""
    instance: list[InstanceSection]
    """Places, before `transform` moves them all. Default: one, as given."""
    instance_file: FilePath
    """Path of a .csv, .txt or .npy file of more places: twelve numbers each, the three rows of `matrix`."""
    center_mm: list[float]
    """Center, mm. Default [0, 0, 0]."""
    radius_mm: float
    """Radius, mm, above 0."""
    corner_mm: list[float]
    """One corner, mm."""
    edge_u_mm: list[float]
    """First edge from the corner, mm."""
    edge_v_mm: list[float]
    """Second edge from the corner, mm."""
    normal: list[float]
    """Direction that it faces, of any length. Default [0, 0, 1]."""
    size_mm: list[float]
    """Lengths of the edges, mm, above 0."""


class EmissionSection(TypedDict, total=False):
    """Light that a surface emits by itself, evenly in all directions."""

    group: str
    """Light group that it belongs to."""
    spectrum: SpectrumReference
    """Relative spectral power: its scale does not matter."""
    radiance_w_per_sr_m2: float
    """Radiance over 200 to 1200 nm, W/(sr m²), above 0."""
    sides: EmissionSides
    """Sides that emit: `"both"`, or `"front"`, that of the geometric normal; the outside of spheres and boxes. The surface
    reflects on both. Default "both"."""


class DisplacementSection(TypedDict, total=False):
    """A surface moved along its normals."""

    map: TextureReference
    """Height over texture coordinates, in units of `amount_mm`: a map of values from 0 to 1."""
    amount_mm: float
    """Height of the value 1, mm, outward; -100 to 100."""
    subdivisions: int
    """How often every triangle is split into four before, 0 to 8. Default 0."""


class InstanceSection(TypedDict, total=False):
    """A place of a mesh: stretches, scales, turns, then moves; or a matrix."""

    stretch: list[float]
    """Factors along the axes of the mesh, none 0; negative ones mirror. Default [1, 1, 1]."""
    scale: float
    """Factor on all lengths, above 0. Default 1."""
    rotate_deg: list[float]
    """Turns about the x, then the y, then the z axis, degrees. Default [0, 0, 0]."""
    axis: list[float]
    """Turn about `axis` by `angle_deg`, applied after `rotate_deg`: the axis, of any length. Default: none."""
    angle_deg: float
    """Angle of the turn about `axis`, degrees."""
    translate_mm: list[float]
    """Displacement, mm. Default [0, 0, 0]."""
    matrix: list[list[float]]
    """Any affine map instead of all these: three rows of four numbers, the last of each a displacement in mm."""
    part: str
    """Part of the image that it belongs to; instances of one name are one part. Default: the name of the object."""
    material: str
    """Material of its part, the same for all instances of the part. Default: that of the object."""


class PaintedMask(TypedDict, total=False):
    """A mask over the rendered image."""

    mask: FilePath
    """Gray or RGB PNG of the proportions of the render, of any size: 1 where it is white, 0 where it is black; values between
    mix. Of RGB the brightest channel counts."""
    inside: float
    """Factor inside, 0 to 1e6."""
    outside: float
    """Factor outside, 0 to 1e6. Default 1."""


class CaptureSection(TypedDict, total=False):
    """One exposure of the sensor."""

    name: str
    """Name, unique among the captures: letters, digits, `_`, `-`, `+`, `.` and spaces between them; files carry it."""
    light_groups: dict[str, float]
    """Light groups that are on, with their drive relative to the stated power, 0 or more. Default: all dark."""
    exposure_ms: ExposureTime
    """Exposure time in milliseconds, 1e-6 to 3 600 000, or "auto". Default "auto"."""
    auto_exposure: AutoExposure
    """Target of automatic exposure. Default: the 99th percentile of the pixels at 80 % of saturation, 0.01 to 1000 ms."""
    gain: float
    """Analog gain, 0.01 to 1000. Default 1."""
    filters: list[SpectrumReference]
    """Filters in front of the sensor in this capture only, at normal incidence, multiplied: a place of a filter wheel.
    Default: none."""
    subtract: str
    """Name of an earlier capture whose image is subtracted, scaled by exposure time: ambient light. Default: none."""
    bracket_ev: list[float]
    """Further exposures of the same view and gain, in stops (factors of two in time) from the exposure time, -16 to 16; all of
    them are merged to one frame of higher dynamic range, weighted by their noise. At most 31. Default: none."""
    light_on_ms: float
    """How long the lights are on, ms, 1e-6 to 3 600 000: what the safety assessment counts. Default: the sum of the exposure
    times."""


class AutoExposure(TypedDict, total=False):
    """Chooses the exposure that puts a percentile of the pixels at a fraction of full scale. It looks at the mean image, dark
    signal included, never at a noisy one: the same scene gives the same time."""

    percentile: float
    """Percentile of the pixels that is put at the target; 100 is the brightest pixel."""
    target_fraction: float
    """Target as a fraction of the electrons between black and saturation."""
    min_exposure_ms: float
    """Shortest exposure, ms."""
    max_exposure_ms: float
    """Longest exposure, ms."""


class MotionSection(TypedDict, total=False):
    """How the image moves on the sensor between exposures: a hand that holds the camera, a tongue that does not keep still.
    The whole image shifts, evenly. With a global shutter it is at rest within an exposure; with a rolling shutter it drifts on
    while row after row is exposed, so that it leans and blurs. Rotation and parallax are left out."""

    drift_px_per_s: list[float]
    """Steady motion of the image, pixels of the sensor per second: to the right, downward; -1e6 to 1e6. Default [0, 0]."""
    jitter_px: float
    """Random shift of each exposure, standard deviation in either direction, pixels, 0 to 1000. Default 0."""
    interval_ms: float
    """Time between the end of an exposure and the start of the next, ms, 0 to 1e6. Default 200."""


class DevelopSection(TypedDict, total=False):
    """How raw frames become linear channels."""

    demosaic: Demosaicing
    """Interpolation of the colors: "bilinear", or "gradient_corrected" (Malvar, He, Cutler 2004; Bayer arrays only). Default
    "bilinear"."""
    dark_frames: int
    """Dark frames that are averaged and subtracted in place of the black level, for each exposure time and gain, 0 to 1000.
    Default 0: none are taken."""
    flat_field: FlatFieldSection
    """Flat field that every frame is divided by. Default: none."""
    bad_pixel_sigma: float
    """Pixels whose dark signal or response lies farther from the others than this many robust standard deviations are replaced
    by their neighbors, 1 to 1000; needs dark frames or a flat field. Default: none are replaced."""


class FlatFieldSection(TypedDict, total=False):
    """Frames of even light from which the response of each pixel, the shading of the lens and bad pixels are known."""

    frames: int
    """Frames that are averaged, 1 to 1000. Default 16."""
    level: float
    """Signal of the brightest channel on the axis, share of full scale, 0.01 to 0.95. Default 0.5."""
    spectrum: SpectrumReference
    """Spectrum of the light, of any scale. Default "equal_energy"."""


class SpectroradiometerSection(TypedDict, total=False):
    """A spectroradiometer in the place of the camera, pointed at a spot or at parts of the scene. The defaults describe a spot
    instrument of the class of the PR-670; noise floor, dynamic range and stray light are assumed."""

    name: str
    """Name, unique among the spectroradiometers."""
    capture: str
    """Capture whose lights are on."""
    aim: list[float]
    """Where the middle of the spot lies in the image, from its left and its top edge, 0 to 1. Default: the middle, unless
    `parts` are given."""
    parts: list[str]
    """Parts of the scene over which the reading is averaged, by object name, instead of a spot."""
    acceptance_deg: float
    """Full angle of the round spot, degrees, 0.01 to 60. Default 1."""
    filters: list[SpectrumReference]
    """Filters in front of the instrument. Default: none."""
    first_nm: float
    """First wavelength that is read, nm, 200 to 1200. Default 380."""
    last_nm: float
    """Last wavelength that is read, nm, 200 to 1200. Default 780. Wavelengths whose slit reaches beyond the rendered bands are
    left out."""
    step_nm: float
    """Spacing of the readings, nm, 0.1 to 100. Default 2."""
    bandwidth_nm: float
    """Full width at half maximum of the triangular slit function, nm, 0.1 to 100. Default 8."""
    noise_floor_w_per_sr_m2_nm: float
    """Noise of a reading without light, W/(sr m² nm) rms, 0 to 1e6. Default 5e-7."""
    dynamic_range: float
    """Largest ratio of signal to noise floor at every wavelength: the darkest part of a spectrum that can be told beside its
    peak, 1 to 1e12. Default 1e4."""
    stray_light: float
    """Share of the mean signal that is scattered evenly over all wavelengths, 0 to 0.1. Default 1e-5."""
    readings: int
    """Readings that are averaged, 1 to 1 000 000. Default 1."""


class SafetySection(TypedDict, total=False):
    """Settings of the photobiological safety assessment. Without a distance there is no margin."""

    patient_eye_distance_mm: float
    """Distance from the camera's pupil, along its axis, at which a patient's eye may look into the lights, mm, above 0.
    Default: unknown."""
    operator_eye_distance_mm: float
    """Distance from the lit mouth to the eye of the operator, who sees it by reflected light, mm, above 0. Default: unknown."""
    mucosa_distance_mm: float
    """Distance from the camera's pupil, along its axis, to the nearest mucosa, mm, above 0. Default: the distance from the
    camera to the point that it looks at."""
    lit_diameter_mm: float
    """Diameter of what the operator sees lit, mm, above 0. Default 60."""
    reflectance: float
    """Diffuse reflectance of what the operator sees, 0 to 1. Default 1, the upper bound."""
    mucosa_safety_factor: float
    """Factor by which limits for skin are divided for mucosa, for which there are none, 1 to 1000. Default 10 (assumed) where
    a mouth is lit, else 1. A scene without a mouth counts as one where this is given."""
    aphakic: bool
    """Whether the patient may be an infant or have no lens in the eye. Default false."""


class AnalysisSection(TypedDict, total=False):
    """Analysis of the captures."""

    frame: str
    """Capture that is analyzed."""
    parts: list[str]
    """Parts of the scene, by object name. Default: all."""
    rectangle_px: list[int]
    """Only pixels of this rectangle of the sensor: column, row, width, height. Default: none."""
    polygon_px: list[list[float]]
    """Only pixels whose center lies in this polygon: corners [x, y] in pixels of the raw image, x to the right and y downward
    from its upper left corner. Default: none."""
    mask: FilePath
    """Only pixels of this mask, an image of the size of the raw image: PNG, TIFF or NumPy, where not zero is inside. Default:
    none."""
    inset_px: int
    """Pixels of the sensor by which the region keeps away from the rim of these parts, 0 to 64: pixels at the rim hold light
    of what lies beside, as of teeth and lips. Default 0."""
    compared_px: list[RegionReference]
    """Two regions of the sensor whose pixels are compared: how well the frames tell them apart. Default: none."""
    region: list[AnalysisRegionSection]
    """Further regions of the frame, each analyzed by itself. Default: none."""
    porphyrin: str
    """Fluorophore whose share is estimated; "none" for no such estimate. Default: the porphyrin that the region holds, else
    that of the scene; where there is none "protoporphyrin_ix", but "none" if the scene holds a fluorophore that no tissue has."""
    bulk: BulkReference
    """Fluorophores that form the bulk of the tissue: the name of a material, whose fluorophores count without the porphyrin
    (where a concentration is a map, with its mean over the region), or a table of concentrations. Default: the material of the
    first part."""
    tissue: str
    """Tissue of the region, for an estimate that knows how tissue varies: a `[[tissue]]` or a site of the catalogue; "none"
    for no such estimate. Default: the site that the material of the first part is made of, if it is layered tissue."""
    tissue_probability: float
    """Probability beforehand that the region is this tissue, 0.01 to 1. The estimate is an average over it and the tissues
    `dorsal_tongue`, `buccal_mucosa`, `hard_palate` and `lip`, which share the rest; 1: none of these is compared. Default 0.9."""
    further_frames: list[str]
    """Further captures that enter this estimate, by name. Default: none."""
    prior_width: float
    """How various the tissue is thought to be, over what people differ by, 0.01 to 10. Default 1.25."""
    library_error: float
    """Relative error of the spectra of the library at each wavelength, 0 to 1; channels average over it. Default 0.03."""
    wanted_d_prime: float
    """d' that a target shall reach, 0.1 to 100: how many frames it takes, and the smallest diameter. Default 3.29, which errs
    in 5 % of cases either way."""
    noise_threshold: float
    """Pixels whose R + G + B is below this many standard deviations of its noise have no chromaticity, 0 to 1000. Default 5."""


class SensorRegionSection(TypedDict, total=False):
    """A region of the sensor: where all that is given holds."""

    parts: list[str]
    """Parts of the scene, by object name. Default: all."""
    rectangle_px: list[int]
    """Only pixels of this rectangle of the sensor: column, row, width, height. Default: none."""
    polygon_px: list[list[float]]
    """Only pixels whose center lies in this polygon: corners [x, y] in pixels of the raw image, x to the right and y downward
    from its upper left corner. Default: none."""
    mask: FilePath
    """Only pixels of this mask, an image of the size of the raw image: PNG, TIFF or NumPy, where not zero is inside. Default:
    none."""


class AnalysisRegionSection(TypedDict, total=False):
    """A region that is analyzed by itself, beside that of `[analysis]` and in the same frame: parts of the scene, a shape on
    the sensor, or where both hold. What it does not say is as in `[analysis]`."""

    name: str
    """Name, unique among regions."""
    parts: list[str]
    """Parts of the scene, by object name. Default: all."""
    rectangle_px: list[int]
    """Only pixels of this rectangle of the sensor: column, row, width, height. Default: none."""
    polygon_px: list[list[float]]
    """Only pixels whose center lies in this polygon: corners [x, y] in pixels of the raw image, x to the right and y downward
    from its upper left corner. Default: none."""
    mask: FilePath
    """Only pixels of this mask, an image of the size of the raw image: PNG, TIFF or NumPy, where not zero is inside. Default:
    none."""
    inset_px: int
    """Pixels of the sensor by which the region keeps away from the rim of its parts, 0 to 64. Default: as in `[analysis]`."""
    porphyrin: str
    """Fluorophore whose share is estimated; "none" for no such estimate. Default: as in `[analysis]`; where that names none
    the porphyrin that this region holds."""
    bulk: BulkReference
    """Fluorophores that form the bulk of the tissue, as in `[analysis]`. Default: the material of its first part; of a region
    without parts what `[analysis]` names."""
    tissue: str
    """Tissue of the region, a `[[tissue]]` or a site of the catalogue; "none" for no estimate that knows tissue. Default: the
    site that the material of its first part is made of; of a region without parts what `[analysis]` names."""
    tissue_probability: float
    """Probability beforehand that the region is this tissue, 0.01 to 1. Default: as in `[analysis]`."""
    further_frames: list[str]
    """Further captures that enter this estimate, by name. Default: as in `[analysis]`."""
    prior_width: float
    """How various the tissue is thought to be, over what people differ by, 0.01 to 10. Default: as in `[analysis]`."""
    library_error: float
    """Relative error of the spectra of the library at each wavelength, 0 to 1. Default: as in `[analysis]`."""
    noise_threshold: float
    """Pixels whose R + G + B is below this many standard deviations of its noise have no chromaticity, 0 to 1000. Default: as
    in `[analysis]`."""


class TargetSection(TypedDict, total=False):
    """Something that shall be seen: a lesion of the mouth, parts of the scene, or a shape on the sensor. The analysis tells
    how well. Every `[[mouth.lesion]]` is a target already."""

    name: str
    """Name, unique among targets."""
    lesion: str
    """Name of a `[[mouth.lesion]]`, where the target is one. Default: none."""
    parts: list[str]
    """Parts of the scene, by object name. Default: all."""
    rectangle_px: list[int]
    """Only pixels of this rectangle of the sensor: column, row, width, height. Default: none."""
    polygon_px: list[list[float]]
    """Only pixels whose center lies in this polygon: corners [x, y] in pixels of the raw image, x to the right and y downward
    from its upper left corner. Default: none."""
    mask: FilePath
    """Only pixels of this mask, an image of the size of the raw image: PNG, TIFF or NumPy, where not zero is inside. Default:
    none."""
    background: RegionReference
    """What the target is told from. Default: a ring around it, of about its area, two pixels away; of a lesion on its own
    part."""


class OutputSection(TypedDict, total=False):
    """Where results go."""

    folder: str
    """Folder for the results, relative to where the program runs. Default: chosen by the program."""


class Experiment(TypedDict, total=False):
    """An experiment: scene, lights, camera, captures and analysis. Lengths are in millimeters, wavelengths in nanometers;
    every other unit is in the name of its field. Lists of what has names may be dictionaries by name."""

    format: int
    """Version of the form of this file: 1."""
    title: str
    """Name of the experiment for people. Default: empty."""
    description: str
    """Description of the experiment. Default: empty."""
    base: str
    """Experiment that this file overrides: a name of the catalogue or a path relative to this file. Tables are merged key by
    key, lists entry by entry by `name`; `remove = true` in an entry removes it."""
    unset: list[str] | dict[str, str]
    """Paths of what the base says and this file does not want: sections, entries, fields, as in `["light.white", "analysis"]`.
    They are taken away before this file is put on top. Default: none."""
    spectral: SpectralSection
    """Wavelengths."""
    render: RenderSection
    """Image size, samples and limits of the render."""
    camera: CameraSection
    """Pinhole from which the radiance image is rendered."""
    lens: LensSection
    """Lens between scene and sensor. Without `lens` and `sensor` the file describes a scene only."""
    view_filter: ViewFilterSection
    """Filters in front of the lens."""
    sensor: SensorSection
    """Sensor behind the lens."""
    light: list[LightSection] | dict[str, LightSection]
    """Light sources."""
    fluorophore: list[FluorophoreSection] | dict[str, FluorophoreSection]
    """Fluorophores besides those of the catalogue, or variants of those."""
    tissue: list[TissueSection] | dict[str, TissueSection]
    """Layered tissues besides the sites of the catalogue, or variants of those."""
    material: list[MaterialSection] | dict[str, MaterialSection]
    """Materials."""
    mouth: MouthSection
    """A parametric mouth; its parts become objects."""
    object: list[ObjectSection] | dict[str, ObjectSection]
    """Surfaces."""
    concentration: dict[str, ConcentrationFactor]
    """Factors on the concentrations of fluorophores, by name. A finished render follows them without a new one. Default: none."""
    capture: list[CaptureSection] | dict[str, CaptureSection]
    """Exposures of the sensor, in this order."""
    motion: MotionSection
    """Motion of the image between exposures. Default: none."""
    develop: DevelopSection
    """How raw frames become linear channels. Default: black level and bilinear interpolation."""
    spectroradiometer: list[SpectroradiometerSection] | dict[str, SpectroradiometerSection]
    """Spectroradiometers in the place of the camera."""
    safety: SafetySection
    """Distances for the assessment of photobiological safety."""
    analysis: AnalysisSection
    """Analysis of the captures."""
    target: list[TargetSection] | dict[str, TargetSection]
    """What shall be seen: how well the frames tell it from what lies around it."""
    output: OutputSection
    """Where results go."""
    files: dict[str, str]
    """SHA-256 of files that decide a render, by their paths: a file with other content is refused. Results hold those that
    they were made from. Default: none."""
