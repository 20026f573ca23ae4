//! Tests of the curves of `palpate bench accuracy` about resolution in space, on small bodies. A curve has a point for
//! each value of a quantity that is varied: the error of the force on a tool that presses on a body, and the time of a
//! step. The errors of each curve must stay within its bound and show the expected trend; times are not judged. The
//! finding of a curve is the text of the report that says what it shows. The varied quantities are the cells of the
//! layer (tetrahedral mesh) of a body, the contact stiffness, the vertices of the skins (surface meshes), with contacts
//! at the vertices of both skins or of one (the sides), the collision proxies (convex hulls), and the texels (cells of
//! the grid of the depth stage, which finds how deep bodies overlap), with each implementation (path) of that stage.

use palpate_bench::accuracy::{self, Curve, Settings};

fn measure(name: &str) -> Curve {
    let settings = Settings { device: std::env::var("PALPATE_TEST_DEVICE").ok(), ..Settings::quick() };
    let curve = accuracy::measure(name, &settings, &mut |_| ()).unwrap();
    assert!(curve.name == name && curve.points.len() >= 6, "the curve `{name}` must have 6 points or more: {curve:?}");
    assert!(
        curve.points.iter().all(|point| point.step_ms() > 0.0),
        "each point of the curve must have a time above 0 ms: {curve:?}"
    );
    let text = accuracy::section(&curve, None).unwrap();
    assert!(!text.finding.contains("why is not known"), "the finding of `{name}` lacks a reason: {}", text.finding);
    println!("finding of the curve `{name}`: {}", text.finding);
    assert!(
        text.plot.is_some() && curve.is_within(),
        "the curve `{name}` has no plot, or errors above its bound: {}",
        text.finding
    );
    curve
}

fn errors(curve: &Curve, line: usize) -> Vec<f64> {
    curve.lines()[line].points.iter().map(|point| point.error().unwrap()).collect()
}

#[test]
#[ignore = "long: 59 s"]
fn lasting_finer_layers_and_stiffer_contact_are_more_accurate() {
    let layer = measure("layer");
    for line in 0..layer.lines().len() {
        let all = errors(&layer, line);
        assert!(
            all[0] > 1.5 * all[5],
            "the error must fall by a third or more from the coarsest layer to the finest: {all:?}"
        );
    }
    let stiffness = measure("stiffness");
    let all = errors(&stiffness, 0);
    assert!(
        all[0] > 0.5 && all.windows(2).all(|w| w[1] < w[0]),
        "the errors must fall, from more than 0.5, from the softest contact to the stiffest: {all:?}"
    );
}

#[test]
#[ignore = "long: 1 min"]
fn lasting_neither_skins_nor_sides_nor_proxies_change_the_force_much() {
    for name in ["skin", "sides"] {
        let curve = measure(name);
        assert_eq!(curve.lines().len(), 2);
        // Each error of the force, relative to the force of the curve's reference, must be below 0.5.
        (0..2).for_each(|line| assert!(errors(&curve, line).iter().all(|error| *error < 0.5), "inaccurate: {curve:?}"));
    }
    measure("proxies");
}

#[test]
#[ignore = "long: 12 s"]
fn texels_and_paths_do_not_change_a_bit_and_sampled_depths_would() {
    let curve = measure("texel");
    // For comparison the curve also has points whose depths are sampled on the CPU, at the centres of texels; all other
    // points are the engine's.
    let is_sampled = |setting: &str| setting.starts_with("at centres");
    let (sampled, own): (Vec<_>, Vec<_>) = curve.points.iter().partition(|point| is_sampled(&point.setting));
    assert!(
        own.len() >= 6 && own.iter().all(|point| point.error() == Some(0.0)),
        "the engine's points must have no error: {own:?}"
    );
    assert!(
        sampled.len() >= 6 && sampled[0].error() > sampled[sampled.len() - 1].error(),
        "depths sampled at centres of texels must be less exact with large texels: {sampled:?}"
    );
    assert!(
        curve.span_reason.contains(" 0 differ in a bit"),
        "the reason for the span of the errors must say that no force differs in a bit: {}",
        curve.span_reason
    );
}
