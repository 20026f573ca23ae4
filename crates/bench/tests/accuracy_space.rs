//! Tests of the curves of `palpate bench accuracy` about resolution in space, on small bodies: the errors of each must
//! stay within its bound and show the expected trend. Times are not judged.

use palpate_bench::accuracy::{self, Curve, Settings};

fn measure(name: &str) -> Curve {
    let settings = Settings { device: std::env::var("PALPATE_TEST_DEVICE").ok(), ..Settings::quick() };
    let curve = accuracy::measure(name, &settings, &mut |_| ()).unwrap();
    assert!(curve.name == name && curve.points.len() >= 6, "curve: {curve:?}");
    assert!(curve.points.iter().all(|point| point.step_ms() > 0.0), "curve: {curve:?}");
    let text = accuracy::section(&curve).unwrap();
    assert!(!text.finding.contains("why is not known"), "finding of `{name}`: {}", text.finding);
    println!("finding of `{name}`: {}", text.finding);
    assert!(text.plot.is_some() && curve.is_within(), "finding: {}", text.finding);
    curve
}

fn errors(curve: &Curve, line: usize) -> Vec<f64> {
    curve.lines()[line].points.iter().map(|point| point.error().unwrap()).collect()
}

#[test]
#[ignore = "long: 59 s"]
fn finer_layers_and_stiffer_contact_are_more_accurate() {
    let layer = measure("layer");
    for line in 0..layer.lines().len() {
        let all = errors(&layer, line);
        assert!(all[0] > 1.5 * all[5], "errors from the coarsest layer to the finest: {all:?}");
    }
    let stiffness = measure("stiffness");
    let all = errors(&stiffness, 0);
    assert!(
        all[0] > 0.5 && all.windows(2).all(|w| w[1] < w[0]),
        "errors from the softest contact to the stiffest: {all:?}"
    );
}

#[test]
#[ignore = "long: 1 min"]
fn neither_skins_nor_sides_nor_proxies_change_the_force_much() {
    for name in ["skin", "sides"] {
        let curve = measure(name);
        assert_eq!(curve.lines().len(), 2);
        (0..2).for_each(|line| assert!(errors(&curve, line).iter().all(|error| *error < 0.5), "curve: {curve:?}"));
    }
    measure("proxies");
}

#[test]
#[ignore = "long: 12 s"]
fn texels_and_paths_do_not_change_a_bit_and_sampled_depths_would() {
    let curve = measure("texel");
    let is_sampled = |setting: &str| setting.starts_with("at centres");
    let (sampled, own): (Vec<_>, Vec<_>) = curve.points.iter().partition(|point| is_sampled(&point.setting));
    assert!(own.len() >= 6 && own.iter().all(|point| point.error() == Some(0.0)), "points of the engine: {own:?}");
    assert!(
        sampled.len() >= 6 && sampled[0].error() > sampled[6].error(),
        "curve of depths sampled at centres of texels: {sampled:?}"
    );
    assert!(
        curve.span_reason.contains(" 0 differ in a bit"),
        "reason given for a curve that spans few powers of ten: {}",
        curve.span_reason
    );
}
