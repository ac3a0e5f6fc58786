//! Hat functions of the excitation wavelength, of which light spectra are made up after a render.

use thiserror::Error;

use super::Curve;

/// Step, nm, at which spectra are sampled while nodes are chosen and errors are found.
const STEP_NM: f64 = 1.0;
/// Greatest distance of neighboring nodes among the lights that are asked for, and beyond them, nm.
const WIDEST_NM: [f64; 2] = [12.0, 20.0];
/// Least distance of neighboring nodes, nm.
const NARROWEST_NM: f64 = 2.0;
/// How far a change of the nodes is felt, nm.
const REACH_NM: f64 = 60.0;
/// Share of its greatest value below which the error of a response counts relative to this share: light that excites next to
/// nothing need not be as exact.
const DARK: f64 = 0.05;

/// Wavelengths at which the excitation of a light group is kept apart: a render with the hat functions of the nodes as light
/// spectra gives every light spectrum in their range by a weighted sum.
///
/// Hat k rises from node k - 1 to 1 at node k and falls to 0 at node k + 1; all together are 1 from the first node to the last.
/// A light spectrum s is replaced by its projection `P s = sum_k w_k hat_k` (least squares). What a fluorophore makes of it is a
/// linear functional `integral G s`, with G the excitation spectrum seen through everything in the way. `s - P s` is
/// orthogonal to all hats, so the error is `integral (s - P s) (G - P G)`: of fourth order in the distance h of the nodes,
/// `h^4 / 720 integral s G''''`, where the light is wide, and never more than the error of G itself, `h^2 / 12 G''`, where it is a
/// line.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationNodes {
    nodes_nm: Vec<f64>,
}

/// Why wavelengths can't be nodes.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("nodes of the excitation must be three or more increasing wavelengths; got {0:?}")]
pub struct NodesError(pub Vec<f64>);

impl ExcitationNodes {
    /// Nodes at given wavelengths, nm.
    ///
    /// # Errors
    /// Fewer than three, or wavelengths that do not increase.
    pub fn new(nodes_nm: Vec<f64>) -> Result<Self, NodesError> {
        let increase = nodes_nm.windows(2).all(|pair| pair[0] < pair[1]);
        if nodes_nm.len() < 3 || !increase || !nodes_nm.iter().all(|nm| nm.is_finite()) {
            return Err(NodesError(nodes_nm));
        }
        Ok(Self { nodes_nm })
    }

    /// Chooses nodes over a span, so that every Gaussian light of 8 nm and more (full width at half maximum) whose peak lies in
    /// `peaks_nm` excites each of the `responses` to within `tolerance` of what it excites, or of a twentieth of what light of its
    /// power could. Responses are excitation spectra, on any scale.
    ///
    /// Begins with nodes 12 nm apart (20 nm beyond the peaks) and halves the interval next to the worst light until
    /// none is worse than the tolerance; 2 nm is the least distance.
    pub fn choose(span_nm: [f64; 2], peaks_nm: [f64; 2], responses: &[Curve], tolerance: f64) -> Self {
        let mut nodes = Self::even(span_nm, peaks_nm);
        let samples: Vec<Vec<f64>> =
            responses.iter().map(|response| sampled(span_nm, &|nm| response.at(nm))).collect();
        let lights = narrow_lights(span_nm, peaks_nm);
        let mut errors: Vec<f64> =
            lights.iter().map(|(_, light)| nodes.worst_error(span_nm, light, &samples)).collect();
        // Each step halves one interval, so there is an end to it
        loop {
            let worst = (0..errors.len()).max_by(|a, b| errors[*a].total_cmp(&errors[*b])).unwrap_or(0);
            let peak_nm = lights[worst].0;
            if errors[worst] <= tolerance || !nodes.halve_next_to(peak_nm) {
                return nodes;
            }
            // The projection of a narrow light does not reach far
            let near = |(_, (other_nm, _)): &(usize, &(f64, Vec<f64>))| (other_nm - peak_nm).abs() < REACH_NM;
            for (index, (_, light)) in lights.iter().enumerate().filter(near) {
                errors[index] = nodes.worst_error(span_nm, light, &samples);
            }
        }
    }

    /// Even nodes, at the widest distances with which the choice begins.
    fn even(span_nm: [f64; 2], peaks_nm: [f64; 2]) -> Self {
        let mut nodes_nm = vec![span_nm[0]];
        let inside = [peaks_nm[0].max(span_nm[0]), peaks_nm[1].min(span_nm[1])];
        for (edges, widest) in [
            ([span_nm[0], inside[0]], WIDEST_NM[1]),
            (inside, WIDEST_NM[0]),
            ([inside[1], span_nm[1]], WIDEST_NM[1]),
        ] {
            let count = ((edges[1] - edges[0]) / widest).ceil().max(0.0) as usize;
            nodes_nm.extend((1..=count).map(|i| edges[0] + (edges[1] - edges[0]) * i as f64 / count as f64));
        }
        Self { nodes_nm }
    }

    /// Greatest error of what a light that is sampled over the span excites.
    fn worst_error(&self, span_nm: [f64; 2], light: &[f64], samples: &[Vec<f64>]) -> f64 {
        let rest = self.residual(span_nm, light);
        samples.iter().map(|response| relative_error(light, &rest, response)).fold(0.0, f64::max)
    }

    /// Halves the wider one of the two intervals around a wavelength that may still be halved.
    fn halve_next_to(&mut self, nm: f64) -> bool {
        let last = self.nodes_nm.len() - 2;
        let own = self.nodes_nm.partition_point(|node| *node <= nm).saturating_sub(1).min(last);
        let width = |interval: usize| self.nodes_nm[interval + 1] - self.nodes_nm[interval];
        let near = [own, own.saturating_sub(1), (own + 1).min(last)];
        let widest = near.into_iter().max_by(|a, b| width(*a).total_cmp(&width(*b))).unwrap_or(own);
        if width(widest) < 2.0 * NARROWEST_NM {
            return false;
        }
        let middle = 0.5 * (self.nodes_nm[widest] + self.nodes_nm[widest + 1]);
        self.nodes_nm.insert(widest + 1, middle);
        true
    }

    /// The nodes, nm.
    pub fn nodes_nm(&self) -> &[f64] {
        &self.nodes_nm
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes_nm.len()
    }

    /// Never: there are three nodes or more.
    pub fn is_empty(&self) -> bool {
        self.nodes_nm.is_empty()
    }

    /// First and last node, nm.
    pub fn span_nm(&self) -> [f64; 2] {
        [self.nodes_nm[0], self.nodes_nm[self.nodes_nm.len() - 1]]
    }

    /// The hat function of a node.
    pub fn hat(&self, node: usize) -> Curve {
        let nodes = &self.nodes_nm;
        let from = node.saturating_sub(1);
        let until = (node + 1).min(nodes.len() - 1);
        let wavelengths: Vec<f64> = nodes[from..=until].to_vec();
        let values = (from..=until).map(|other| f64::from(u8::from(other == node))).collect();
        Curve::new(wavelengths, values).unwrap_or_else(|_| Curve::constant(0.0))
    }

    /// Share of a light spectrum that lies outside the nodes.
    pub fn share_outside(&self, light: &Curve) -> f64 {
        let [first, last] = self.span_nm();
        1.0 - light.integral(first, last) / light.total()
    }

    /// Weights of the hats for a light spectrum, in its unit: the projection of the part within the nodes.
    pub fn weights(&self, light: &Curve) -> Vec<f64> {
        let mut moments = vec![0.0; self.len()];
        for (node, pair) in self.nodes_nm.windows(2).enumerate() {
            let (all, above) = power_and_moment(light, pair[0], pair[1]);
            moments[node] += all - above;
            moments[node + 1] += above;
        }
        self.solve(moments)
    }

    /// Responses to lines at the nodes, linear between them, from those to the hats: with these, the response to any light is the same
    /// as that of its [`Self::weights`].
    pub fn line_responses(&self, hat_responses: Vec<f64>) -> Vec<f64> {
        self.solve(hat_responses)
    }

    /// Relative error of what a light excites in each of some responses, which are excitation spectra on any scale: that of the
    /// worst, relative to a twentieth of what light of its power could excite where that is more.
    pub fn error(&self, light: &Curve, responses: &[Curve]) -> f64 {
        let span_nm = self.span_nm();
        let light = sampled(span_nm, &|nm| light.at(nm));
        let rest = self.residual(span_nm, &light);
        let of = |response: &Curve| relative_error(&light, &rest, &sampled(span_nm, &|nm| response.at(nm)));
        responses.iter().map(of).fold(0.0, f64::max)
    }

    /// What a light that is sampled over the span has besides its projection.
    fn residual(&self, [first, _]: [f64; 2], light: &[f64]) -> Vec<f64> {
        let at = |sample: usize| first + (sample as f64 + 0.5) * STEP_NM;
        // Moments and Gram matrix by the same sums, so that the rest is orthogonal to the hats to rounding
        let mut moments = vec![0.0; self.len()];
        let mut diagonal = vec![0.0; self.len()];
        let mut beside = vec![0.0; self.len() - 1];
        let place = |sample: usize| {
            let nm = at(sample);
            let left = self.nodes_nm.partition_point(|node| *node <= nm).clamp(1, self.len() - 1) - 1;
            let part = (nm - self.nodes_nm[left]) / (self.nodes_nm[left + 1] - self.nodes_nm[left]);
            (left, part)
        };
        for (sample, value) in light.iter().enumerate() {
            let (left, part) = place(sample);
            moments[left] += (1.0 - part) * value;
            moments[left + 1] += part * value;
            diagonal[left] += (1.0 - part) * (1.0 - part);
            diagonal[left + 1] += part * part;
            beside[left] += part * (1.0 - part);
        }
        let weights = solve_tridiagonal(diagonal, &beside, moments);
        let made = |sample: usize| {
            let (left, part) = place(sample);
            (1.0 - part) * weights[left] + part * weights[left + 1]
        };
        light.iter().enumerate().map(|(sample, value)| value - made(sample)).collect()
    }

    /// Weights from the integrals of the light times each hat.
    fn solve(&self, moments: Vec<f64>) -> Vec<f64> {
        let width = |interval: usize| self.nodes_nm[interval + 1] - self.nodes_nm[interval];
        let count = self.len();
        let left = |node: usize| if node > 0 { width(node - 1) } else { 0.0 };
        let right = |node: usize| if node + 1 < count { width(node) } else { 0.0 };
        // The integral of a hat squared is a third of its base, that of two neighbors a sixth of what they share
        let diagonal = (0..count).map(|node| (left(node) + right(node)) / 3.0).collect();
        let beside: Vec<f64> = (0..count - 1).map(|interval| width(interval) / 6.0).collect();
        solve_tridiagonal(diagonal, &beside, moments)
    }
}

/// Power of a light between two wavelengths, and the same weighted by a ramp from 0 to 1.
pub(crate) fn power_and_moment(light: &Curve, from_nm: f64, to_nm: f64) -> (f64, f64) {
    let part = light.clipped(from_nm, to_nm);
    let ramp = |nm: f64| (nm - from_nm) / (to_nm - from_nm);
    let (mut all, mut above) = (0.0, 0.0);
    for (nm, value) in part.wavelengths_nm().windows(2).zip(part.values().windows(2)) {
        let width = nm[1] - nm[0];
        // Light and ramp are linear here: Simpson's rule is exact for their product.
        let middle = 0.25 * (value[0] + value[1]) * (ramp(nm[0]) + ramp(nm[1]));
        all += 0.5 * width * (value[0] + value[1]);
        above += width / 6.0 * (value[0] * ramp(nm[0]) + 4.0 * middle + value[1] * ramp(nm[1]));
    }
    (all, above)
}

/// Solves a symmetric tridiagonal system (Thomas algorithm).
fn solve_tridiagonal(mut diagonal: Vec<f64>, beside: &[f64], mut right: Vec<f64>) -> Vec<f64> {
    for row in 1..right.len() {
        let factor = beside[row - 1] / diagonal[row - 1];
        diagonal[row] -= factor * beside[row - 1];
        right[row] -= factor * right[row - 1];
    }
    for row in (0..right.len()).rev() {
        let next = if row + 1 < right.len() { beside[row] * right[row + 1] } else { 0.0 };
        right[row] = (right[row] - next) / diagonal[row];
    }
    right
}

/// A function in the middles of steps over a span.
fn sampled([first, last]: [f64; 2], function: &dyn Fn(f64) -> f64) -> Vec<f64> {
    let count = ((last - first) / STEP_NM).round().max(1.0) as usize;
    (0..count).map(|sample| function(first + (sample as f64 + 0.5) * STEP_NM)).collect()
}

/// Gaussian lights of 8 nm with their peaks, 1 nm apart.
fn narrow_lights(span_nm: [f64; 2], peaks_nm: [f64; 2]) -> Vec<(f64, Vec<f64>)> {
    const FWHM_NM: f64 = 8.0;
    let count = (peaks_nm[1] - peaks_nm[0]).max(0.0) as usize;
    let light = |peak_nm: f64| {
        let shape = move |nm: f64| (-4.0 * std::f64::consts::LN_2 * ((nm - peak_nm) / FWHM_NM).powi(2)).exp();
        (peak_nm, sampled(span_nm, &shape))
    };
    (0..=count).map(|i| light(peaks_nm[0] + i as f64)).collect()
}

fn relative_error(light: &[f64], rest: &[f64], response: &[f64]) -> f64 {
    let sum = |of: &[f64]| of.iter().zip(response).map(|(a, b)| a * b).sum::<f64>();
    let (all, greatest) = (sum(light), response.iter().copied().fold(0.0, f64::max));
    let least = DARK * greatest * light.iter().sum::<f64>();
    if least > 0.0 { sum(rest).abs() / all.max(least) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaussian(center_nm: f64, fwhm_nm: f64) -> impl Fn(f64) -> f64 {
        move |nm| (-4.0 * std::f64::consts::LN_2 * ((nm - center_nm) / fwhm_nm).powi(2)).exp()
    }

    #[test]
    fn what_is_linear_between_the_nodes_is_made_up_exactly() {
        let nodes = ExcitationNodes::new(vec![340.0, 350.0, 366.0, 380.0]).unwrap();
        let light = Curve::new(nodes.nodes_nm().to_vec(), vec![0.0, 2.0, 0.5, 1.0]).unwrap();
        for (weight, value) in nodes.weights(&light).iter().zip(light.values()) {
            assert!((weight - value).abs() < 1e-12, "{weight} {value}");
        }
        let sum: f64 = (0..4).map(|node| nodes.hat(node).at(372.0)).sum();
        assert!((sum - 1.0).abs() < 1e-12);
        assert!(
            (nodes.share_outside(&Curve::new(vec![330.0, 350.0], vec![1.0, 1.0]).unwrap()) - 0.5).abs()
                < 1e-9
        );
        assert!(ExcitationNodes::new(vec![340.0, 330.0, 350.0]).is_err());
    }

    #[test]
    fn chosen_nodes_hold_every_narrow_light_and_wide_ones_better() {
        // As narrow as the Soret bands of porphyrin and of blood, and a wide one
        let responses = [
            Curve::from_fn(280.0, 620.0, gaussian(405.0, 32.0)),
            Curve::from_fn(280.0, 620.0, |nm| 1.0 - 0.8 * gaussian(415.0, 30.0)(nm)),
            Curve::from_fn(280.0, 620.0, gaussian(350.0, 80.0)),
        ];
        let nodes = ExcitationNodes::choose([320.0, 560.0], [340.0, 500.0], &responses, 0.002);
        assert!(nodes.len() < 45, "{nodes:?}");
        let mut worst = [0.0_f64; 2];
        for tenth in 3400..=5000 {
            for (worst, fwhm_nm) in worst.iter_mut().zip([8.0, 20.0]) {
                let light = Curve::from_fn(300.0, 600.0, gaussian(f64::from(tenth) / 10.0, fwhm_nm));
                *worst = worst.max(nodes.error(&light, &responses));
            }
        }
        // Peaks between those that were tried, and other samples, may be a little worse
        assert!(worst[0] < 0.0025 && worst[1] < 0.5 * worst[0], "{worst:?}");
        // Dense where the responses bend most
        let least = |from: f64, until: f64| {
            let pairs = nodes.nodes_nm().windows(2).filter(|pair| pair[0] >= from && pair[1] <= until);
            pairs.map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min)
        };
        assert!(least(390.0, 430.0) < least(465.0, 501.0), "{nodes:?}");
    }
}
