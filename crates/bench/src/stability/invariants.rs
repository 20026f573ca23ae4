//! The invariants (`Invariant`), conditions that every step of a case must keep; a case is one simulation of the
//! stability matrix (many stiff and extreme simulations). The invariants are judged from measured steps alone. A
//! finding says how one invariant was kept and which step broke it first; the verdict on a case follows from its
//! findings. A flag, the engine's report of a problem in a step, excuses a broken invariant only if it warns of that
//! invariant; a break without such a flag is a silent failure. The tool is the rigid body that the haptic device leads;
//! the wrench is the force and torque of the contacts on the tool.

use glam::DVec3;
use palpate::Flags;
use serde::Serialize;

use super::trace::Sample;

/// The energy may exceed the sum of its initial value and the energy supplied by at most this share of the sum of all
/// energies' magnitudes: the engine's solver leaves an error of a twentieth of the time step's, and the engine keeps
/// the state in f32.
pub const ENERGY: f64 = 1e-3;
/// A body is at rest when its kinetic energy is below this share of the greatest sum of kinetic and elastic energy that
/// it had.
pub const AT_REST: f64 = 1e-4;
/// The reported wrench may differ from the sum of the contacts' forces by this share of the sum of their magnitudes:
/// the engine sums in f32, and the two terms of the contact law (of depth and of its rate) nearly cancel while a
/// contact opens.
pub const FORCE: f64 = 1e-3;
/// Bound on the relative residual of a step's linear system: the residual in the norm of its preconditioner at which
/// the engine raises a flag, ten times that at which a solver without a tolerance may stop.
pub const RESIDUAL: f64 = 0.1;
/// The change of the tool's momentum may differ from the sum of the impulses on it by this share of the largest
/// impulse: the share of the tool that the solver's residual leaves to the next step. The most that occurred is 5.4e-3,
/// in steps of 100 ms.
pub const BALANCE: f64 = 1e-2;
/// Bound on the residual for a preset, as a multiple of its tolerance: twice the residual at which the engine raises a
/// flag.
const LOOSE_RESIDUAL: f64 = 20.0;
/// Bound on the balance of momentum for a preset, as a multiple of its tolerance: twice the relative error of the
/// normal forces above which iterations go on.
const LOOSE_BALANCE: f64 = 10.0;
/// At rest the force on a node may be out of balance by this share of the weight of all nodes.
pub const BALANCED: f64 = 1e-3;
/// The greatest contact force on the tool may differ from that of a tight solver, which stops at [`TIGHT`], by this
/// share: a difference of forces that is just noticeable.
pub const PEAK: f64 = 0.07;
/// Tolerance of the tight solver: what it reaches in f32 in every case. At 1e-7 some steps end above ten times that.
pub const TIGHT: f64 = 1e-6;
/// Invariants of a case's end are judged over the last steps, this share of all steps, because an oscillation may be at
/// a turning point, without motion, in any single step.
pub const END: f64 = 0.1;
/// The centre of a body that nothing pushes may move by this share of the body's edge, because the state is f32.
pub const DRIFT: f64 = 1e-5;

/// An invariant that is tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Invariant {
    /// All reported numbers are finite.
    Finite,
    /// Energy does not appear from nothing.
    Energy,
    /// The wrench is the sum of its contacts' forces by the contact law.
    Force,
    /// Contacts push and never pull.
    Push,
    /// The residual of the step's linear system is within its bound.
    Residual,
    /// The reported force is the force that moves the tool.
    Balance,
    /// A loose solver gives the same greatest force as a tight one.
    Peak,
    /// A damped case comes to rest.
    Rest,
    /// Where a body has come to rest, elastic forces carry its weight.
    Balanced,
    /// A body that nothing pushes stays in place.
    Drift,
    /// A body that was let go is back in shape, not inside out.
    Shape,
    /// A case that should have contact has it.
    Touch,
    /// A tool that was drawn out of the body or went through it has no contact any more.
    Parted,
}

impl Invariant {
    /// Name in the report.
    pub fn name(self) -> &'static str {
        match self {
            Invariant::Finite => "finite",
            Invariant::Energy => "energy",
            Invariant::Force => "force",
            Invariant::Push => "push",
            Invariant::Residual => "residual",
            Invariant::Balance => "balance",
            Invariant::Peak => "peak",
            Invariant::Rest => "rest",
            Invariant::Balanced => "balanced",
            Invariant::Drift => "drift",
            Invariant::Shape => "shape",
            Invariant::Touch => "touch",
            Invariant::Parted => "parted",
        }
    }

    /// Whether breaking the invariant makes the force at the user's hand wrong, so that it is a failure even if a flag
    /// warns of it.
    fn is_hard(self) -> bool {
        matches!(self, Invariant::Finite | Invariant::Energy | Invariant::Force | Invariant::Push | Invariant::Peak)
    }

    /// The flags that warn that this invariant may be broken in their step; other flags do not excuse a break.
    pub fn excuses(self) -> Flags {
        match self {
            // The flag means that a number was not finite.
            Invariant::Finite => Flags::NON_FINITE,
            // The rotations of tetrahedra are kept constant over a step, which adds energy to a spinning body. The
            // elastic energy of an inverted tetrahedron depends on which of its several polar rotations is chosen, in
            // this measurement as in the engine.
            Invariant::Energy => Flags::TURNS_TOO_FAR | Flags::INVERTED,
            // In the reported wrench, contacts that pull count as zero, but they act in the solution.
            Invariant::Push => Flags::TENSION_REMAINS,
            // The sum of contact forces that is computed here leaves out contacts that pull, as the wrench does, so
            // that no flag explains a difference. Nor does a flag explain that contact is missing.
            Invariant::Force | Invariant::Touch => Flags(0),
            // `NOT_CONVERGED` means just that the linear system is not solved. The rotation of an inverted tetrahedron
            // cannot be followed from outside the engine, so that the system computed here differs from the engine's.
            // Spinning blocks with a Young's modulus of 1 TPa break the invariant while they gain energy, presumably by
            // rounding of their large stress.
            Invariant::Residual => Flags::NOT_CONVERGED | Flags::INVERTED | Flags::TURNS_TOO_FAR,
            // The tool's equations are part of the linear system, so that the residual of the system breaks this
            // invariant too. Contacts that pull move the tool but are left out of the wrench; a step that was retried
            // in parts reports the force of its last part; a frozen tool does not move.
            Invariant::Balance => Flags::NOT_CONVERGED | Flags::TENSION_REMAINS | Flags::STEP_RETRIED | Flags::FROZEN,
            // The greatest force is wrong where the system is not solved; contacts that pull are left out of it.
            Invariant::Peak => Flags::NOT_CONVERGED | Flags::TENSION_REMAINS,
            // The residual that the solver leaves may push the body as a whole; the spinning blocks of 1 TPa drift as
            // well.
            Invariant::Drift => Flags::NOT_CONVERGED | Flags::TURNS_TOO_FAR,
            // Newton iterations that do not converge may come to rest anywhere; an inverted tetrahedron has several
            // forces.
            Invariant::Balanced => Flags::NEWTON_NOT_CONVERGED | Flags::INVERTED,
            // The motion of a body that stays inside out does not decay as predicted for oscillations about the rest
            // shape.
            Invariant::Rest => Flags::INVERTED,
            // The flags mean that the body is not back in its rest shape (inverted), or will not come back (frozen).
            Invariant::Shape => Flags::INVERTED | Flags::FROZEN,
            // The engine may leave out contacts beyond the depth limit, so that the body may stay caught on the tool;
            // a body that is inside out or frozen may stay caught too.
            Invariant::Parted => Flags::DEPTH_BEYOND_LIMIT | Flags::INVERTED | Flags::FROZEN,
        }
    }

    /// Whether one of the flags `flags` excuses breaking the invariant.
    fn is_excused(self, flags: Flags) -> bool {
        self.excuses().0 & flags.0 != 0
    }
}

/// The invariants that one case promises to keep in addition to those of every step. The end of a case is the last part
/// of its steps, the share [`END`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Promise {
    /// Tolerance of the case's preset; zero without one. The bounds on the residual and on the balance of momentum grow
    /// with it.
    pub tolerance: f64,
    /// Greatest contact force on the tool by a tight solver, N; `None`: the case's own solver is tight.
    pub peak: Option<f64>,
    /// Greatest kinetic energy at the end, as a share of the greatest sum of kinetic and elastic energy that the body
    /// had; `None`: the case need not come to rest.
    pub rest: Option<f64>,
    /// Whether the forces on each node must be balanced at the end.
    pub balanced: bool,
    /// Number of a step, and the greatest distance of the centre of the free nodes in later steps from its position in
    /// that step, m; `None`: the centre may move.
    pub drift: Option<(usize, f64)>,
    /// Greatest distance of a node from its rest position at the end, m; `None`: the body need not be back in shape.
    pub shape: Option<f64>,
    /// Whether a contact must press in some step.
    pub touches: bool,
    /// Whether no contact may press at the end.
    pub parts: bool,
}

/// How an invariant was kept in a case.
#[derive(Debug, Clone, Serialize)]
pub struct Finding {
    /// The invariant.
    pub invariant: Invariant,
    /// The measured value that is nearest to its bound or furthest beyond it.
    pub worst: f64,
    /// The bound of that value.
    pub bound: f64,
    /// Number of the step in which `worst` was measured, from 1; 0 is the state before the first step.
    pub step: usize,
    /// The first step that broke the invariant without an excusing flag or, if there is none, the first step that broke
    /// it; `None`: no step broke it.
    pub broken: Option<usize>,
    /// Flags of the step in `broken`, as a bit mask.
    pub flags: u32,
    /// Whether any step that broke the invariant had no excusing flag.
    pub is_silent: bool,
}

/// Verdict on a case, from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All invariants hold, and no flag was raised.
    Pass,
    /// The engine refused the scene with an error.
    Refused,
    /// A flag was raised. Invariants of energy and force hold; others may be broken if a flag warns of it.
    Degraded,
    /// An invariant of energy or force is broken, and a flag of that step warns of it.
    Fail,
    /// An invariant is broken in a step without a flag that warns of it.
    Silent,
}

impl Verdict {
    /// Name in the report.
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
    /// Records that a step broke the invariant; `is_silent`: no flag of the step excuses it. `broken` becomes the first
    /// step that broke the invariant without an excuse or, if there is none, the first step that broke it.
    fn note(&mut self, step: usize, flags: Flags, is_silent: bool) {
        if self.broken.is_none() || (is_silent && !self.is_silent) {
            (self.broken, self.flags) = (Some(step), flags.0);
        }
        self.is_silent |= is_silent;
    }

    /// The broken invariant, its step, flags and worst value as text; `None`: the invariant was not broken.
    pub fn in_words(&self) -> Option<String> {
        let step = self.broken?;
        let names: Vec<&str> = Flags(self.flags).names().collect();
        let flags = if names.is_empty() { "no flag".into() } else { names.join(", ") };
        let Finding { invariant, worst, bound, .. } = self;
        Some(match invariant {
            Invariant::Finite => format!("finite: step {step} reports a number that is not finite ({flags})"),
            Invariant::Touch => "touch: nothing presses in any step".into(),
            _ => format!("{} from step {step} ({flags}): {worst:.2e} at worst, {bound:.2e} allowed", invariant.name()),
        })
    }
}

/// Judges every invariant for the steps of a case; the first sample is the state before the first step.
pub fn judge(samples: &[Sample], promise: &Promise) -> Vec<Finding> {
    let from_first = |invariant, measure: fn(&Sample) -> (f64, f64)| worst(invariant, samples, 1, measure);
    let mut findings = vec![
        from_first(Invariant::Finite, |s| (f64::from(u8::from(!s.is_finite)), 0.5)),
        energy(samples),
        from_first(Invariant::Force, |s| (s.missed, FORCE * s.pressed + s.touch_floor)),
        from_first(Invariant::Push, |s| (s.tension, FORCE * s.pressed + s.touch_floor)),
        worst(Invariant::Residual, samples, 1, |s| {
            (s.residual, RESIDUAL.max(LOOSE_RESIDUAL * promise.tolerance).max(s.residual_floor))
        }),
        worst(Invariant::Balance, samples, 1, |s| (s.balance, BALANCE.max(LOOSE_BALANCE * promise.tolerance))),
    ];
    let end = end_of(samples);
    if let Some(peak) = promise.peak {
        let most = samples.iter().map(|s| s.force).fold(0.0, f64::max);
        let at = samples.iter().position(|s| s.force == most).unwrap_or_default();
        let at_peak = |s: &Sample| ((s.force - peak).abs(), PEAK * peak);
        findings.push(worst(Invariant::Peak, &samples[..=at], at, at_peak));
    }
    if let Some(left) = promise.rest {
        let most = samples.iter().map(|s| s.stirred).fold(0.0, f64::max);
        findings.push(worst(Invariant::Rest, samples, end, |s| (s.motion, left.max(AT_REST) * most)));
    }
    if promise.balanced {
        findings.push(worst(Invariant::Balanced, samples, end, |s| (s.unbalanced, BALANCED)));
    }
    if let Some((from, bound)) = promise.drift {
        let reference = samples.get(from).map_or(DVec3::ZERO, |s| s.moved);
        findings.push(worst(Invariant::Drift, samples, from, |s| (s.moved.distance(reference), bound)));
    }
    if let Some(bound) = promise.shape {
        findings.push(worst(Invariant::Shape, samples, end, |s| (s.deformed, bound)));
    }
    if promise.touches {
        let touches = samples.iter().any(|s| s.pressed > 0.0);
        let last = samples.len().saturating_sub(1);
        findings.push(worst(Invariant::Touch, samples, last, |_| (f64::from(u8::from(!touches)), 0.5)));
    }
    if promise.parts {
        findings.push(worst(Invariant::Parted, samples, end, |s| (s.pressed, 0.0)));
    }
    findings
}

/// Index of the first sample of a case's end, the last tenth of its samples.
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
    let mut finding = worst(Invariant::Energy, samples, 1, |_| {
        at += 1;
        gains[at]
    });
    // Energy that a flagged step gained stays in the body, so that later steps are judged only by what they add to it.
    let mut told = 0.0f64;
    finding.is_silent = false;
    for (step, (sample, &(gain, bound))) in samples.iter().zip(&gains).enumerate() {
        if Invariant::Energy.is_excused(sample.flags) {
            told = told.max(gain);
        } else if is_beyond(gain - told, bound) {
            finding.note(step, sample.flags, true);
        }
    }
    finding
}

/// Finds the sample, from index `from` on, whose value is nearest to its bound or furthest beyond it. `measure` returns
/// value and bound of a sample; NaN breaks any bound.
fn worst(
    invariant: Invariant,
    samples: &[Sample],
    from: usize,
    mut measure: impl FnMut(&Sample) -> (f64, f64),
) -> Finding {
    let mut finding =
        Finding { invariant, worst: 0.0, bound: 0.0, step: from, broken: None, flags: 0, is_silent: false };
    let (mut most, mut raised) = (f64::NEG_INFINITY, Flags::default());
    for (step, sample) in samples.iter().enumerate().skip(from) {
        let (value, bound) = measure(sample);
        // A drift is a sum over steps: what moved the body in a step with a flag is still there in the steps after it.
        raised.0 = sample.flags.0 | if invariant == Invariant::Drift { raised.0 } else { 0 };
        if is_beyond(value, bound) {
            finding.note(step, sample.flags, !invariant.is_excused(raised));
        }
        // Any positive value breaks a bound of zero; such values are compared without dividing by the bound.
        let share = if bound > 0.0 { value / bound } else { value };
        if share > most || value.is_nan() {
            (most, finding.worst, finding.bound, finding.step) = (share, value, bound, step);
        }
    }
    finding
}

/// Whether a value is beyond its bound; it is if either of them is NaN.
fn is_beyond(value: f64, bound: f64) -> bool {
    value > bound || value.is_nan() || bound.is_nan()
}

/// The verdict on a case.
pub fn verdict(samples: &[Sample], findings: &[Finding]) -> Verdict {
    let broken = || findings.iter().filter(|f| f.broken.is_some());
    let was_flagged = samples.iter().any(|s| s.flags != Flags::default());
    if broken().any(|f| f.is_silent) {
        Verdict::Silent
    } else if broken().any(|f| f.invariant.is_hard()) {
        Verdict::Fail
    } else if was_flagged {
        Verdict::Degraded
    } else {
        Verdict::Pass
    }
}

#[cfg(test)]
mod tests;
