//! Scene compilation: a scene becomes plain buffers, part by part.
//!
//! | file | what |
//! |---|---|
//! | `geometry` | triangles, instances, analytic shapes, bounding volume hierarchies |
//! | `lights` | lights, and the distinct spectra that they emit |
//! | `emitters` | the distinct matrices of fluorophores, on surfaces and in tissue |
//! | `bases` | the hats of nodes, and what they excite |
//! | `visible_points` | points that the camera sees, samples of the scene |
//! | `operators` | fluorescence operators, weighted by the spectrum of each light group |
//! | `excitation` | bases of the light that arrives after reflections |
//! | `materials` | band averages and tables of every material |
//! | `spread` | radial profiles of translucent materials |
//! | `interreflection` | how much interreflection adds to direct light |

mod bases;
mod emitters;
mod excitation;
mod geometry;
mod interreflection;
mod lights;
mod materials;
mod operators;
mod spread;
mod visible_points;

use fluorspar_accel::{BuildError, Simd};

use super::compiled_scene::{CompiledScene, EmissionBands};
use super::settings::RenderSettings;
use super::survival_probability::RouletteModel;
use crate::interruption::end_if_interrupted;
use crate::scene::Scene;

impl CompiledScene {
    /// Of the settings only the excitation nodes and the roughness of coats count.
    pub(super) fn new(scene: &Scene, settings: &RenderSettings) -> Result<Self, BuildError> {
        // Compile surfaces and light sources
        let (geometry, emissive) = geometry::compile(scene)?;
        let matrices = emitters::Matrices::new(scene);
        let lights = lights::compile(scene, &matrices.list, emissive, settings);

        // Weight the excitation spectrum of each light group by what arrives at the visible points
        end_if_interrupted();
        let points = visible_points::on_fluorescent_surfaces(scene, &geometry);
        let group_spectra = operators::group_spectra(scene, &points);
        let operators = operators::compile(scene, &matrices.list, &group_spectra, settings);
        let bases = bases::compile(scene, &matrices.list, &lights, settings);

        // Compile materials
        end_if_interrupted();
        let roulette = RouletteModel::new(&scene.grid);
        let (materials, material_spectra) = materials::compile(scene, &matrices, &roulette, &group_spectra);
        let repeat_probability =
            excitation::repeat_probability(&materials, &material_spectra, &lights, &operators.unweighted);
        let excitation = excitation::compile(operators.of_groups, &lights, &material_spectra);
        let has_translucency = material_spectra.iter().any(|material| material.spread.is_some());
        let emission_bands = EmissionBands::new(&scene.grid);
        let has_holes = scene.objects.iter().any(|object| materials.has_opacity(object.material));

        let has_discrete_choices =
            materials.has_discrete_choices() || lights.group_lights.iter().any(|group| group.len() > 1);
        let mut compiled = Self {
            camera: scene.camera.clone(),
            grid: scene.grid.clone(),
            bands: scene.grid.len(),
            object_material: scene.objects.iter().map(|object| object.material).collect(),
            has_discrete_choices,
            simd: Simd::detect(),
            clearance: (1e-6 * geometry.largest_coordinate_m()).max(1e-9),
            bvh: geometry.bvh,
            vertices: geometry.vertices,
            film_normals: geometry.film_normals,
            triangles: geometry.triangles,
            instances: geometry.instances,
            shapes: geometry.shapes,
            sources: lights.sources,
            lights: lights.lights,
            light_targets: lights.light_targets,
            group_lights: lights.group_lights,
            object_light: lights.object_light,
            environment: lights.environment,
            environment_maps: lights.environment_maps,
            materials,
            material_spectra,
            has_holes,
            has_translucency,
            regularizes: settings.regularize,
            emission_bands,
            roulette,
            fluorophores: scene.fluorophores.len(),
            spectra: settings.spectrum_number(scene.light_groups.len()),
            excitation,
            bases,
            plain_operators: operators.unweighted,
            repeat_probability,
        };

        // Prepare Russian roulette
        end_if_interrupted();
        let gain = interreflection::gain(&compiled);
        compiled.roulette.fill_in(scene, &group_spectra, &gain);
        Ok(compiled)
    }
}
