//! Parameters of a directive, and which of them were used.

use std::cell::RefCell;

use fluorspar_format::{PbrtEntity, PbrtParameter};

use crate::convert::Remark;

/// The parameters of a directive; those that nobody asks for are named in the end.
pub(crate) struct Given<'a> {
    pub(crate) entity: &'a PbrtEntity,
    used: RefCell<Vec<&'a str>>,
}

impl<'a> Given<'a> {
    pub(crate) fn new(entity: &'a PbrtEntity) -> Self {
        Self { entity, used: RefCell::new(Vec::new()) }
    }

    /// Marks parameters as used.
    pub(crate) fn used(&self, names: &[&str]) {
        let names =
            self.entity.parameters.iter().map(|p| p.name.as_str()).filter(|name| names.contains(name));
        self.used.borrow_mut().extend(names);
    }

    pub(crate) fn find(&self, name: &str) -> Option<&'a PbrtParameter> {
        self.used(&[name]);
        self.entity.find(name)
    }

    pub(crate) fn number(&self, name: &str) -> Option<f64> {
        self.used(&[name]);
        self.entity.number(name)
    }

    pub(crate) fn numbers(&self, name: &str) -> Option<&'a [f64]> {
        self.used(&[name]);
        self.entity.numbers(name)
    }

    /// Three numbers: a point or a vector.
    pub(crate) fn point(&self, name: &str, default: [f64; 3]) -> glam::DVec3 {
        let given = self.numbers(name).and_then(|values| <[f64; 3]>::try_from(values).ok());
        glam::DVec3::from_array(given.unwrap_or(default))
    }

    pub(crate) fn text(&self, name: &str) -> Option<&'a str> {
        self.used(&[name]);
        self.entity.text(name)
    }

    pub(crate) fn flag(&self, name: &str) -> Option<bool> {
        self.used(&[name]);
        self.entity.flag(name)
    }

    /// Names the parameters that were not used.
    pub(crate) fn finish(&self, directive: &str, remarks: &mut Vec<Remark>) {
        let used = self.used.borrow();
        for parameter in &self.entity.parameters {
            if !used.contains(&parameter.name.as_str()) {
                let name = fluorspar::quote::excerpt(&parameter.name);
                let class = fluorspar::quote::excerpt(&self.entity.class);
                let text = format!("{directive} \"{class}\": \"{name}\" has no counterpart and is left out");
                remarks.push(Remark { at: parameter.at, text, matters: true });
            }
        }
    }
}
