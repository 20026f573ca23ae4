//! Tests of the findings (sentences that answer a section's question) and tables of the proximity report, on made-up
//! results.

use palpate::internal::stages::POSE_TO_CONTACT;

use super::*;
use crate::Samples;

fn place(total_ms: f64, contacts: usize, area_cm2: f64) -> Place {
    let mut samples_us = Samples::default();
    samples_us.add(&[("depth".into(), 400.0 * total_ms), ("contact".into(), 600.0 * total_ms)]);
    samples_us.add(&[(POSE_TO_CONTACT.into(), 1000.0 * total_ms)]);
    Place { contacts, area: 1e-4 * area_cm2, samples_us, ..Place::default() }
}

fn sized(vertices: usize, total_ms: f64) -> Sensitivity {
    Sensitivity { vertices, place: place(total_ms, 100, 1.0), ..Sensitivity::default() }
}

#[test]
fn sensitivity_is_judged_by_the_last_and_the_first() {
    let held = sensitivity_finding(&[sized(1_000, 2.0), sized(2_000, 9.0), sized(64_000, 2.5)]);
    assert!(
        held.contains("64 times as many") && held.contains("1.25 times as long: within the allowed ratio of 1.5"),
        "finding: {held}"
    );
    let missed = sensitivity_finding(&[sized(1_000, 2.0), sized(64_000, 3.2)]);
    assert!(missed.contains("1.60 times as long: beyond"), "finding: {missed}");
    let section = sensitivity(&[sized(1_000, 2.0), sized(64_000, 3.0)]).unwrap();
    assert_eq!(section.table.rows[1].last().unwrap(), "1.50");
    assert_eq!(section.table.rows[0].len(), section.table.heads.len());
}

#[test]
fn more_area_costs_more() {
    let row = |area: f64, time: f64| Area { place: place(time, (200.0 * area) as usize, area), ..Area::default() };
    // The first row has no contact, so that the finding leaves it out.
    let rows = [row(0.0, 9.0), row(1.0, 1.0), row(3.0, 2.0), row(10.0, 4.0), row(20.0, 14.0)];
    let finding = area_finding(&rows);
    assert!(
        finding.starts_with("From 1.0 to 20.0 cm^2, 20.0 times the area, the query takes 14.0 times"),
        "finding: {finding}"
    );
    assert!(
        finding.contains("0.50 ms between the first two areas and 1.00 ms between the last two; at the last, 60 %"),
        "finding: {finding}"
    );
    assert!(area_finding(&rows[..4]).contains("too few"));
}

#[test]
fn peers_are_faster_or_slower() {
    let peers = Peers {
        place: place(4.0, 600, 9.0),
        boxed_us: vec![2_000.0],
        all_us: vec![10_000.0],
        refit_us: vec![500.0],
        ..Peers::default()
    };
    let finding = peers_finding(&peers);
    assert!(finding.contains("2.00 times as slow as closest points for the 0 vertices"), "finding: {finding}");
    assert!(finding.contains("(2.00 ms; 2.50 ms with the refit)"), "finding: {finding}");
    assert!(finding.contains("2.50 times as fast as closest points for all vertices (10.00 ms)"), "finding: {finding}");
}
