//! Tests of `palpate stability`, which simulates stiff and extreme cases along *axes* (each axis varies one parameter)
//! and checks each case against *invariants* (what every simulation must keep): some axes pass, a fault planted in a
//! kernel (GPU program) makes cases fail, and bad input is refused. Along an axis, a *cell* holds the cases with
//! one value of the parameter. The *verdict* on a case is `Pass` if all invariants hold and no step raised a flag
//! (a sign that something went wrong), and `Silent` if a step breaks an invariant without a flag that warns of it.

#[path = "../../../vk-tests/harness/spoil.rs"]
mod spoil;

use std::process::Command;

use palpate::Flags;
use palpate_bench::stability::invariants::{Invariant, Verdict};
use palpate_bench::stability::{self, Results, Settings, document};

/// Runs the axes `only` with few values and steps. Each kernel named in `replaced` is replaced by the SPIR-V that is
/// given with its name.
fn run(only: &[&str], replaced: Vec<(String, Vec<u8>)>) -> Results {
    let settings = Settings {
        is_quick: true,
        only: only.iter().map(|name| name.to_string()).collect(),
        device: std::env::var("PALPATE_TEST_DEVICE").ok(),
        replaced,
        ..Settings::default()
    };
    let mut told = 0;
    let results = stability::run(&settings, &mut |_| told += 1).unwrap();
    assert_eq!(told, results.cases().count());
    results
}

#[test]
fn a_part_of_the_matrix_passes_and_its_report_has_a_letter_for_every_cell() {
    let results = run(&["bound", "tetrahedron"], vec![]);
    assert_eq!(results.faults(), [""; 0]);
    assert!(results.cases().all(|(_, _, case)| case.verdict == Verdict::Pass && case.steps > 30));
    let names: Vec<&str> = results.axes.iter().map(|axis| axis.name.as_str()).collect();
    assert_eq!(names, ["tetrahedron", "bound"]);
    let document = document(&results);
    let svg = document.chapters[0].sections[0].plot.as_ref().unwrap();
    // The letter P (pass) is in six cells and in the legend.
    assert_eq!(svg.matches(">P</text>").count(), 7, "the plot as SVG: {svg}");
    let html = document.html();
    assert!(html.contains("all but one") && html.contains("<svg"));
    assert_eq!(serde_json::to_value(&results).unwrap()["axes"][1]["cells"][0]["cases"][0]["verdict"], "pass");
}

#[test]
fn turning_too_far_and_being_inside_out_are_told_in_the_steps_concerned() {
    let results = run(&["spin", "stretch"], vec![]);
    let flags = |label: &str| {
        let (.., case) = results.cases().find(|(_, cell, _)| cell.label == label).unwrap();
        println!("case {label}: {}", case.in_words());
        (Flags(case.flags), case.flagged, case.steps)
    };
    assert_eq!(flags("100 rad/s").0, Flags::default());
    // Implicit Euler slows the spin down, so that the last steps turn less far and raise no flag.
    let (told, flagged, steps) = flags("300 rad/s");
    assert!(
        told.contains(Flags::TURNS_TOO_FAR) && flagged > steps / 4 && flagged < steps,
        "the flags {told:?} were raised in {flagged} of all {steps} steps"
    );
    // A body that is let go inside out returns to its shape, so only the first steps raise the flag `INVERTED`.
    let (told, flagged, steps) = flags("turned inside out");
    assert!(
        told.contains(Flags::INVERTED) && flagged < steps / 2,
        "the flags {told:?} were raised in {flagged} of all {steps} steps"
    );
    assert!(results.cases().all(|(.., case)| case.verdict != Verdict::Silent), "faults: {:?}", results.faults());
}

#[test]
#[ignore = "long: 15 s"]
fn lasting_a_fault_in_a_kernel_turns_verdicts_red_by_the_invariant_that_it_breaks() {
    let made = "contacts[c] = Contact(n, found.w, arm, pair.tool_sign, found.x, rate, stiffness, damping";
    let faults = [
        // Fault: elastic forces accelerate the body away from its rest shape.
        (
            "elastic/element_forces",
            "float impulse = -params.dt",
            "float impulse = params.dt",
            "bound",
            Invariant::Residual,
        ),
        // Fault: mass-proportional damping accelerates instead of braking.
        ("solve/assemble", "- damping * v)", "+ damping * v)", "bound", Invariant::Residual),
        // Fault: the damping of contacts is left out of the right-hand side of the linear system.
        (
            "solve/assemble",
            "+ normal_operator(contact, h) * contact.rate",
            "+ h * h * contact.stiffness * contact.area * contact.rate",
            "contact-stiffness",
            Invariant::Residual,
        ),
        // Two faults: the reported wrench (force and torque) pulls where contacts push; the reported force is 20 % too
        // great.
        ("wrench/reduce", "-= force * column[k]", "+= force * column[k]", "contact-stiffness", Invariant::Force),
        (
            "wrench/reduce",
            "float force = contact.area",
            "float force = 1.2 * contact.area",
            "contact-stiffness",
            Invariant::Force,
        ),
        // Fault: the stiffness of contacts is 5 % greater than the scene says.
        (
            "contact/response",
            made,
            &made.replace("rate, stiffness", "rate, 1.05 * stiffness"),
            "contact-stiffness",
            Invariant::Force,
        ),
        // Fault: a contact is released (loses its stiffness) only if it pulls by more than a tenth of the pressure that
        // its depth causes.
        (
            "solve/contact_iteration",
            "if (end_pressure(contact, at_x, params.dt) < 0.0) {",
            "if (end_pressure(contact, at_x, params.dt) < -0.1 * contact.stiffness * contact.depth) {",
            "contact-stiffness",
            Invariant::Push,
        ),
        // Fault: a loose solver takes its warm start for the solution; the tight one that gives the right peak does not.
        (
            "solve/update",
            "if (is_small) return",
            "if (is_small || params.tolerance > 1e-4 && last.count == 0) return",
            "preset",
            Invariant::Peak,
        ),
        // Fault: elastic forces are 10 % too great, so that the loaded bar rests where they do not carry its weight.
        (
            "elastic/element_forces",
            "float impulse = -params.dt",
            "float impulse = -1.1 * params.dt",
            "newton",
            Invariant::Balanced,
        ),
    ];
    for (kernel, from, to, axis, invariant) in faults {
        let results = run(&[axis], vec![(kernel.into(), spoil::spoiled(kernel, from, to))]);
        let red = results.cases().filter(|(_, _, case)| case.verdict == Verdict::Silent);
        let breaks = |found: &&stability::invariants::Finding| found.invariant == invariant && found.is_silent;
        let seen = red.filter(|(.., case)| case.findings.iter().any(|found| breaks(&found))).count();
        println!(
            "{kernel} with `{to}`: invariant {invariant:?} is broken in {seen} cases; faults: {}",
            results.faults().join("; ")
        );
        assert!(
            seen > 0 && !results.faults().is_empty(),
            "{kernel} with `{to}`: no case breaks the invariant {invariant:?}; faults: {:?}",
            results.faults()
        );
    }
}

/// Where the solver's operator is far softer than the material, Newton iterations do not converge, and a flag says so.
#[test]
#[ignore = "long: 15 s"]
fn newton_iterations_that_do_not_converge_are_flagged() {
    let law = "Evaluation law = evaluate(material, e, compression, own_lambda);";
    let soft = format!("{law} law.mu *= 0.2; law.lambda *= 0.2;");
    let kernel = "elastic/element_forces";
    let results = run(&["newton"], vec![(kernel.into(), spoil::spoiled(kernel, law, &soft))]);
    for (_, cell, case) in results.cases() {
        let is_told = Flags(case.flags).contains(Flags::NEWTON_NOT_CONVERGED);
        println!("{} iterations: flags {:?}", cell.label, Flags(case.flags));
        assert_eq!(is_told, cell.label != "1", "{} iterations: flags {:?}", cell.label, Flags(case.flags));
    }
}

#[test]
fn a_name_that_is_no_axis_is_refused_with_those_there_are() {
    let output =
        Command::new(env!("CARGO_BIN_EXE_palpate")).args(["stability", "--only", "young,poison"]).output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "wrong error: {message}");
    assert!(
        message.contains("poison") && message.contains("poisson-neo-hookean") && message.lines().count() == 1,
        "wrong error: {message}"
    );
}
