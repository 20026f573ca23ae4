//! `palpate bench`: every question is answered, however small; what is written; bad input. No times are judged.

use std::path::PathBuf;
use std::process::Command;

use palpate::bench::haptics;
use palpate::bench::proximity::{self, Outcome, Settings};
use palpate::bench::solver::{self, Case, Mesh};

#[test]
fn a_tiny_run_answers_every_question_of_the_query() {
    let settings = Settings {
        runs: 3,
        warm_up: 1,
        sizes: vec![4_000, 9_000],
        areas_cm2: vec![0.0, 1.0, 2.0],
        area_vertices: 18_000,
        peer_vertices: [2_000, 3_000],
        peer_colliding: 20,
        scenes: empty_folder(),
        ..Settings::quick()
    };
    let mut told = Vec::new();
    let results = proximity::run(&settings, &mut |what: &str| told.push(what.to_string())).unwrap();
    assert!(told.iter().any(|what| what.starts_with("peers")), "{told:?}");

    let [few, many] = &results.sensitivity[..] else { panic!("{:?}", results.sensitivity) };
    assert!(few.place.contacts > 100 && few.place.contacts == many.place.contacts, "{few:?} {many:?}");
    assert!(few.vertices < many.vertices && few.place.samples_us.total_ms() > 0.0);
    let samples = serde_json::to_value(&few.place.samples_us).unwrap();
    let runs = |timer: &str| samples[timer].as_array().unwrap().len();
    assert_eq!(["pose", "contact", "pose to contact"].map(runs), [3; 3]);
    let areas: Vec<f64> = results.area.iter().map(|row| 1e4 * row.place.area).collect();
    assert!(results.area[0].place.contacts == 0 && areas[0] == 0.0);
    // Coarse triangles on a coarse border, and the ball is a little beside the pole.
    assert!((areas[1] - 1.0).abs() < 0.15 && (areas[2] - 2.0).abs() < 0.2, "{areas:?}");
    let peers = &results.peers;
    assert!(peers.inside.abs_diff(20) <= 3 && peers.colliding.iter().all(|&n| n > 0), "{peers:?}");
    assert!(results.scenes.len() == 5 && results.scenes.iter().all(|s| matches!(s.outcome, Outcome::Missing(_))));

    let document = proximity::document(&results).unwrap();
    let text = document.markdown(true);
    let named = ["sensitivity.svg", "area.svg", "peers.svg", "no scene was measured", "**Found:**", "quick run"];
    assert!(named.iter().all(|word| text.contains(word)), "{text}");
    let json = serde_json::to_value(&results).unwrap();
    assert_eq!((&json["schema"], &json["benchmark"]), (&2.into(), &"proximity".into()));
    let depths = |series: &str| json[series][1]["samples_us"]["depth"].as_array().unwrap().len();
    assert_eq!((depths("sensitivity"), depths("area")), (3, 2));
}

#[test]
fn a_tiny_run_answers_every_question_of_the_solver() {
    let block = |young, dt| Case { mesh: Mesh::Block(3), young, dt, steps: 4 };
    let settings = solver::Settings {
        cases: vec![block(2e4, 1e-3), block(2e6, 1e-2)],
        tolerances: vec![1e-1, 1e-6],
        repetitions: 2,
        scaling: vec![3, 5],
        scaling_steps: 2,
        ..solver::Settings::quick()
    };
    let mut told = Vec::new();
    let results = solver::run(&settings, &mut |what: &str| told.push(what.to_string())).unwrap();
    assert!(told.iter().any(|what| what == "block0k-20kPa-1ms: run 2 of 2"), "{told:?}");

    assert_eq!(results.cases.len(), 2);
    for case in &results.cases {
        assert!(case.tetrahedra == 162 && case.nodes == 64 && case.largest_displacement > 0.0);
        let by_preconditioner: Vec<_> = case.runs.chunk_by(|a, b| a.preconditioner == b.preconditioner).collect();
        assert_eq!(by_preconditioner.len(), 2, "{case:?}");
        for runs in by_preconditioner {
            let [loose, tight] = runs else { panic!("{runs:?}") };
            assert_eq!((loose.tolerance, tight.tolerance), (1e-1, 1e-6));
            // On the stiff block with long steps 1e-6 is more than single precision can promise.
            assert!(case.case.young > 2e4 || tight.flagged == 0, "{tight:?}");
            // The solver's tolerance, and f32 displacements.
            assert!(tight.error < 1e-5 && tight.error > 0.0 && tight.error < loose.error, "{runs:?}");
            assert!(tight.iterations.iter().zip(&loose.iterations).all(|(many, few)| many > few), "{runs:?}");
            assert!(tight.step_us.len() == 2 && tight.step_us.iter().all(|steps| steps.len() == 4));
        }
    }
    let [small, large] = &results.scaling[..] else { panic!("{:?}", results.scaling) };
    assert!((small.tetrahedra, large.tetrahedra) == (162, 750) && small.steps.len() == 2);
    assert_eq!(large.iterations[0].iterations, [32, 8]);
    assert!(large.iterations[0].bytes_device > 750 * 100 && large.iterations[0].step_us[1].len() == 2);

    let text = solver::document(&results).unwrap().markdown(true);
    let named = ["block0k.svg", "growth.svg", "1 ms at", "**Found:**", "quick run"];
    assert!(named.iter().all(|word| text.contains(word)), "{text}");
    let json = serde_json::to_value(&results).unwrap();
    assert_eq!((&json["schema"], &json["benchmark"]), (&2.into(), &"solver".into()));
    assert_eq!(json["cases"][1]["runs"][0]["step_us"][1].as_array().unwrap().len(), 4);
    assert_eq!((&json["cases"][1]["young"], &json["cases"][1]["name"]), (&2e6.into(), &"block0k-2MPa-10ms".into()));
}

#[test]
fn a_tiny_run_answers_every_question_of_the_loop() {
    let settings = haptics::Settings {
        dampings: vec![0.0],
        delays: vec![0.0, 20e-3],
        rates: vec![50.0],
        bisected: 0.5,
        walls: vec![2000.0],
        vertices: 4_000,
        cell: 0.04,
        jitter_seconds: 0.3,
        ..haptics::Settings::quick()
    };
    let mut told = Vec::new();
    let results = haptics::run(&settings, &mut |what: &str| told.push(what.to_string())).unwrap();
    assert!(told.iter().any(|what| what == "slide: premium at 50 Hz"), "{told:?}");

    let [width] = &results.widths[..] else { panic!("{:?}", results.widths) };
    assert!((width.profile, width.damping, width.coupling) == ("premium", 0.0, 800.0) && width.local >= width.raw);
    let [prompt, late] = &results.delays[..] else { panic!("{:?}", results.delays) };
    assert!(prompt.local > late.local && late.local > late.gil && prompt.delay == 0.0, "{prompt:?} {late:?}");
    let [slow] = &results.rates[..] else { panic!("{:?}", results.rates) };
    // The raw force of a slow simulation swings on walls that the local model holds: that is what it is for.
    assert!(slow.rate == 50.0 && slow.local > 10.0 * slow.raw, "{slow:?}");

    use haptics::{Met, Mode};
    assert_eq!(results.holds.len(), 2 * Mode::ALL.len());
    let held = |met: Met, mode: Mode| results.holds.iter().find(|held| held.met == met && held.mode == mode).unwrap();
    let wall = held(Met::Wall(2000.0), Mode::Local);
    assert!(haptics::is_still(&wall.force) && wall.reading.swing <= 2e-5 && wall.force.mean > 0.5, "{wall:?}");
    assert!(!haptics::is_still(&held(Met::Wall(2000.0), Mode::Raw).force), "{:?}", results.holds);
    assert!(held(Met::Head, Mode::Local).force.mean > 0.1, "{:?}", results.holds);
    for slid in &results.slides {
        assert!(slid.rate == 50.0 && slid.slide.raw.newtons > 0.0 && slid.slide.contact.newtons > 0.0, "{slid:?}");
        assert_eq!(slid.trace.len(), 300);
    }
    let [idle, loaded] = &results.jitter[..] else { panic!("{:?}", results.jitter) };
    assert!(loaded.is_loaded && !idle.is_loaded && loaded.servo.ticks > 0 && loaded.steps > 0);

    let text = haptics::document(&results).unwrap().markdown(true);
    let plots = ["width.svg", "delay.svg", "rate.svg", "hold.svg", "slide.svg", "ticks.svg"];
    assert!(plots.iter().chain(&["**Found:**", "quick run"]).all(|word| text.contains(word)), "{text}");
    let json = serde_json::to_value(&results).unwrap();
    assert_eq!((&json["schema"], &json["benchmark"]), (&2.into(), &"haptics".into()));
    assert_eq!((&json["holds"][0]["met"]["wall"], &json["holds"][2]["mode"]), (&2000.0.into(), &"raw".into()));
}

/// A folder without scenes.
fn empty_folder() -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("no_scenes");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn a_folder_of_scenes_that_is_none_is_refused_before_anything_is_measured() {
    let settings = Settings { scenes: PathBuf::from("no such folder"), ..Settings::quick() };
    let mut told = Vec::new();
    let error = proximity::run(&settings, &mut |what: &str| told.push(what.to_string())).unwrap_err().to_string();
    assert!(told.is_empty() && error.contains("no such folder") && error.contains("--scenes"), "{error}");
}

#[test]
fn benchmarks_and_cases_of_no_such_name_are_refused() {
    for (arguments, mistake, remedy) in [
        (["bench", "speed", "--quick"], "speed", "proximity"),
        (["bench", "solver", "--cases=human,ball"], "ball", "block105k"),
    ] {
        let run = Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).output().unwrap();
        let error = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(2), "{error}");
        assert!(error.contains(mistake) && error.contains(remedy) && error.lines().count() == 1, "{error}");
    }
}
