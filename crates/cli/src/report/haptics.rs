//! The report of a session (one run of the haptic loop with a device), for `summary.json` and for the terminal. A
//! *tick* is one iteration of the loop; a force is *played* when it is commanded to the device. The passivity
//! controller limits the energy that the user's hand receives to what the hand gave and what the controller *lends* it
//! for a contact force that appears late, after the hand has moved unopposed. The *bare timer* is a thread that only
//! waits for ticks, for comparison with the loop.

use std::fmt;

use palpate::Explanation;
use palpate::internal::haptics::clock::Lateness;
use palpate::internal::haptics::event::{Event, EventCounts};
use palpate::internal::haptics::session::Report;
use serde_json::{Value, json};

/// The entry `haptics` of `summary.json`. Units are part of the names; `null` stands for what was not measured.
pub fn summary(report: &Report) -> Value {
    let energy = report.energy;
    let events: serde_json::Map<String, Value> = report
        .events
        .happened()
        .map(|(name, begun, ticks)| (name.into(), json!({ "begun": begun, "ticks": ticks })))
        .collect();
    json!({
        "profile": report.profile,
        "notes": report.notes,
        "ticks": report.lateness.ticks(),
        "ticks_lost": report.lost,
        "lateness": lateness(&report.lateness),
        "bare_timer": report.bare.as_ref().map(lateness),
        "age_ms": {
            "p50": 1e3 * report.staleness.quantile(0.5),
            "p99": 1e3 * report.staleness.quantile(0.99),
            "worst": 1e3 * report.staleness.quantile(1.0),
        },
        "steps": report.steps,
        "pace": report.pace,
        "peak_force_n": report.peak_force,
        "energy_j": {
            "taken": energy.taken,
            "given": energy.given,
            "net_given": energy.net(),
            "damped": energy.damped,
            "lent": energy.lent,
            "stored": energy.stored,
            "dissipated": energy.dissipated(),
        },
        "end": {
            "played_force_n": report.end[0].force.length(),
            "contact_force_n": report.end[1].force.length(),
        },
        "overestimate": report.overestimate(),
        "events": events,
        "ended": report.ended,
    })
}

fn lateness(lateness: &Lateness) -> Value {
    json!({
        "p50_us": 1e6 * lateness.quantile(0.5),
        "p99_us": 1e6 * lateness.quantile(0.99),
        "p99_9_us": 1e6 * lateness.quantile(0.999),
        "worst_us": 1e6 * lateness.worst(),
        "missed": lateness.missed(),
        "missed_share": lateness.share_missed(),
    })
}

/// The lines that are printed at the end of a session.
pub struct Closing<'a>(pub &'a Report);

impl fmt::Display for Closing<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Closing(report) = self;
        let line = |f: &mut fmt::Formatter, name: &str, lateness: &Lateness| {
            let us = |share| 1e6 * lateness.quantile(share);
            let [half, most, nearly_all] = [0.5, 0.99, 0.999].map(us);
            // `missed` counts deadlines that were missed by more than 2 ms; one late tick may miss several.
            let (ticks, missed, share) = (lateness.ticks(), lateness.missed(), 100.0 * lateness.share_missed());
            writeln!(
                f,
                "{name}: {ticks} ticks, late by {half:.0} us (median), {most:.0} us (p99), {nearly_all:.0} us (p99.9), \
                 {:.0} us (worst); {missed} ticks late by more than 2 ms ({share:.3} %)",
                1e6 * lateness.worst()
            )
        };
        let of = if report.tool.is_empty() { String::new() } else { format!(" of {}", report.tool) };
        line(f, &format!("haptic loop{of}"), &report.lateness)?;
        if let Some(bare) = &report.bare {
            line(f, "bare timer, for comparison", bare)?;
        }
        if report.lost > 0 {
            writeln!(f, "lost: {} ticks ran but are not counted or recorded: their queue was full", report.lost)?;
        }
        let ages = [0.5, 0.99, 1.0].map(|share| 1e3 * report.staleness.quantile(share));
        let (steps, pace) = (report.steps, 100.0 * report.pace);
        writeln!(
            f,
            "contact wrench out of date by {:.1} ms (median), {:.1} ms (p99), {:.1} ms (worst)",
            ages[0], ages[1], ages[2]
        )?;
        writeln!(f, "simulation steps: {steps}; simulated time ran at {pace:.0} % of real time")?;
        let energy = report.energy;
        let (taken, given) = (energy.taken.iter().sum::<f64>(), energy.given.iter().sum::<f64>());
        writeln!(
            f,
            "energy: the hand gave {taken:.2e} J, was lent {:.2e} J by the controller, and received {given:.2e} J; \
             {:.2e} J are stored, {:.2e} J were dissipated ({:.2e} J of them by passivity control)",
            energy.lent,
            energy.stored,
            energy.dissipated(),
            energy.damped
        )?;
        let [played, contact] = report.end.map(|wrench| wrench.force.length());
        writeln!(
            f,
            "force at the end: {played:.4} N played, {contact:.4} N from contacts; greatest played force {:.4} N",
            report.peak_force
        )?;
        if let Some(overestimate) = report.overestimate() {
            writeln!(
                f,
                "from one wrench to the next, the local model foretold {overestimate:.2} times the change of contact force"
            )?;
        }
        writeln!(f, "events: {}", told(&report.events))?;
        report.ended.iter().try_for_each(|reason| writeln!(f, "ended early: {reason}"))
    }
}

/// For each event that happened: the words for it, how often it began, and the number of ticks in which it was present.
pub fn happened(events: &EventCounts) -> impl Iterator<Item = (&'static Explanation, u64, u64)> {
    let happened =
        Event::ALL.into_iter().map(|(event, _)| (event.explained(), events.begun(event), events.ticks(event)));
    happened.filter(|(_, begun, _)| *begun > 0)
}

/// How often something happened, in words.
pub fn times(count: u64) -> String {
    if count == 1 { "once".into() } else { format!("{count} times") }
}

fn told(events: &EventCounts) -> String {
    let told: Vec<String> = happened(events)
        .map(|(words, begun, ticks)| {
            format!("{}: {}, in {ticks} tick{} in all", words.title, times(begun), if ticks == 1 { "" } else { "s" })
        })
        .collect();
    if told.is_empty() { "none".into() } else { told.join("; ") }
}
