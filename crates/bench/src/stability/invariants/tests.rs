//! Tests of the invariants of the stability matrix (conditions that each of its many simulations, the cases, must
//! keep): each invariant is broken once, with a flag (the engine's report of a problem) that excuses the break and
//! without one; a case that keeps all invariants passes. A sample is the measurements of one step.

use super::*;

/// Samples of the start and of ten steps, which keep every invariant: energy falls from 1 J, and contacts press with
/// 0.5 N until shortly before the end.
fn kept() -> Vec<Sample> {
    let step = |k: usize| {
        let energy = 1.0 - 0.05 * k as f64;
        let good = Sample { is_finite: true, energy, turned_over: 1.0, ..Sample::default() };
        let pressed = if k < 9 { 0.5 } else { 0.0 };
        let force = if k == 4 { 2.0 } else { 1.0 };
        Sample { stirred: 1.0, pressed, force, residual: 1e-5, balance: 1e-5, deformed: 0.01, ..good }
    };
    (0..=10).map(step).collect()
}

const PROMISE: Promise = Promise {
    tolerance: 0.0,
    peak: Some(2.0),
    rest: Some(1e-3),
    balanced: true,
    drift: Some((5, 1e-6)),
    shape: Some(0.1),
    touches: true,
    parts: true,
};
/// All flags as a bit mask.
const ALL: u32 = 0x7ff;

fn verdict_of(samples: &[Sample]) -> Verdict {
    verdict(samples, &judge(samples, &PROMISE))
}

#[test]
fn what_keeps_every_invariant_passes() {
    let samples = kept();
    assert_eq!(verdict_of(&samples), Verdict::Pass);
    let findings = judge(&samples, &PROMISE);
    assert_eq!(findings.len(), 13);
    assert!(
        findings.iter().all(|f| f.broken.is_none() && f.in_words().is_none()),
        "no finding may be a broken invariant: {findings:?}"
    );
}

#[test]
fn each_invariant_can_be_broken_and_a_flag_of_another_step_excuses_nothing() {
    type Spoil = fn(&mut Sample);
    let invariants: [(Invariant, usize, Spoil); 12] = [
        (Invariant::Finite, 7, |s| s.is_finite = false),
        (Invariant::Energy, 7, |s| s.energy = 1.01),
        (Invariant::Force, 7, |s| s.missed = 6e-4),
        (Invariant::Push, 7, |s| s.tension = 6e-4),
        (Invariant::Residual, 7, |s| s.residual = 0.2),
        (Invariant::Balance, 7, |s| s.balance = f64::NAN),
        (Invariant::Peak, 4, |s| s.force = 2.15),
        (Invariant::Rest, 9, |s| s.motion = 2e-3),
        (Invariant::Balanced, 10, |s| s.unbalanced = 2e-3),
        (Invariant::Drift, 7, |s| s.moved.x = 2e-6),
        (Invariant::Shape, 10, |s| s.deformed = 0.2),
        (Invariant::Parted, 10, |s| s.pressed = 0.1),
    ];
    for (invariant, step, spoil) in invariants {
        let mut samples = kept();
        spoil(&mut samples[step]);
        let findings = judge(&samples, &PROMISE);
        let broken: Vec<_> = findings.iter().filter_map(|f| f.broken.map(|step| (f.invariant, step))).collect();
        assert_eq!(broken, [(invariant, step)]);
        assert_eq!(verdict(&samples, &findings), Verdict::Silent, "verdict with {invariant:?} broken and no flag");
        let excuses = invariant.excuses().0;
        // A drift is a sum over steps, so that a flag of an earlier step excuses it; one of a later step does not.
        let other = if invariant == Invariant::Drift { step + 1 } else { step - 1 };
        samples[other].flags = Flags(ALL);
        assert_eq!(
            verdict_of(&samples),
            Verdict::Silent,
            "verdict with {invariant:?} broken and all flags in step {other}"
        );
        if invariant == Invariant::Drift {
            samples[step - 1].flags = Flags(ALL);
            assert_eq!(verdict_of(&samples), Verdict::Degraded, "drift with all flags one step earlier");
            continue;
        }
        samples[step].flags = Flags(ALL & !excuses);
        assert_eq!(
            verdict_of(&samples),
            Verdict::Silent,
            "verdict with {invariant:?} broken and only flags that do not excuse it"
        );
        let told = if invariant.is_hard() { Verdict::Fail } else { Verdict::Degraded };
        for (flag, name) in Flags::ALL.into_iter().filter(|(flag, _)| excuses & flag.0 != 0) {
            samples[step].flags = flag;
            assert_eq!(verdict_of(&samples), told, "verdict with {invariant:?} broken and a flag that excuses it");
            let words = judge(&samples, &PROMISE).iter().find_map(Finding::in_words).unwrap();
            assert!(
                words.starts_with(invariant.name()) && words.contains(&format!("step {step}")),
                "the text must begin with the invariant's name and contain the number of the step: {words}"
            );
            assert!(words.contains(name), "the text must contain the name of the flag: {words}");
        }
    }
}

#[test]
fn what_is_to_touch_and_does_not_is_a_failure_whatever_is_flagged() {
    let mut samples = kept();
    samples.iter_mut().for_each(|s| (s.pressed, s.flags) = (0.0, Flags(ALL)));
    let findings = judge(&samples, &PROMISE);
    assert_eq!(verdict(&samples, &findings), Verdict::Silent);
    assert!(findings.iter().find_map(Finding::in_words).unwrap().starts_with("touch: nothing presses"));
}

#[test]
fn the_worst_of_an_invariant_is_a_step_and_never_the_start() {
    let samples = kept();
    let energy = judge(&samples, &PROMISE).into_iter().find(|f| f.invariant == Invariant::Energy).unwrap();
    assert_eq!((energy.step, energy.bound), (1, ENERGY));
    assert!((energy.worst + 0.05).abs() < 1e-12, "the worst change of energy must be -0.05 J: {energy:?}");
}

#[test]
fn the_end_is_its_last_tenth_and_a_step_that_no_flag_excuses_is_the_one_told() {
    let mut samples: Vec<Sample> = (0..200).map(|_| kept()[10]).collect();
    samples[0].stirred = 1.0;
    (samples[0].pressed, samples[0].force) = (0.5, 2.0);
    samples[179].motion = 1.0;
    assert_eq!(verdict_of(&samples), Verdict::Pass);
    // Motion in any step of the last tenth breaks `Rest`, even if the last step happens to be a turning point.
    samples[181].motion = 1.0;
    assert_eq!(verdict_of(&samples), Verdict::Silent);
    samples[181].flags = Flags::INVERTED;
    samples[190].motion = 0.5;
    let rest = judge(&samples, &PROMISE).into_iter().find(|f| f.invariant == Invariant::Rest).unwrap();
    assert_eq!((rest.broken, rest.is_silent, rest.step), (Some(190), true, 181));
}

#[test]
fn a_flagged_step_excuses_no_later_one() {
    let mut samples = kept();
    (samples[6].residual, samples[6].flags) = (0.2, Flags::NOT_CONVERGED);
    assert_eq!(verdict_of(&samples), Verdict::Degraded);
    samples[8].residual = 0.2;
    assert_eq!(verdict_of(&samples), Verdict::Silent);
    // Energy that a flagged step gained stays in the body and is excused; energy that a later step gains on top of it
    // is not.
    let mut samples = kept();
    samples.iter_mut().skip(6).for_each(|s| s.energy = 1.5);
    samples[6].flags = Flags::TURNS_TOO_FAR;
    assert_eq!(verdict_of(&samples), Verdict::Fail);
    samples[9].energy = 1.51;
    assert_eq!(verdict_of(&samples), Verdict::Silent);
    // A sideways motion counts as drift too, however far the body has sagged before.
    let mut samples = kept();
    samples.iter_mut().for_each(|s| s.moved.y = -1e-3);
    samples[9].moved.x = 2e-6;
    assert_eq!(verdict_of(&samples), Verdict::Silent);
}

#[test]
fn energy_that_was_put_in_is_no_gain_and_a_flag_alone_degrades() {
    let mut samples = kept();
    (samples[7].energy, samples[7].supplied) = (2.0, 1.5);
    assert_eq!(verdict_of(&samples), Verdict::Pass);
    samples[3].flags = Flags::DEPTH_BEYOND_LIMIT;
    assert_eq!(verdict_of(&samples), Verdict::Degraded);
}
