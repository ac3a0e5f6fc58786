//! What nobody outside of a study knows: codes of exports are made with it.

use fluorspar::digest::sha256_hex;
use fluorspar_session::Result;

use crate::event::Event;
use crate::store::Study;

/// 32 random bytes, as hexadecimal digits.
pub(crate) fn new_secret() -> String {
    rand::random::<[u8; 32]>().iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Study {
    /// The secret of the study; one of an earlier version, which has none, gets it.
    pub(crate) fn secret(&mut self) -> Result<String> {
        let of_study = |event: &Event| match event {
            Event::Study { name, site, secret } => Some((name.clone(), site.clone(), secret.clone())),
            _ => None,
        };
        let begun = self.log.entries.iter().rev().find_map(|entry| of_study(&entry.event));
        let (name, site, known) = begun.unwrap_or_default();
        if !known.is_empty() {
            return Ok(known);
        }
        let secret = new_secret();
        self.commit("init", vec![Event::Study { name, site, secret: secret.clone() }])?;
        Ok(secret)
    }
}

/// By what norms tell a study, whatever its log says: nothing can be learned from it.
pub(crate) fn public_id(secret: &str) -> String {
    sha256_hex([format!("public id of a study\n{secret}")])
}
