//! The sections of the haptics report about the stiffest wall that the haptic loop renders without oscillating. The
//! stiffness of that wall is called the limit; Gil's bound is the stiffness of the stiffest wall that is stable by the
//! theory of Gil and others.

use palpate::Result;
use palpate::internal::haptics::local_model::in_series;

use super::{range, span};
use crate::haptics::width::{RANGE, STILL, STILL_SHARE, dissipation};
use crate::haptics::{Limit, Width};
use crate::plot::{Line, Logarithmic, Panel, panels};
use crate::{Section, Table};

/// A limit counts as beyond the range of walls that were tried if it is at least this share of the greatest stiffness
/// that was tried.
const END: f64 = 0.999;

/// Whether the limit `stiffness` (N/m) is beyond the range of walls that were tried.
fn is_above(stiffness: f64) -> bool {
    stiffness >= END * RANGE[1]
}

fn newtons_a_metre(stiffness: f64) -> String {
    match stiffness {
        k if k <= 0.0 => "none".into(),
        k if is_above(k) => format!("> {:.0}", RANGE[1]),
        k => format!("{k:.0}"),
    }
}

fn from_to(limits: impl Iterator<Item = f64> + Clone) -> String {
    range(limits, newtons_a_metre)
}

/// The section about how the limit depends on the wall's damping.
pub fn widths(widths: &[Width]) -> Result<Section> {
    let heads =
        ["device", "coupling", "wall's damping", "in a session", "no passivity control", "raw force", "felt, raw"];
    let mut table = Table::new(heads.into_iter().chain(["Colgate"]));
    for w in widths {
        table.rows.push(vec![
            w.profile.clone(),
            format!("{:.0}", w.coupling),
            format!("{:.0}", w.damping),
            newtons_a_metre(w.session),
            newtons_a_metre(w.local),
            newtons_a_metre(w.raw),
            format!("{:.0}", in_series(w.raw, 1.0 / w.coupling)),
            newtons_a_metre(w.colgate),
        ]);
    }
    let of_device = |group: &[Width]| {
        let line = |name: &str, of: fn(&Width) -> f64| Line {
            name: name.into(),
            points: group.iter().map(|w| (dissipation() + w.damping, of(w))).collect(),
            ..Line::default()
        };
        let lines = vec![line("session", |w| w.session), line("raw", |w| w.raw), line("Colgate", |w| w.colgate)];
        Panel { title: group.first().map_or("", |w| &w.profile).into(), lines }
    };
    let drawn: Vec<Panel> = widths.chunk_by(|a, b| a.profile == b.profile).map(of_device).collect();
    let axes = Logarithmic { x: "damping of hand, device and wall, N s/m", y: "stiffest wall, N/m", level: None };
    Ok(Section {
        title: "How stiff a wall may be, by the wall's damping".into(),
        question: format!(
            "Which is the stiffest wall (N/m, from {:.0} to {:.0}) whose force stays still after a press? Still: over \
             the last of four seconds the force varies by no more than {:.0} % or {STILL} N, its oscillation does not \
             grow, and it has not vanished. Damping is in N s/m; the simulation runs at 1 kHz. `raw force`: the \
             newest wrench's, unchanged until the next. `felt`: coupling and wall in series. `Colgate`: the passivity \
             limit of a wall that is sampled at 1 kHz without a coupling.",
            RANGE[0],
            RANGE[1],
            1e2 * STILL_SHARE
        ),
        table,
        plot: Some(panels(&axes, &drawn)?),
        finding: width_finding(widths),
        ..Section::default()
    })
}

fn width_finding(widths: &[Width]) -> String {
    let of = |limit: fn(&Width) -> f64| {
        let above = widths.iter().filter(|w| is_above(limit(w))).count();
        format!("{} ({above} of {} beyond the range)", from_to(widths.iter().map(limit)), widths.len())
    };
    format!(
        "The stiffest wall is, in N/m: {} in a session, {} without passivity control, {} with the raw force; in \
         series with the coupling, as the hand feels it, the last is {}.",
        of(|w| w.session),
        of(|w| w.local),
        of(|w| w.raw),
        range(widths.iter().map(|w| in_series(w.raw, 1.0 / w.coupling)), |k| format!("{k:.0}"))
    )
}

/// The section about how the limit depends on the delay of the force.
pub fn delays(limits: &[Limit]) -> Result<Section> {
    let x = |limit: &Limit| 1e3 * limit.delay + 0.5;
    Ok(Section {
        title: "How stiff a wall may be, by the force's delay".into(),
        question: "How much does a transport delay between the loop and the device cost? The wall has no damping, and \
                   passivity control is off. `local model`: the session's force law between wrenches; `raw force`: \
                   the newest wrench's, unchanged until the next. `Gil`: the stability limit of a wall without a \
                   coupling at this delay, K = b / (T / 2 + delay); `felt`: coupling and stiffest wall in series."
            .into(),
        table: table(limits, "delay, ms", |limit| format!("{:.0}", 1e3 * limit.delay)),
        plot: Some(plot(limits, "delay and half a tick, ms", x)?),
        finding: limits_finding(limits, |limit| format!("{:.0} ms", 1e3 * limit.delay)),
        ..Section::default()
    })
}

/// The section about how the limit depends on the rate of the simulation.
pub fn rates(limits: &[Limit]) -> Result<Section> {
    Ok(Section {
        title: "How stiff a wall may be, by the simulation's rate".into(),
        question: "How much does a slow simulation cost, whose wrench arrives one interval after its step began? The \
                   wall has no damping, and passivity control is off. `local model`: the session's force law between \
                   wrenches; `raw force`: the newest wrench's, unchanged until the next. `Colgate`: the passivity \
                   limit of a wall sampled at that rate; `Gil`: the stability limit of a wall whose force is one \
                   interval late, K = b / (3/2 T)."
            .into(),
        table: table(limits, "rate, Hz", |limit| format!("{:.0}", limit.rate)),
        plot: Some(plot(limits, "rate of the simulation, Hz", |limit| limit.rate)?),
        finding: limits_finding(limits, |limit| format!("{:.0} Hz", limit.rate)),
        ..Section::default()
    })
}

fn table(limits: &[Limit], head: &str, of: impl Fn(&Limit) -> String) -> Table {
    let mut table = Table::new(["device", head, "local model", "raw force", "felt", "felt, raw", "Colgate", "Gil"]);
    for limit in limits {
        let felt = |wall: f64| format!("{:.0}", in_series(wall, 1.0 / limit.coupling));
        table.rows.push(vec![
            limit.profile.clone(),
            of(limit),
            newtons_a_metre(limit.local),
            newtons_a_metre(limit.raw),
            felt(limit.local),
            felt(limit.raw),
            format!("{:.0}", limit.colgate),
            format!("{:.0}", limit.gil),
        ]);
    }
    table
}

fn plot(limits: &[Limit], x: &str, at: impl Fn(&Limit) -> f64) -> Result<String> {
    let of_device = |group: &[Limit]| {
        let line = |name: &str, of: fn(&Limit) -> f64| Line {
            name: name.into(),
            points: group.iter().map(|limit| (at(limit), of(limit))).collect(),
            ..Line::default()
        };
        let lines = vec![line("local", |l| l.local), line("raw", |l| l.raw), line("Gil", |l| l.gil)];
        Panel { title: group.first().map_or("", |limit| &limit.profile).into(), lines }
    };
    let drawn: Vec<Panel> = limits.chunk_by(|a, b| a.profile == b.profile).map(of_device).collect();
    panels(&Logarithmic { x, y: "stiffest wall, N/m", level: None }, &drawn)
}

/// Text that gives the limits in the easiest and in the hardest case (the cases with the greatest and with the least of
/// Gil's bounds), and says how all limits compare with Gil's bounds.
fn limits_finding(limits: &[Limit], of: impl Fn(&Limit) -> String) -> String {
    let Some((low, high)) = span(limits.iter().map(|limit| limit.gil)) else { return "nothing was measured.".into() };
    let at = |gil: f64| {
        let group: Vec<&Limit> = limits.iter().filter(|limit| limit.gil == gil).collect();
        let name = group.first().map_or_else(String::new, |limit| of(limit));
        let [local, raw] = [|l: &Limit| l.local, |l: &Limit| l.raw].map(|f| from_to(group.iter().map(|l| f(l))));
        format!("at {name} {local} with the local model and {raw} with the raw force")
    };
    let better = limits.iter().filter(|l| l.local > l.raw).count();
    let worse = limits.iter().filter(|l| l.local < l.raw).count();
    let below = |of: fn(&Limit) -> f64| limits.iter().filter(|l| of(l) < l.gil).count();
    let [with, without] = [below(|l| l.local), below(|l| l.raw)];
    format!(
        "The stiffest wall is, in N/m, {}, {}. The local model allows more than the raw force in {better} of {} cases \
         and less in {worse}. Limits below Gil's bound: {with} with the local model, {without} with the raw force.",
        at(high),
        at(low),
        limits.len()
    )
}
