//! Layered tissue whose parameters vary over a surface: known at the nodes of a grid of parameters, multilinear between.

use glam::Vec2;

use super::material_error::MaterialError;
use super::texture::ScalarTexture;
use crate::tissue::RadialProfile;

/// Most parameters that vary at once.
pub const MAX_MAPPED_PARAMETERS: usize = 3;
/// Most nodes of a parameter.
pub const MAX_NODES: usize = 8;

/// A parameter of tissue over a surface, and the values at which the tissue is known.
#[derive(Clone, Debug, PartialEq)]
pub struct MappedParameter {
    /// Name for error messages, for instance "superficial_blood".
    pub name: String,
    /// Values at which the tissue is known, increasing: 2 to 8.
    pub nodes: Vec<f32>,
    /// How the weight of the upper node rises over each interval: the share `t` of the way gives the weight
    /// `t / (t + bend (1 - t))`, so that 1 is linear and less rises faster at first. None: all are 1.
    pub bends: Vec<f32>,
    /// The parameter over the surface, in the unit of the nodes. Values beyond the outermost nodes count as these.
    pub map: ScalarTexture,
}

/// States of a tissue on a grid of its parameters. At a point the state is the mean of the nodes around its parameters, a
/// product of weights along each of them: weights are 0 to 1 and add up to 1, so that a mean of states that conserve photons
/// conserves them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StateGrid {
    /// Parameters that vary, at most 3; the nodes of the last one follow each other. Without any there is one state.
    pub parameters: Vec<MappedParameter>,
    /// How far from where it enters reflected light of each state leaves, in their order. None: it leaves where it enters.
    pub profiles: Vec<RadialProfile>,
}

impl StateGrid {
    /// Number of states: the product of the numbers of nodes.
    pub fn len(&self) -> usize {
        self.parameters.iter().map(|parameter| parameter.nodes.len()).product()
    }

    /// Whether a parameter has no nodes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Parameters of a state, in their order.
    pub fn parameters_of(&self, state: usize) -> Vec<f32> {
        let mut rest = state;
        let mut values: Vec<f32> = self
            .parameters
            .iter()
            .rev()
            .map(|parameter| {
                let value = parameter.nodes[rest % parameter.nodes.len()];
                rest /= parameter.nodes.len();
                value
            })
            .collect();
        values.reverse();
        values
    }

    /// Calls `each` with the number and the weight of every state at a point, in order, those of weight 0 included.
    #[inline]
    pub fn weights(&self, uv: Vec2, mut each: impl FnMut(usize, f32)) {
        let mut axes = [[0.0; MAX_NODES]; MAX_MAPPED_PARAMETERS];
        for (axis, parameter) in axes.iter_mut().zip(&self.parameters) {
            parameter.weights(uv, axis);
        }
        for state in 0..self.len() {
            let (mut rest, mut weight) = (state, 1.0);
            for (axis, parameter) in axes.iter().zip(&self.parameters).rev() {
                let nodes = parameter.nodes.len();
                weight *= axis[rest % nodes];
                rest /= nodes;
            }
            each(state, weight);
        }
    }

    /// Weights of all states at a point, in their order.
    pub fn weights_at(&self, uv: Vec2) -> Vec<f32> {
        let mut weights = Vec::with_capacity(self.len());
        self.weights(uv, |_, weight| weights.push(weight));
        weights
    }

    /// The same states with other maps of the parameters, made from theirs.
    #[must_use]
    pub fn with_maps(&self, mut map: impl FnMut(&ScalarTexture) -> ScalarTexture) -> Self {
        let parameters = self.parameters.iter();
        let changed =
            |parameter: &MappedParameter| MappedParameter { map: map(&parameter.map), ..parameter.clone() };
        Self { parameters: parameters.map(changed).collect(), profiles: self.profiles.clone() }
    }

    /// Checks numbers and order of the nodes.
    pub(super) fn check(&self, states: usize) -> Result<(), MaterialError> {
        let bad = |message: String| Err(MaterialError::States(message));
        if self.parameters.len() > MAX_MAPPED_PARAMETERS {
            let count = self.parameters.len();
            return bad(format!(
                "{count} parameters vary over the surface; at most {MAX_MAPPED_PARAMETERS} can"
            ));
        }
        for MappedParameter { name, nodes, bends, .. } in &self.parameters {
            if !(2..=MAX_NODES).contains(&nodes.len()) || !nodes.is_sorted_by(|a, b| a < b) {
                return bad(format!("{name} needs 2 to {MAX_NODES} nodes that increase; got {nodes:?}"));
            }
            let fit = bends.is_empty() || bends.len() + 1 == nodes.len();
            if !fit || !bends.iter().all(|bend| bend.is_finite() && *bend > 0.0) {
                return bad(format!(
                    "{name} needs a bend above 0 for each interval, or none at all; got {bends:?}"
                ));
            }
        }
        if self.len() == states {
            return Ok(());
        }
        bad(format!("the nodes of the parameters make {} states, but {states} are given", self.len()))
    }
}

impl MappedParameter {
    /// A parameter whose nodes are still to be chosen.
    pub fn without_nodes(name: String, map: ScalarTexture) -> Self {
        Self { name, nodes: Vec::new(), bends: Vec::new(), map }
    }

    /// Weights of the nodes at a point: hat functions with bent sides.
    #[inline]
    fn weights(&self, uv: Vec2, weights: &mut [f32; MAX_NODES]) {
        let last = self.nodes.len() - 1;
        let value = self.map.at(uv).clamp(self.nodes[0], self.nodes[last]);
        let right = self.nodes.partition_point(|&node| node < value).clamp(1, last);
        let fraction = (value - self.nodes[right - 1]) / (self.nodes[right] - self.nodes[right - 1]);
        let weight = match self.bends.get(right - 1) {
            Some(bend) => bent(fraction, *bend),
            None => fraction,
        };
        weights[right - 1] = 1.0 - weight;
        weights[right] = weight;
    }
}

/// Weight of the upper node of an interval, a share `fraction` of the way to it: from 0 to 1, rising.
#[inline]
pub(super) fn bent(fraction: f32, bend: f32) -> f32 {
    fraction / (fraction + bend * (1.0 - fraction))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameter(nodes: &[f32], value: f32) -> MappedParameter {
        let map = ScalarTexture::Constant(value);
        MappedParameter { nodes: nodes.to_vec(), ..MappedParameter::without_nodes("x".into(), map) }
    }

    fn grid(parameters: Vec<MappedParameter>) -> StateGrid {
        StateGrid { parameters, profiles: Vec::new() }
    }

    fn weights(grid: &StateGrid) -> Vec<f32> {
        let mut weights = Vec::new();
        grid.weights(Vec2::ZERO, |state, weight| {
            assert_eq!(state, weights.len());
            weights.push(weight);
        });
        weights
    }

    #[test]
    fn weights_interpolate_the_parameters() {
        let grid = grid(vec![parameter(&[0.5, 1.0, 4.0], 2.5), parameter(&[0.0, 2.0], 0.5)]);
        let weights = weights(&grid);
        assert_eq!(weights.len(), 6);
        assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        for (axis, expected) in [2.5, 0.5].into_iter().enumerate() {
            let mean: f32 =
                weights.iter().enumerate().map(|(state, w)| w * grid.parameters_of(state)[axis]).sum();
            assert!((mean - expected).abs() < 1e-6, "{axis}: {mean}");
        }
    }

    #[test]
    fn bends_change_weights_between_nodes_only() {
        let bent = |value| {
            let bends = vec![0.5, 3.0];
            weights(&grid(vec![MappedParameter { bends, ..parameter(&[1.0, 2.0, 4.0], value) }]))
        };
        assert_eq!(bent(1.0), [1.0, 0.0, 0.0]);
        assert_eq!(bent(2.0), [0.0, 1.0, 0.0]);
        assert_eq!(bent(4.0), [0.0, 0.0, 1.0]);
        // t / (t + bend (1 - t)) half way: 1 / (1 + bend).
        assert!((bent(1.5)[1] - 1.0 / 1.5).abs() < 1e-6 && (bent(3.0)[2] - 0.25).abs() < 1e-6);
        let rising: Vec<f32> = (0..=20).map(|i| bent(1.0 + 0.05 * i as f32)[1]).collect();
        assert!(rising.is_sorted_by(|a, b| a < b), "{rising:?}");
    }

    #[test]
    fn beyond_the_nodes_the_outermost_state_holds() {
        for (value, expected) in [(-3.0, [1.0, 0.0]), (9.0, [0.0, 1.0]), (1.0, [1.0, 0.0])] {
            let grid = grid(vec![parameter(&[1.0, 4.0], value)]);
            assert_eq!(weights(&grid), expected);
        }
        assert_eq!(weights(&StateGrid::default()), [1.0]);
    }

    #[test]
    fn grids_that_do_not_fit_are_refused() {
        let check = |nodes: &[f32], states| {
            grid(vec![parameter(nodes, 1.0)]).check(states).map_err(|e| e.to_string())
        };
        assert_eq!(check(&[1.0, 2.0], 2), Ok(()));
        assert!(check(&[1.0, 2.0], 3).unwrap_err().contains("2 states, but 3"));
        assert!(check(&[2.0, 1.0], 2).unwrap_err().contains("increase"));
        assert!(check(&[1.0], 1).unwrap_err().contains("2 to 8"));
        for bends in [vec![1.0, 1.0], vec![0.0], vec![f32::NAN]] {
            let parameters = vec![MappedParameter { bends, ..parameter(&[1.0, 2.0], 1.0) }];
            let said = grid(parameters).check(2).unwrap_err().to_string();
            assert!(said.contains("a bend above 0 for each interval"), "{said}");
        }
        assert!(grid(vec![parameter(&[1.0, 2.0], 1.0); 4]).check(16).is_err());
    }
}
