//! Explanations, for the report of the stability matrix (many stiff and extreme simulations of a soft block), of why a
//! case, which is one simulation, did not pass: what was done to the block, what happened to it, and a remedy if there
//! is one. A flag is the engine's report of a problem in a step.

use palpate::Flags;

use super::invariants::Verdict;
use super::{AxisResult, CellResult, Judged};

/// Meaning of each flag except the two that report a full buffer, for cases whose cause is not known in more detail;
/// the gravest flag first.
const FLAGS: [(Flags, &str); 11] = [
    (Flags::FROZEN, "not even the shortest step could be solved, and all motion was stopped"),
    (Flags::NON_FINITE, "a number left single precision's range, and the step was done again in halves"),
    (Flags::STEP_RETRIED, "the solver broke down, and the step was done again in halves"),
    (Flags::DEPTH_BEYOND_LIMIT, "the sphere is deeper in the block than `depth_limit`"),
    (Flags::TENSION_REMAINS, "the sphere bounces off within a step, and contacts still pull after four releases"),
    (Flags::NOT_CONVERGED, "the solver stopped at a residual above that expected of single precision"),
    (Flags::TURNS_TOO_FAR, "the block turns too far in a step for its stiffness"),
    (Flags::INVERTED, "tetrahedra were inside out"),
    (Flags::NEWTON_NOT_CONVERGED, "the Newton iterations did not solve the step's equations"),
    (Flags::MOVED_TOO_FAR, "the tool moves further than its own extent in a step"),
    (Flags::NOT_A_HEIGHT_FIELD, "the skin folds over itself in front of the sphere"),
];

/// Text that says why a case is degraded or fails, and what helps if something does.
pub fn reason(axis: &AxisResult, cell: &CellResult, case: &Judged) -> String {
    let flags = Flags(case.flags);
    let plain = FLAGS.iter().find(|(flag, _)| flags.contains(*flag)).map(|(_, why)| capital(why));
    let (cause, remedy) = match known(axis, cell, case) {
        Some((cause, remedy)) => (Some(cause), remedy),
        None => (plain, None),
    };
    let mut words = cause.map_or(String::new(), |cause| cause + ".");
    if case.inverted > 0 {
        let steps = case.trace.iter().filter(|step| step.inverted > 0).count();
        let share = 100 * steps / case.trace.len().max(1);
        let rare = if share == 0 { "under 1".into() } else { share.to_string() };
        words += &format!(
            " At most {} tetrahedra were inside out in one step; in {rare} % of the recorded steps at least one was.",
            case.inverted
        );
    }
    if case.verdict == Verdict::Silent {
        words += " No flag warns of it.";
    }
    remedy.map_or(words.clone(), |remedy| format!("{words} {remedy}.")).trim().into()
}

/// Cause and remedy of a case that is understood; `None`: it is not.
fn known(axis: &AxisResult, cell: &CellResult, case: &Judged) -> Option<(String, Option<&'static str>)> {
    let flags = Flags(case.flags);
    let is_deep = flags.contains(Flags::DEPTH_BEYOND_LIMIT);
    let (cause, remedy) = match (axis.name.as_str(), case.scenario.as_str()) {
        ("young" | "gravity" | "density", "press" | "press, undamped" | "hang" | "hang, undamped")
            if flags.contains(Flags::INVERTED) || is_deep =>
        {
            ("The block is so soft that its own weight folds it".into(), Some("A stiffer material bears its weight"))
        }
        ("stretch", _) if cell.label.contains("inside out") => {
            ("The block begins inside out, and turns back by itself".into(), None)
        }
        ("stretch", _) => ("The block springs back so hard that it overshoots".into(), None),
        ("mass-ratio", _) if is_deep => {
            ("The block cannot stop so heavy a sphere, which goes through it and comes out".into(), None)
        }
        ("thrust", _) => (
            "The device pulls the sphere through the block, deeper than `depth_limit`; its coupling is stiff".into(),
            Some("A softer coupling holds the sphere at the surface"),
        ),
        ("teleport", _) => (
            "The device jumps into the block from one step to the next, deeper than `depth_limit`".into(),
            Some("A softer coupling, or a higher `depth_limit`, helps"),
        ),
        ("spin", _) if flags.contains(Flags::TURNS_TOO_FAR) => (
            "Rotations are frozen over a step, so that a part that turns by more than 0.12 rad in a step moves along \
             its tangents and is stretched"
                .into(),
            Some("With `newton = 2` the block loses energy instead of gaining it"),
        ),
        ("spin-stiff", _) => (
            "Rotations are frozen over a step, and a spinning block is stretched along its tangents: in so stiff a \
             block that is much energy, though the rotation is small"
                .into(),
            Some("`newton = 2` suffices up to 10 GPa; at 1 TPa neither 2 nor 3 does"),
        ),
        _ => return None,
    };
    Some((cause, remedy))
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(scenario: &str, flags: Flags, verdict: Verdict) -> Judged {
        Judged {
            scenario: scenario.into(),
            verdict,
            steps: 0,
            flags: flags.0,
            flagged: 1,
            first_flagged: Some(1),
            inverted: 0,
            findings: Vec::new(),
            refusal: None,
            trace: Vec::new(),
            seconds: 0.0,
        }
    }

    #[test]
    fn a_reason_is_a_sentence_about_what_was_done_or_about_the_flag() {
        let axis =
            |name: &str| AxisResult { name: name.into(), title: name.into(), is_listed: false, cells: Vec::new() };
        let cell = |label: &str| CellResult {
            label: label.into(),
            is_core: false,
            verdict: Verdict::Degraded,
            cases: Vec::new(),
        };
        let inverted = case("release", Flags::INVERTED, Verdict::Degraded);
        assert!(
            reason(&axis("stretch"), &cell("turned inside out"), &inverted).starts_with("The block begins inside out")
        );
        let spin = case("spin", Flags::TURNS_TOO_FAR, Verdict::Silent);
        let words = reason(&axis("spin"), &cell("300 rad/s"), &spin);
        assert!(
            words.contains("No flag warns of it. With `newton = 2`") && words.ends_with('.'),
            "the explanation must tell of the missing flag and of the remedy, and end with a full stop: {words}"
        );
        let odd = case("pluck", Flags::NOT_CONVERGED, Verdict::Degraded);
        let words = reason(&axis("young"), &cell("1 TPa"), &odd);
        assert_eq!(words, "The solver stopped at a residual above that expected of single precision.");
    }
}
