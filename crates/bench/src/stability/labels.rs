//! Labels for the values of the axes (varied quantities) of the stability matrix (many stiff and extreme simulations,
//! each judged by invariants, which are conditions that a simulation must keep).

/// The factor by which a body is stretched along an edge, in words; a factor below zero turns the body inside out.
pub fn stretched(factor: f64) -> String {
    let percent = (100.0 * factor.abs()).round();
    match factor {
        -1.0 => "turned inside out".into(),
        f if f < 0.0 => format!("inside out, to {percent} %"),
        f if f < 1.0 => format!("pressed to {percent} %"),
        _ => format!("stretched to {percent} % (by {} %)", percent - 100.0),
    }
}

/// A number as a power of ten, such as `1e3`.
pub fn power(value: f64) -> String {
    format!("{value:.0e}")
}

/// A number with its unit and an SI prefix.
pub fn si(value: f64, unit: &str) -> String {
    let (scale, prefix) = match value.abs() {
        x if x >= 1e12 => (1e-12, "T"),
        x if x >= 1e9 => (1e-9, "G"),
        x if x >= 1e6 => (1e-6, "M"),
        x if x >= 1e3 => (1e-3, "k"),
        x if x >= 1.0 || x == 0.0 => (1.0, ""),
        x if x >= 1e-3 => (1e3, "m"),
        _ => (1e6, "u"),
    };
    let digits = (value * scale * 1e3).round() / 1e3;
    format!("{digits} {prefix}{unit}")
}
