//! `fluorspar tissue sweep`.

use fluorspar_session::tissue::{SweptTissue, sweep_table};

use crate::commands::table::{align, short};

/// What the columns of the table are called here, so that it stays narrow.
const HEADS: [&str; 12] = [
    "value",
    "R 450 nm",
    "R 540 nm",
    "R 630 nm",
    "Y",
    "x",
    "y",
    "F",
    "x of F",
    "y of F",
    "half of F, um",
    "1/e, um",
];

/// The results in words and columns.
pub(super) fn describe(found: &SweptTissue) -> String {
    let mut rows = sweep_table(found, short);
    rows[0] = HEADS.map(String::from).to_vec();
    format!(
        "{} ({}) by {}, of which it has {}\n\
         R: reflectance; Y, x, y: of white light reflected; F: fluorescence under {} nm, the depth above which half of it arises, and\n\
         that at which 1/e of the light is left\n\n{}",
        found.title,
        found.site,
        found.parameter,
        short(found.typical),
        found.excitation_nm,
        align(&rows, &[])
    )
}
