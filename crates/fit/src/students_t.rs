//! Quantiles of Student's t distribution.

/// The 97.5 % quantile for this number of degrees of freedom: an estimate lies within so many standard errors of the
/// true value in 95 % of cases. The expansion is that of Abramowitz and Stegun (1964), 26.7.5; below three degrees of
/// freedom, where it fails, the exact values.
pub fn two_sided_95(degrees: usize) -> f64 {
    const Z: f64 = 1.959_963_984_540_054;
    let n = degrees as f64;
    let odd = |coefficients: &[f64]| coefficients.iter().rev().fold(0.0, |sum, c| sum * Z * Z + c) * Z;
    match degrees {
        0 => f64::INFINITY,
        1 => 12.706_204_736_432_1,
        2 => 4.302_652_729_911_28,
        _ => {
            Z + odd(&[1.0, 1.0]) / (4.0 * n)
                + odd(&[3.0, 16.0, 5.0]) / (96.0 * n.powi(2))
                + odd(&[-15.0, 17.0, 19.0, 3.0]) / (384.0 * n.powi(3))
                + odd(&[-945.0, -1920.0, 1482.0, 776.0, 79.0]) / (92_160.0 * n.powi(4))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of published tables.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (degrees, expected) in
            [(1, 12.706), (2, 4.303), (3, 3.182), (5, 2.571), (10, 2.228), (30, 2.042), (1000, 1.962)]
        {
            assert!((two_sided_95(degrees) - expected).abs() < 2e-3 * expected, "{degrees}: {}", two_sided_95(degrees));
        }
    }
}
