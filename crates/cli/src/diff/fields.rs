//! Compares two series of fields.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use palpate::scene::vtk_xml::{Field, read_fields, read_series};
use palpate::{Error, Result};

use super::{Difference, Findings};

/// Times of moments that count as the same, s.
const SAME: f64 = 1e-9;

/// Arrays by which contacts of two runs are matched; they are no quantities.
const KEYS: [&str; 3] = ["body", "other_body", "vertex"];
/// An array of numbers that only name something.
const MATERIAL: &str = "material";

/// Compares the moments that two series have in common.
pub fn compare(name: &str, a: &Path, b: &Path, findings: &mut Findings) -> Result<Vec<Difference>> {
    let (first, second) = (read_series(a)?, read_series(b)?);
    let mut all: Vec<Difference> = Vec::new();
    let (mut common, mut last) = (0, None);
    let mut unlike = BTreeMap::new();
    for (time, file) in &first {
        let Some((_, other)) = second.iter().find(|(other, _)| (other - time).abs() <= SAME) else { continue };
        common += 1;
        // The file of a body that stays is listed for many moments.
        if last.as_ref() == Some(&(file, other)) {
            continue;
        }
        last = Some((file, other));
        let [mut of_a, mut of_b] = [read_fields(file)?, read_fields(other)?];
        if let [Some(keys), Some(others)] = [keys(&of_a), keys(&of_b)] {
            [of_a, of_b] = matched([of_a, of_b], [&keys, &others]);
        }
        for field in of_b.iter().filter(|field| of_a.iter().all(|own| own.name != field.name)) {
            *unlike.entry(format!("only the second run has {}", field.name)).or_insert(0) += 1;
        }
        for field in &of_a {
            let Some(twin) = of_b.iter().find(|twin| twin.name == field.name) else {
                *unlike.entry(format!("only the first run has {}", field.name)).or_insert(0) += 1;
                continue;
            };
            if twin.numbers.len() != field.numbers.len() || twin.components != field.components {
                *unlike.entry(format!("the size of {} differs", field.name)).or_insert(0) += 1;
                continue;
            }
            let is_name = field.name == MATERIAL || KEYS.contains(&field.name.as_str());
            if is_name && field.numbers != twin.numbers {
                *unlike.entry(format!("{} differs", field.name)).or_insert(0) += 1;
            }
            if is_name || field.numbers.is_empty() {
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
        findings.unmatched.push(format!("{name}: of {counts}, {common} are at the same times and are compared"));
    }
    for (what, count) in unlike {
        findings.unmatched.push(format!("{name}: {what}, at {count} of {common} moments"));
    }
    Ok(all.into_iter().map(Difference::done).collect())
}

/// What contacts are matched by: bodies and vertex, and a number for contacts of which these are the same. `None` for
/// other points.
fn keys(fields: &[Field]) -> Option<Vec<[u64; 4]>> {
    let named = |name: &&str| fields.iter().find(|field| field.name == **name && field.components == 1);
    let columns: Vec<&Field> = KEYS.iter().filter_map(named).collect();
    let [bodies, others, vertices] = columns[..] else { return None };
    let mut counts = BTreeMap::new();
    let rows = bodies.numbers.iter().zip(&others.numbers).zip(&vertices.numbers);
    let key = |((body, other), vertex): ((&f64, &f64), &f64)| {
        let key = [body, other, vertex].map(|x| x.to_bits());
        let count = counts.entry(key).or_insert(0);
        *count += 1;
        [key[0], key[1], key[2], *count]
    };
    Some(rows.map(key).collect())
}

/// The contacts of both runs in one order; where one run has no such contact, its numbers are zero, and its position is
/// that of the other's.
fn matched(fields: [Vec<Field>; 2], keys: [&[[u64; 4]]; 2]) -> [Vec<Field>; 2] {
    let all: BTreeSet<[u64; 4]> = keys.iter().flat_map(|keys| keys.iter().copied()).collect();
    let places: [BTreeMap<[u64; 4], usize>; 2] = keys.map(|keys| keys.iter().copied().zip(0..).collect());
    let row = |side: usize, field: &Field, key: &[u64; 4]| -> Option<Vec<f64>> {
        let at = places[side].get(key)? * field.components;
        field.numbers.get(at..at + field.components).map(<[f64]>::to_vec)
    };
    std::array::from_fn(|side| {
        let ordered = |field: &Field| {
            let twin = fields[1 - side].iter().find(|twin| twin.name == field.name);
            let is_kept = field.name == "Points" || KEYS.contains(&field.name.as_str());
            let other = |key| twin.filter(|_| is_kept).and_then(|twin| row(1 - side, twin, key));
            let of_key = |key| row(side, field, key).or_else(|| other(key)).unwrap_or(vec![0.0; field.components]);
            Field { numbers: all.iter().flat_map(of_key).collect(), ..field.clone() }
        };
        fields[side].iter().map(ordered).collect()
    })
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
