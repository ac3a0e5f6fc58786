//! The vertices of a path, and what the spectra need to run back along it: scalars only.

use super::compiled_scene::Emitter;

/// Direct light of one source at a vertex: factors on the source's spectrum.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DirectLight {
    /// Irradiance that the diffuse base turns into radiance `R e / pi`.
    pub(super) diffuse: f32,
    /// Irradiance that reaches the fluorophores.
    pub(super) fluorescent: f32,
    /// Radiance reflected by the coat.
    pub(super) gloss: f32,
}

/// A vertex of the path. Its lists lie in the path, at the places that it holds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Vertex {
    pub(super) material: u32,
    /// Start of the weights of its reflectance terms in [`Path::weights`].
    weights: u32,
    /// Start and number of its entries in [`Path::emitters`].
    emitters: (u32, u32),
    /// Start and number of its entries in [`Path::emission`].
    emission: (u32, u32),
    /// Factor on light that arrives along the continued path: times the reflectance.
    pub(super) diffuse: f32,
    /// Factor for the fluorescence operator.
    pub(super) fluorescent: f32,
    /// Achromatic factor of the coat.
    pub(super) gloss: f32,
}

/// How far from where it entered light leaves the first vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexSpread {
    /// Node of the radial profiles below the distance, and the share of the way to the next.
    pub(super) node: usize,
    pub(super) fraction: f32,
    /// One over the density with which it was drawn, mm².
    pub(super) inverse_density: f32,
    /// For the choice of a state of each fluorophore.
    pub(super) choice: f32,
}

/// The vertices of one path; reused from path to path.
#[derive(Debug, Default)]
pub(super) struct Path {
    vertices: Vec<Vertex>,
    /// Weights of reflectance terms, vertex after vertex.
    weights: Vec<f32>,
    /// Fluorophores that are present, with their concentrations, vertex after vertex.
    emitters: Vec<(Emitter, f32)>,
    /// Direct light, one entry per source, vertex after vertex.
    direct: Vec<DirectLight>,
    /// Emission seen along the continued path: source and factor (surroundings may hold several).
    emission: Vec<(u32, f32)>,
    /// Emission seen by the camera directly.
    pub(super) seen: Vec<(u32, f32)>,
    /// Source of the random choices that are made while spectra run back along the path.
    pub(super) choices: u64,
    /// Of the first vertex, where light leaves it elsewhere than it entered.
    pub(super) spread: Option<VertexSpread>,
    /// How much more direct light there is where that entered, one entry per source.
    pub(super) entered: Vec<DirectLight>,
}

impl Path {
    pub(super) fn clear(&mut self) {
        self.vertices.clear();
        self.weights.clear();
        self.emitters.clear();
        self.direct.clear();
        self.emission.clear();
        self.seen.clear();
        self.spread = None;
    }

    /// Vertices from the camera on.
    pub(super) fn vertices(&self) -> &[Vertex] {
        &self.vertices
    }

    /// Weights of the reflectance terms of the vertex's material; more may follow.
    #[inline(always)]
    pub(super) fn weights(&self, vertex: &Vertex) -> &[f32] {
        &self.weights[vertex.weights as usize..]
    }

    /// Fluorophores at a vertex, with their concentrations, above 0.
    #[inline(always)]
    pub(super) fn emitters(&self, vertex: &Vertex) -> &[(Emitter, f32)] {
        let (start, count) = vertex.emitters;
        &self.emitters[start as usize..(start + count) as usize]
    }

    /// Direct light at a vertex, one entry per source.
    #[inline(always)]
    pub(super) fn direct(&self, vertex: usize, sources: usize) -> &[DirectLight] {
        &self.direct[vertex * sources..(vertex + 1) * sources]
    }

    /// Emission seen along the path continued from a vertex.
    #[inline(always)]
    pub(super) fn emission(&self, vertex: &Vertex) -> &[(u32, f32)] {
        let (start, count) = vertex.emission;
        &self.emission[start as usize..(start + count) as usize]
    }

    /// Adds a vertex of a material; its weights, lights and factors follow.
    pub(super) fn push_vertex(&mut self, material: usize, sources: usize) {
        let weights = self.weights.len() as u32;
        let emitters = (self.emitters.len() as u32, 0);
        self.vertices.push(Vertex { material: material as u32, weights, emitters, ..Vertex::default() });
        self.direct.resize(self.direct.len() + sources, DirectLight::default());
    }

    /// Lets light leave the first vertex elsewhere than it entered; direct light there follows.
    pub(super) fn spread_first_vertex(&mut self, spread: VertexSpread, sources: usize) {
        self.spread = Some(spread);
        self.entered.clear();
        self.entered.resize(sources, DirectLight::default());
    }

    /// How much more direct light of a source there is where light entered than at the first vertex: diffuse, fluorescent.
    pub(super) fn entered_more(&self, source: usize) -> [f32; 2] {
        [self.entered[source].diffuse, self.entered[source].fluorescent]
    }

    /// Adds to the weights of the reflectance terms of the last vertex.
    pub(super) fn push_weight(&mut self, weight: f32) {
        self.weights.push(weight);
    }

    /// Adds the fluorophores of the last vertex: `list` is called with the weights of its reflectance terms and the list to add to.
    pub(super) fn push_emitters(&mut self, list: impl FnOnce(&[f32], &mut Vec<(Emitter, f32)>)) {
        let Some(vertex) = self.vertices.last_mut() else { return };
        list(&self.weights[vertex.weights as usize..], &mut self.emitters);
        vertex.emitters.1 = self.emitters.len() as u32 - vertex.emitters.0;
    }

    /// Sets the factors on light that arrives at the last vertex along the continued path.
    pub(super) fn continue_with(&mut self, diffuse: f32, fluorescent: f32, gloss: f32) {
        if let Some(vertex) = self.vertices.last_mut() {
            (vertex.diffuse, vertex.fluorescent, vertex.gloss) = (diffuse, fluorescent, gloss);
        }
    }

    /// Direct light of a source at a vertex, to add to.
    pub(super) fn direct_mut(&mut self, vertex: usize, sources: usize, source: usize) -> &mut DirectLight {
        &mut self.direct[vertex * sources + source]
    }

    /// Adds emission that a ray from the last vertex, or from the camera, meets.
    pub(super) fn add_emission(&mut self, source: usize, factor: f32) {
        let entry = (source as u32, factor);
        match self.vertices.last_mut() {
            None => self.seen.push(entry),
            Some(vertex) => {
                if vertex.emission.1 == 0 {
                    vertex.emission.0 = self.emission.len() as u32;
                }
                vertex.emission.1 += 1;
                self.emission.push(entry);
            }
        }
    }
}
