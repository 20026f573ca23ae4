//! Richardson extrapolation: the limit of an answer as the mesh is refined.

/// The limit of an answer for vanishing mesh size, if its error is proportional to the power `order` of the size.
/// `first` is the answer at the size `coarse`, and `second` that at the smaller size `fine`.
pub fn limit([(coarse, first), (fine, second)]: [(f64, f64); 2], order: f64) -> f64 {
    second + (second - first) / ((coarse / fine).powf(order) - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_leads_to_its_limit() {
        let answer = |h: f64| 3.0 - 0.7 * h.powi(2);
        assert!((limit([(0.5, answer(0.5)), (0.2, answer(0.2))], 2.0) - 3.0).abs() < 1e-14);
        let answer = |h: f64| 3.0 + 0.7 * h;
        assert!((limit([(0.5, answer(0.5)), (0.2, answer(0.2))], 1.0) - 3.0).abs() < 1e-14);
        assert!((limit([(0.5, answer(0.5)), (0.2, answer(0.2))], 2.0) - 3.0).abs() > 1e-3);
    }
}
