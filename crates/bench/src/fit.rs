//! Power laws fitted to measurements.

/// The exponent p of the power law y = c x^p that fits the points (x, y) best, by least squares of the logarithms.
/// `None`: there are no two points with different x.
pub fn exponent(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (mx, my) = logs.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0 / count, sum.1 + p.1 / count));
    let (xy, xx) = logs.iter().fold((0.0, 0.0), |sum, p| (sum.0 + (p.0 - mx) * (p.1 - my), sum.1 + (p.0 - mx).powi(2)));
    (xx > 0.0).then_some(xy / xx)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_are_fitted() {
        let points: Vec<(f64, f64)> = [1e4, 1e5, 1e6].iter().map(|&x: &f64| (x, 3.0 * x.powf(1.25))).collect();
        assert!((exponent(&points).unwrap() - 1.25).abs() < 1e-12);
        assert!(exponent(&points[..1]).is_none() && exponent(&[]).is_none());
    }
}
