//! Materials.

use fluorspar::material::{
    Coat, Coated, Conductor, Dielectric, FluorophoreAmount, Lambertian, MAX_DIELECTRIC_INDEX, MIN_ROUGHNESS,
    Material, Mixture, NormalMap, ReflectanceTerm, ScalarTexture, Scattering,
};
use fluorspar::quote::excerpt;
use fluorspar::spectral::Curve;
use fluorspar_format::{PbrtError, PbrtKind, PbrtPlace, Transfer, read_texture};

use crate::convert::Convert;
use crate::given::Given;
use crate::spectrum::Role;
use crate::texture::{Terms, uniform};

/// Materials without a surface: light passes as if there were nothing.
const INVISIBLE: &[&str] = &["", "none", "interface"];

/// Most mixtures within mixtures.
const MOST_MIXED: usize = 32;

/// Largest index of a coat.
const MOST_INDEX: f64 = 3.0;

impl Convert<'_> {
    /// Number of the material of a shape; `None` where it has no surface.
    pub(crate) fn material(&mut self, index: Option<usize>) -> Result<Option<usize>, PbrtError> {
        match index {
            Some(index) => self.material_within(index, 0),
            None => {
                if self.default_material.is_none() {
                    self.default_material = Some(self.materials.len());
                    self.materials.push(Material::lambertian("default", Curve::constant(0.5)));
                }
                Ok(self.default_material)
            }
        }
    }

    fn material_within(&mut self, index: usize, depth: usize) -> Result<Option<usize>, PbrtError> {
        if let Some(known) = self.material_of.get(&index) {
            return Ok(*known);
        }
        let tree = self.tree;
        let entity = &tree.materials[index].entity;
        if depth == MOST_MIXED {
            let message = format!(
                "mixtures are nested more than {MOST_MIXED} deep; remove a mixture that contains itself"
            );
            return Err(self.error(entity.at, message));
        }
        if INVISIBLE.contains(&entity.class.as_str()) {
            self.material_of.insert(index, None);
            return Ok(None);
        }
        let given = Given::new(entity);
        let class = excerpt(&entity.class);
        let own = tree.materials[index].name.as_deref().map_or_else(|| format!("{class}_{index}"), excerpt);
        let scattering = match entity.class.as_str() {
            "matte" => self.matte(&given, "Kd")?,
            "diffuse" => self.matte(&given, "reflectance")?,
            "plastic" | "substrate" | "uber" => self.glossy(&given)?,
            "coateddiffuse" => self.coated_diffuse(&given)?,
            "metal" | "conductor" => self.metal(&given, "")?,
            "coatedconductor" => {
                self.remark(entity.at, "\"coatedconductor\": the metal is kept, without its coat");
                given.used(&[
                    "interface.roughness",
                    "interface.uroughness",
                    "interface.vroughness",
                    "interface.eta",
                    "thickness",
                    "g",
                    "albedo",
                    "maxdepth",
                    "nsamples",
                ]);
                self.metal(&given, "conductor.")?
            }
            "glass" | "dielectric" => self.glass(&given)?,
            "thindielectric" => self.thin_dielectric(&given)?,
            "mirror" => self.mirror(&given)?,
            "mix" => match self.mixture(&given, depth)? {
                Some(mixture) => mixture,
                None => return Ok(None),
            },
            _ => self.stand_in(&given)?,
        };
        let mut material = Material::new(&own, scattering);
        self.fluorescence(&given, &mut material)?;
        material.opacity = self.opacity(&given)?;
        material.normal_map = self.normal_map(&given)?;
        for name in ["bumpmap", "displacement"] {
            if given.find(name).is_some() {
                self.remark(entity.at, format!("\"{name}\": bumps have no counterpart; give a normal map"));
            }
        }
        given.finish("Material", &mut self.remarks);
        let number = self.materials.len();
        self.materials.push(material);
        self.material_of.insert(index, Some(number));
        Ok(Some(number))
    }

    /// The terms of a reflectance, between 0 and 1.
    fn reflectance(&mut self, given: &Given<'_>, name: &str, usual: f64) -> Result<Terms, PbrtError> {
        let terms = match given.find(name) {
            Some(parameter) => self.terms(parameter, Role::Reflectance)?,
            None => uniform(Curve::constant(usual)),
        };
        let at = given.find(name).map_or(given.entity.at, |parameter| parameter.at);
        let mut is_bounded = false;
        let bound = |value: &f64| value.clamp(0.0, 1.0);
        let mut bounded = Terms::new();
        for term in terms {
            let values = term.spectrum.values();
            if values.iter().all(|value| (0.0..=1.0).contains(value)) {
                bounded.push(term);
                continue;
            }
            is_bounded = true;
            let nm = term.spectrum.wavelengths_nm().to_vec();
            let curve = Curve::new(nm, values.iter().map(bound).collect())
                .map_err(|e| self.error(at, e.to_string()))?;
            bounded.push(ReflectanceTerm { spectrum: curve, ..term });
        }
        // Weights of a texture are cut as well: those of bright images times a factor exceed 1
        let mut cut = Terms::new();
        for term in bounded {
            let limit = limit_of_weight(&term.spectrum);
            let exceeds = term.weight.max() > limit;
            is_bounded |= exceeds;
            let weight = if exceeds {
                self.changed(term.weight, |weight| weight.min(limit), at)?
            } else {
                term.weight
            };
            cut.push(ReflectanceTerm { weight, ..term });
        }
        if is_bounded {
            self.remark(at, format!("\"{name}\": a reflectance lies outside of 0 to 1 and is cut there"));
        }
        Ok(cut)
    }

    /// The mean over wavelengths and the surface of a spectrum that can only be a number here.
    fn mean(&mut self, given: &Given<'_>, name: &str, usual: f64) -> Result<f64, PbrtError> {
        let terms = self.reflectance(given, name, usual)?;
        if terms.iter().any(|term| term.weight.constant().is_none()) {
            let text = format!("\"{name}\": it is the same everywhere here, the largest of its texture");
            self.remark(given.entity.at, text);
        }
        let grid = &self.options.grid;
        let mean = |curve: &Curve| curve.bin_averages(grid).iter().sum::<f64>() / grid.len() as f64;
        Ok(terms.iter().map(|term| mean(&term.spectrum) * f64::from(term.weight.max())).sum::<f64>().min(1.0))
    }

    fn matte(&mut self, given: &Given<'_>, name: &str) -> Result<Scattering, PbrtError> {
        if let Some(sigma) = given.find("sigma")
            && sigma.numbers() != Some(&[0.0])
        {
            self.remark(sigma.at, "\"sigma\": the surface is Lambertian");
        }
        let reflectance = self.reflectance(given, name, 0.5)?;
        Ok(Scattering::Lambertian(Lambertian { reflectance, states: None }))
    }

    /// GGX alpha of `roughness`, or of `uroughness` and `vroughness`, as the version of the file maps it.
    fn alpha(&mut self, given: &Given<'_>, prefix: &str, usual: f32) -> Result<ScalarTexture, PbrtError> {
        let names = ["roughness", "uroughness", "vroughness"].map(|name| format!("{prefix}{name}"));
        let [both, u, v] = names.each_ref().map(|name| given.find(name));
        if let (Some(u), Some(v)) = (u, v)
            && u.values != v.values
        {
            self.remark(
                v.at,
                "\"vroughness\": roughness is the same in all directions, that of \"uroughness\"",
            );
        }
        let remap = given.flag("remaproughness").unwrap_or(true);
        let Some(parameter) = u.or(v).or(both) else {
            let usual = if remap { self.remapped(usual) } else { usual };
            return Ok(ScalarTexture::Constant(usual));
        };
        let texture = self.weight(parameter)?;
        let is_v4 = self.is_v4();
        let at = parameter.at;
        let alpha = move |roughness: f32| {
            let roughness = roughness.max(0.0);
            if remap { remapped(roughness, is_v4) } else { roughness }.min(1.0)
        };
        self.changed(texture, alpha, at)
    }

    fn remapped(&self, roughness: f32) -> f32 {
        remapped(roughness, self.is_v4()).min(1.0)
    }

    /// Version 3: a diffuse reflection and a glossy one. Here a coat, whose index follows from the glossy reflectance.
    fn glossy(&mut self, given: &Given<'_>) -> Result<Scattering, PbrtError> {
        let at = given.entity.at;
        let is_substrate = given.entity.class == "substrate";
        let usual = if is_substrate { 0.5 } else { 0.25 };
        let reflectance = self.reflectance(given, "Kd", usual)?;
        let glossy = self.mean(given, "Ks", usual)?;
        let index = match given.find("eta").or(given.find("index")) {
            Some(parameter) => self.index(parameter)?,
            None => 1.5,
        };
        // Of plastic, Ks is a factor on Fresnel's reflectance; of a substrate, the reflectance itself.
        let straight = ((index - 1.0) / (index + 1.0)).powi(2);
        let wanted = if is_substrate { glossy } else { glossy * straight };
        for name in ["Kr", "Kt"] {
            if given.find(name).is_some() && self.mean(given, name, 0.0)? > 0.0 {
                self.remark(
                    at,
                    format!(
                        "\"{name}\": smooth reflection and transmission besides gloss have no counterpart"
                    ),
                );
            }
        }
        let alpha = self.alpha(given, "", 0.1)?;
        if wanted <= 0.0 {
            return Ok(Scattering::Lambertian(Lambertian { reflectance, states: None }));
        }
        let root = wanted.sqrt().min((MOST_INDEX - 1.0) / (MOST_INDEX + 1.0));
        let index = (1.0 + root) / (1.0 - root);
        self.remark(
            at,
            format!("\"Ks\": gloss is that of a coat of index {index:.3}, which reflects as much at normal incidence"),
        );
        self.coated(reflectance, index, alpha, at)
    }

    fn coated(
        &mut self,
        reflectance: Terms,
        index: f64,
        alpha: ScalarTexture,
        at: PbrtPlace,
    ) -> Result<Scattering, PbrtError> {
        let roughness = self.changed(alpha, |alpha| alpha.clamp(MIN_ROUGHNESS, 1.0), at)?;
        if self.options.single_scattering && roughness.max() > MIN_ROUGHNESS {
            let text = "single scattering is for rough metals and glass; a rough coat keeps the light that it scatters more than once";
            self.remark(at, text);
        }
        let base = Lambertian { reflectance, states: None };
        Ok(Scattering::Coated(Coated { base, coat: Coat::new(index as f32, roughness) }))
    }

    /// Version 4: the base is given below the coat, where light goes back and forth.
    fn coated_diffuse(&mut self, given: &Given<'_>) -> Result<Scattering, PbrtError> {
        let at = given.entity.at;
        let index = match given.find("eta") {
            Some(parameter) => self.index(parameter)?.clamp(1.0, MOST_INDEX),
            None => 1.5,
        };
        given.used(&["thickness", "maxdepth", "nsamples", "twosided"]);
        for name in ["albedo", "g"] {
            if given.find(name).is_some() {
                self.remark(at, format!("\"{name}\": the layer between coat and base is clear"));
            }
        }
        let below = self.reflectance(given, "reflectance", 0.5)?;
        let alpha = self.alpha(given, "", 0.0)?;
        // R (1 - F) / (1 - R F), F the diffuse reflectance of the coat from inside.
        let inside = internal_reflectance(index);
        let seen = |value: f64| value * (1.0 - inside) / (1.0 - value * inside);
        let is_plain = |term: &ReflectanceTerm| term.weight.constant() == Some(1.0);
        let reflectance = if let [term] = below.as_slice()
            && is_plain(term)
        {
            let values = term.spectrum.values().iter().map(|value| seen(*value)).collect();
            let curve = Curve::new(term.spectrum.wavelengths_nm().to_vec(), values);
            uniform(curve.map_err(|error| self.error(at, error.to_string()))?)
        } else {
            let text = "\"reflectance\": each term of the texture is taken through the coat by itself";
            self.remark(at, text);
            let mut terms = Terms::new();
            for term in below {
                let values = term.spectrum.values().to_vec();
                let top = values.iter().copied().fold(0.0, f64::max);
                let weight = self.changed(
                    term.weight,
                    |weight| {
                        let value = f64::from(weight) * top;
                        if top > 0.0 { (seen(value.min(1.0)) / top) as f32 } else { weight }
                    },
                    at,
                )?;
                terms.push(ReflectanceTerm { spectrum: term.spectrum, weight });
            }
            terms
        };
        self.coated(reflectance, index, alpha, at)
    }

    /// The index of refraction of a parameter, one for all wavelengths.
    fn index(&mut self, parameter: &fluorspar_format::PbrtParameter) -> Result<f64, PbrtError> {
        if parameter.kind == PbrtKind::Texture {
            let texture = self.weight(parameter)?;
            return Ok(f64::from(texture.max()));
        }
        let curve = self.spectrum(parameter, Role::Index)?;
        let (low, high) =
            curve.values().iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        let index = curve.at(587.6);
        if high - low > 1e-6 {
            self.remark(
                parameter.at,
                format!("the index is {index:.4} at all wavelengths, that at 587.6 nm"),
            );
        }
        Ok(index)
    }

    fn glass(&mut self, given: &Given<'_>) -> Result<Scattering, PbrtError> {
        let at = given.entity.at;
        let index = match given.find("eta").or(given.find("index")) {
            Some(parameter) => self.index(parameter)?,
            None => 1.5,
        };
        if !(index > 1.0 && index <= f64::from(MAX_DIELECTRIC_INDEX)) {
            let message = format!(
                "an index of {index}; it must lie above 1 and up to {MAX_DIELECTRIC_INDEX}. For one below 1, turn the surface around by \
                 ReverseOrientation"
            );
            return Err(self.error(at, message));
        }
        if given.find("Kr").is_some() && self.mean(given, "Kr", 1.0)? < 1.0 {
            self.remark(at, "\"Kr\": Fresnel's equations decide how much is reflected");
        }
        let transmittance = match given.find("Kt") {
            Some(_) => self.reflectance(given, "Kt", 1.0)?,
            None => uniform(Curve::constant(1.0)),
        };
        if transmittance.iter().any(|term| term.weight.constant().is_none()) {
            self.remark(at, "\"Kt\": it is the same everywhere here; its texture is left out");
        }
        let roughness = self.alpha(given, "", 0.0)?;
        let transmittance = match transmittance.as_slice() {
            [term] => term.spectrum.scaled(f64::from(term.weight.constant().unwrap_or(1.0))),
            _ => Curve::constant(1.0),
        };
        let single_scattering = self.options.single_scattering;
        let refractive_index = index as f32;
        Ok(Scattering::Dielectric(Dielectric {
            refractive_index,
            roughness,
            transmittance,
            single_scattering,
        }))
    }

    /// Two parallel surfaces: what passes goes straight on. A mirror with holes reflects as much at normal incidence.
    fn thin_dielectric(&mut self, given: &Given<'_>) -> Result<Scattering, PbrtError> {
        let index = match given.find("eta") {
            Some(parameter) => self.index(parameter)?,
            None => 1.5,
        };
        let reflected = thin_reflectance(index);
        self.remark(
            given.entity.at,
            format!("\"thindielectric\": a mirror of {reflected:.3} of the surface, the rest open; it does not rise toward grazing angles"),
        );
        Ok(Scattering::Conductor(mirror(|_| 1.0)))
    }

    fn mirror(&mut self, given: &Given<'_>) -> Result<Scattering, PbrtError> {
        let terms = self.reflectance(given, "Kr", 0.9)?;
        let curve = self.one_curve(&terms, given.entity.at, "Kr");
        self.remark(
            given.entity.at,
            "\"mirror\": a metal that reflects \"Kr\" at normal incidence, more at grazing angles",
        );
        Ok(Scattering::Conductor(mirror(|nm| curve.at(nm))))
    }

    /// The sum of terms where they are largest.
    fn one_curve(&mut self, terms: &Terms, at: PbrtPlace, name: &str) -> Curve {
        if terms.iter().any(|term| term.weight.constant().is_none()) {
            self.remark(
                at,
                format!("\"{name}\": it is the same everywhere here, the largest of its texture"),
            );
        }
        let sum = |nm: f64| terms.iter().map(|t| t.spectrum.at(nm) * f64::from(t.weight.max())).sum::<f64>();
        Curve::from_fn(200.0, 1200.0, sum)
    }

    fn metal(&mut self, given: &Given<'_>, prefix: &str) -> Result<Scattering, PbrtError> {
        let at = given.entity.at;
        let is_v3 = given.entity.class == "metal";
        let roughness = self.alpha(given, prefix, if is_v3 { 0.01 } else { 0.0 })?;
        let [eta, k, reflectance] = ["eta", "k", "reflectance"].map(|name| format!("{prefix}{name}"));
        if given.find(&reflectance).is_some() {
            let terms = self.reflectance(given, &reflectance, 0.5)?;
            let curve = self.one_curve(&terms, at, &reflectance);
            // As pbrt-v4: an index of 1 whose extinction gives the reflectance at normal incidence.
            let extinction = |nm: f64| {
                let r = curve.at(nm).clamp(0.0, 0.9999);
                2.0 * (r / (1.0 - r)).sqrt()
            };
            let (n, k) = (Curve::constant(1.0), Curve::from_fn(200.0, 1200.0, extinction));
            let single_scattering = self.options.single_scattering;
            return Ok(Scattering::Conductor(Conductor { n, k, roughness, single_scattering }));
        }
        let mut part = |name: &str, usual: &str| match given.find(name) {
            Some(parameter) if parameter.kind == PbrtKind::Texture => {
                let message = format!("\"{name}\" of a metal can't be a texture; give a spectrum");
                Err(self.error(parameter.at, message))
            }
            Some(parameter) => self.spectrum(parameter, Role::Index),
            None => self.usual_metal(usual, at),
        };
        let (n, k) = (part(&eta, "metal-Cu-eta")?, part(&k, "metal-Cu-k")?);
        let least = n.values().iter().chain(k.values()).copied().fold(f64::INFINITY, f64::min);
        if least < 0.0 {
            return Err(
                self.error(at, format!("\"eta\" and \"k\" of a metal can't be {least}; give 0 or more"))
            );
        }
        let single_scattering = self.options.single_scattering;
        Ok(Scattering::Conductor(Conductor { n, k, roughness, single_scattering }))
    }

    fn usual_metal(&mut self, name: &str, at: PbrtPlace) -> Result<Curve, PbrtError> {
        let parameter = fluorspar_format::PbrtParameter {
            name: name.into(),
            kind: PbrtKind::Spectrum,
            values: fluorspar_format::PbrtValues::Texts(vec![name.into()]),
            at,
            texture: [None; 2],
        };
        self.spectrum(&parameter, Role::Index)
    }

    /// Two materials side by side; `None` where neither has a surface.
    fn mixture(&mut self, given: &Given<'_>, depth: usize) -> Result<Option<Scattering>, PbrtError> {
        let at = given.entity.at;
        let names: Vec<String> = match given.find("materials").and_then(|parameter| parameter.texts()) {
            Some(names) => names.to_vec(),
            None => ["namedmaterial1", "namedmaterial2"]
                .iter()
                .filter_map(|n| given.text(n))
                .map(String::from)
                .collect(),
        };
        let [first, second] = names.as_slice() else {
            return Err(
                self.error(at, "a mixture needs two materials; add \"string materials\" [ \"A\" \"B\" ]")
            );
        };
        let mut parts = [0; 2];
        for (part, name) in parts.iter_mut().zip([first, second]) {
            let found = match self.tree.named_materials.get(name) {
                Some(&index) => self.material_within(index, depth + 1)?,
                None if self.is_v4() => {
                    let message = format!("no MakeNamedMaterial defines \"{}\"", excerpt(name));
                    return Err(self.error(at, message));
                }
                None => {
                    let name = excerpt(name);
                    let text = format!(
                        "\"{name}\" is taken as matte, as in pbrt-v3: no MakeNamedMaterial defines it"
                    );
                    self.remark(at, text);
                    self.material(None)?
                }
            };
            match found {
                Some(number) => *part = number,
                None => {
                    self.remark(at, "a mixture with a material without surface is no surface");
                    return Ok(None);
                }
            }
        }
        let amount = match given.find("amount") {
            None => ScalarTexture::Constant(0.5),
            Some(parameter)
                if matches!(parameter.kind, PbrtKind::Rgb | PbrtKind::Spectrum | PbrtKind::Xyz) =>
            {
                let curve = self.spectrum(parameter, Role::Reflectance)?;
                let grid = &self.options.grid;
                let mean = curve.bin_averages(grid).iter().sum::<f64>() / grid.len() as f64;
                ScalarTexture::Constant(mean as f32)
            }
            Some(parameter) => match parameter.texture {
                [None, Some(_)] => {
                    let terms = self.terms(parameter, Role::Reflectance)?;
                    terms.first().map_or(ScalarTexture::Constant(0.5), |term| term.weight.clone())
                }
                _ => self.weight(parameter)?,
            },
        };
        if amount.max() > 1.0 {
            return Err(self.error(at, format!("\"amount\" is {} somewhere; give 0 to 1", amount.max())));
        }
        // In version 3 the amount is that of the first material, in version 4 that of the second.
        let [first, second] = if self.is_v4() { parts } else { [parts[1], parts[0]] };
        Ok(Some(Scattering::Mixture(Mixture { first, second, amount })))
    }

    /// A diffuse surface in place of a material that has no counterpart.
    fn stand_in(&mut self, given: &Given<'_>) -> Result<Scattering, PbrtError> {
        let names = ["reflectance", "Kd", "color"];
        let color = names.into_iter().find(|name| given.find(name).is_some());
        let what =
            color.map_or_else(|| "reflects 1/2".to_string(), |name| format!("reflects its \"{name}\""));
        let class = excerpt(&given.entity.class);
        self.remark(
            given.entity.at,
            format!("Material \"{class}\" has no counterpart; a matte surface that {what} stands in"),
        );
        let all: Vec<&str> =
            given.entity.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
        given.used(&all);
        let reflectance = self.reflectance(given, color.unwrap_or("reflectance"), 0.5)?;
        Ok(Scattering::Lambertian(Lambertian { reflectance, states: None }))
    }

    fn fluorescence(&mut self, given: &Given<'_>, material: &mut Material) -> Result<(), PbrtError> {
        let concentration = given.find("concentration");
        let Some(matrix) = given.entity.parameters.iter().find(|p| p.kind == PbrtKind::PhotoLumi) else {
            return Ok(());
        };
        given.used(&[&matrix.name]);
        if material.parts().is_some() {
            self.remark(matrix.at, "the fluorescence of a mixture has no counterpart; give it to its parts");
            return Ok(());
        }
        let amount = match concentration {
            Some(parameter) => self.weight(parameter)?,
            None => ScalarTexture::Constant(1.0),
        };
        let fluorophore = self.photolumi(&material.name, matrix)?;
        material.fluorophores.push(FluorophoreAmount::new(fluorophore, amount));
        Ok(())
    }

    fn opacity(&mut self, given: &Given<'_>) -> Result<Option<ScalarTexture>, PbrtError> {
        if given.entity.class == "thindielectric" {
            let index = match given.find("eta") {
                Some(parameter) => parameter.numbers().and_then(<[f64]>::first).copied().unwrap_or(1.5),
                None => 1.5,
            };
            return Ok(Some(ScalarTexture::Constant(thin_reflectance(index) as f32)));
        }
        if given.entity.class != "uber" || given.find("opacity").is_none() {
            return Ok(None);
        }
        let opacity = self.mean(given, "opacity", 1.0)?;
        Ok((opacity < 1.0).then_some(ScalarTexture::Constant(opacity as f32)))
    }

    fn normal_map(&mut self, given: &Given<'_>) -> Result<Option<NormalMap>, PbrtError> {
        let Some(name) = given.text("normalmap") else { return Ok(None) };
        let at = given.entity.at;
        let path = self.tree.path_of(at, name);
        let image =
            read_texture(&path, Transfer::Linear).map_err(|error| self.error(at, error.to_string()))?;
        if image.channels < 3 {
            return Err(self.error(at, format!("{}: a normal map has three colors", path.display())));
        }
        let rgb: Vec<f32> = image
            .data
            .chunks_exact(image.channels)
            .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect();
        let map = NormalMap::from_rgb(image.width, image.height, &rgb, 1.0);
        let map = map.map_err(|error| self.error(at, format!("{}: {error}", path.display())))?;
        self.note_read(path);
        Ok(Some(map))
    }

    /// A copy of a material with the alpha mask of a shape.
    pub(crate) fn masked(&mut self, material: usize, alpha: ScalarTexture) -> usize {
        let mut copy = self.materials[material].clone();
        copy.opacity = Some(alpha);
        if let Some(known) = self.materials.iter().position(|other| *other == copy) {
            return known;
        }
        self.materials.push(copy);
        self.materials.len() - 1
    }
}

/// Largest weight of a spectrum in a reflectance: 1 for the three of colors, which add up to 1, and for white; for darker ones what
/// makes them as bright.
fn limit_of_weight(spectrum: &Curve) -> f32 {
    let most = spectrum.max();
    if most > 0.9 { 1.0 } else { (1.0 / most.max(1e-6)) as f32 }
}

/// GGX alpha of a roughness: in version 4 its square root, in version 3 a fit to other distributions.
fn remapped(roughness: f32, is_v4: bool) -> f32 {
    if is_v4 {
        return roughness.sqrt();
    }
    if roughness == 0.0 {
        return 0.0;
    }
    let x = roughness.max(1e-3).ln();
    1.62142 + x * (0.819_955 + x * (0.1734 + x * (0.017_120_1 + x * 0.000_640_711)))
}

/// Reflectance of two parallel surfaces at normal incidence, `2 R / (1 + R)`.
fn thin_reflectance(index: f64) -> f64 {
    let r = ((index - 1.0) / (index + 1.0)).powi(2);
    2.0 * r / (1.0 + r)
}

/// Diffuse reflectance of a dielectric from inside: `1 - (1 - F) / n²`, F that from outside.
pub(crate) fn internal_reflectance(index: f64) -> f64 {
    const COSINES: usize = 1000;
    let fresnel = |i: usize| {
        let cos = (i as f64 + 0.5) / COSINES as f64;
        2.0 * cos * f64::from(fluorspar::material::fresnel::dielectric_fresnel(cos as f32, index as f32))
    };
    let outside = (0..COSINES).map(fresnel).sum::<f64>() / COSINES as f64;
    1.0 - (1.0 - outside) / (index * index)
}

/// A smooth metal of a reflectance at normal incidence that rises least toward grazing angles: of all indices with that
/// reflectance the one of the largest extinction coefficient.
fn mirror(reflectance: impl Fn(f64) -> f64) -> Conductor {
    // R = 1 - 4 n / ((n + 1)² + k²); with s = 4 / (1 - R) the largest k is at n = s/2 - 1.
    let index = |nm: f64| 2.0 / (1.0 - reflectance(nm).clamp(0.0, 0.998)) - 1.0;
    let n = Curve::from_fn(200.0, 1200.0, index);
    let k = Curve::from_fn(200.0, 1200.0, |nm| (index(nm).powi(2) - 1.0).max(0.0).sqrt());
    Conductor { n, k, roughness: ScalarTexture::Constant(0.0), single_scattering: false }
}

#[cfg(test)]
mod tests {
    use fluorspar::material::fresnel::conductor_fresnel;

    use super::*;

    #[test]
    fn mirrors_reflect_what_they_should() {
        for reflectance in [0.1, 0.5, 0.9, 0.99] {
            let metal = mirror(|_| reflectance);
            let (n, k) = (metal.n.at(500.0), metal.k.at(500.0));
            assert!((conductor_fresnel(1.0, n, k) - reflectance).abs() < 1e-9);
            assert!(
                (conductor_fresnel(0.7, n, k) - reflectance).abs() < 0.03,
                "{}",
                conductor_fresnel(0.7, n, k)
            );
        }
    }

    #[test]
    fn roughness_is_mapped_as_by_its_version() {
        assert_eq!((remapped(0.25, true), remapped(0.0, false)), (0.5, 0.0));
        // RoughnessToAlpha of pbrt-v3 at 1 and at 0.1.
        assert!(
            (remapped(1.0, false) - 1.62142).abs() < 1e-6 && (remapped(0.1, false) - 0.4618).abs() < 1e-4,
            "{}",
            remapped(0.1, false)
        );
    }

    /// Known value for an index of 1.5: 0.596 (Egan and Hilgeman 1973).
    #[test]
    fn light_inside_a_coat_is_mostly_kept() {
        assert!((internal_reflectance(1.5) - 0.596).abs() < 1e-3, "{}", internal_reflectance(1.5));
    }
}
