//! Why a case did not pass: one sentence, from what it did.

use super::laws::{Law, Verdict};
use super::{AxisResult, Judged};
use crate::report::Flags;

/// What a flag means in these cases, the gravest first.
const FLAGS: [(Flags, &str); 9] = [
    (Flags::FROZEN, "no step short enough could be solved, so everything was stopped where it was"),
    (Flags::NON_FINITE, "a number left single precision's range, and the step was done again in halves"),
    (Flags::STEP_RETRIED, "the solver broke down, and the step was done again in halves"),
    (Flags::DEPTH_BEYOND_LIMIT, "the sphere is deeper in the block than the scene's depth_limit"),
    (
        Flags::ADHESIVE_DROPPED_TWICE,
        "contacts still pulled after four more solves: the sphere bounces off within a step",
    ),
    (Flags::NOT_CONVERGED, "the solver ran out of its iterations before single precision's floor"),
    (
        Flags::TURNS_TOO_FAR,
        "it turns by more than 0.12 rad a step, over which rotations are frozen: what goes along tangents is stretched",
    ),
    (Flags::INVERTED, "tetrahedra were inside out, or too thin for their rotation to be found"),
    (Flags::NOT_A_HEIGHT_FIELD, "the skin folds over itself along the contact's normal"),
];

/// Why a case of an axis was degraded or failed, and what can be done about it.
pub fn reason(axis: &AxisResult, case: &Judged) -> String {
    let flags = Flags(case.flags);
    let mut words: Vec<String> =
        FLAGS.iter().filter(|(flag, _)| flags.contains(*flag)).map(|(_, why)| why.to_string()).collect();
    if case.inverted > 0 {
        words.push(format!("up to {} tetrahedra were inside out", case.inverted));
    }
    if case.verdict == Verdict::Silent {
        let laws: Vec<&str> = case.findings.iter().filter(|f| f.broken.is_some()).map(|f| f.law.name()).collect();
        words.push(format!("{} broken, and nothing was said", laws.join(", ")));
    }
    if case.findings.iter().any(|f| f.broken.is_some() && f.law == Law::Energy) {
        words.push(
            "one linearisation a step is too few for what moves so far in it: shorter steps, or newton = 3".into(),
        );
    }
    if let Some(remedy) = remedy(axis.name.as_str()) {
        words.push(remedy.into());
    }
    words.join("; ")
}

/// What mends it, by what was taken to its extreme.
fn remedy(axis: &str) -> Option<&'static str> {
    Some(match axis {
        "mass-ratio" => "a sphere that the block cannot stop goes through it: nothing to mend but the scene",
        "thrust" | "teleport" => {
            "the coupling pushes harder than the block can bear: a softer one, or a higher depth_limit"
        }
        "gravity" | "density" => "the block cannot bear the load: a stiffer material",
        "young" => "its own weight and the sphere crush so soft a block: a stiffer material",
        _ => return None,
    })
}
