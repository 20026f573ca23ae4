//! Tests of `palpate validate`, which computes values that others published: some cases reproduce theirs, a fault
//! planted in each law (in a kernel, a GPU program) turns a case red, and bad input is refused.

#[path = "../../../vk-tests/harness/spoil.rs"]
mod spoil;

use std::process::Command;

use palpate_bench::validation::{self, Results, Settings, document};

/// Runs cases in the quick form. Each kernel named in `replaced` is replaced by the SPIR-V that is given with its name.
fn run(only: &[&str], replaced: Vec<(String, Vec<u8>)>) -> Results {
    let settings = Settings {
        is_quick: true,
        only: only.iter().map(|name| name.to_string()).collect(),
        device: std::env::var("PALPATE_TEST_DEVICE").ok(),
        replaced,
    };
    validation::run(&settings, &mut |_| ()).unwrap()
}

#[test]
fn some_cases_reproduce_their_values_and_the_report_shows_them() {
    let results = run(&["patch", "energy", "cook", "sofa-cantilever"], vec![]);
    assert_eq!(results.faults(), [""; 0]);
    let names: Vec<&str> = results.cases.iter().map(|case| case.case.name).collect();
    assert_eq!(names, ["patch", "energy", "cook", "sofa-cantilever"]);
    let document = document(&results).unwrap();
    let html = document.html();
    assert!(html.contains("MacNeal") && html.contains("23.96") && html.contains("<svg"), "the report lacks something");
    assert!(document.markdown().contains("All 10 published values are reproduced."));
    let json = serde_json::to_value(&results).unwrap();
    assert_eq!(json["cases"][2]["quantities"][0]["quantity"]["published"], 23.96);
    assert_eq!(json["cases"][2]["quantities"][0]["quantity"]["levels"].as_array().unwrap().len(), 3);
}

/// A kernel, a text in it that is replaced by another, and the case that must notice it.
type Fault<'a> = (&'a str, &'a str, &'a str, &'a str);

const FORCES: &str = "elastic/element_forces";
const LAW: &str = "linear_stress(e, material.mu, lambda)";
/// The corotational law with a shear modulus that is 5 % too great.
const STIFF: &str = "linear_stress(e, 1.05 * material.mu, lambda)";

fn must_be_noticed(faults: &[Fault]) {
    for &(kernel, from, to, case) in faults {
        let results = run(&[case], vec![(kernel.into(), spoil::spoiled(kernel, from, to))]);
        println!("{kernel} with `{to}`: {}", results.faults().join("; "));
        assert!(!results.faults().is_empty(), "{kernel} with `{to}`: {case} does not notice it");
    }
}

#[test]
#[ignore = "long: 30 s"]
fn lasting_a_fault_in_each_law_turns_a_case_red() {
    must_be_noticed(&[
        // The corotational law: shear modulus; Lamé's first parameter.
        (FORCES, LAW, "linear_stress(e, 1.01 * material.mu, lambda)", "patch"),
        (FORCES, LAW, "linear_stress(e, material.mu, 1.01 * lambda)", "patch"),
        (FORCES, LAW, "linear_stress(e, 1.01 * material.mu, lambda)", "sofa-cantilever"),
        (FORCES, LAW, STIFF, "cook"),
        // The neo-Hookean law: shear modulus, and the resistance to a change of volume.
        (FORCES, "law.stress = mu * (e +", "law.stress = 1.01 * mu * (e +", "patch"),
        (FORCES, "+ (l * larger) * all_cofactors", "+ (1.01 * l * larger) * all_cofactors", "patch"),
        (FORCES, "law.stress = mu * (e +", "law.stress = 1.1 * mu * (e +", "sofa-neo-hookean"),
        // The energy density that is shown.
        (
            "draw/elements",
            "density = material.mu * square(even)",
            "density = 1.01 * material.mu * square(even)",
            "energy",
        ),
        // Weight.
        ("solve/assemble", "h * (rest.w * params.gravity -", "h * (1.01 * rest.w * params.gravity -", "hanging"),
        // Tractions.
        ("elastic/loads", "uintBitsToFloat(entry.y) * force", "1.01 * uintBitsToFloat(entry.y) * force", "patch"),
        // The contact force that is reported.
        ("wrench/reduce", "float force = contact.area", "float force = 1.05 * contact.area", "indentation"),
        // Friction.
        ("contact/response", "predicted, params.friction,", "predicted, 1.01 * params.friction,", "friction"),
    ]);
}

#[test]
#[ignore = "long: 90 s"]
fn lasting_a_fault_turns_every_other_case_red() {
    must_be_noticed(&[
        (FORCES, LAW, STIFF, "csm1"),
        (FORCES, LAW, STIFF, "csm2"),
        (FORCES, LAW, STIFF, "csm3"),
        (FORCES, LAW, STIFF, "elastica"),
        (FORCES, LAW, STIFF, "impact"),
        ("elastic/pressures", "vec4(-0.5 * pressure", "vec4(-0.515 * pressure", "le10"),
        // The contact force that presses the body.
        (
            "solve/assemble",
            "return h * contact.area * contact.stiffness * contact.depth",
            "return 0.93 * h * contact.area * contact.stiffness * contact.depth",
            "indentation",
        ),
        ("contact/response", "predicted, params.friction,", "predicted, 1.01 * params.friction,", "slope"),
    ]);
}

#[test]
fn a_name_that_is_no_case_is_refused_with_those_there_are_and_the_list_names_sources() {
    let palpate = |arguments: &[&str]| Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).output().unwrap();
    let output = palpate(&["validate", "--only", "patch,patches"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "wrong error: {message}");
    assert!(message.contains("patches") && message.contains("csm1") && message.lines().count() == 1, "{message}");
    let output = palpate(&["validate", "--list", "--only", "csm1,le10"]);
    let list = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && list.lines().count() == 2, "wrong list: {list}");
    assert!(list.contains("Turek") && list.contains("NAFEMS"), "wrong list: {list}");
}
