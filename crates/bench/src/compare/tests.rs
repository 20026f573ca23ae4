//! Tests of comparing an old and a new result of `palpate bench`: which differences count as worse, and which as noise.

use serde_json::{Value, json};

use super::*;
use crate::suite::Head;

fn results(parts: Value) -> Results {
    let head = Head {
        schema: crate::SCHEMA,
        version: "0".into(),
        commit: "c".into(),
        device: "d".into(),
        driver: "e".into(),
        depth_path: "compute".into(),
        is_cpu: true,
        threads: 2,
        is_quick: true,
    };
    let benchmarks = [("solver".to_string(), json!({ "settings": {}, "names": [], "parts": parts }))];
    Results { head, benchmarks: benchmarks.into_iter().collect() }
}

fn timed(rounds: [f64; 3]) -> Results {
    let [low, middle, high] = rounds;
    let rounds = [low, middle, middle, middle, high].map(|us| vec![us; 4]);
    results(json!({ "p": { "runs": [{ "setting": "s", "step_us": rounds, "force_error": 0.01 }] } }))
}

fn only(old: &Results, new: &Results, end: &str) -> Comparison {
    let (all, lonely) = compare(old, new).unwrap();
    assert!(lonely.is_empty());
    all.into_iter().find(|c| c.path.ends_with(end)).unwrap()
}

#[test]
fn slower_is_worse_only_beyond_the_spread() {
    let old = timed([10.0, 11.0, 12.0]);
    let noisy = only(&old, &timed([11.5, 14.0, 18.0]), "step_us");
    assert_eq!((noisy.verdict, noisy.ratio[1]), (Verdict::Same, 14.0 / 11.0));
    assert_eq!(noisy.path, "solver/p/runs/s/step_us");
    assert_eq!(only(&old, &timed([13.3, 14.0, 18.0]), "step_us").verdict, Verdict::Worse);
    assert_eq!(only(&timed([13.3, 14.0, 18.0]), &old, "step_us").verdict, Verdict::Better);
}

#[test]
fn greater_errors_are_worse_and_rounding_is_none() {
    let of = |error: f64| results(json!({ "p": { "force_error": error } }));
    assert_eq!(only(&of(0.01), &of(0.012), "error").verdict, Verdict::Worse);
    assert_eq!(only(&of(0.01), &of(0.0105), "error").verdict, Verdict::Same);
    assert_eq!(only(&of(1e-8), &of(5e-7), "error").verdict, Verdict::Same);
    assert_eq!(only(&of(0.02), &of(0.01), "error").verdict, Verdict::Better);
    assert_eq!(only(&of(0.02), &of(f64::NAN), "error").verdict, Verdict::Worse);
    assert_ne!(only(&of(f64::NAN), &of(f64::NAN), "error").verdict, Verdict::Worse);
}

#[test]
fn other_settings_are_not_compared() {
    let mut other = results(json!({}));
    other.benchmarks["solver"]["settings"] = json!({ "steps": 7 });
    assert!(compare(&results(json!({})), &other).unwrap_err().to_string().contains("`solver` has different settings"));
    let mut other = results(json!({}));
    other.head.is_quick = false;
    assert!(compare(&results(json!({})), &other).is_err());
}

#[test]
fn one_round_is_dealt_out_and_few_samples_are_not_judged() {
    let of = |us: Vec<f64>| results(json!({ "p": { "samples_us": { "pose": us } } }));
    let old = of((0..50).map(|k| 10.0 + f64::from(k % 3)).collect());
    assert_eq!(only(&old, &of(vec![20.0; 50]), "pose").verdict, Verdict::Worse);
    assert_eq!(only(&of(vec![1.0]), &of(vec![9.0]), "pose").verdict, Verdict::Unjudged);
    assert_eq!(only(&of(vec![0.0; 50]), &of(vec![9.0; 50]), "pose").verdict, Verdict::Unjudged);
    let (all, lonely) = compare(&old, &results(json!({}))).unwrap();
    assert!(all.is_empty() && lonely == ["solver/p/samples_us/pose"]);
}

#[test]
fn the_table_begins_with_what_is_worse() {
    let (old, new) = (timed([10.0, 11.0, 12.0]), timed([20.0, 21.0, 22.0]));
    let rows = table(&compare(&old, &new).unwrap().0).rows;
    assert!(
        rows[0][0].ends_with("step_us") && rows[0][6] == "slower" && rows[1][6] == "same",
        "the slower time is not in the first row: {rows:?}"
    );
    assert_eq!(rows[0][3..6], ["1.91", "1.67", "2.20"]);
}

#[test]
fn what_the_machine_took_longer_for_is_no_regression() {
    let with_gauge = |mut results: Results, us: f64| {
        results.benchmarks["solver"]["gauges"] = json!({ "p": vec![us; 10] });
        results
    };
    let (old, new) = (timed([10.0, 11.0, 12.0]), timed([20.0, 22.0, 24.0]));
    let compared = |old: f64, new_us: f64| {
        only(&with_gauge(timed([10.0, 11.0, 12.0]), old), &with_gauge(new.clone(), new_us), "step_us")
    };
    assert_eq!(only(&old, &new, "step_us").verdict, Verdict::Worse);
    assert_eq!((compared(5.0, 10.0).verdict, compared(5.0, 10.0).ratio[1]), (Verdict::Same, 1.0));
    assert_eq!(compared(5.0, 5.0).verdict, Verdict::Worse);
    // The gauge, the time of a fixed piece of work, measures the CPU, so results of a GPU are not corrected by it.
    let other = |us| {
        let mut results = with_gauge(if us < 6.0 { old.clone() } else { new.clone() }, us);
        results.head.is_cpu = false;
        results
    };
    assert_eq!(only(&other(5.0), &other(10.0), "step_us").verdict, Verdict::Worse);
}

#[test]
fn what_costs_no_time_is_compared_as_well() {
    let of = |bytes: u64, iterations: [u32; 2], flags: &[&str]| {
        results(
            json!({ "p": { "bytes_device": bytes, "runs": [{ "name": "a", "iterations": iterations, "flags": flags }] } }),
        )
    };
    let old = of(1000, [10, 12], &["inverted"]);
    let verdict = |new: &Results, end: &str| only(&old, new, end).verdict;
    let same = of(1010, [11, 13], &["inverted"]);
    let worse = of(2000, [20, 20], &["inverted", "frozen"]);
    for end in ["bytes_device", "iterations", "flags"] {
        assert_eq!(
            (verdict(&same, end), verdict(&worse, end)),
            (Verdict::Same, Verdict::Worse),
            "verdicts on `{end}`, first for results that hardly differ, then for clearly worse ones"
        );
    }
    assert_eq!(verdict(&of(1000, [10, 12], &["frozen"]), "flags"), Verdict::Worse);
    assert_eq!(verdict(&of(500, [10, 12], &[]), "flags"), Verdict::Better);
}

#[test]
fn a_part_that_is_slower_as_a_whole_is_told_and_one_time_out_of_the_ordinary() {
    let of = |us: &dyn Fn(usize) -> f64| {
        let runs = |p: usize| (0..8).map(move |k| (p, k));
        let run = |(p, k): (usize, usize)| json!({ "name": k.to_string(), "step_us": vec![us(8 * p + k); 10] });
        let part = |p: usize| json!({ "runs": runs(p).map(run).collect::<Vec<_>>() });
        results(json!({ "p": part(0), "q": part(1) }))
    };
    let old = of(&|_| 10.0);
    let worse = |new: &Results| {
        let (all, _) = compare(&old, new).unwrap();
        let worse = all.into_iter().filter(|c| c.verdict == Verdict::Worse);
        worse.map(|c| c.path).collect::<Vec<_>>()
    };
    assert!(worse(&old).is_empty());
    // All times of the part `q` grow by a half.
    let slower = worse(&of(&|k| if k < 8 { 10.0 } else { 15.0 }));
    assert_eq!(slower, ["solver/q"], "slower paths: {slower:?}");
    // One time grows by a half, and the other times grow by at most 3 %: its ratio of new to old is an outlier among
    // all ratios.
    let slower = worse(&of(&|k| if k == 3 { 15.0 } else { 10.0 + 0.1 * (k % 4) as f64 }));
    assert_eq!(slower, ["solver/p/runs/3/step_us"], "slower paths: {slower:?}");
    // On a busy machine, with ratios from a half to two, no ratio is an outlier.
    assert!(worse(&of(&|k| 10.0 * 2f64.powf((k % 5) as f64 / 2.0 - 1.0))).is_empty());
}
