//! Regions beside that of `[analysis]`, as `NAME=WHERE`.

use std::path::Path;

use fluorspar_experiment::Experiment;
use fluorspar_format::read_toml;

use crate::analyze::Regions;
use crate::values::{Override, quoted};
use crate::{Error, ExperimentSource, Result};

/// A region as it was typed.
#[derive(Clone, Debug)]
pub(crate) struct RegionOption {
    pub(crate) name: String,
    /// The option with its value.
    typed: String,
    /// Fields of `[analysis]` and their values.
    fields: Vec<(String, String)>,
}

/// Reads the regions of the command line.
pub(crate) fn region_options(texts: &[String]) -> Result<Vec<RegionOption>> {
    regions_called(texts, |text| format!("⟨named_region={text}⟩"))
}

/// Reads regions, and what each is called in messages.
pub(crate) fn regions_called(texts: &[String], called: impl Fn(&str) -> String) -> Result<Vec<RegionOption>> {
    let mut regions: Vec<RegionOption> = Vec::with_capacity(texts.len());
    for text in texts {
        let region = region_option(text, called(text))?;
        if regions.iter().any(|other| other.name == region.name) {
            let RegionOption { name, typed, .. } = &region;
            return Err(Error::Input(format!("{typed}: there are two regions \"{name}\"; rename one")));
        }
        regions.push(region);
    }
    Ok(regions)
}

fn region_option(text: &str, typed: String) -> Result<RegionOption> {
    let wrong = |why: &str| {
        Error::Input(format!(
            "{typed}: {why}; write a name and parts, a rectangle (column, row, width, height), a polygon, a mask or fields of [analysis]: \
             lip=lower_lip, lip=430,350,100,80, 'lip=[[430,350],[530,350],[480,450]]', lip=mask.png, 'lip={{parts=[\"lower_lip\"], inset_px=3}}'"
        ))
    };
    let (name, place) = text.split_once('=').ok_or_else(|| wrong("there is no ="))?;
    let (name, place) = (name.trim(), place.trim());
    if name.is_empty() || place.is_empty() {
        return Err(wrong("a name or a place is missing"));
    }
    if name.contains('"') {
        return Err(wrong("a name has no quotation marks"));
    }
    let in_quotes = |part: &str| quoted(part.trim());
    let is_mask = |path: &Path| {
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        ending.is_some_and(|ending| ["png", "tif", "tiff", "npy"].contains(&ending.as_str()))
    };
    let words: Vec<&str> = place.split(',').collect();
    let is_number = |word: &&str| word.trim().parse::<f64>().is_ok();
    let fields = if place.starts_with('{') {
        fields_of_table(place).ok_or_else(|| wrong("this is not a table of TOML"))?
    } else if place.starts_with("[[") {
        vec![("polygon_px".into(), place.into())]
    } else if place.starts_with('[') {
        vec![("rectangle_px".into(), place.into())]
    } else if words.iter().all(is_number) {
        vec![("rectangle_px".into(), format!("[{place}]"))]
    } else if is_mask(Path::new(place)) {
        vec![("mask".into(), in_quotes(place))]
    } else {
        let parts: Vec<String> = words.iter().map(|word| in_quotes(word)).collect();
        vec![("parts".into(), format!("[{}]", parts.join(", ")))]
    };
    if let Some((field, _)) = fields.iter().find(|(field, _)| field == "frame" || field == "compared_px") {
        return Err(wrong(&format!("{field} is of the whole analysis, not of a region")));
    }
    Ok(RegionOption { name: name.into(), typed, fields })
}

/// The fields of an inline table.
fn fields_of_table(text: &str) -> Option<Vec<(String, String)>> {
    let table: toml::Table = read_toml(&format!("region = {text}")).ok()?;
    let fields = table.get("region")?.as_table()?;
    Some(fields.iter().map(|(field, given)| (field.clone(), given.to_string())).collect())
}

impl RegionOption {
    /// The region with its mask, where it is one, below a folder.
    #[must_use]
    pub(crate) fn below(self, folder: &Path) -> Self {
        let mask = self.masks().next();
        match mask {
            Some(mask) => self.masked(&folder.join(mask)),
            None => self,
        }
    }

    /// The region with its mask, where it is one, at another path.
    #[must_use]
    pub(crate) fn masked(mut self, mask: &Path) -> Self {
        for (_, value) in self.fields.iter_mut().filter(|(field, _)| field == "mask") {
            *value = quoted(&mask.to_string_lossy());
        }
        self
    }

    /// Its fields as an inline table.
    pub(crate) fn table(&self) -> String {
        let fields: Vec<String> =
            self.fields.iter().map(|(field, value)| format!("{field} = {value}")).collect();
        format!("{{ {} }}", fields.join(", "))
    }

    /// Its mask, where it has one.
    pub(crate) fn masks(&self) -> impl Iterator<Item = String> {
        let of_mask = self.fields.iter().filter(|(field, _)| field == "mask");
        of_mask.filter_map(|(_, value)| {
            let table: toml::Table = read_toml(&format!("mask = {value}")).ok()?;
            Some(table.get("mask")?.as_str()?.to_owned())
        })
    }

    /// The region as tissue of a site, where it names none.
    #[must_use]
    pub(crate) fn of_site(mut self, site: Option<&str>) -> Self {
        let is_given = |field: &str| self.fields.iter().any(|(name, _)| name == field);
        if let Some(site) = site.filter(|_| !is_given("tissue") && !is_given("parts")) {
            self.fields.push(("tissue".into(), quoted(site)));
        }
        self
    }

    /// The changes that make this the region of `[analysis]`.
    fn as_main(&self, experiment: &Experiment) -> Vec<Override> {
        let Some(analysis) = &experiment.file.analysis else { return Vec::new() };
        let place = &analysis.place;
        let shapes = [
            ("rectangle_px", place.rectangle_px.is_some()),
            ("polygon_px", place.polygon_px.is_some()),
            ("mask", place.mask.is_some()),
        ];
        let unset = shapes
            .iter()
            .filter(|(_, is_set)| *is_set)
            .map(|(field, _)| Override::unset(&format!("analysis.{field}")));
        let of_shape = self.fields.iter().filter(|(field, _)| shapes.iter().any(|(shape, _)| shape == field));
        let set = of_shape.map(|(field, value)| {
            Override::of_option(&format!("analysis.{field}"), value, self.typed.clone())
        });
        unset.chain(set).collect()
    }

    /// The changes that add this region to an experiment, in place of one of its name. None where nothing is analyzed.
    pub(crate) fn overrides(&self, experiment: &Experiment) -> Vec<Override> {
        let Some(analysis) = &experiment.file.analysis else { return Vec::new() };
        let path = format!("analysis.region.{}", quoted(&self.name));
        let replaced = analysis.region.iter().any(|region| region.name == self.name);
        let unset = replaced.then(|| Override::unset(&path));
        unset.into_iter().chain([Override::insert(&path, self.table(), self.typed.clone())]).collect()
    }
}

/// An experiment with further regions, and all its changes. It keeps its title: regions make no other experiment.
pub(crate) fn with_regions(
    source: &ExperimentSource,
    (experiment, overrides): (&Experiment, &[Override]),
    regions: &Regions<'_>,
) -> Result<(Experiment, Vec<Override>)> {
    let main = regions.main.iter().flat_map(|region| region.as_main(experiment));
    let added = main.chain(regions.beside.iter().flat_map(|region| region.overrides(experiment)));
    let all: Vec<Override> = overrides.iter().cloned().chain(added).collect();
    let mut with_all = source.parse(&all)?;
    with_all.file.title.clone_from(&experiment.file.title);
    with_all.file.description.clone_from(&experiment.file.description);
    Ok((with_all, all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_told_by_their_form() {
        let read = |text: &str| region_options(&[text.to_owned()]).map(|mut all| all.remove(0));
        let fields = |text: &str| read(text).unwrap().fields;
        let one = |field: &str, value: &str| vec![(field.to_owned(), value.to_owned())];
        assert_eq!(fields("lip=lower_lip, upper_lip"), one("parts", "[\"lower_lip\", \"upper_lip\"]"));
        assert_eq!(fields("a=1,2,30,40"), one("rectangle_px", "[1,2,30,40]"));
        assert_eq!(fields("a=[1,2,30,40]"), one("rectangle_px", "[1,2,30,40]"));
        assert_eq!(fields("a=[[1,2],[3,4],[5,0]]"), one("polygon_px", "[[1,2],[3,4],[5,0]]"));
        assert_eq!(fields("a=b/mask.PNG"), one("mask", "\"b/mask.PNG\""));
        assert_eq!(fields("a={mask=\"mask.png\"}"), one("mask", "\"mask.png\""));
        assert_eq!(fields("a={parts=[\"x\"], inset_px=3}").len(), 2);
        for text in ["lip", "=lip", "lip=", "a={parts=", "a={frame=\"white\"}", "a\"b=lip"] {
            let error = read(text).unwrap_err().to_string();
            assert!(
                error.contains(&format!("⟨named_region={text}⟩: ")) && error.contains("lip=lower_lip"),
                "{error}"
            );
        }
        assert!(region_options(&["a=b".into(), "a=c".into()]).is_err());
        let called = |text: &str| format!("t.csv: region {text} of patient P1, visit 1");
        let error = regions_called(&["a=b".into(), "a=c".into()], called).unwrap_err().to_string();
        assert_eq!(
            error,
            "t.csv: region a=c of patient P1, visit 1: there are two regions \"a\"; rename one"
        );
    }
}
