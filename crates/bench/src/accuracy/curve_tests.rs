//! Tests of the curves (error and computing time of the settings of one varied value): best buys (settings that no
//! other beats in both error and time), orders of convergence, shares of the error that remain after one more unit of
//! the varied value, and the verdict whether the errors are within a bound.

use super::*;

fn point(value: f64, ms: f64, error: Option<f64>) -> Point {
    Point { value, force_error: error, step_us: vec![vec![1e3 * ms]], ..Point::default() }
}

fn curve(points: Vec<Point>) -> Curve {
    Curve { points, bound: 1e-3, ..Curve::default() }
}

#[test]
fn the_best_buys_are_those_that_nothing_beats_in_both() {
    let mut flagged = point(1.0, 0.5, Some(1e-6));
    flagged.flags = vec!["not_converged".into()];
    let mut elsewhere = point(1.0, 9.0, Some(0.9));
    elsewhere.panel = "stiff".into();
    let all = vec![
        point(1.0, 1.0, Some(0.1)),
        point(2.0, 2.0, Some(0.2)),
        point(3.0, 2.0, Some(0.01)),
        point(4.0, 2.5, Some(0.01)),
        point(5.0, 3.0, None),
        flagged,
        elsewhere,
    ];
    assert_eq!(curve(all).best(), [true, false, true, false, false, false, true]);
}

#[test]
fn noise_makes_no_best_buy() {
    let rounds =
        |us: [f64; 3], error| Point { step_us: us.map(|us| vec![us]).to_vec(), ..point(1.0, 1.0, Some(error)) };
    // The cheaper point is cheaper by only 2 %, or by 20 % with rounds whose ranges of time overlap. Both differences
    // count as noise, so that the more accurate point is the only best buy.
    for (cheap, dear) in [([980.0; 3], [1000.0; 3]), ([700.0, 800.0, 990.0], [900.0, 1000.0, 1100.0])] {
        assert_eq!(curve(vec![rounds(cheap, 0.02), rounds(dear, 0.01)]).best(), [false, true]);
    }
    let clear = [rounds([700.0, 800.0, 850.0], 0.02), rounds([900.0, 1000.0, 1100.0], 0.01)];
    assert_eq!(curve(clear.to_vec()).best(), [true, true]);
    // Two equally accurate points whose costs differ by no more than noise are both best buys.
    assert_eq!(curve(vec![rounds([980.0; 3], 0.01), rounds([1000.0; 3], 0.01)]).best(), [true, true]);
}

#[test]
fn luck_neither_spans_nor_judges_nor_makes_an_order() {
    let errors = [0.08, 0.02, 3e-5, 0.005, 0.00125];
    let at = |errors: &[f64]| -> Vec<Point> {
        errors.iter().enumerate().map(|(k, error)| point(0.5f64.powi(k as i32), 1.0, Some(*error))).collect()
    };
    let lucky = curve(at(&errors));
    assert!((lucky.decades() - 64f64.log10()).abs() < 1e-9, "errors span {} decades, not log10(64)", lucky.decades());
    assert!(lucky.lines()[0].order(false).is_none() && !lucky.is_within());
    assert!((lucky.lines()[0].local_orders(false)[0] - 2.0).abs() < 1e-9);
    let steady = curve(at(&[0.08, 0.02, 0.005, 0.00125, 0.0003125]));
    assert!((steady.lines()[0].order(false).unwrap().0 - 2.0).abs() < 1e-9 && steady.is_within());
    // Decades (powers of ten) are counted within one line: line `b` is far below line `a`, but the gap between the two
    // does not count.
    let named = |line: &str, k| Point { line: line.into(), ..point(1.0, 1.0, Some(k)) };
    assert!(curve(vec![named("a", 1.0), named("a", 0.5), named("b", 1e-4), named("b", 1e-4)]).decades() < 0.31);
}

#[test]
fn who_is_judged_is_the_finest_of_a_line_or_of_a_panel_or_everyone() {
    let named = |line: &str, error| Point { line: line.into(), ..point(1.0, 1.0, error) };
    let all = vec![named("a", Some(1e-4)), named("a", Some(0.5)), named("b", Some(0.5)), named("b", Some(1e-4))];
    let judged = |judged, points: &[Point]| Curve { judged, ..curve(points.to_vec()) }.beyond().len();
    assert_eq!(judged(Judged::Finest, &all), 1);
    assert_eq!((judged(Judged::FinestOfPanel, &all), judged(Judged::FinestOfPanel, &all[..3])), (0, 1));
    let apart = Point { panel: "other".into(), ..named("c", Some(0.5)) };
    assert_eq!(judged(Judged::FinestOfPanel, &[&all[..], &[apart]].concat()), 1);
    assert_eq!((judged(Judged::Every, &all), judged(Judged::Every, &all[3..])), (2, 0));
    assert_eq!(judged(Judged::Every, &[named("a", None), named("a", Some(1e-4))]), 1);
    assert_eq!(judged(Judged::Finest, &[named("a", Some(f64::NAN))]), 1);
}

#[test]
fn errors_that_are_nearly_the_same_buy_nothing() {
    let cheap = point(1.0, 1.0, Some(0.0102));
    assert_eq!(curve(vec![cheap.clone(), point(1.0, 2.0, Some(0.01))]).best(), [true, false]);
    assert_eq!(curve(vec![cheap, point(1.0, 2.0, Some(0.009))]).best(), [true, true]);
}

#[test]
fn steps_of_different_lengths_are_paid_by_the_time_they_simulate() {
    let mut long = point(1.0, 2.0, Some(0.1));
    long.simulated_s = 0.01;
    let short = Point { simulated_s: 0.001, ..point(1.0, 1.0, Some(0.1)) };
    assert!((long.cost() - 0.2).abs() < 1e-12 && (short.cost() - 1.0).abs() < 1e-12);
    assert_eq!(curve(vec![long, short]).best(), [true, false]);
}

#[test]
fn orders_are_fitted_where_errors_fall_and_not_to_floor_or_ceiling() {
    let second = |h: f64| Some((0.5 * h * h).max(1e-5));
    let points = [1.0, 0.4, 0.2, 0.1, 0.05, 0.001, 0.0005].map(|h| point(h, 1.0, second(h))).to_vec();
    let all = curve(points.clone());
    let (order, count) = all.lines()[0].order(false).unwrap();
    // The fit takes the points from the value 0.4, the first with an error below a tenth, to 0.001, where the floor
    // (errors that no longer fall) begins. The error at 0.001 is above the power law, so that the fitted order is below
    // 2.
    assert!(count == 5 && order < 2.0, "fitted order: {order}, expected below 2; fitted points: {count}, expected 5");
    let all = curve(points[..5].to_vec());
    let (order, count) = all.lines()[0].order(false).unwrap();
    assert!((order - 2.0).abs() < 1e-9 && count == 4, "order: {order}, expected 2; points: {count}, expected 4");
    assert!((all.decades() - (0.5f64 / 0.5 / 0.0025).log10()).abs() < 1e-9);
    // Points listed in reverse give the same order of convergence. The error of the displacements, which these points
    // lack, has no order of convergence.
    let turned = curve(points[..5].iter().rev().cloned().collect());
    assert!((turned.lines()[0].order(false).unwrap().0 - 2.0).abs() < 1e-9);
    assert!(turned.lines()[0].order(true).is_none());
    assert!(curve(vec![point(1.0, 1.0, Some(0.05)); 2]).lines()[0].order(false).is_none());
}

#[test]
fn shares_are_what_a_unit_leaves() {
    let points = (1..=6).map(|n| point(f64::from(n), 1.0, Some(0.2f64.powi(n)))).collect();
    let (share, count) = curve(points).lines()[0].share().unwrap();
    assert!((share - 0.2).abs() < 1e-9 && count == 5, "share: {share}, expected 0.2; points: {count}, expected 5");
}

#[test]
fn a_line_beyond_its_bound_or_without_a_number_spoils_the_verdict() {
    let named = |line: &str, error| Point { line: line.into(), ..point(1.0, 1.0, error) };
    let good = vec![named("a", Some(0.5)), named("a", Some(1e-4)), named("b", Some(9e-4))];
    assert!(curve(good.clone()).is_within());
    for bad in [Some(2e-3), None] {
        let all = curve([good.clone(), vec![named("c", bad)]].concat());
        let beyond = all.beyond();
        assert!(!all.is_within() && beyond.len() == 1 && beyond[0].0.name == "c" && beyond[0].1 == bad);
    }
    assert!(!curve(Vec::new()).is_within());
}

#[test]
fn what_stands_beside_is_not_judged() {
    let at = |panel: &str, error| Point { panel: panel.into(), force_error: Some(error), ..Point::default() };
    let points = vec![at("engine", 1e-9), at("others", 0.5)];
    let curve = Curve { points, bound: 0.1, judged: Judged::Every, ..Curve::default() };
    assert!(!curve.is_within());
    assert!(Curve { beside: "others".into(), ..curve.clone() }.is_within());
    assert!(!Curve { beside: "engine".into(), ..curve }.is_within());
}
