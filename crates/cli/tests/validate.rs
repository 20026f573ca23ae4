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

#[test]
#[ignore = "long: 120 s"]
fn a_fault_in_each_law_turns_a_case_red() {
    let forces = "elastic/element_forces";
    let [law, stiffer, stiff] =
        ["", "1.01 * ", "1.05 * "].map(|by| format!("linear_stress(e, {by}material.mu, lambda)"));
    let (law, stiffer, stiff) = (law.as_str(), stiffer.as_str(), stiff.as_str());
    let faults = [
        // The corotational law: shear modulus; Lamé's first parameter.
        (forces, law, stiffer, "patch"),
        (forces, law, "linear_stress(e, material.mu, 1.01 * lambda)", "patch"),
        (forces, law, stiffer, "sofa-cantilever"),
        (forces, law, stiff, "cook"),
        (forces, law, stiff, "csm1"),
        (forces, law, stiff, "csm2"),
        (forces, law, stiff, "csm3"),
        (forces, law, stiff, "elastica"),
        (forces, law, stiff, "impact"),
        // The neo-Hookean law: shear modulus, and the resistance to a change of volume.
        (forces, "law.stress = mu * (e +", "law.stress = 1.01 * mu * (e +", "patch"),
        (forces, "+ (l * larger) * all_cofactors", "+ (1.01 * l * larger) * all_cofactors", "patch"),
        (forces, "law.stress = mu * (e +", "law.stress = 1.1 * mu * (e +", "sofa-neo-hookean"),
        // The energy density that is shown.
        (
            "draw/energy",
            "density = material.mu * square(even)",
            "density = 1.01 * material.mu * square(even)",
            "energy",
        ),
        // Weight.
        ("solve/assemble", "h * (rest.w * params.gravity -", "h * (1.01 * rest.w * params.gravity -", "hanging"),
        // Loads: tractions; pressure.
        ("elastic/loads", "uintBitsToFloat(entry.y) * force", "1.01 * uintBitsToFloat(entry.y) * force", "patch"),
        ("elastic/pressures", "vec4(-0.5 * pressure", "vec4(-0.515 * pressure", "le10"),
        // Contact: the force that is reported; the force that presses the body.
        ("wrench/reduce", "float force = contact.area", "float force = 1.05 * contact.area", "indentation"),
        (
            "solve/assemble",
            "return h * contact.area * contact.stiffness * contact.depth",
            "return 0.93 * h * contact.area * contact.stiffness * contact.depth",
            "indentation",
        ),
        // Friction.
        ("contact/response", "predicted, params.friction,", "predicted, 1.01 * params.friction,", "friction"),
        ("contact/response", "predicted, params.friction,", "predicted, 1.01 * params.friction,", "slope"),
    ];
    for (kernel, from, to, case) in faults {
        let results = run(&[case], vec![(kernel.into(), spoil::spoiled(kernel, from, to))]);
        println!("{kernel} with `{to}`: {}", results.faults().join("; "));
        assert!(!results.faults().is_empty(), "{kernel} with `{to}`: {case} does not notice it");
    }
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
