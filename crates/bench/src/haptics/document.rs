//! The report of the haptics benchmark, made from its [`Results`]. All numbers of the report's findings (the sentences
//! that answer a section's question) are computed from the measurements. A tick is one iteration of the haptic loop.

mod between;
mod controllers;
mod forces;
mod walls;

use palpate::Result;
use palpate_devices::hand::HandParameters;
use serde_json::Value;

use super::jitter::{Late, MORE};
use super::width::CRITICAL;
use super::{Punctual, Results};
use crate::plot::{Bar, bars};
use crate::{Section, Table};

/// Text that says how the benchmark was measured.
pub fn preface(_: &Value) -> String {
    let HandParameters { mass, stiffness, damping, device_damping, friction, .. } = HandParameters::default();
    format!(
        "The haptic loop ticks at 1 kHz with the gains that a session would choose for the device. A simulated hand \
         holds the device ({mass} kg; arm of {stiffness} N/m and {damping} N s/m; device of {device_damping} N s/m and \
         {friction} N of friction; encoders of the profile's resolution). Everything is simulated in virtual time, so that every \
         run gives the same numbers. Against walls, the limit of oscillation is found with a hand that dissipates \
         little: the arm has {} N s/m, the device {} N s/m, without friction or encoders. Only the lateness of ticks is measured in real \
         time.",
        CRITICAL.damping, CRITICAL.device_damping
    )
}

/// A section for each part that was measured.
pub fn sections(results: &Results) -> Result<Vec<Section>> {
    let mut sections = Vec::new();
    if !results.widths.is_empty() {
        sections.push(walls::widths(&results.widths)?);
    }
    if !results.delays.is_empty() {
        sections.push(walls::delays(&results.delays)?);
    }
    if !results.rates.is_empty() {
        sections.push(walls::rates(&results.rates)?);
    }
    if !results.holds.is_empty() {
        sections.push(forces::holds(&results.holds)?);
    }
    if !results.slides.is_empty() {
        sections.push(forces::slides(&results.slides)?);
    }
    if !results.between.is_empty() {
        sections.push(between::between(&results.between)?);
    }
    if !results.controllers.is_empty() {
        sections.push(controllers::controllers(&results.controllers)?);
    }
    if !results.jitter.is_empty() {
        sections.push(jitter(&results.jitter)?);
    }
    Ok(sections)
}

/// The least and the greatest of the numbers; `None` if there are none.
fn span(numbers: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    numbers.fold(None, |span, x| match span {
        None => Some((x, x)),
        Some((low, high)) => Some((low.min(x), high.max(x))),
    })
}

/// The least and the greatest of the numbers as text, in the form `1 to 2`; if both give the same text, this text once.
fn range(numbers: impl Iterator<Item = f64>, text: impl Fn(f64) -> String) -> String {
    let Some((low, high)) = span(numbers) else { return "nothing".into() };
    let (low, high) = (text(low), text(high));
    if low == high { low } else { format!("{low} to {high}") }
}

fn jitter(sessions: &[Punctual]) -> Result<Section> {
    let mut table = Table::new(["thread", "load", "ticks", "median, us", "p99, us", "p99.9, us", "worst, us"]);
    table.heads.extend(["missed", "missed, %", "steps", "wrench out of date by, ms", "p99, ms"].map(Into::into));
    let mut drawn = Vec::new();
    for session in sessions {
        let what = if session.is_loaded { "simulating touch-head" } else { "no load" };
        for (kind, (name, late)) in
            [("loop", Some(session.servo)), ("bare timer", session.bare)].into_iter().enumerate()
        {
            let Some(late) = late else { continue };
            let us = |time: f64| format!("{:.0}", 1e6 * time);
            let mut row = vec![name.into(), what.into(), late.ticks.to_string()];
            row.extend([late.median, late.p99, late.p999, late.worst].map(us));
            row.extend([late.missed.to_string(), format!("{:.3}", 1e2 * late.share_missed), session.steps.to_string()]);
            row.extend(session.age.map(|age| format!("{:.1}", 1e3 * age)));
            table.rows.push(row);
            drawn.push(Bar { name: format!("{name}, {what}"), length: 1e6 * late.p999, kind });
        }
    }
    Ok(Section {
        title: "How punctual the loop's ticks are".into(),
        question: format!(
            "How late are ticks, and how many deadlines are missed by more than 2 ms? For comparison, a thread that \
             only waits (the bare timer) wakes at the same deadlines in the same run; the loop may miss that thread's \
             share and {:.1} % more. Under load the engine simulates without pause; the device follows a script. The \
             plot shows the 99.9th percentile.",
            1e2 * MORE
        ),
        table,
        plot: Some(bars("lateness, us", &drawn)?),
        finding: jitter_finding(sessions),
        ..Section::default()
    })
}

fn jitter_finding(sessions: &[Punctual]) -> String {
    let of = |session: &Punctual| {
        let what = if session.is_loaded { "While the scene touch-head is simulated" } else { "Without load" };
        let Late { p99, worst, share_missed, .. } = session.servo;
        let own = format!(
            "{what} 99 of 100 ticks come within {:.0} us, the latest {:.1} ms late, and {:.3} % of the deadlines are missed",
            1e6 * p99,
            1e3 * worst,
            1e2 * share_missed
        );
        let bare = session.bare.map_or_else(String::new, |bare| {
            let verdict = if session.is_punctual() { "within" } else { "beyond" };
            let share = 1e2 * bare.share_missed;
            format!(
                " ({verdict} what is allowed: a bare timer misses {share:.3} %, with 99 of 100 ticks within {:.0} us)",
                1e6 * bare.p99
            )
        });
        own + &bare + "."
    };
    sessions.iter().map(of).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
#[path = "document_tests.rs"]
mod tests;
