//! Tests of the findings (sentences that answer a section's question) and tables of the report on the paper's scenes,
//! on made-up results.

use super::*;

fn times(query_ms: f64, step_ms: f64, contacts: u32) -> Times {
    Times {
        touching: 3,
        stages_us: [("solve".to_string(), vec![750.0 * step_ms]), ("depth".to_string(), vec![250.0 * step_ms])].into(),
        query_us: vec![1e3 * query_ms; 3],
        step_us: vec![1e3 * step_ms, 9e3 * step_ms, 900.0 * step_ms],
        contacts: vec![contacts],
        areas: vec![1e-4],
        iterations: vec![12],
    }
}

fn ran(name: &str, query_ms: f64, step_ms: f64) -> Ran {
    Ran { name: name.into(), times: times(query_ms, step_ms, 7), ..Ran::default() }
}

#[test]
fn scenes_are_held_against_the_paper_and_the_goals() {
    let idle = Ran { flags: vec!["not_converged".into()], ..Ran { name: "gears".into(), ..Ran::default() } };
    let all = [ran("touch-head", 1.7, 9.0), ran("pumpkins", 3.5, 20.0), idle];
    let section = scenes(&all).unwrap();
    let told = [
        "no longer than the paper's in 1 of 2 scenes, not pumpkins (3.50 ms)",
        "no longer than the goal in 0 of 2 scenes, not touch-head (1.70 ms), pumpkins (3.50 ms)",
        "touch-head 9.00 ms, pumpkins 20.0 ms. Flags were raised: not_converged. No bodies touched in gears.",
    ];
    assert!(told.iter().all(|told| section.finding.contains(told)), "finding: {}", section.finding);
    assert_eq!(section.table.rows[0][4..], ["7", "1.00", "2.00", "1.70", "1.50", "9.00", "12"]);
    assert!(section.table.rows.iter().all(|row| row.len() == section.table.heads.len()));
    let by_stage = stages(&all[..1]).unwrap();
    assert!(by_stage.finding.contains("touch-head: solve") && by_stage.table.rows[0].ends_with(&["75".to_string()]));
    assert_eq!(by_stage.table.rows[0].len(), by_stage.table.heads.len());
}

#[test]
fn growth_is_a_power_of_what_differs() {
    let row = |bodies: usize| Grown { bodies, times: times(0.5, bodies as f64, 9), ..Grown::default() };
    let section = growth(By::Bodies, &[row(1), row(4), row(16)]).unwrap();
    let told = "From 1 to 16 (bodies) the query's time goes from 0.50 to 0.50 ms (power 0.00), the solver's from 0.75 \
                to 12.0 ms (power 1.00), the loop's from 1.00 to 16.0 ms (power 1.00).";
    assert_eq!(section.finding, told);
    assert_eq!(section.table.rows[2].len(), section.table.heads.len());
    assert!(growth(By::Area, &[]).unwrap().finding.contains("too few rows"));
}

#[test]
fn what_was_not_measured_has_no_section() {
    let empty = Results { growth: vec![(By::Area, Vec::new())], ..Results::default() };
    assert!(sections(&empty).unwrap().is_empty());
}
