//! Compares two series of fields.

use std::path::Path;

use palpate::scene::vtk_xml::{Field, read_fields, read_series};
use palpate::{Error, Result};

use super::Difference;

/// Times of moments that count as the same, s.
const SAME: f64 = 1e-9;

/// Compares the moments that two series have in common.
pub fn compare(name: &str, a: &Path, b: &Path, notes: &mut Vec<String>) -> Result<Vec<Difference>> {
    let (first, second) = (read_series(a)?, read_series(b)?);
    let mut all: Vec<Difference> = Vec::new();
    let (mut common, mut unlike, mut last) = (0, 0, None);
    for (time, file) in &first {
        let Some((_, other)) = second.iter().find(|(other, _)| (other - time).abs() <= SAME) else { continue };
        common += 1;
        // The file of a body that stays is listed for many moments.
        if last.as_ref() == Some(&(file, other)) {
            continue;
        }
        last = Some((file, other));
        let [of_a, of_b] = [read_fields(file)?, read_fields(other)?];
        for field in &of_a {
            let Some(twin) = of_b.iter().find(|twin| twin.name == field.name) else { continue };
            if twin.numbers.len() != field.numbers.len() || twin.components != field.components {
                unlike += usize::from(field.name == "Points");
                continue;
            }
            if field.numbers.is_empty() {
                continue;
            }
            let quantity = format!("{name} {}", field.name);
            let at = all.iter().position(|difference| difference.quantity == quantity).unwrap_or_else(|| {
                all.push(Difference::new(quantity, unit(&field.name)));
                all.len() - 1
            });
            all[at].add(*time, differences(field, twin));
        }
    }
    if common == 0 {
        let problem = format!("has no moment in common with {}", b.display());
        return Err(Error::input(a, None, problem, "export both runs at the same times"));
    }
    if common < first.len().max(second.len()) {
        let counts = format!("{} and {} moments", first.len(), second.len());
        notes.push(format!("{name}: of {counts}, {common} are at the same times and are compared"));
    }
    if unlike > 0 {
        notes.push(format!(
            "{name}: the number of points differs at {unlike} of {common} moments, which are not compared"
        ));
    }
    Ok(all.into_iter().map(Difference::done).collect())
}

/// For each point or cell the norm of the difference, and that of the first field; for points their distance from the
/// first of them.
fn differences<'a>(a: &'a Field, b: &'a Field) -> impl Iterator<Item = (f64, f64)> + 'a {
    let from = if a.name == "Points" { a.numbers.get(..a.components).unwrap_or_default() } else { &[] };
    let norm = |vector: &mut dyn Iterator<Item = f64>| vector.map(|x| x * x).sum::<f64>().sqrt();
    let rows = a.numbers.chunks(a.components).zip(b.numbers.chunks(a.components));
    rows.map(move |(a, b)| {
        let value = norm(&mut a.iter().enumerate().map(|(k, x)| x - from.get(k).unwrap_or(&0.0)));
        (norm(&mut a.iter().zip(b).map(|(a, b)| a - b)), value)
    })
}

/// Unit of an array that `palpate run --export` writes.
fn unit(name: &str) -> &'static str {
    match name {
        "Points" | "displacement" | "depth" => "m",
        "velocity" => "m/s",
        "contact_force" | "force" => "N",
        "area" => "m^2",
        "strain_energy_density" => "J/m^3",
        "pressure" | "hydrostatic_pressure" | "cauchy_stress" | "principal_stress" | "von_mises_stress" => "Pa",
        _ => "",
    }
}
