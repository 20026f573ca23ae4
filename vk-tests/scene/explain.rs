//! Tests of `Simulation::explain`, which reports the passes (dispatches, draws, fills and copies on the GPU) and the
//! arrays of a step, by stage, and the features that the scene uses. Every kernel must be listed as recorded, or as
//! left out with a reason, and features that a scene does not use must cost nothing.

use std::collections::BTreeSet;

use palpate::internal::gpu::shader_names;
use palpate::internal::plan::Explanation;
use palpate::{Scene, Simulation, StepReport, StepWork};

use crate::scene::whole_step::{open, run, scene};

/// Number of solver iterations for which passes are counted.
const ITERATIONS: u32 = 16;

/// Scene of a block with a fixed bottom. `contact` is text before the body, `material` and `body` are further keys of
/// the block's material and of its table `[[body]]`, and `rest` is text of further tables.
fn block(contact: &str, material: &str, body: &str, rest: &str) -> String {
    format!(
        "{contact}\n[[body]]\nname = \"block\"\n{body}\n\
         layer = {{ box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [4, 3, 4] }}\n\
         material = {{ young = 2e4, poisson = 0.45, density = 1000.0{material} }}\n\
         [[body.core]]\nname = \"bottom\"\nmotion = \"fixed\"\n\
         bind = {{ box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }}\n{rest}\n"
    )
}

const TOOL: &str = "[tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.0499, 0.0]\n\
                    [coupling]\nstiffness = 500.0\ndamping = 2.0\n";
/// Text of a bar with a dynamic rigid core (a rigid body inside the bar, to which nodes are attached) at either end.
const BAR: &str = "[[body]]\nname = \"bar\"\nlayer = { box = [[0.2, 0.0, 0.0], [0.4, 0.02, 0.02]], cells = [10, 1, 1] }\n\
                   material = { young = 2e6, poisson = 0.3, density = 1000.0 }\n\
                   [[body.core]]\nname = \"left\"\nmotion = \"dynamic\"\nbind = { box = [[0.1, -1, -1], [0.245, 1, 1]] }\n\
                   [[body.core]]\nname = \"right\"\nmotion = \"dynamic\"\nbind = { box = [[0.355, -1, -1], [1, 1, 1]] }\n";

/// Upper bound, in bytes, of the memory of all arrays with one element together; such arrays stand in for arrays that
/// are empty in a scene.
const LITTLE: u64 = 1024;

/// Checks that every kernel is listed once, either recorded or left out with a reason, and that the numbers of passes
/// agree with those of the recorded step. Returns the explanation.
fn check(name: &str, simulation: &Simulation) -> Explanation {
    let explanation = simulation.explain(ITERATIONS);
    let (mut all, mut recorded) = (Vec::new(), 0);
    for stage in &explanation.stages {
        assert!(!stage.reason.is_empty(), "{name}: stage {} has no reason", stage.stage);
        for kernel in &stage.kernels {
            assert_eq!(
                kernel.recorded,
                kernel.reason.is_empty(),
                "{name}: kernel with a reason though recorded, or left out without one: {kernel:?} of stage {}",
                stage.stage
            );
            assert!(stage.recorded || !kernel.recorded, "{name}: recorded {kernel:?} in a stage that is left out");
            recorded += usize::from(kernel.recorded);
            // Fills and copies are listed by the arrays that they write; only kernels have a `/` in their name.
            all.extend(kernel.kernel.split(", ").filter(|name| name.contains('/')).map(str::to_string));
        }
        assert_eq!(
            stage.recorded,
            stage.passes > 0,
            "{name}: a stage must be recorded exactly if it has passes; stage {}",
            stage.stage
        );
    }
    let known: BTreeSet<String> = shader_names()
        .filter(|n| !n.starts_with("test/") && !n.starts_with("draw/") && !n.starts_with("view/"))
        .map(Into::into)
        .collect();
    assert_eq!(
        all.iter().cloned().collect::<BTreeSet<_>>(),
        known,
        "{name}: the kernels listed (left) must be all kernels of the engine (right)"
    );
    assert_eq!(
        all.len(),
        known.len(),
        "{name}: a kernel is listed twice: entries in the list (left), different kernels (right)"
    );
    let (stages, dependent) = simulation.passes(ITERATIONS);
    assert_eq!(
        explanation.passes,
        stages.iter().map(|(_, n)| n).sum::<u32>(),
        "{name}: number of passes in the explanation (left) and in the recorded step (right)"
    );
    assert_eq!(explanation.dependent_passes, dependent, "{name}: number of passes that wait for an earlier pass");
    for (stage, passes) in stages {
        let own = explanation.stages.iter().find(|known| known.stage == stage).unwrap();
        assert_eq!(own.passes, passes, "{name}: number of passes of stage {stage}");
    }
    // No memory may go to arrays that no pass binds, apart from arrays of one element. Memory is allocated in pieces
    // that are slightly larger than the bound arrays.
    let arrays: u64 = explanation.stages.iter().map(|stage| stage.bytes_device).sum();
    let share = arrays as f64 / explanation.bytes_device as f64;
    println!(
        "{name}: {recorded} kernels recorded, {} in all; ratio of bytes in bound arrays to allocated bytes {share:.4}",
        known.len()
    );
    let is_little = explanation.bytes_device - arrays.min(explanation.bytes_device) < LITTLE;
    assert!(
        arrays <= explanation.bytes_device && (share > 0.8 || is_little),
        "{name}: ratio of bytes in bound arrays to allocated bytes {share}"
    );
    assert!(explanation.features.iter().all(|feature| !feature.reason.is_empty()), "{name}: a feature has no reason");
    assert!(explanation.to_string().lines().count() > known.len());
    explanation
}

#[test]
#[ignore = "long: 12 s"]
fn every_kernel_of_made_scenes_is_recorded_or_left_out_for_a_reason() {
    let joined = format!("{BAR}[[body.joint]]\ncores = [\"left\", \"right\"]\npoint = [0.3, 0.01, 0.01]\n");
    let probe = "[[probe]]\nname = \"top\"\nbody = \"block\"\nnearest = [0.0, 0.03, 0.0]\n";
    let bound = "[[body]]\nname = \"block\"\nlayer = { box = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]], cells = [8, 8, 8] }\n\
                 material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
                 [[body.core]]\nname = \"core\"\nmotion = \"dynamic\"\nbind = { all = true }\n";
    let load =
        |what: &str| format!("[[body.load]]\nname = \"l\"\n{what}\nbind = {{ box = [[-1, 0.029, -1], [1, 1, 1]] }}\n");
    let supported = block(
        "",
        "",
        "",
        "[[body.support]]\nname = \"side\"\nplane = [1, 0, 0]\n\
                                       bind = { box = [[-1, -1, -1], [-0.0499, 1, 1]] }\n",
    );
    let floor = "[[body]]\nname = \"floor\"\nplane = [0.0, 1.0, 0.0, -0.05]\n";
    for (name, text) in [
        ("a block alone", block("", "", "", "")),
        ("a block that is touched", block("", "", "", TOOL)),
        ("one body's vertices tested, friction", block("[contact]\nfriction = 0.3\nsides = \"one\"", "", "", TOOL)),
        ("patches, three Newton iterations", block("[step]\nnewton = 3", "", "dilatation = \"patch\"", TOOL)),
        ("neo-Hookean with a probe", block("", ", law = \"neo-hookean\"", "", probe)),
        ("a coarse space", block("[solver]\npreconditioner = \"coarse\"", "", "", TOOL)),
        ("a matrix-free operator", block("[solver]\noperator = \"matrix-free\"", "", "", TOOL)),
        ("nothing deforms", bound.into()),
        ("joined cores", joined),
        ("half-space", format!("{BAR}{floor}")),
        ("supports", supported.clone()),
        ("a load on nodes", block("", "", "", &load("force = [0, 1, 0]"))),
        ("pressure", block("", "", "", &load("pressure = 10.0"))),
        ("supports, a coarse space", format!("[solver]\npreconditioner = \"coarse\"\n{supported}")),
        ("a tool alone", TOOL.into()),
    ] {
        check(name, &open(&scene(&text), None));
    }
    // The stage that finds penetration depths has two implementations, called paths.
    let block = scene(&block("", "", "", TOOL));
    for path in [palpate::internal::stages::depth::Path::Graphics, palpate::internal::stages::depth::Path::Compute] {
        check(path.name(), &open(&block, Some(path)));
    }
}

#[test]
#[ignore = "long: 14 s"]
fn every_kernel_of_the_scenes_in_assets_is_recorded_or_left_out_for_a_reason() {
    for entry in std::fs::read_dir("assets/scenes").unwrap() {
        let file = entry.unwrap().path();
        let scene = Scene::load(&file).unwrap();
        check(&scene.name(), &open(&scene, None));
    }
}

/// All that a step costs: its passes in order with their numbers, its arrays, and the bytes allocated on the GPU.
fn cost(text: &str) -> (Explanation, u64) {
    let simulation = open(&scene(text), None);
    let mut explanation = check("cost", &simulation);
    // Texts for readers may differ between two scenes whose steps cost the same.
    explanation.features.clear();
    explanation.scene.clear();
    explanation.stages.iter_mut().for_each(|stage| stage.reason.clear());
    let bytes = simulation.context().bytes_allocated();
    (explanation, bytes)
}

#[test]
#[ignore = "long: 34 s"]
fn lasting_a_feature_that_is_not_used_costs_nothing() {
    let plain = || block("", "", "", TOOL);
    let contact = |keys: &str| block(&format!("[contact]\n{keys}"), "", "", TOOL);
    let joined = format!("{BAR}[[body.joint]]\ncores = [\"left\", \"right\"]\npoint = [0.3, 0.01, 0.01]\n");
    // Patches do without the assembled operator, which takes more memory than they do.
    let matrix_free = |keys: &str| block("[solver]\noperator = \"matrix-free\"", "", keys, TOOL);
    let probe = "[[probe]]\nname = \"top\"\nbody = \"block\"\nnearest = [0.0, 0.03, 0.0]\n";
    let cases = [
        // Each case: name, and the scene without the feature's keys, with the feature switched off, and with it used.
        // The feature "second side" tests the vertices of both bodies of a pair for contact, and not those of one only.
        ("friction", plain(), contact("friction = 0.0"), contact("friction = 0.3")),
        ("second side", contact("sides = \"one\""), contact("sides = \"one\""), contact("sides = \"both\"")),
        (
            "damping",
            plain(),
            block("", ", damping_mass = 0.0, damping_stiffness = 0.0", "", TOOL),
            block("", ", damping_mass = 1.0, damping_stiffness = 0.001", "", TOOL),
        ),
        ("Newton", plain(), block("[step]\nnewton = 1", "", "", TOOL), block("[step]\nnewton = 2", "", "", TOOL)),
        (
            "coarse space",
            plain(),
            block("[solver]\npreconditioner = \"jacobi\"", "", "", TOOL),
            block("[solver]\npreconditioner = \"coarse\"", "", "", TOOL),
        ),
        ("patches", matrix_free(""), matrix_free("dilatation = \"element\""), matrix_free("dilatation = \"patch\"")),
        (
            "neo-Hookean",
            plain(),
            block("", ", law = \"corotational\"", "", TOOL),
            block("", ", law = \"neo-hookean\"", "", TOOL),
        ),
        ("joints", BAR.into(), BAR.replace("name = \"bar\"", "name = \"bar\"\njoint = []"), joined),
        ("probes", plain(), format!("probe = []\n{}", plain()), format!("{}{probe}", plain())),
        (
            "preset",
            plain(),
            format!("preset = \"balanced\"\n{}", plain()),
            format!("preset = \"accurate\"\n{}", plain()),
        ),
    ];
    for (name, absent, off, used) in cases {
        let ((absent, absent_bytes), (mut off, off_bytes), (used, used_bytes)) =
            (cost(&absent), cost(&off), cost(&used));
        off.preset = None;
        assert_eq!(off, absent, "{name}: costs differ between the feature switched off and its keys left out");
        assert_eq!(off_bytes, absent_bytes, "{name}: bytes differ: feature switched off (left), keys left out (right)");
        println!(
            "{name}: {} passes and {} bytes with the feature switched off, {} passes and {} bytes with it used",
            off.passes, off_bytes, used.passes, used_bytes
        );
        assert!(
            used.passes >= off.passes && used_bytes >= off_bytes,
            "{name}: a scene that uses the feature costs less"
        );
    }
}

#[test]
fn times_that_nobody_asks_for_leave_the_step_as_it_is() {
    let text = block("", "", "", TOOL);
    let [mut timed, mut untimed] = [&text, &text].map(|text| open(&scene(text), None));
    timed.time_every(1).unwrap();
    untimed.time_every(0).unwrap();
    let forces = |simulation: &mut Simulation| -> Vec<_> {
        run(simulation, 5).iter().map(|row| row.tool.map(|tool| tool.force.to_array())).collect()
    };
    assert_eq!(forces(&mut timed), forces(&mut untimed));
    assert!(timed.stage_times().is_some() && untimed.stage_times().is_none());
    // Once timing is switched on again, times are reported again.
    untimed.time_every(1).unwrap();
    run(&mut untimed, 1);
    assert!(untimed.stage_times().is_some_and(|times| !times.is_empty()));
}

/// Where every pass is timed, the names are those of `--explain`, the numbers of passes are those that the step reports,
/// and the step computes the same.
#[test]
fn passes_are_timed_by_kernel_and_counted() {
    let text = block("", "", "", TOOL);
    let [mut plain, mut timed] = [&text, &text].map(|text| open(&scene(text), None));
    timed.time_passes().unwrap();
    let [plain_rows, rows] = [&mut plain, &mut timed].map(|simulation| run(simulation, 5));
    let forces = |rows: &[StepReport]| rows.iter().map(|row| row.tool.map(|tool| tool.force)).collect::<Vec<_>>();
    assert_eq!(forces(&plain_rows), forces(&rows));
    let explanation = timed.explain(ITERATIONS);
    let known: BTreeSet<&str> =
        explanation.stages.iter().flat_map(|stage| &stage.kernels).map(|kernel| kernel.kernel.as_str()).collect();
    let counts = timed.pass_counts();
    for (what, count) in counts {
        assert!(known.contains(what.as_str()), "--explain does not list {what}, which was timed");
        assert!(*count > 0, "{what} was timed without a pass");
    }
    let times = timed.stage_times().unwrap();
    assert!(times.iter().all(|(what, us)| *us > 0.0 && counts.iter().any(|(known, _)| known == what)));
    for (what, least) in [("elastic/element_forces", 5), ("solve/commit", 5), ("solve/gather", 10)] {
        let count = counts.iter().find(|(known, _)| known == what).map_or(0, |(_, count)| *count);
        assert!(count >= least, "{what} ran {count} times in 5 steps, {least} at least expected");
    }
    for (row, plain) in rows.iter().zip(&plain_rows) {
        let StepWork { solves, submits, planned_iterations, dependent_passes, gpu_us } = row.work;
        assert!(solves >= 1 && submits >= 1, "{:?}", row.work);
        assert!(planned_iterations >= row.iterations, "{:?} for {} iterations", row.work, row.iterations);
        assert_eq!(StepWork { gpu_us: None, ..row.work }, StepWork { gpu_us: None, ..plain.work });
        // An iteration has two passes at least.
        assert!(dependent_passes > 2 * planned_iterations, "{:?}", row.work);
        assert!(
            gpu_us.is_some_and(|us| us > 0.0 && us < row.step_us),
            "{:?} in a step of {} us",
            row.work,
            row.step_us
        );
    }
    let sum = times.iter().map(|(_, us)| us).sum::<f64>();
    let last = rows[rows.len() - 1].work.gpu_us.unwrap();
    assert!((sum / last - 1.0).abs() < 1e-9, "passes take {sum} us, the step {last} us on the device");
}

#[test]
fn one_side_takes_less_memory() {
    // If `sides` is "one", only vertices of the finer skin (surface mesh) of a pair of bodies are tested for contact;
    // touch.rs compares that case with a reference implementation.
    let of = |sides: &str| {
        let mut simulation = open(
            &scene(&block(&format!("[contact]\nsamples = \"vertices\"\nsides = \"{sides}\""), "", "", TOOL)),
            None,
        );
        let row = run(&mut simulation, 3).pop().unwrap();
        (simulation.context().bytes_allocated(), row.tool.unwrap().force.length(), row.flags.0)
    };
    let ((both, force, flags), (one, alone, flags_too)) = (of("both"), of("one"));
    println!("contact on both sides: {both} bytes, force {force:.5} N; on one side: {one} bytes, force {alone:.5} N");
    assert!(one < both && [force, alone].iter().all(|force| *force > 0.0) && [flags, flags_too] == [0, 0]);
}
