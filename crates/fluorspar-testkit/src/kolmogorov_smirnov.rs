//! One-sample Kolmogorov-Smirnov test.

/// P-value of the hypothesis that samples follow a continuous distribution function.
///
/// Asymptotic distribution with Stephens' correction for finite samples (J. R. Stat. Soc. B 32, 115, 1970).
pub fn kolmogorov_smirnov(samples: &mut [f64], distribution: impl Fn(f64) -> f64) -> f64 {
    samples.sort_by(f64::total_cmp);
    let n = samples.len() as f64;
    let distance = samples
        .iter()
        .enumerate()
        .map(|(i, &x)| {
            let f = distribution(x);
            (f - i as f64 / n).abs().max(((i + 1) as f64 / n - f).abs())
        })
        .fold(0.0, f64::max);
    let t = distance * (n.sqrt() + 0.12 + 0.11 / n.sqrt());
    let tail: f64 = (1..=100)
        .map(|k| {
            let k = f64::from(k);
            let sign = if k as i32 % 2 == 1 { 1.0 } else { -1.0 };
            sign * (-2.0 * k * k * t * t).exp()
        })
        .sum();
    (2.0 * tail).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_samples_fit_the_uniform_distribution_only() {
        let mut samples: Vec<f64> = (0..1000).map(|i| (f64::from(i) + 0.5) / 1000.0).collect();
        assert!(kolmogorov_smirnov(&mut samples, |x| x) > 0.99);
        assert!(kolmogorov_smirnov(&mut samples, |x| x * x) < 1e-9);
    }
}
