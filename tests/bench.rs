//! `palpate bench proximity`: every question is answered, however small; what is written; bad input. No times are judged.

use std::path::PathBuf;
use std::process::Command;

use palpate::bench::proximity::{self, Outcome, Settings};

#[test]
fn a_tiny_run_answers_every_question() {
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
fn a_benchmark_of_no_such_name_is_refused() {
    let run = Command::new(env!("CARGO_BIN_EXE_palpate")).args(["bench", "speed"]).output().unwrap();
    let error = String::from_utf8(run.stderr).unwrap();
    assert_eq!(run.status.code(), Some(2), "{error}");
    assert!(error.contains("speed") && error.contains("proximity") && error.lines().count() == 1, "{error}");
}
