//! How much a design rests on what was assumed, and on how well it can be made.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::spectral::Curve;

use super::design_space::{Design, DesignError, DesignSpace};
use super::merits::{LimitExcess, Merits};
use super::problem::{Budget, DesignProblem, GeometryChoice, LongPassEdge};
use super::region_model::RegionModel;

/// Factors on each assumed number: a quarter more, a quarter less.
const FACTORS: [f64; 2] = [1.25, 0.75];

/// What a quarter more, and a quarter less, of an assumed number does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensitivity {
    /// The number.
    pub assumption: String,
    /// Relative change of the loss of the best design with a quarter more.
    pub loss_change: f64,
    /// The same with a quarter less.
    pub loss_change_of_less: f64,
    /// Whether another of the designs is then the best, either way.
    pub other_best: bool,
}

/// Raises and lowers each assumed number by a quarter, for the designs given, the best first: how its loss changes, and whether it stays the
/// best of them.
///
/// # Errors
/// A problem without designs.
pub fn sensitivities(problem: &DesignProblem, designs: &[Design]) -> Result<Vec<Sensitivity>, DesignError> {
    let Some(best) = designs.first() else { return Ok(Vec::new()) };
    let before = losses(problem, std::slice::from_ref(best))?;
    let [raised, lowered] = FACTORS.map(|factor| changes(problem, best, factor));
    let mut found: Vec<Sensitivity> = raised
        .into_par_iter()
        .zip(lowered)
        .map(|((assumption, more), (_, less))| {
            let [of_more, of_less] = [losses(&more, designs)?, losses(&less, designs)?];
            let is_beaten = |losses: &[f64]| losses.iter().skip(1).any(|loss| *loss < losses[0]);
            // A design that loses nothing, such as one without leak, has nothing to compare with
            let change = |losses: &[f64]| if before[0] > 0.0 { losses[0] / before[0] - 1.0 } else { 0.0 };
            Ok(Sensitivity {
                assumption,
                loss_change: change(&of_more),
                loss_change_of_less: change(&of_less),
                other_best: is_beaten(&of_more) || is_beaten(&of_less),
            })
        })
        .collect::<Result<_, DesignError>>()?;
    let largest = |s: &Sensitivity| s.loss_change.abs().max(s.loss_change_of_less.abs());
    found.sort_by(|a, b| largest(b).total_cmp(&largest(a)));
    Ok(found)
}

/// Losses of designs in a problem that has the same choices.
fn losses(problem: &DesignProblem, designs: &[Design]) -> Result<Vec<f64>, DesignError> {
    // Only the lights of these designs are prepared
    let mut used: Vec<usize> = designs.iter().flat_map(|design| design.lights.iter().copied()).collect();
    used.sort_unstable();
    used.dedup();
    let lights = used.iter().map(|&k| problem.lights[k].clone()).collect();
    let space = DesignSpace::new(DesignProblem { lights, ..problem.clone() })?;
    let renumbered = |design: &Design| {
        let place = |light: &usize| used.binary_search(light).unwrap_or(0);
        Design { lights: design.lights.iter().map(place).collect(), ..design.clone() }
    };
    Ok(designs.iter().map(|design| space.evaluate(&renumbered(design)).loss).collect())
}

/// The problem with each of its assumed numbers times a factor, one at a time.
fn changes(problem: &DesignProblem, best: &Design, factor: f64) -> Vec<(String, DesignProblem)> {
    let mut found = Vec::new();
    let mut add = |name: String, counts: bool, change: &dyn Fn(&mut DesignProblem)| {
        if counts {
            let mut changed = problem.clone();
            change(&mut changed);
            found.push((name, changed));
        }
    };
    let (assumed, library) = (&problem.assumptions, &problem.library);
    add("unknown gain".into(), assumed.gain > 0.0, &|p| p.assumptions.gain *= factor);
    add("unknown drives".into(), assumed.drive > 0.0, &|p| p.assumptions.drive *= factor);
    add("unknown leak".into(), assumed.leak > 0.0, &|p| p.assumptions.leak *= factor);
    let has_priors = problem.weights.iter().any(|prior| prior.relative > 0.0);
    add("priors of weights".into(), has_priors, &|p| {
        p.weights.iter_mut().for_each(|prior| prior.relative *= factor);
    });
    add("pixels of a region".into(), true, &|p| p.assumptions.pixels *= factor);
    add("shift of emission".into(), library.emission_shift_nm > 0.0, &|p| {
        p.library.emission_shift_nm *= factor
    });
    add("shift of excitation".into(), library.excitation_shift_nm > 0.0, &|p| {
        p.library.excitation_shift_nm *= factor;
    });
    let shaped = library.shape > 0.0;
    add("error of spectra".into(), shaped, &|p| p.library.shape *= factor);
    add("correlation of that error".into(), shaped, &|p| p.library.correlation_nm *= factor);
    add("time or electrons in all".into(), true, &|p| {
        p.budget = match p.budget {
            Budget::Time(seconds) => Budget::Time(factor * seconds),
            Budget::Electrons(electrons) => Budget::Electrons(factor * electrons),
        };
    });
    let camera = best.camera;
    add("read noise".into(), true, &|p| {
        let camera = &mut p.cameras[camera];
        camera.dark_variance_e2 *= factor * factor;
        camera.line_variance_e2 *= factor * factor;
    });
    let uneven = problem.cameras[camera].prnu > 0.0;
    add("non-uniformity of pixels".into(), uneven, &|p| p.cameras[camera].prnu *= factor);
    for &light in &best.lights {
        let name = format!("power of {}", problem.lights[light].name);
        add(name, matches!(problem.budget, Budget::Time(_)), &|p| {
            p.lights[light].light *= factor;
            p.lights[light].power_w *= factor;
        });
    }
    let regions: Vec<&RegionModel> = problem.regions_of(best.geometry).collect();
    for (number, region) in regions.iter().enumerate() {
        let of = if regions.len() > 1 { format!(" in {}", region.response.name) } else { String::new() };
        let mut add_of = |name: String, change: &dyn Fn(&mut RegionModel)| {
            add(format!("{name}{of}"), true, &|p| {
                p.region_mut(best.geometry, number).into_iter().for_each(change);
            });
        };
        for (j, part) in region.response.fluorescence.iter().enumerate() {
            add_of(part.name.clone(), &|region| {
                region.response.fluorescence[j].radiance.iter_mut().for_each(|v| *v *= factor);
                region.response.fluorescence[j].amount *= factor;
                // More of a fluorophore is also more of what its unknowns change of it
                for change in &mut region.changes {
                    change.fluorescence[j].iter_mut().for_each(|v| *v *= factor);
                }
            });
        }
        add_of("reflected light".into(), &|region| {
            region.response.reflected = region.response.reflected.scaled(factor);
            for change in &mut region.changes {
                change.reflected = change.reflected.as_ref().map(|reflected| reflected.scaled(factor));
            }
        });
        for (k, change) in region.changes.iter().enumerate() {
            add_of(format!("spread of {}", change.name), &|region| {
                region.changes[k] = region.changes[k].grown(factor, &region.response);
            });
        }
    }
    found
}

/// Tolerances of manufacture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Tolerances {
    /// Peaks of lights, nm, to both sides, 0 to 50. Default 3.
    pub light_nm: f64,
    /// Edges of filters, nm, to both sides, 0 to 50. Default 2.
    pub filter_nm: f64,
    /// Largest angle at which light passes the viewing filter, degrees, 0 to 60. Default 15.
    pub angle_deg: f64,
    /// Effective refractive index of the filter, 1 to 4. Default 1.8.
    pub effective_index: f64,
}

impl Default for Tolerances {
    fn default() -> Self {
        Self { light_nm: 3.0, filter_nm: 2.0, angle_deg: 15.0, effective_index: 1.8 }
    }
}

/// The worst case of a design within tolerances.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WorstCase {
    /// Its loss; the spectra as made are known then, as after a calibration.
    pub loss: f64,
    /// The largest ratio of reflected to fluorescent electrons.
    pub leak: f64,
    /// Shift of each light, nm.
    pub light_shifts_nm: Vec<f64>,
    /// Shift of the filter, nm.
    pub filter_shift_nm: f64,
    /// Angle at which light passes it, degrees.
    pub angle_deg: f64,
    /// Limits that the design breaks anywhere within its tolerances.
    pub broken: Vec<&'static str>,
    /// How far it is beyond each of them at most.
    pub excesses: Vec<LimitExcess>,
}

impl WorstCase {
    /// The worse of two by their losses, with the larger leak and the limits that either breaks.
    fn or(self, other: Self) -> Self {
        let leak = self.leak.max(other.leak);
        let mut excesses = self.excesses.clone();
        for of_other in &other.excesses {
            match excesses.iter_mut().find(|excess| excess.limit == of_other.limit) {
                Some(excess) if of_other.is_beyond(excess) => *excess = *of_other,
                Some(_) => {}
                None => excesses.push(*of_other),
            }
        }
        let broken = excesses.iter().map(|excess| excess.limit).collect();
        Self { leak, broken, excesses, ..if other.loss > self.loss { other } else { self } }
    }
}

/// Tries all ends of the tolerances of a design together: every light to both sides, the filter to both sides, at the axis and at the
/// largest angle, where its edges move to `lambda sqrt(1 - sin² / n²)`. Loss and leak are the worst of all, the shifts are those of the
/// worst loss.
///
/// # Errors
/// A problem without designs.
pub fn worst_case(
    problem: &DesignProblem,
    design: &Design,
    tolerances: &Tolerances,
) -> Result<WorstCase, DesignError> {
    let lights = design.lights.len();
    let side = |bit: usize, corner: usize| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
    let case = |light_shifts_nm: Vec<f64>, filter_shift_nm: f64, angle_deg: f64| {
        let sine = angle_deg.to_radians().sin() / tolerances.effective_index;
        let scale = (1.0 - sine * sine).sqrt();
        let space = DesignSpace::new(as_made(problem, design, &light_shifts_nm, filter_shift_nm, scale))?;
        let merits = space.evaluate(&space.design(0));
        let excesses = space.excesses(&merits);
        let Merits { loss, leak, broken, .. } = merits;
        Ok(WorstCase { loss, leak, light_shifts_nm, filter_shift_nm, angle_deg, broken, excesses })
    };
    let ends: Vec<WorstCase> = (0..1_usize << (lights + 2))
        .into_par_iter()
        .map(|corner| {
            let shifts = (0..lights).map(|k| tolerances.light_nm * side(k, corner)).collect();
            let angle_deg = if corner >> (lights + 1) & 1 == 0 { 0.0 } else { tolerances.angle_deg };
            case(shifts, tolerances.filter_nm * side(lights, corner), angle_deg)
        })
        .collect::<Result<_, DesignError>>()?;
    let as_meant = case(vec![0.0; lights], 0.0, 0.0)?;
    Ok(ends.into_iter().fold(as_meant, WorstCase::or))
}

/// The problem of one design only, its lights shifted and its filter shifted and turned.
fn as_made(
    problem: &DesignProblem,
    design: &Design,
    light_shifts_nm: &[f64],
    filter_shift_nm: f64,
    filter_scale: f64,
) -> DesignProblem {
    let mut made = problem.clone();
    made.lights = design.lights.iter().map(|&k| problem.lights[k].clone()).collect();
    for (light, shift) in made.lights.iter_mut().zip(light_shifts_nm) {
        light.spectrum = moved(&light.spectrum, |nm| nm + shift);
    }
    let mut filter = problem.filters[design.filter].clone();
    let edge = |nm: f64| filter_scale * (nm + filter_shift_nm);
    filter.fixed = moved(&filter.fixed, edge);
    if let Some(long_pass) = &mut filter.long_pass {
        long_pass.edge = match long_pass.edge {
            LongPassEdge::At(nm) => LongPassEdge::At(edge(nm)),
            // At an angle each edge moves by its own wavelength; that of the middle light stands for all
            LongPassEdge::AfterPeak(nm) => {
                let peaks: f64 = made.lights.iter().map(|light| light.peak_nm).sum();
                let peak_nm = peaks / made.lights.len().max(1) as f64;
                LongPassEdge::AfterPeak(edge(peak_nm + nm) - peak_nm)
            }
        };
    }
    made.filters = vec![filter];
    made.cameras = vec![problem.cameras[design.camera].clone()];
    made.lenses = vec![problem.lenses[design.lens].clone()];
    made.drives = vec![problem.drives[design.drive]];
    made.splits = vec![problem.splits[design.split].clone()];
    let of_lens = |geometry: &GeometryChoice| GeometryChoice {
        lens_sr: geometry.lens_sr.get(design.lens).copied().into_iter().collect(),
        ..geometry.clone()
    };
    made.geometries = problem.geometries.get(design.geometry).map(of_lens).into_iter().collect();
    made.exposures = vec![design.lights.len()];
    made
}

/// A curve whose wavelengths have moved.
fn moved(curve: &Curve, to: impl Fn(f64) -> f64) -> Curve {
    let wavelengths = curve.wavelengths_nm().iter().map(|&nm| to(nm)).collect();
    Curve::new(wavelengths, curve.values().to_vec()).unwrap_or_else(|_| curve.clone())
}
