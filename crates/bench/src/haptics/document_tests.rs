//! Tests of the findings (sentences that answer a section's question) and tables of the haptics report, on made-up
//! results.

use super::*;
use crate::haptics::between::{Path, Place};
use crate::haptics::{
    Between, Change, Changes, Controlled, Controller, HoldResult, Limit, Met, Mode, Slid, Spread, Width,
};

fn width(damping: f64, [session, local, raw]: [f64; 3]) -> Width {
    Width { profile: "touch".into(), coupling: 400.0, damping, session, local, raw, colgate: 5000.0 }
}

#[test]
fn walls_beyond_the_range_and_walls_of_no_stiffness_are_said() {
    let section = walls::widths(&[width(0.0, [0.0, 1e5, 400.0]), width(5.0, [1e5, 1e5, 1200.0])]).unwrap();
    let told = "none to > 100000 (1 of 2 beyond the range) in a session, > 100000 (2 of 2 beyond the range) without \
                passivity control, 400 to 1200 (0 of 2 beyond the range) with the raw force; in series with the \
                coupling, as the hand feels it, the last is 200 to 300.";
    assert!(section.finding.ends_with(told), "finding: {}", section.finding);
    assert_eq!(section.table.rows[0], ["touch", "400", "0", "none", "> 100000", "400", "200", "5000"]);
    assert_eq!(section.table.heads.len(), section.table.rows[0].len());
}

#[test]
fn the_local_model_may_be_better_or_worse() {
    let limit = |delay: f64, local: f64, raw: f64| Limit {
        profile: "touch".into(),
        coupling: 400.0,
        delay,
        rate: 1e3,
        local,
        raw,
        colgate: 5000.0,
        gil: 2.5 / (0.5e-3 + delay),
    };
    let section = walls::delays(&[limit(0.0, 1e5, 9000.0), limit(0.02, 300.0, 250.0)]).unwrap();
    let told = "at 0 ms > 100000 with the local model and 9000 with the raw force, at 20 ms 300 with the local model \
                and 250 with the raw force. The local model allows more than the raw force in 2 of 2 cases and less \
                in 0. Limits below Gil's bound: 0 with the local model, 0 with the raw force.";
    assert!(section.finding.ends_with(told), "finding: {}", section.finding);
    let worse = walls::rates(&[limit(0.0, 100.0, 9000.0)]).unwrap().finding;
    assert!(worse.contains("in 0 of 1 cases and less in 1. Limits below Gil's bound: 1 with"), "finding: {worse}");
    assert!(walls::delays(&[]).unwrap().finding.contains("nothing"));
}

fn hold_result(mode: Mode, mean: f64, deviation: f64) -> HoldResult {
    let force = Spread { mean, deviation, swing: 4.0 * deviation };
    let reading = Spread { swing: 2e-5, ..Spread::default() };
    HoldResult {
        met: Met::Wall(500.0),
        profile: "touch".into(),
        rate: 50.0,
        mode,
        force,
        no_friction: Some(force),
        reading,
        quantum_forces: [0.008, 0.04],
    }
}

#[test]
fn a_force_that_is_gone_is_not_still() {
    let all =
        [hold_result(Mode::Session, 0.0, 0.0), hold_result(Mode::Local, 2.0, 0.019), hold_result(Mode::Raw, 2.0, 0.3)];
    let section = forces::holds(&all).unwrap();
    let told = "as in a session 0 of 1, 1 left without a force; without friction 0 of 1, 1 left without a force; no passivity \
                control 1 of 1 (the noisiest 19.00 mN of 2.00 N: wall, 500 N/m, touch, 50 Hz); without friction 1 of 1 (the \
                noisiest 19.00 mN of 2.00 N: wall, 500 N/m, touch, 50 Hz); raw force 0 of 1 (the noisiest 300.00 mN of 2.00 N: \
                wall, 500 N/m, touch, 50 Hz); without friction 0 of 1 (the noisiest 300.00 mN of 2.00 N: wall, 500 N/m, touch, \
                50 Hz).";
    assert!(section.finding.ends_with(told), "finding: {}", section.finding);
    let row = &section.table.rows[0];
    assert_eq!(row[..6], ["wall, 500 N/m", "touch", "50", "0.000", "0.00 (0.00)", "0.00 (0.00)"]);
    assert_eq!(row[9..], ["2.000", "300.00 (1200.00)", "300.00 (1200.00)", "20", "8 + 40"]);
    assert_eq!(section.table.heads.len(), row.len());
    let noisy = forces::holds(&[hold_result(Mode::Local, 2.0, 0.021)]).unwrap().finding;
    assert!(noisy.contains("no passivity control 0 of 1"), "finding: {noisy}");
}

#[test]
fn jumps_are_judged_while_touching_and_while_sliding() {
    let change =
        |newtons: f64, force: f64| Change { newtons, force, time: 0.0, excess: newtons / 0.05f64.max(0.05 * force) };
    let slid = |mode: Mode, mean: f64, touch: f64, slide: f64| Slid {
        profile: "touch".into(),
        rate: 50.0,
        mode,
        force: Spread { mean, ..Spread::default() },
        quantum_forces: [0.008, 0.04],
        touch: Changes { played: change(touch, 0.5), ..Changes::default() },
        slide: Changes { played: change(slide, 2.0), raw: change(0.2, 2.0), ..Changes::default() },
        trace: vec![[1.0, 1.0, 1.1, 1.2], [1.1, 1.2, 1.1, 1.2]],
    };
    let all =
        [slid(Mode::Session, 1.0, 0.06, 0.09), slid(Mode::Session, 0.0, 0.0, 0.0), slid(Mode::Raw, 1.0, 0.01, 0.2)];
    let section = forces::slides(&all).unwrap();
    let told = [
        "as in a session 0 of 2 while touching (at worst 60.0 mN, 12.0 %: touch, 50 Hz), 1 of 2 while sliding (at worst 90.0 mN, \
         4.5 %: touch, 50 Hz), 1 of 2 left without a force;",
        "raw force 1 of 1 while touching (at worst 10.0 mN, 2.0 %",
        "0 of 1 while sliding (at worst 200.0 mN, 10.0 %",
        "jumps by 200.0 mN",
    ];
    assert!(told.iter().all(|told| section.finding.contains(told)), "finding: {}", section.finding);
    assert_eq!(section.table.heads.len(), section.table.rows[0].len());
    assert!(section.plot.unwrap().contains("touch at 50 Hz") && forces::slides(&[]).unwrap().plot.is_none());
}

#[test]
fn the_force_between_steps_is_told_of_each_path() {
    let run = |path, rate, mode, difference, prediction_error| Between {
        place: Place::Cheek,
        young: 2e4,
        path,
        rate,
        mode,
        peak: 3.0,
        difference: [difference, 2.0 * difference],
        greatest: 1.0 + difference,
        prediction_error,
    };
    let press = Path::Press(0.02);
    let all = [
        run(press, 1000.0, Mode::Session, 0.0, Some(0.001)),
        run(press, 50.0, Mode::Session, 0.01, Some(0.04)),
        run(press, 100.0, Mode::Session, 0.005, Some(0.02)),
        run(press, 50.0, Mode::Raw, 0.2, None),
        run(Path::Slide, 50.0, Mode::Session, 0.03, Some(0.05)),
        run(Path::Slide, 50.0, Mode::Raw, 0.1, None),
    ];
    let section = between::between(&all).unwrap();
    let told = "Medians of the difference: press and release, 20 mm/s 0.5 to 1.0 % (20.0 % with the raw force); slide \
                with friction 3.0 % (10.0 % with the raw force). The greatest force is 100.5 to 103.0 % of that at \
                1000 steps a second. The local model predicts the next step's change of force to 0.1 to 5.0 %.";
    assert_eq!(section.finding, told);
    assert_eq!(section.table.rows[3][6..], ["20.0", "40.0", "120.0", ""].map(String::from));
    assert_eq!(section.table.heads.len(), section.table.rows[0].len());
    assert!(section.plot.unwrap().contains("raw") && between::between(&[]).unwrap().plot.is_none());
}

#[test]
fn a_loop_that_misses_more_than_a_bare_timer_is_named() {
    let late = |share_missed: f64| Late { ticks: 1000, p99: 50e-6, worst: 3e-3, share_missed, ..Late::default() };
    let session = |own: f64, bare: f64| Punctual {
        is_loaded: true,
        servo: late(own),
        bare: Some(late(bare)),
        steps: 7,
        age: [0.01, 0.02],
        notes: Vec::new(),
    };
    let section = jitter(&[session(0.002, 0.0015)]).unwrap();
    let told = "99 of 100 ticks come within 50 us, the latest 3.0 ms late, and 0.200 % of the deadlines are missed \
                (within what is allowed: a bare timer misses 0.150 %, with 99 of 100 ticks within 50 us).";
    assert!(section.finding.ends_with(told), "finding: {}", section.finding);
    assert!(section.table.rows.len() == 2 && section.table.rows[1].len() == section.table.heads.len());
    assert!(jitter(&[session(0.003, 0.0015)]).unwrap().finding.contains("(beyond what is allowed"));
}

#[test]
fn what_was_not_measured_has_no_section() {
    assert!(sections(&Results::default()).unwrap().is_empty());
}

#[test]
fn what_a_controller_leaves_and_what_the_hand_gains_are_told_of_each() {
    let case = |controller, share, net, lent| Controlled {
        controller,
        profile: "touch".into(),
        body: 300.0,
        rate: 60.0,
        gap: true,
        share,
        deviation: 1e-3,
        net,
        lent,
        acts: 0.25,
    };
    let all = [
        case(Controller::Session, 1.0, 2e-3, 2e-3),
        case(Controller::Observer, 0.2, -1e-3, 0.0),
        case(Controller::Observer, 0.98, 3e-3, 0.0),
    ];
    let section = controllers::controllers(&all).unwrap();
    let told = "session 100 % (1 of 1 cases within 3 %), 0.00 mJ; \
                Hannaford and Ryu 2002 20 to 98 % (1 of 2 cases within 3 %), 3.00 mJ.";
    assert!(section.finding.ends_with(told), "finding: {}", section.finding);
    assert_eq!(
        section.table.rows[1][..6],
        ["Hannaford and Ryu 2002", "touch", "300", "60", "yes", "20.0"].map(String::from)
    );
    assert_eq!(section.table.heads.len(), section.table.rows[0].len());
    assert!(controllers::controllers(&[]).unwrap().finding.contains("nothing"));
}
