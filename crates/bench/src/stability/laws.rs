//! Laws that every step keeps, judged from measured steps alone; each verdict says the first step that broke a law.

use glam::DVec3;
use palpate::Flags;
use serde::Serialize;

use super::trace::Sample;

/// Energy may exceed what was there and what was put in by this much of what was turned over: the solver stops at 1e-5 of
/// the right-hand side in its own norm, and the state is f32.
pub const ENERGY: f64 = 1e-3;
/// Kinetic energy that is no longer motion, of the most that the body had of kinetic and elastic.
pub const AT_REST: f64 = 1e-4;
/// What the wrench may miss of its contacts, of all they push: f32 sums, and the law of a contact cancels as it lets go.
pub const FORCE: f64 = 1e-3;
/// What a step may leave of its linear system: the engine speaks up at ten times the tolerance of 1e-5, in the norm of its
/// preconditioner; the diagonal's, used here, may be ten times off.
pub const RESIDUAL: f64 = 1e-3;
/// What the tool's momentum may miss, of its largest part; the tool's rows are six of many in the residual.
pub const BALANCE: f64 = 1e-2;
/// Laws of a case's end are judged over this much of its steps: one step may be a turning point.
pub const END: f64 = 0.1;
/// Where nothing pushes, the centre of a body stays within this of its edge; f32 places.
pub const DRIFT: f64 = 1e-5;

/// A law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// All that is told is a number.
    Finite,
    /// No energy from nothing.
    Energy,
    /// The wrench is the sum of its contacts by the contact law.
    Force,
    /// Contacts push, and never pull.
    Push,
    /// The linear system is solved.
    Residual,
    /// The force told is the force that moves the tool.
    Balance,
    /// What is damped comes to rest.
    Rest,
    /// What is not pushed stays.
    Drift,
    /// What was let go is no longer inside out or out of shape.
    Shape,
    /// What is to touch does.
    Touch,
    /// What is drawn out or gone through touches no longer.
    Parted,
}

impl Law {
    /// For readers.
    pub fn name(self) -> &'static str {
        match self {
            Law::Finite => "finite",
            Law::Energy => "energy",
            Law::Force => "force",
            Law::Push => "push",
            Law::Residual => "residual",
            Law::Balance => "balance",
            Law::Rest => "rest",
            Law::Drift => "drift",
            Law::Shape => "shape",
            Law::Touch => "touch",
            Law::Parted => "parted",
        }
    }

    /// Whether breaking it makes good nothing of what the hand feels: a failure even where a flag says so.
    fn is_hard(self) -> bool {
        matches!(self, Law::Finite | Law::Energy | Law::Force | Law::Push)
    }

    /// Flags that say that this law may be broken in their step; any other says nothing of it.
    pub fn excuses(self) -> Flags {
        match self {
            // Said of the very number.
            Law::Finite => Flags::NON_FINITE,
            // Rotations frozen over a step feed what spins; and of a tetrahedron inside out the elastic energy depends on which
            // of its rotations is taken, from outside as within.
            Law::Energy => Flags::TURNS_TOO_FAR | Flags::INVERTED,
            // Those that pull count as zero in the wrench, and not in the solution.
            Law::Push => Flags::ADHESIVE_DROPPED_TWICE,
            // The sum leaves out what pulls, as the wrench does: nothing excuses that.
            Law::Force | Law::Touch => Flags(0),
            // The flag says just this; a rotation inside out cannot be followed from outside, so the system is another; and in
            // blocks of 1 TPa that spin it is missed while they gain energy, presumably by the rounding of so much stress.
            Law::Residual => Flags::NOT_CONVERGED | Flags::INVERTED | Flags::TURNS_TOO_FAR,
            // The tool's rows are left with the others; pulls that the wrench leaves out move the tool; of a step done in parts
            // the last part's force is told; stopped is stopped.
            Law::Balance => Flags::NOT_CONVERGED | Flags::ADHESIVE_DROPPED_TWICE | Flags::STEP_RETRIED | Flags::FROZEN,
            // What is left unsolved may push the whole; and the same blocks drift.
            Law::Drift => Flags::NOT_CONVERGED | Flags::TURNS_TOO_FAR,
            // A body caught inside out creeps, and does not swing as it does at rest.
            Law::Rest => Flags::INVERTED,
            // It says so: it is not back, or will not be.
            Law::Shape => Flags::INVERTED | Flags::FROZEN,
            // A contact that deep is none, so the body may be caught on it; or caught inside out.
            Law::Parted => Flags::DEPTH_BEYOND_LIMIT | Flags::INVERTED | Flags::FROZEN,
        }
    }

    /// Whether flags excuse it.
    fn is_excused(self, flags: Flags) -> bool {
        self.excuses().0 & flags.0 != 0
    }
}

/// What a case promises at its end, beside what every step keeps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Promise {
    /// How much kinetic energy is left at the end, at most, of the most that the body had of kinetic and elastic; `None`: it is
    /// not due to be at rest.
    pub rest: Option<f64>,
    /// How far the centre of the free nodes may be from where it was, m, from the step on that is given.
    pub drift: Option<(usize, f64)>,
    /// How far any node may be from rest at the end, m.
    pub shape: Option<f64>,
    /// Whether something presses, sooner or later.
    pub touches: bool,
    /// Whether nothing presses at the end.
    pub parts: bool,
}

/// How a law was kept in a case.
#[derive(Debug, Clone, Serialize)]
pub struct Finding {
    /// Which.
    pub law: Law,
    /// The value nearest to its bound, or furthest beyond, and that bound.
    pub worst: f64,
    /// See `worst`.
    pub bound: f64,
    /// The step of it, from 1; 0: the start.
    pub step: usize,
    /// The first step that broke it; if any did without a flag that says so, the first of these.
    pub broken: Option<usize>,
    /// The flags of that step.
    pub flags: u32,
    /// Whether any step that broke it had no flag that says so.
    pub is_silent: bool,
}

/// What became of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All laws hold, and no flag was raised.
    Pass,
    /// The scene is not taken, and it is said why.
    Refused,
    /// A flag was raised, and no law of energy or force is broken; what else is broken it says.
    Degraded,
    /// A law of energy or force is broken, and a flag of that step says that it may be.
    Fail,
    /// A law is broken, and no flag of that step says that it may be.
    Silent,
}

impl Verdict {
    /// For readers.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Pass => "pass",
            Verdict::Refused => "refused",
            Verdict::Degraded => "degraded",
            Verdict::Fail => "fail",
            Verdict::Silent => "silent failure",
        }
    }
}

impl Finding {
    /// A step broke it: the first is told, or the first that no flag excuses.
    fn note(&mut self, step: usize, flags: Flags, is_silent: bool) {
        if self.broken.is_none() || (is_silent && !self.is_silent) {
            (self.broken, self.flags) = (Some(step), flags.0);
        }
        self.is_silent |= is_silent;
    }

    /// Which law was broken, and where; `None`: none was.
    pub fn in_words(&self) -> Option<String> {
        let step = self.broken?;
        let names: Vec<&str> = Flags(self.flags).names().collect();
        let flags = if names.is_empty() { "no flag".into() } else { names.join(", ") };
        let Finding { law, worst, bound, .. } = self;
        Some(match law {
            Law::Finite => format!("finite: step {step} tells what is no number ({flags})"),
            Law::Touch => "touch: nothing presses in any step".into(),
            _ => format!("{} from step {step} ({flags}): {worst:.2e} at worst, {bound:.2e} allowed", law.name()),
        })
    }
}

/// Every law against the steps of a case; the first sample is the start.
pub fn judge(samples: &[Sample], promise: &Promise) -> Vec<Finding> {
    let from_first = |law, measure: fn(&Sample) -> (f64, f64)| worst(law, samples, 1, measure);
    let mut findings = vec![
        from_first(Law::Finite, |s| (f64::from(u8::from(!s.is_finite)), 0.5)),
        energy(samples),
        from_first(Law::Force, |s| (s.missed, FORCE * s.pressed + s.touch_floor)),
        from_first(Law::Push, |s| (s.pulled, FORCE * s.pressed + s.touch_floor)),
        from_first(Law::Residual, |s| (s.residual, RESIDUAL.max(s.residual_floor))),
        from_first(Law::Balance, |s| (s.balance, BALANCE)),
    ];
    let end = end_of(samples);
    if let Some(left) = promise.rest {
        let most = samples.iter().map(|s| s.stirred).fold(0.0, f64::max);
        findings.push(worst(Law::Rest, samples, end, |s| (s.motion, left.max(AT_REST) * most)));
    }
    if let Some((from, bound)) = promise.drift {
        let reference = samples.get(from).map_or(DVec3::ZERO, |s| s.moved);
        findings.push(worst(Law::Drift, samples, from, |s| (s.moved.distance(reference), bound)));
    }
    if let Some(bound) = promise.shape {
        findings.push(worst(Law::Shape, samples, end, |s| (s.deformed, bound)));
    }
    if promise.touches {
        let touches = samples.iter().any(|s| s.pressed > 0.0);
        let last = samples.len().saturating_sub(1);
        findings.push(worst(Law::Touch, samples, last, |_| (f64::from(u8::from(!touches)), 0.5)));
    }
    if promise.parts {
        findings.push(worst(Law::Parted, samples, end, |s| (s.pressed, 0.0)));
    }
    findings
}

/// The step from which on laws of the end are judged.
pub fn end_of(samples: &[Sample]) -> usize {
    samples.len() - (END * samples.len() as f64).ceil() as usize
}

fn energy(samples: &[Sample]) -> Finding {
    let start = samples.first().map_or(0.0, |s| s.energy);
    let mut turned = 0.0f64;
    let gains: Vec<(f64, f64)> = samples
        .iter()
        .map(|s| {
            turned = turned.max(s.turned_over);
            (s.energy - start - s.supplied, ENERGY * turned)
        })
        .collect();
    let mut at = 0;
    let mut finding = worst(Law::Energy, samples, 1, |_| {
        at += 1;
        gains[at]
    });
    // What a step gained with a flag that says so stays: of later steps only what they add to it is theirs.
    let mut told = 0.0f64;
    finding.is_silent = false;
    for (step, (sample, &(gain, bound))) in samples.iter().zip(&gains).enumerate() {
        if Law::Energy.is_excused(sample.flags) {
            told = told.max(gain);
        } else if is_beyond(gain - told, bound) {
            finding.note(step, sample.flags, true);
        }
    }
    finding
}

/// The sample from a step on that is nearest to its bound, or furthest beyond; a value that is no number breaks any.
fn worst(law: Law, samples: &[Sample], from: usize, mut measure: impl FnMut(&Sample) -> (f64, f64)) -> Finding {
    let mut finding = Finding { law, worst: 0.0, bound: 0.0, step: from, broken: None, flags: 0, is_silent: false };
    let mut most = f64::NEG_INFINITY;
    for (step, sample) in samples.iter().enumerate().skip(from) {
        let (value, bound) = measure(sample);
        if is_beyond(value, bound) {
            finding.note(step, sample.flags, !law.is_excused(sample.flags));
        }
        // Of a bound of zero any value is beyond.
        let share = if bound > 0.0 { value / bound } else { value };
        if share > most || value.is_nan() {
            (most, finding.worst, finding.bound, finding.step) = (share, value, bound, step);
        }
    }
    finding
}

/// What is no number is beyond any bound, and so is anything beyond a bound that is none.
fn is_beyond(value: f64, bound: f64) -> bool {
    value > bound || value.is_nan() || bound.is_nan()
}

/// The verdict on a case.
pub fn verdict(samples: &[Sample], findings: &[Finding]) -> Verdict {
    let broken = || findings.iter().filter(|f| f.broken.is_some());
    let was_flagged = samples.iter().any(|s| s.flags != Flags::default());
    if broken().any(|f| f.is_silent) {
        Verdict::Silent
    } else if broken().any(|f| f.law.is_hard()) {
        Verdict::Fail
    } else if was_flagged {
        Verdict::Degraded
    } else {
        Verdict::Pass
    }
}

#[cfg(test)]
mod tests;
