//! Tests of `palpate bench`: tiny runs answer every question of the report; results of shards (subsets of the
//! benchmarks' parts, measured separately) are joined; results are compared with earlier ones; bad input is refused. No
//! times are judged. In the benchmark of the haptic loop, the *local model* extrapolates the contact wrench between
//! simulation steps; the *raw force* is the force without the local model. In a *hold* a simulated person presses the
//! tool (the rigid body that the haptic device leads) against a surface and holds still; in a *slide* the person moves
//! the tool along the surface.

use std::process::{Command, Output};

use palpate_bench::haptics::{self, Haptics, Place};
use palpate_bench::paper::{self, Paper};
use palpate_bench::proximity::{self, Proximity};
use palpate_bench::solver::{self, Case, Mesh, Solver};
use palpate_bench::suite::{self, Head, Shard};
use palpate_bench::{Benchmark, Document};
use serde_json::{Map, Value};

/// Measures all parts of a benchmark; returns the parts' results, the progress lines, and the report as HTML.
fn measure(benchmark: Box<dyn Benchmark>) -> (Map<String, Value>, Vec<String>, String) {
    let mut told = Vec::new();
    let benchmarks = [benchmark];
    let head = Head::new(None, true).unwrap();
    let watch = &mut |what: &str| told.push(what.to_string());
    let (results, failed) = suite::measure(&benchmarks, head, Shard::WHOLE, &|_, _| true, watch).unwrap();
    assert!(failed.is_empty(), "parts that failed: {failed:?}");
    let document: Document = suite::document(&benchmarks, &results, None).unwrap();
    let parts = results.benchmarks[benchmarks[0].name()]["parts"].as_object().unwrap().clone();
    let text = document.markdown();
    assert!(text.contains("quick run") && text.contains("**Found:**"), "report: {text}");
    let page = document.html();
    assert_eq!(page.matches("<h3>").count(), text.matches("\n### ").count());
    (parts, told, page)
}

#[test]
fn a_tiny_run_answers_every_question_of_the_query() {
    let settings = proximity::Settings {
        runs: 3,
        warm_up: 1,
        sizes: vec![4_000, 9_000],
        areas_cm2: vec![0.0, 1.0, 2.0],
        area_vertices: 18_000,
        peer_vertices: [2_000, 3_000],
        peer_colliding: 20,
        ..proximity::Settings::quick()
    };
    let (json, told, page) = measure(Box::new(Proximity(settings)));
    let results = proximity::Results::of(&json).unwrap();
    assert!(told.iter().any(|what| what.starts_with("peers")), "progress lines: {told:?}");

    let [few, many] = &results.sensitivity[..] else { panic!("two sizes are expected: {:?}", results.sensitivity) };
    assert!(
        few.place.contacts > 100 && few.place.contacts == many.place.contacts,
        "results with few vertices: {few:?}; with many vertices: {many:?}"
    );
    assert!(few.vertices < many.vertices && few.place.samples_us.total_ms() > 0.0);
    let samples = serde_json::to_value(&few.place.samples_us).unwrap();
    let runs = |timer: &str| samples[timer].as_array().unwrap().len();
    assert_eq!(["pose", "contact", "pose to contact"].map(runs), [3; 3]);
    let areas: Vec<f64> = results.area.iter().map(|row| 1e4 * row.place.area).collect();
    assert!(results.area[0].place.contacts == 0 && areas[0] == 0.0);
    // The tolerances are wide, because the triangles at the border of the contact area are coarse and the bodies touch
    // a little away from the poles, about which their vertices lie in rings.
    assert!(
        (areas[1] - 1.0).abs() < 0.15 && (areas[2] - 2.0).abs() < 0.2,
        "contact areas, requested 0, 1 and 2 cm^2, measured {areas:?} cm^2"
    );
    let peers = results.peers.as_ref().unwrap();
    assert!(
        peers.inside.abs_diff(20) <= 3 && peers.colliding.iter().all(|&n| n > 0),
        "wrong numbers of colliding vertices: {peers:?}"
    );
    assert_eq!(page.matches("<figure>").count(), 3, "report: {page}");
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
    let (json, told, page) = measure(Box::new(Solver(settings)));
    let results = solver::Results::of(&json).unwrap();
    assert!(told.iter().any(|what| what == "block0k-20kPa-1ms: run 2 of 2"), "progress lines: {told:?}");

    assert_eq!(results.cases.len(), 2);
    for case in &results.cases {
        assert!(case.tetrahedra == 162 && case.nodes == 64 && case.largest_displacement > 0.0);
        let by_preconditioner: Vec<_> = case.runs.chunk_by(|a, b| a.preconditioner == b.preconditioner).collect();
        assert_eq!(by_preconditioner.len(), 2, "runs with two preconditioners are expected: {case:?}");
        for runs in by_preconditioner {
            let [loose, tight] = runs else { panic!("runs with two tolerances are expected: {runs:?}") };
            assert_eq!((loose.tolerance, tight.tolerance), (1e-1, 1e-6));
            // Single precision cannot guarantee a residual of 1e-6 on the stiff block with long steps.
            assert!(
                case.case.young > 2e4 || tight.flagged == 0,
                "a run with the tight tolerance has flagged steps: {tight:?}"
            );
            // The bound on the error covers the solver's tolerance and the rounding of f32 displacements.
            assert!(tight.error < 1e-5 && tight.error > 0.0 && tight.error < loose.error, "wrong errors: {runs:?}");
            assert!(
                tight.iterations.iter().zip(&loose.iterations).all(|(many, few)| many > few),
                "the tight tolerance needs no more iterations: {runs:?}"
            );
            assert!(tight.step_us.len() == 2 && tight.step_us.iter().all(|steps| steps.len() == 4));
        }
    }
    let [small, large] = &results.scaling[..] else { panic!("two sizes are expected: {:?}", results.scaling) };
    assert!((small.tetrahedra, large.tetrahedra) == (162, 750) && small.steps.len() == 2);
    assert_eq!(large.iterations[0].iterations, [32, 8]);
    assert!(large.iterations[0].bytes_device > 750 * 100 && large.iterations[0].short_us.len() == 2);

    assert!(page.matches("<figure>").count() == 2 && page.contains("1 ms at"), "report: {page}");
    let stiff = &json["block0k-2MPa-10ms"];
    assert_eq!((stiff["runs"][0]["step_us"][1].as_array().unwrap().len(), &stiff["young"]), (4, &2e6.into()));
}

#[test]
#[ignore = "long: 19 s"]
fn lasting_a_tiny_run_answers_every_question_of_the_loop() {
    let settings = haptics::Settings {
        dampings: vec![0.0],
        delays: vec![0.0, 20e-3],
        rates: vec![50.0],
        bisected: 0.5,
        walls: vec![2000.0],
        between_places: vec![Place::Cheek],
        between_moduli: vec![2e4],
        vertices: 4_000,
        cell: 0.04,
        jitter_seconds: 0.3,
        ..haptics::Settings::quick()
    };
    let (json, told, page) = measure(Box::new(Haptics(settings)));
    let results = haptics::Results::of(&json).unwrap();
    assert!(told.iter().any(|what| what == "slide: premium at 50 Hz"), "progress lines: {told:?}");

    let [width] = &results.widths[..] else { panic!("one damping is expected: {:?}", results.widths) };
    assert!(
        (width.profile.as_str(), width.damping, width.coupling) == ("premium", 0.0, 800.0) && width.local >= width.raw
    );
    let [prompt, late] = &results.delays[..] else { panic!("two delays are expected: {:?}", results.delays) };
    assert!(
        prompt.local > late.local && late.local > late.gil && prompt.delay == 0.0,
        "results without delay: {prompt:?}; with a delay of 20 ms: {late:?}"
    );
    let [slow] = &results.rates[..] else { panic!("one rate is expected: {:?}", results.rates) };
    // With a slow simulation the raw force oscillates at virtual walls at which the local model's force is steady.
    assert!(
        slow.rate == 50.0 && slow.local > 10.0 * slow.raw,
        "the local model must allow much stiffer walls than the raw force: {slow:?}"
    );

    use haptics::{Met, Mode};
    assert_eq!(results.holds.len(), 2 * Mode::ALL.len());
    let held = |met: Met, mode: Mode| results.holds.iter().find(|held| held.met == met && held.mode == mode).unwrap();
    let wall = held(Met::Wall(2000.0), Mode::Local);
    assert!(
        haptics::is_still(&wall.force) && wall.reading.swing <= 2e-5 && wall.force.mean > 0.5,
        "the position or the force of this hold is not steady, or the force is too small: {wall:?}"
    );
    assert!(
        !haptics::is_still(&held(Met::Wall(2000.0), Mode::Raw).force),
        "the raw force at the wall must not be steady: {:?}",
        results.holds
    );
    assert!(
        held(Met::Head, Mode::Local).force.mean > 0.1,
        "the force at the soft head is too small: {:?}",
        results.holds
    );
    for slid in &results.slides {
        assert!(
            slid.rate == 50.0 && slid.slide.raw.newtons > 0.0 && slid.slide.contact.newtons > 0.0,
            "wrong rate, or no change of force: {slid:?}"
        );
        assert_eq!(slid.trace.len(), 120);
    }
    let [reference, own, raw] = &results.between[..3] else { panic!("three presses are expected") };
    let [at_reference, at_own, at_raw] = [reference, own, raw].map(|run| run.difference[0]);
    assert!(
        at_reference == 0.0 && at_own < 0.05 && at_own < 0.5 * at_raw && own.prediction_error.unwrap() < 0.2,
        "the loop must know the force between steps: {reference:?}, {own:?}, {raw:?}"
    );
    let [idle, loaded] = &results.jitter[..] else { panic!("idle and loaded runs are expected: {:?}", results.jitter) };
    assert!(loaded.is_loaded && !idle.is_loaded && loaded.servo.ticks > 0 && loaded.steps > 0);

    assert_eq!(page.matches("<figure>").count(), 7, "report: {page}");
    assert_eq!((&json["hold"][0]["met"]["wall"], &json["hold"][2]["mode"]), (&2000.0.into(), &"raw".into()));
}

#[test]
#[ignore = "long: 19 s"]
fn lasting_a_tiny_run_answers_every_question_of_the_papers_scenes() {
    let folder = tempfile::tempdir().unwrap();
    // Each of the paper's five scenes is replaced by the same small scene, under the name of the scene that it
    // replaces.
    for told in paper::SCENES {
        let scene =
            include_str!("../../../assets/scenes/touch-head.toml").replace("44000", "4000").replace("0.018", "0.04");
        std::fs::write(folder.path().join(format!("{}.toml", told.name)), scene.replace("0.092", "0.084")).unwrap();
    }
    let settings = paper::Settings {
        scenes: folder.path().into(),
        steps: 8,
        radii: vec![0.005, 0.02],
        vertices: vec![4e3, 8e3],
        cells: vec![0.06, 0.04],
        bodies: vec![1.0, 2.0],
        growth_steps: 1,
        ..paper::Settings::quick()
    };
    let (json, told, page) = measure(Box::new(Paper(settings.clone())));
    assert!(told.iter().any(|what| what == "bodies: 2"), "progress lines: {told:?}");
    let results = paper::Results::of(&json).unwrap();
    assert_eq!(results.scenes.len(), 5);
    for ran in &results.scenes {
        let paper::Times { touching, query_us, step_us, stages_us, areas, .. } = &ran.times;
        assert!(
            ran.vertices == 4000 && ran.tetrahedra > 100 && *touching > 3 && areas[0] > 1e-6,
            "wrong size or too little contact: {ran:?}"
        );
        assert!(
            query_us.len() + step_us.len() + stages_us["solve"].len() == *touching,
            "wrong numbers of timed steps: {ran:?}"
        );
        // Different steps give the two, so that on a busy machine either median of a few may be the greater.
        assert!(ran.times.query_ms() > 0.0 && ran.times.step_ms() > 0.0);
    }
    for (by, rows) in &results.growth {
        let [small, large] = &rows[..] else { panic!("two sizes are expected: {rows:?}") };
        assert!(small.times.contacts() > 0.0 && large.times.contacts() > 0.0, "scenes that grow by {by:?}: {rows:?}");
        let is_larger = match by {
            paper::By::Area => small.times.area() < large.times.area(),
            paper::By::Skin => 2 * small.vertices == large.vertices,
            paper::By::Layer => small.tetrahedra < large.tetrahedra,
            paper::By::Bodies => 2.0 * small.times.contacts() == large.times.contacts(),
        };
        assert!(is_larger, "scenes that grow by {by:?}: {rows:?}");
    }
    assert_eq!(page.matches("<figure>").count(), 5, "report: {page}");
    let nowhere = paper::Settings { scenes: "no such folder".into(), ..settings };
    let error = Paper(nowhere).measure("gears", &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("no such folder/gears.toml") && error.contains("--scenes"), "wrong error: {error}");
}

fn palpate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).output().unwrap()
}

#[test]
fn two_shards_joined_give_the_report_of_the_whole_and_every_part_is_in_one() {
    let folder = tempfile::tempdir().unwrap();
    let dir = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let ok = |arguments: &[&str]| {
        let done = palpate(arguments);
        assert!(done.status.success(), "error: {}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8(done.stdout).unwrap()
    };
    // These three parts run on a simulated clock, and so give the same numbers in every run.
    let asked = ["bench", "haptics/damping", "haptics/delay", "haptics/rate", "--quick"];
    let with = |more: &[&str]| ok(&[&asked[..], more].concat());
    assert_eq!(with(&["--list"]), "haptics/damping\nhaptics/delay\nhaptics/rate\n");
    let whole = with(&["--out", &dir("whole")]);
    let first = with(&["--shard", "1/2", "--out", &dir("1")]);
    assert!(first.contains("not merged yet: delay"), "the program printed: {first}");
    with(&["--shard", "2/2", "--out", &dir("2")]);
    assert_eq!(ok(&["bench", "--merge", &dir("2"), &dir("1"), "--out", &dir("both")]), whole);
    let read = |name: &str, file: &str| std::fs::read_to_string(folder.path().join(name).join(file)).unwrap();
    assert_eq!(read("both", "report.html"), read("whole", "report.html"));
    let results = |name: &str| {
        let mut value: Value = serde_json::from_str(&read(name, "results.json")).unwrap();
        // The measured speed of the machine differs from run to run.
        value["benchmarks"]["haptics"].as_object_mut().unwrap().remove("gauges").unwrap();
        value
    };
    assert_eq!(results("both"), results("whole"));
    let twice = palpate(&["bench", "--merge", &dir("1"), &dir("1")]);
    assert!(twice.status.code() == Some(2) && String::from_utf8_lossy(&twice.stderr).contains("`damping`"));
}

#[test]
fn what_is_slower_than_before_ends_with_status_4() {
    let folder = tempfile::tempdir().unwrap();
    let dir = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let arguments = ["bench", "proximity/peers", "--quick", "--out", &dir("new")];
    assert!(palpate(&arguments).status.success());
    let same = palpate(&["bench", "--merge", &dir("new"), "--compare", &dir("new")]);
    assert!(same.status.success(), "error: {}", String::from_utf8_lossy(&same.stderr));
    assert!(String::from_utf8_lossy(&same.stdout).contains("0 of"));
    // These old results say that the contact stage took a hundredth of the time that it took in the new results.
    let file = folder.path().join("new/results.json");
    let mut json: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let contact = &mut json["benchmarks"]["proximity"]["parts"]["peers"]["samples_us"]["contact"];
    contact.as_array_mut().unwrap().iter_mut().for_each(|us| *us = (0.01 * us.as_f64().unwrap()).into());
    let old = folder.path().join("old.json");
    std::fs::write(&old, json.to_string()).unwrap();
    let slower = palpate(&["bench", "--merge", &dir("new"), "--compare", old.to_str().unwrap()]);
    let text = String::from_utf8_lossy(&slower.stdout);
    assert!(slower.status.code() == Some(4) && text.contains("samples_us/contact"), "report: {text}");
    assert!(text.contains(" slower |") && text.contains("1 of"), "report: {text}");
}

#[test]
fn what_is_not_there_is_refused_before_anything_is_measured() {
    for (arguments, mistake, remedy) in [
        (&["bench", "speed", "--quick"][..], "speed", "proximity"),
        (&["bench", "solver/ball"], "solver/ball", "--list"),
        (&["bench", "--shard", "3/2"], "3/2", "1/4"),
        (&["bench", "solver", "--compare", "no-such.json"], "no-such.json", "results.json"),
        (&["bench", "--merge", "no-such-folder"], "no-such-folder", "results.json"),
    ] {
        let run = palpate(arguments);
        let error = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(2), "wrong error: {error}");
        assert!(error.contains(mistake) && error.contains(remedy) && error.lines().count() == 1, "error: {error}");
    }
}
