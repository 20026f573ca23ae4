//! Tests of the findings (sentences that answer a section's question) and tables of the solver report, on made-up
//! results.

use super::*;
use crate::solver::{Case, Iteration, Mesh, Steps};

fn run(tolerance: f64, ms: f64, error: f64, flagged: usize) -> Run {
    Run {
        preconditioner: "jacobi".into(),
        tolerance,
        error,
        iterations: vec![7, 9, 8],
        flagged,
        flags: if flagged > 0 { vec!["not_converged".into()] } else { Vec::new() },
        bytes_device: 0,
        step_us: vec![vec![900.0 * ms; 3], vec![1e3 * ms, 2e3 * ms, 500.0 * ms], vec![1e3 * ms; 3]],
    }
}

fn case(young: f64, runs: Vec<Run>) -> Measured {
    let case = Case { mesh: Mesh::Block(12), young, dt: 1e-3, steps: 3 };
    Measured {
        name: case.name(),
        case,
        tetrahedra: 10_368,
        nodes: 2_197,
        reference_seconds: 1.0,
        largest_displacement: 1e-3,
        runs,
    }
}

#[test]
fn the_fastest_setting_has_an_allowed_error_and_no_flags() {
    let runs = vec![run(1e-3, 2.0, 2e-4, 0), run(1e-4, 4.0, 9e-5, 0), run(1e-5, 6.0, 1e-6, 0), run(1e-6, 3.0, 1e-7, 2)];
    let cases = [case(2e4, runs), case(2e6, vec![run(1e-6, 9.0, f64::NAN, 0)])];
    let section = accuracy(&cases).unwrap();
    assert!(
        section.finding.contains("20 kPa, 1 ms at 4.00 ms (jacobi to 1e-4, 8 iterations)"),
        "finding: {}",
        section.finding
    );
    assert!(section.finding.contains("2 MPa, 1 ms: not reached by any setting. Flags were raised: not_converged."));
    let row = ["20 kPa, 1 ms", "jacobi", "1e-4", "4.00", "2.80", "8.00", "8", "0", "9.0e-5"];
    assert_eq!(section.table.rows[1], row);
    assert!(section.plot.unwrap().contains("20 kPa, 1 ms"));
}

#[test]
fn we_are_held_against_the_faster_peer() {
    let cases = [case(2e4, vec![run(1e-5, 5.0, 1e-5, 0)]), case(2e6, vec![run(1e-5, 96.0, 1e-5, 0)])];
    let compared: Vec<(Peer, &Measured)> =
        PEERS.into_iter().filter_map(|p| p.case(&cases).map(|case| (p, case))).collect();
    assert_eq!(compared.len(), 2);
    let section = peers(&compared);
    assert_eq!(section.table.rows[0][6..], ["3.80", "3.10", "2.5"]);
    assert_eq!(section.table.rows[1][6..], ["0.50", "0.50", "2.5"]);
    assert!(section.finding.starts_with("1 of 2 goals are reached"), "finding: {}", section.finding);
    let none = [case(2e4, vec![run(1e-3, 1.0, 1e-2, 0)])];
    let compared: Vec<(Peer, &Measured)> =
        PEERS.into_iter().filter_map(|p| p.case(&none).map(|case| (p, case))).collect();
    assert!(peers(&compared).table.rows[0].iter().filter(|cell| *cell == "none").count() == 5);
}

#[test]
fn growth_is_a_power_of_the_tetrahedra() {
    let size = |tetrahedra: usize, ms: f64| {
        let (long_us, short_us) = (vec![1e3 * 32.0 * ms], vec![1e3 * 8.0 * ms]);
        let bytes_device = 300 * tetrahedra as u64;
        let iteration =
            Iteration { preconditioner: "jacobi".into(), bytes_device, long_us, short_us, iterations: [32, 8] };
        let steps = Steps { young: 2e4, iterations: vec![10], flagged: 0, step_us: vec![2e4 * ms * ms] };
        Size { tetrahedra, nodes: tetrahedra / 5, iterations: vec![iteration], steps: vec![steps] }
    };
    let sizes = [size(1_000, 0.1), size(10_000, 1.0), size(100_000, 10.0)];
    let section = growth(&sizes).unwrap();
    // The exponents p of time ~ tetrahedra^p: 2 for a step, and 1 for an iteration, which is within its goal.
    assert!(
        section.finding.contains("step, 20 kPa 2.00, iteration, jacobi 1.00 (within"),
        "finding: {}",
        section.finding
    );
    assert!(
        section.finding.contains("At most 300 bytes on the device for each tetrahedron, within"),
        "finding: {}",
        section.finding
    );
    assert_eq!(section.table.rows[1], ["10000", "2000", "1.000", "100.0", "300", "20.0", "10"]);
    assert_eq!(section.table.rows[0].len(), section.table.heads.len());
    let slower = growth(&[size(1_000, 0.1), size(10_000, 2.0)]).unwrap();
    assert!(slower.finding.contains("1.30 (beyond"), "finding: {}", slower.finding);
}

#[test]
fn what_was_not_measured_has_no_section() {
    assert!(sections(&Results::default()).unwrap().is_empty());
}
