//! `fluorspar predict`: a flat sample in numbers.
