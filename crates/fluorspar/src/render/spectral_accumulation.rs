//! Runs spectra from the far end of a path to the camera: at each vertex
//! `arriving -> R * arriving + F * arriving + direct light`, on whole band vectors, every component at once.

use std::f32::consts::FRAC_1_PI;

use super::compiled_scene::CompiledScene;
use super::path::{Path, Vertex};

/// Band vectors of all components while they travel, `[group][kind][band]` with kinds reflected, one per
/// fluorophore, multiple.
#[derive(Debug)]
pub(super) struct SpectralState {
    values: Vec<f32>,
    next: Vec<f32>,
    fluoresced: Vec<f32>,
    kinds: usize,
    bands: usize,
    /// Per group: holds light that never fluoresced; holds light that did.
    reflected: Vec<bool>,
    fluorescent: Vec<bool>,
}

impl SpectralState {
    pub(super) fn new(scene: &CompiledScene<'_>) -> Self {
        let kinds = scene.plain_operators.len() + 2;
        let groups = scene.lamp_operators.len();
        let len = groups * kinds * scene.bands;
        Self {
            values: vec![0.0; len],
            next: vec![0.0; len],
            fluoresced: vec![0.0; scene.bands],
            kinds,
            bands: scene.bands,
            reflected: vec![false; groups],
            fluorescent: vec![false; groups],
        }
    }

    /// Computes the radiance of every component that reaches the camera along the path.
    pub(super) fn gather(&mut self, scene: &CompiledScene<'_>, path: &Path) {
        self.values.fill(0.0);
        self.reflected.fill(false);
        self.fluorescent.fill(false);
        for vertex in path.vertices().iter().rev() {
            self.add_emission(scene, &vertex.arriving);
            self.scatter(scene, vertex);
        }
        self.add_emission(scene, &path.seen);
    }

    /// How many components there are.
    pub(super) fn components(&self) -> usize {
        self.reflected.len() * self.kinds
    }

    /// Radiance of one component, one value per band.
    pub(super) fn component(&self, component: usize) -> &[f32] {
        &self.values[component * self.bands..(component + 1) * self.bands]
    }

    /// Components that hold anything after [`Self::gather`].
    pub(super) fn is_lit(&self, component: usize) -> bool {
        let group = component / self.kinds;
        if component.is_multiple_of(self.kinds) { self.reflected[group] } else { self.fluorescent[group] }
    }

    fn add_emission(&mut self, scene: &CompiledScene<'_>, emission: &[(usize, f32)]) {
        for &(source, factor) in emission {
            let source = &scene.sources[source];
            self.reflected[source.group] = true;
            let start = source.group * self.kinds * self.bands;
            for (value, spectrum) in self.values[start..start + self.bands].iter_mut().zip(&source.bands) {
                *value += factor * spectrum;
            }
        }
    }

    fn scatter(&mut self, scene: &CompiledScene<'_>, vertex: &Vertex) {
        let (bands, kinds) = (self.bands, self.kinds);
        let material = &scene.materials[vertex.material];
        let continues = vertex.diffuse > 0.0 || vertex.gloss > 0.0 || vertex.fluorescent > 0.0;
        for group in 0..self.reflected.len() {
            let (was_reflected, was_fluorescent) = (self.reflected[group], self.fluorescent[group]);
            let base = group * kinds * bands;
            if (was_reflected || was_fluorescent) && continues {
                let fluoresces = vertex.fluorescent > 0.0 && vertex.concentration.iter().any(|&c| c > 0.0);
                // Fluorescence reads the arriving light, so it comes before the elastic step overwrites it.
                self.next[base..base + kinds * bands].fill(0.0);
                if fluoresces && was_reflected {
                    let arriving = &self.values[base..base + bands];
                    for ((fluorophore, _), concentration) in
                        material.fluorophores.iter().zip(&vertex.concentration)
                    {
                        if *concentration > 0.0 {
                            let start = base + (1 + fluorophore) * bands;
                            scene.lamp_operators[group][*fluorophore].add_product(
                                vertex.fluorescent * concentration,
                                arriving,
                                &mut self.next[start..start + bands],
                            );
                        }
                    }
                    self.fluorescent[group] = true;
                }
                if fluoresces && was_fluorescent {
                    self.fluoresced.fill(0.0);
                    for kind in 1..kinds {
                        let start = base + kind * bands;
                        for (sum, value) in self.fluoresced.iter_mut().zip(&self.values[start..start + bands])
                        {
                            *sum += value;
                        }
                    }
                    let start = base + (kinds - 1) * bands;
                    for ((fluorophore, _), concentration) in
                        material.fluorophores.iter().zip(&vertex.concentration)
                    {
                        if *concentration > 0.0 {
                            scene.plain_operators[*fluorophore].add_product(
                                vertex.fluorescent * concentration,
                                &self.fluoresced,
                                &mut self.next[start..start + bands],
                            );
                        }
                    }
                }
                for kind in 0..kinds {
                    if (kind == 0 && !was_reflected) || (kind > 0 && !self.fluorescent[group]) {
                        continue;
                    }
                    let start = base + kind * bands;
                    let values = &mut self.values[start..start + bands];
                    let emitted = &self.next[start..start + bands];
                    for ((value, reflectance), emitted) in
                        values.iter_mut().zip(&vertex.reflectance).zip(emitted)
                    {
                        *value = (vertex.diffuse * reflectance + vertex.gloss) * *value + emitted;
                    }
                }
            } else if was_reflected || was_fluorescent {
                self.values[base..base + kinds * bands].fill(0.0);
                self.reflected[group] = false;
                self.fluorescent[group] = false;
            }
        }

        for (source, direct) in scene.sources.iter().zip(&vertex.direct) {
            if direct.diffuse <= 0.0 && direct.gloss <= 0.0 && direct.fluorescent <= 0.0 {
                continue;
            }
            let base = source.group * kinds * bands;
            self.reflected[source.group] = true;
            let diffuse = direct.diffuse * FRAC_1_PI;
            for ((value, spectrum), reflectance) in
                self.values[base..base + bands].iter_mut().zip(&source.bands).zip(&vertex.reflectance)
            {
                *value += (diffuse * reflectance + direct.gloss) * spectrum;
            }
            for ((fluorophore, _), concentration) in material.fluorophores.iter().zip(&vertex.concentration) {
                if *concentration <= 0.0 {
                    continue;
                }
                self.fluorescent[source.group] = true;
                let factor = direct.fluorescent * FRAC_1_PI * concentration;
                let start = base + (1 + fluorophore) * bands;
                for (value, exitance) in
                    self.values[start..start + bands].iter_mut().zip(&source.exitance[*fluorophore])
                {
                    *value += factor * exitance;
                }
            }
        }
    }
}
