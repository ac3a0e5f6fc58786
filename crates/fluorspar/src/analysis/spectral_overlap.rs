//! How alike two spectra are, whatever their size.

/// Overlap of two spectra on the same bins: the cosine of the angle between them, `a·b / (|a| |b|)`. 1 for spectra of one shape, 0
/// for spectra without a common bin; `None` where one is zero or the lengths differ.
pub fn spectral_overlap(a: &[f64], b: &[f64]) -> Option<f64> {
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let product = dot(a, a).sqrt() * dot(b, b).sqrt();
    (a.len() == b.len() && product > 0.0).then(|| dot(a, b) / product)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_does_not_matter_and_shape_does() {
        assert!((spectral_overlap(&[1.0, 2.0, 0.0], &[3.0, 6.0, 0.0]).unwrap() - 1.0).abs() < 1e-15);
        assert_eq!(spectral_overlap(&[1.0, 0.0], &[0.0, 5.0]), Some(0.0));
        assert!((spectral_overlap(&[1.0, 0.0], &[1.0, 1.0]).unwrap() - 0.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(spectral_overlap(&[0.0, 0.0], &[1.0, 1.0]), None);
        assert_eq!(spectral_overlap(&[1.0], &[1.0, 1.0]), None);
    }
}
