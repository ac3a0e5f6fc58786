//! Numbers for people, in columns.

use serde_json::Value;

use super::{print_json, print_text};
use crate::error::CliError;
pub(crate) use crate::values::short;

/// Options of the commands that list a part of the catalogue.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ListOptions {
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

impl ListOptions {
    pub(crate) fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a list as JSON or as lines of cells, their head first; the columns of `left` are left-aligned.
    pub(crate) fn print(
        &self,
        list: &[Value],
        head: &[&str],
        mut rows: Vec<Vec<String>>,
        left: &[usize],
    ) -> Result<(), CliError> {
        if self.json {
            return print_json(&list);
        }
        rows.insert(0, head.iter().map(|&cell| cell.into()).collect());
        print_text(&align(&rows, left))
    }
}

/// Lines of cells: numbers to the right, the first column and those named here to the left.
pub(crate) fn align(rows: &[Vec<String>], left: &[usize]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| {
        rows.iter().filter_map(|row| row.get(c)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let cell = |(c, (cell, &width)): (usize, (&String, &usize))| {
            if c == 0 || left.contains(&c) { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        };
        let cells: Vec<String> = row.iter().zip(&widths).enumerate().map(cell).collect();
        text += &format!("{}\n", cells.join("  ").trim_end());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_digits_of_any_size() {
        let shown = [0.0, 1.2345e-5, 0.012345, 1.2345, 999.96, 12345.0, 1.2346e7].map(short);
        assert_eq!(shown, ["0", "1.234e-5", "0.01235", "1.234", "1000.0", "12345", "1.235e7"]);
    }

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let row = |cells: [&str; 3]| cells.map(String::from).to_vec();
        let text = align(&[row(["a", "bcd", "e"]), row(["abc", "1", "text"])], &[2]);
        assert_eq!(text, "a    bcd  e\nabc    1  text\n");
    }
}
