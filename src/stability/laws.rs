//! Laws that every step keeps, judged from measured steps alone; each verdict says the first step that broke a law.

use glam::DVec3;
use serde::Serialize;

use super::trace::Sample;
use crate::report::Flags;

/// Energy may exceed what was there and what was put in by this much of what was turned over: the solver stops at 1e-5 of
/// the right-hand side in its own norm, and the state is f32.
pub const ENERGY: f64 = 1e-3;
/// Kinetic energy that is no longer motion, of the most that was turned over.
pub const AT_REST: f64 = 1e-4;
/// What a step may leave of its linear system: the engine speaks up at ten times the tolerance of 1e-5, in the norm of its
/// preconditioner; the diagonal's, used here, may be ten times off.
pub const RESIDUAL: f64 = 1e-3;
/// What the tool's momentum may miss, of its largest part; the tool's rows are six of many in the residual.
pub const BALANCE: f64 = 1e-2;
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
    /// Contacts push no harder than their stiffness allows.
    Force,
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
}

impl Law {
    /// For readers.
    pub fn name(self) -> &'static str {
        match self {
            Law::Finite => "finite",
            Law::Energy => "energy",
            Law::Force => "force",
            Law::Residual => "residual",
            Law::Balance => "balance",
            Law::Rest => "rest",
            Law::Drift => "drift",
            Law::Shape => "shape",
        }
    }

    /// Whether a flag excuses it: of others no flag makes good what the hand feels.
    fn is_soft(self) -> bool {
        !matches!(self, Law::Finite | Law::Energy | Law::Force)
    }
}

/// What a case promises at its end, beside what every step keeps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Promise {
    /// By how much kinetic energy has fallen at the end, at least, of what was turned over; `None`: nothing damps.
    pub rest: Option<f64>,
    /// How far the centre of the free nodes may be from where it was, m, from the step on that is given.
    pub drift: Option<(usize, f64)>,
    /// How far any node may be from rest at the end, m.
    pub shape: Option<f64>,
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
    /// The first step that broke it.
    pub broken: Option<usize>,
    /// The flags of that step.
    pub flags: u32,
    /// Whether any step that broke it had none.
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
    /// A flag was raised, and what it stands for is within the laws of energy and force, or is missed in that step alone.
    Degraded,
    /// A law of energy or force is broken, and a flag was raised in that step.
    Fail,
    /// A law is broken without a flag.
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
    /// Which law was broken, and where; `None`: none was.
    pub fn in_words(&self) -> Option<String> {
        let step = self.broken?;
        let names: Vec<&str> = Flags(self.flags).names().collect();
        let flags = if names.is_empty() { "no flag".into() } else { names.join(", ") };
        let Finding { law, worst, bound, .. } = self;
        Some(format!("{} from step {step} ({flags}): {worst:.2e} at worst, {bound:.2e} allowed", law.name()))
    }
}

/// Every law against the steps of a case; the first sample is the start.
pub fn judge(samples: &[Sample], promise: &Promise) -> Vec<Finding> {
    let mut findings = vec![
        worst(Law::Finite, samples, |s| (f64::from(u8::from(!s.is_finite)), 0.5)),
        energy(samples),
        worst(Law::Force, samples, |s| (s.force, s.force_bound)),
        worst(Law::Residual, samples, |s| (s.residual, RESIDUAL.max(s.residual_floor))),
        worst(Law::Balance, samples, |s| (s.balance, BALANCE)),
    ];
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return findings };
    let at_end = |law, value: f64, bound: f64| Finding {
        law,
        worst: value,
        bound,
        step: samples.len() - 1,
        broken: is_beyond(value, bound).then_some(samples.len() - 1),
        flags: last.flags.0,
        is_silent: is_beyond(value, bound) && last.flags == Flags::default(),
    };
    if let Some(left) = promise.rest {
        let most = samples.iter().map(|s| s.turned_over - first.turned_over.min(0.0)).fold(0.0, f64::max);
        findings.push(at_end(Law::Rest, last.kinetic, left.max(AT_REST) * most));
    }
    if let Some((from, bound)) = promise.drift {
        let reference = samples.get(from).map_or(DVec3::ZERO, |s| s.moved);
        let since = &samples[from.min(samples.len() - 1)..];
        let mut finding = worst(Law::Drift, since, |s| (s.moved.distance(reference), bound));
        finding.step += from;
        finding.broken = finding.broken.map(|step| step + from);
        findings.push(finding);
    }
    if let Some(bound) = promise.shape {
        findings.push(at_end(Law::Shape, last.deformed, bound));
    }
    findings
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
    let mut finding = worst(Law::Energy, samples, |_| {
        at += 1;
        gains[at - 1]
    });
    // What a flagged step gained stays: of later steps only what they add to it is theirs.
    let mut told = 0.0f64;
    finding.is_silent = samples.iter().zip(&gains).any(|(sample, &(gain, bound))| {
        let is_told = sample.flags != Flags::default();
        told = if is_told { told.max(gain) } else { told };
        !is_told && is_beyond(gain - told, bound)
    });
    finding
}

/// The sample nearest to its bound, or furthest beyond; a value that is no number breaks any.
fn worst(law: Law, samples: &[Sample], mut measure: impl FnMut(&Sample) -> (f64, f64)) -> Finding {
    let mut finding = Finding { law, worst: 0.0, bound: 0.0, step: 0, broken: None, flags: 0, is_silent: false };
    let mut most = f64::NEG_INFINITY;
    for (step, sample) in samples.iter().enumerate() {
        let (value, bound) = measure(sample);
        if is_beyond(value, bound) {
            finding.is_silent |= sample.flags == Flags::default();
            if finding.broken.is_none() {
                (finding.broken, finding.flags) = (Some(step), sample.flags.0);
            }
        }
        // Of a bound of zero any value is beyond.
        let share = if bound > 0.0 { value / bound } else { value };
        if share > most || value.is_nan() || step == 0 {
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
    } else if broken().any(|f| !f.law.is_soft()) {
        Verdict::Fail
    } else if was_flagged {
        Verdict::Degraded
    } else {
        Verdict::Pass
    }
}

#[cfg(test)]
mod tests;
