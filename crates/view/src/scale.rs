//! Scales of colours and of arrow lengths, which end at round numbers and change seldom; and numbers with units as
//! text.

/// A scale from zero to a round number.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Scale {
    /// Upper end of the scale; 0 until a value above zero was shown.
    pub high: f64,
}

/// If the greatest value is below this share of the scale's upper end, the scale is made smaller.
const SMALL: f64 = 0.15;

impl Scale {
    /// Adapts the scale to the greatest value that is shown now.
    pub fn show(&mut self, greatest: f64) {
        if greatest.is_finite() && greatest > 0.0 && (greatest > self.high || greatest < SMALL * self.high) {
            self.high = round_up(greatest);
        }
    }
}

/// The least number of the form 1, 2 or 5 times a power of ten that is no less than the positive number `x`.
fn round_up(x: f64) -> f64 {
    let power = 10f64.powf(x.log10().floor());
    let leading = [1.0, 2.0, 5.0, 10.0].into_iter().find(|digit| digit * power >= x * (1.0 - 1e-12));
    leading.unwrap_or(10.0) * power
}

/// A number as text with three digits and a unit with its prefix: `0.0123` in N gives `12.3 mN`.
pub fn with_unit(x: f64, unit: &str) -> String {
    const PREFIXES: [(f64, &str); 7] =
        [(1e-9, "n"), (1e-6, "\u{b5}"), (1e-3, "m"), (1.0, ""), (1e3, "k"), (1e6, "M"), (1e9, "G")];
    if x == 0.0 || !x.is_finite() {
        return format!("{x} {unit}");
    }
    let (factor, prefix) =
        PREFIXES.into_iter().rev().find(|(factor, _)| x.abs() >= 0.9995 * factor).unwrap_or(PREFIXES[0]);
    let y = x / factor;
    let digits = if y.abs() >= 99.95 { 0 } else { usize::from(y.abs() < 9.995) + 1 };
    let number = format!("{y:.digits$}");
    let short = if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { &number };
    format!("{short} {prefix}{unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_round_and_change_seldom() {
        let mut scale = Scale::default();
        let mut high = |x: f64| {
            scale.show(x);
            scale.high
        };
        assert_eq!(
            [0.0, 3.1e-3, 4.9e-3, 1e-3, 5.1e-3, 2e-3, 1e-3].map(&mut high).map(|x| (x * 1e6).round()),
            [0.0, 5000.0, 5000.0, 5000.0, 10000.0, 10000.0, 1000.0]
        );
        assert_eq!(
            [f64::NAN, f64::INFINITY, -1.0].map(high),
            [1e-3; 3],
            "only positive finite values may change the scale"
        );
    }

    #[test]
    fn numbers_have_prefixes() {
        let all = [
            (0.0123, "12.3 mN"),
            (0.0, "0 N"),
            (1234.0, "1.23 kN"),
            (5.0, "5 N"),
            (250.0, "250 N"),
            (-2e-5, "-20 \u{b5}N"),
        ];
        for (x, text) in all {
            assert_eq!(with_unit(x, "N"), text);
        }
        assert_eq!(with_unit(999.9, "Pa"), "1 kPa");
    }
}
