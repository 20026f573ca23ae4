//! Tests of `palpate bench accuracy` on tiny cases. A *curve* is the error and the cost of the engine for each value of
//! one setting; its *lines* are for different values of other settings. A *preset* is a named setting that is chosen
//! from the points of a curve. Curves agree with their references, a fault planted in a GPU kernel makes the report say
//! that errors are NOT within their bounds, and wrong names are refused. No times are judged.

#[path = "../../../vk-tests/harness/spoil.rs"]
mod spoil;

use palpate_bench::accuracy::{self, Curve, Settings};

/// Settings with blocks and heads so small that both engine and reference solve them quickly.
fn tiny() -> Settings {
    Settings {
        device: std::env::var("PALPATE_TEST_DEVICE").ok(),
        cells: [4, 3, 4],
        steps: 30,
        halvings: 5,
        vertices: 2_000,
        cell: 0.05,
        ..Settings::quick()
    }
}

fn measure(name: &str, settings: &Settings) -> Curve {
    let mut told = Vec::new();
    let curve = accuracy::measure(name, settings, &mut |what: &str| told.push(what.to_string())).unwrap();
    assert!(told.iter().all(|what| what.starts_with(&format!("{name}: "))) && !told.is_empty(), "progress: {told:?}");
    assert!(curve.name == name && curve.points.len() >= 6, "wrong name or too few points: {curve:?}");
    for point in &curve.points {
        assert!(point.step_us.len() == settings.rounds && point.step_ms() > 0.0, "a point lacks step times: {point:?}");
    }
    let text = accuracy::section(&curve, None).unwrap();
    assert!(text.plot.is_some() && !text.finding.is_empty() && text.table.rows.len() == curve.points.len());
    assert!(!text.notes.concat().contains("why is not known"), "notes of curve {name}: {:?}", text.notes);
    println!("curve {name}: finding: {}; notes: {:?}", text.finding, text.notes);
    curve
}

#[test]
#[ignore = "long: 22 s"]
fn lasting_tight_solves_are_the_references_and_loose_ones_are_not() {
    let curve = measure("tolerance", &tiny());
    assert!(curve.is_within(), "lines whose error is beyond its bound: {:?}", curve.beyond());
    // The quick settings have two stiffnesses, each solved with two preconditioners.
    let titles: Vec<String> = curve.lines().iter().map(|line| line.title()).collect();
    assert_eq!(titles, ["20 kPa, jacobi", "20 kPa, auto", "2 MPa, jacobi", "2 MPa, auto"]);
    assert!(curve.decades() > 2.0, "errors span only {} powers of ten", curve.decades());
    for line in curve.lines() {
        let [loose, .., tight] = &line.points[..] else { panic!("line with fewer than two points: {line:?}") };
        // Displacements tell them apart: the forces on the soft block differ little, since rounding leaves an error of
        // 6e-6 in those of its tight solves and its loosest leave 1.1e-5.
        let [loose_error, tight_error] = [loose, tight].map(|point| point.displacement_error.unwrap());
        assert!(loose_error > 10.0 * tight_error, "the tight tolerance gains too little: {line:?}");
        let is_stiff = line.title().starts_with("2 MPa");
        assert!(
            !is_stiff || loose.error().unwrap() > 10.0 * tight.error().unwrap(),
            "forces gain too little: {line:?}"
        );
        assert!(tight.iterations > loose.iterations && tight.flags.is_empty(), "wrong iterations or flags: {line:?}");
    }
    let curve = measure("iterations", &tiny());
    let [first, .., last] = &curve.lines()[1].points[..] else { panic!("a line has too few points: {curve:?}") };
    assert!(
        first.flags == ["not_converged"] && last.flags.is_empty() && curve.is_within(),
        "wrong flags or errors: {curve:?}"
    );
}

#[test]
#[ignore = "long: 18 s"]
fn lasting_shorter_steps_and_more_linearisations_are_more_accurate() {
    let curve = measure("time-step", &tiny());
    let errors: Vec<f64> = curve.points.iter().map(|point| point.error().unwrap()).collect();
    assert!(errors.len() == 6 && errors[0] > 5.0 * errors[5], "errors, longest time step first: {errors:?}");
    let curve = measure("newton", &tiny());
    assert!(curve.is_within() && curve.decades() > 2.0, "errors beyond bounds or too alike: {curve:?}");
    for line in curve.lines() {
        let (share, _) = line.share().unwrap();
        assert!(share > 0.02 && share < 0.5, "{}: a Newton iteration leaves {share} of the error", line.title());
    }
}

#[test]
#[ignore = "long: 16 s"]
fn lasting_single_precision_loses_little_of_the_force_wherever_it_is() {
    // With fewer steps a run would end before the sphere touches the block.
    let curve = measure("precision", &Settings { steps: 50, ..tiny() });
    assert!(curve.is_within() && curve.lines().len() == 2, "errors beyond bounds, or not 2 lines: {curve:?}");
    assert!(curve.points.iter().all(|point| point.error().is_some()), "a point of the curve has no error: {curve:?}");
}

#[test]
#[ignore = "long: 34 s"]
fn lasting_presets_are_settings_that_were_measured() {
    let curve = measure("presets", &tiny());
    assert_eq!(curve.lines().iter().map(|line| line.panel).collect::<std::collections::BTreeSet<_>>().len(), 2);
    for (name, below, setting) in accuracy::presets(&curve) {
        let Some(setting) = setting else { continue };
        assert!(
            setting.error().unwrap() < below && setting.points.len() == 2,
            "wrong error or points of preset {name}: {setting:?}"
        );
        for point in &setting.points {
            assert!(
                curve.points.contains(point) && point.flags.is_empty() && point.keys.len() == 4,
                "preset {name} has a point that is not on the curve, has flags, or has not 4 keys: {point:?}"
            );
        }
    }
}

#[test]
#[ignore = "long: 17 s"]
fn lasting_a_wrong_sign_in_a_kernel_turns_the_verdict_red() {
    // With this fault contact forces pull where they should push; the solver still converges.
    let bytes = spoil::spoiled("solve/assemble", "b -= f * n;", "b += f * n;");
    let curve = measure("tolerance", &Settings { replaced: vec![("solve/assemble".into(), bytes)], ..tiny() });
    let finding = accuracy::section(&curve, None).unwrap().finding;
    assert!(!curve.is_within() && finding.contains("NOT within"), "finding of the curve: {finding}");
}

#[test]
fn curves_of_no_such_name_are_refused() {
    let error = accuracy::measure("speed", &tiny(), &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("`speed`"), "wrong error: {error}");
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["bench", "accuracy/tolerance", "accuracy/speed"])
        .output()
        .unwrap();
    let error = String::from_utf8(run.stderr).unwrap();
    assert!(
        run.status.code() == Some(2) && error.contains("accuracy/speed") && error.lines().count() == 1,
        "wrong error: {error}"
    );
}
