//! Which sets of components describe a spectrum as well as the best one.

use rayon::prelude::*;
use serde::Serialize;

use super::blood::least;
use super::least_squares::{LeastSquares, Nearest};
use super::{FitError, MixtureFit, SpectralMixture, over};

/// All sets of so many components are compared at most: 4096.
pub(super) const MOST_COMPONENTS: usize = 12;
/// Share of a range between nodes to which the amount of blood of a set is searched.
const PRECISION: f64 = 1e-3;
/// Less is rounding, relative to the squares of the data.
const ROUNDING: f64 = 1e-22;

/// A set of components that describes a spectrum about as well as the best.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComponentSet {
    /// Names of its components.
    pub components: Vec<String>,
    /// Weight of each.
    pub weights: Vec<f64>,
    /// Amount of blood; `None` where there is none before them.
    pub blood: Option<f64>,
    /// Root mean square of what it leaves, over standard errors where these are given.
    pub rms: f64,
    /// Criterion less that of the best set.
    pub difference: f64,
    /// Probability that it is the best of all sets that were compared, as far as the criterion tells (Akaike weight).
    pub akaike_weight: f64,
}

/// What all sets say of one component.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetMembership {
    /// Name of the component.
    pub name: String,
    /// Sum of the Akaike weights of all sets that hold it.
    pub akaike_weight: f64,
    /// Supported sets that hold it.
    pub supported_sets: usize,
    /// Least and largest weight in the supported sets, 0 where they do not hold it.
    pub weight_range: [f64; 2],
    /// Mean of its weight over all sets, by their Akaike weights.
    pub mean_weight: f64,
}

/// All sets of components, compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComponentSets {
    /// Sets that were compared. One in which a component has weight 0 is the smaller set without it, and counts as that.
    pub compared: usize,
    /// Sets with too many components for the effective number of bands.
    pub too_large: usize,
    /// Effective number of bands in the criterion.
    pub effective_bands: f64,
    /// Difference from the best up to which a set is supported.
    pub within: f64,
    /// The supported sets, the best first.
    pub supported: Vec<ComponentSet>,
    /// Each component.
    pub components: Vec<SetMembership>,
    /// Pairs that can't be told apart: a supported set that needs one of them, as it is not supported without, stays supported with
    /// the other in its place.
    pub interchangeable: Vec<[String; 2]>,
}

/// A set with its criterion.
struct Compared {
    members: Vec<usize>,
    nearest: Nearest,
    amount: Option<f64>,
    criterion: f64,
}

/// What the criterion takes from the fit of all components.
#[derive(Clone, Copy)]
struct Bands {
    /// Effective number of bands: how much the logarithm of the squares says of a weight.
    effective: f64,
    /// Degrees of freedom of the variance of the residuals, and the weights of that fit: how well the variance is known.
    of_variance: f64,
}

impl Bands {
    /// Akaike's criterion, corrected for few data (Hurvich and Tsai, Biometrika 76, 297, 1989); `None` where there are too many
    /// parameters for them.
    fn criterion(self, squares: f64, parameters: f64) -> Option<f64> {
        let spare = self.of_variance - parameters - 1.0;
        let correction = 2.0 * parameters * (parameters + 1.0) / spare;
        (spare > 0.0).then(|| self.effective * squares.ln() + 2.0 * parameters + correction)
    }
}

/// A search over the amounts of blood that all sets share.
struct Search<'a> {
    nodes: Vec<f64>,
    problems: Vec<LeastSquares>,
    problem_behind: &'a (dyn Fn(f64) -> LeastSquares + Sync),
}

impl Search<'_> {
    /// The nearest sum of some components, and the amount of blood.
    fn nearest(&self, members: &[usize], blood_matters: bool) -> (Nearest, Option<f64>) {
        if !blood_matters {
            return (self.problems[0].nearest(members), None);
        }
        let squares: Vec<f64> =
            self.problems.iter().map(|problem| problem.nearest(members).squares).collect();
        let of = |amount: f64| (self.problem_behind)(amount).nearest(members).squares;
        let amount = least(&self.nodes, &squares, PRECISION, &of);
        ((self.problem_behind)(amount).nearest(members), Some(amount))
    }
}

/// Compares all sets.
pub(super) fn compare(
    mixture: &SpectralMixture,
    data: &[f64],
    errors: Option<&[f64]>,
    fit: &MixtureFit,
    within: f64,
) -> Result<ComponentSets, FitError> {
    let count = mixture.components.len();
    if count > MOST_COMPONENTS {
        return Err(FitError::ManySets { components: count });
    }
    let free = fit.weights.iter().filter(|weight| weight.is_free).count();
    let bands = Bands {
        effective: fit.scatter.effective_bands,
        of_variance: fit.scatter.degrees_of_freedom + (free + usize::from(fit.blood.is_some())) as f64,
    };
    let scaled = over(data, errors);
    let floor = ROUNDING * scaled.iter().map(|value| value * value).sum::<f64>();
    let problem_behind = |amount: f64| LeastSquares::new(&mixture.scaled_components(amount, errors), &scaled);
    let nodes = mixture.blood.nodes();
    let problems = nodes.iter().map(|&amount| problem_behind(amount)).collect();
    let search = Search { nodes, problems, problem_behind: &problem_behind };
    let compared = |set: usize| {
        let members: Vec<usize> = (0..count).filter(|member| set >> member & 1 == 1).collect();
        let blood_matters = mixture.blood.matters(&members);
        // Weights, the variance of the residuals, blood
        let parameters = (members.len() + 1 + usize::from(blood_matters)) as f64;
        if bands.criterion(1.0, parameters).is_none() {
            return Err(());
        }
        let (nearest, amount) = search.nearest(&members, blood_matters);
        let criterion = bands.criterion(nearest.squares.max(floor), parameters).ok_or(())?;
        Ok(nearest.is_free.iter().all(|free| *free).then_some(Compared {
            members,
            nearest,
            amount,
            criterion,
        }))
    };
    let all: Vec<Result<Option<Compared>, ()>> = (0..1usize << count).into_par_iter().map(compared).collect();
    let too_large = all.iter().filter(|set| set.is_err()).count();
    let sets: Vec<Compared> = all.into_iter().filter_map(|set| set.ok().flatten()).collect();
    Ok(described(mixture, sets, too_large, bands.effective, within))
}

fn described(
    mixture: &SpectralMixture,
    mut sets: Vec<Compared>,
    too_large: usize,
    effective_bands: f64,
    within: f64,
) -> ComponentSets {
    sets.sort_by(|a, b| a.criterion.total_cmp(&b.criterion));
    let best = sets.first().map_or(0.0, |set| set.criterion);
    let likelihood = |set: &Compared| (-0.5 * (set.criterion - best)).exp();
    let total: f64 = sets.iter().map(likelihood).sum();
    let weights: Vec<f64> = sets.iter().map(|set| likelihood(set) / total).collect();
    let count = sets.iter().filter(|set| set.criterion - best <= within).count();
    let samples = mixture.wavelengths_nm.len() as f64;
    let name = |member: usize| mixture.components[member].name.clone();
    let supported = sets[..count].iter().zip(&weights).map(|(set, weight)| ComponentSet {
        components: set.members.iter().map(|&member| name(member)).collect(),
        weights: set.nearest.weights.clone(),
        blood: set.amount,
        rms: (set.nearest.squares / samples).sqrt(),
        difference: set.criterion - best,
        akaike_weight: *weight,
    });
    let weight_in = |set: &Compared, member: usize| {
        set.members.iter().position(|&other| other == member).map_or(0.0, |place| set.nearest.weights[place])
    };
    let membership = |member: usize| {
        let held = sets.iter().zip(&weights).filter(|(set, _)| set.members.contains(&member));
        let in_supported = sets[..count].iter().map(|set| weight_in(set, member));
        SetMembership {
            name: name(member),
            akaike_weight: held.map(|(_, weight)| weight).sum(),
            supported_sets: sets[..count].iter().filter(|set| set.members.contains(&member)).count(),
            weight_range: in_supported
                .map(|weight| [weight; 2])
                .reduce(|[low, high], [weight, _]| [low.min(weight), high.max(weight)])
                .unwrap_or_default(),
            mean_weight: sets.iter().zip(&weights).map(|(set, w)| w * weight_in(set, member)).sum(),
        }
    };
    let members = 0..mixture.components.len();
    ComponentSets {
        compared: sets.len(),
        too_large,
        effective_bands,
        within,
        supported: supported.collect(),
        components: members.clone().map(membership).collect(),
        interchangeable: members
            .clone()
            .flat_map(|a| (a + 1..members.end).map(move |b| (a, b)))
            .filter(|&(a, b)| are_interchangeable(&sets[..count], a, b))
            .map(|(a, b)| [name(a), name(b)])
            .collect(),
    }
}

/// Whether some set needs one of two components, and stays among the sets with the other in its place.
fn are_interchangeable(sets: &[Compared], a: usize, b: usize) -> bool {
    let is_supported = |members: &[usize]| sets.iter().any(|set| set.members == members);
    let replaced = |set: &Compared, old: usize, new: usize| {
        let rest: Vec<usize> = set.members.iter().copied().filter(|&other| other != old).collect();
        let mut other = [&rest[..], &[new]].concat();
        other.sort_unstable();
        !is_supported(&rest) && is_supported(&other)
    };
    [(a, b), (b, a)].into_iter().any(|(old, new)| {
        let has_one = |set: &&Compared| set.members.contains(&old) && !set.members.contains(&new);
        sets.iter().filter(has_one).any(|set| replaced(set, old, new))
    })
}
