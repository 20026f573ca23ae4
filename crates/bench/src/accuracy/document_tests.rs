//! Tests of the texts of the accuracy report, which gives for each curve (error and computing time of the settings of
//! one varied value) a finding: a sentence and notes.

use super::*;
use crate::accuracy::Expected;

fn point(value: f64, error: f64) -> Point {
    Point { value, force_error: Some(error), step_us: vec![vec![1e3]], ..Point::default() }
}

fn curve(errors: &[f64]) -> Curve {
    let points = errors.iter().enumerate().map(|(k, error)| point(0.5f64.powi(k as i32), *error)).collect();
    let expected = Some(Expected { order: 2.0, law: "a law".into(), is_of_shape: false });
    Curve { name: "some".into(), points, expected, bound: 0.1, ..Curve::default() }
}

/// The finding's sentence and its notes as one text.
fn finding(curve: &Curve) -> String {
    let (sentence, notes) = super::finding(curve);
    sentence + " " + &notes.join(" ")
}

#[test]
fn what_is_found_is_what_an_error_costs_unless_there_is_more_to_say() {
    let good = curve(&[0.5, 0.05]);
    assert!(
        super::finding(&good).0.starts_with("Cheapest below 7.0 %"),
        "the finding does not begin with the cheapest setting: {:?}",
        super::finding(&good)
    );
    assert!(super::finding(&curve(&[0.05, 0.5])).0.starts_with("NOT within"));
    let every = Curve { judged: Judged::Every, bound: 0.0, ..curve(&[0.0, 0.0]) };
    assert!(super::finding(&every).0.contains("bit for bit") && !finding(&every).contains("Cheapest"));
}

#[test]
fn an_order_and_a_span_have_reasons_of_their_own_and_an_empty_one_shows() {
    let mut first = curve(&[0.08, 0.04, 0.02, 0.01]);
    assert_eq!(finding(&first).matches(UNKNOWN).count(), 2);
    first.order_reason = "of the order".into();
    let told = finding(&first);
    assert!(
        told.contains("1.0, 1.0, 1.0: of the order") && told.contains(&format!("ten: {UNKNOWN}")),
        "finding: {told}"
    );
    first.span_reason = "of the span".into();
    let told = finding(&first);
    assert!(told.contains("ten: of the span") && !told.contains(UNKNOWN), "finding: {told}");
    // The order is the one that theory expects, and the errors span more than two decades: the finding needs no reason.
    let second = finding(&curve(&[0.08, 0.02, 0.005, 0.00125, 0.0003125]));
    assert!(!second.contains(UNKNOWN) && second.contains("close enough"), "finding: {second}");
}

#[test]
fn faults_are_the_curves_that_are_not_within() {
    let good = curve(&[0.5, 0.05]);
    let bad = Curve { name: "other".into(), ..curve(&[0.05, 0.5]) };
    let found = faults(&[good.clone(), bad, good]);
    assert!(
        found.len() == 1 && found[0].starts_with("other: NOT within 10 %") && found[0].contains("50 %"),
        "expected the fault of the curve `other` alone: {found:?}"
    );
}

#[test]
fn earlier_results_are_drawn_beside_and_their_cost_is_compared() {
    let now = curve(&[0.5, 0.05, 0.005]);
    let mut before = now.clone();
    before.points.iter_mut().for_each(|point| point.step_us = vec![vec![4e3]]);
    let told = section(&now, Some(&before)).unwrap();
    let note = told.notes.iter().find(|note| note.contains("as a share of its cost then")).unwrap();
    assert!(note.ends_with("0.25 to 0.25."), "{note}");
    assert!(told.plot.unwrap().contains("before"), "the earlier line has no name");
    // An error that no setting reaches any more is told.
    let told = section(&curve(&[0.5, 0.05]), Some(&curve(&[0.5, 0.05, 0.005]))).unwrap();
    assert!(told.notes.iter().any(|note| note.ends_with("cost then: not reached in 1 of 1.")), "{:?}", told.notes);
}
