//! `fluorspar fluorophore`: list, show, plot, import.
