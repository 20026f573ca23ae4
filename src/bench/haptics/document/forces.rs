//! Forces held, and forces while sliding.

use super::range;
use crate::Result;
use crate::bench::haptics::hold::WITHIN;
use crate::bench::haptics::slide::{ALLOWED, ALLOWED_SHARE, SPEED, WAY};
use crate::bench::haptics::width::{STILL, STILL_SHARE};
use crate::bench::haptics::{Change, Changes, Held, Met, Mode, Slid};
use crate::bench::plot::{Axis, Line, Logarithmic, Panel, lines, panels};
use crate::bench::{Section, Table};

/// What is less is drawn there, N.
const DRAWN: f64 = 1e-6;
/// Points of the slide that are drawn.
const POINTS: usize = 60;

fn name_of(met: Met) -> String {
    match met {
        Met::Wall(stiffness) => format!("wall, {stiffness:.0} N/m"),
        Met::Head => "head".into(),
    }
}

/// Forces held.
pub fn holds(holds: &[Held]) -> Result<Section> {
    let mut table = Table::new(["against", "device", "rate, Hz"]);
    for (_, name) in Mode::ALL {
        table.heads.extend([format!("{name}: N"), "noise, mN".into(), "swing, mN".into()]);
    }
    table.heads.extend(["reading's swing, um", "encoder's step, mN"].map(Into::into));
    for group in holds.chunk_by(|a, b| a.met == b.met && a.profile == b.profile && a.rate == b.rate) {
        let Some(first) = group.first() else { continue };
        let mut row = vec![name_of(first.met), first.profile.into(), format!("{:.0}", first.rate)];
        for (mode, _) in Mode::ALL {
            match group.iter().find(|held| held.mode == mode).map(|held| held.force) {
                Some(f) => row.extend([
                    format!("{:.3}", f.mean),
                    format!("{:.2}", 1e3 * f.deviation),
                    format!("{:.2}", 1e3 * f.swing),
                ]),
                None => row.extend([(); 3].map(|()| String::new())),
            }
        }
        row.extend([format!("{:.0}", 1e6 * first.reading.swing), format!("{:.1}", 1e3 * first.quantum_force)]);
        table.rows.push(row);
    }
    let axes = Logarithmic { x: "rate of the simulation, Hz", y: "noise, N", level: Some(STILL) };
    let drawn: Vec<Panel> = holds.chunk_by(|a, b| a.met == b.met).map(noise).collect();
    Ok(Section {
        title: "How still a held force keeps".into(),
        question: format!(
            "How much noise is in the force of a person who means to be {:.0} mm deep, over the last of three seconds? Allowed \
             are {:.0} % of the force or {STILL} N; `noise` is its standard deviation, `swing` from the least to the greatest, \
             both of all axes together. The reading's swing is that of the device in a session, and the encoder's step what \
             one of its quanta is worth by the coupling. In the plots the worst of all devices; what is below {DRAWN:.0e} N is \
             drawn there.",
            1e3 * WITHIN,
            1e2 * STILL_SHARE
        ),
        table,
        plot: Some(("hold.svg".into(), panels(&axes, &drawn)?)),
        finding: hold_finding(holds),
    })
}

/// The worst of all devices by rate, a line each mode; rates as they come.
fn noise(holds: &[Held]) -> Panel {
    let line = |(mode, name): (Mode, &str)| {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for held in holds.iter().filter(|held| held.mode == mode && held.is_there()) {
            let noise = held.force.deviation.max(DRAWN);
            match points.iter_mut().find(|point| point.0 == held.rate) {
                Some(point) => point.1 = point.1.max(noise),
                None => points.push((held.rate, noise)),
            }
        }
        Line { name: name.split(' ').next_back().unwrap_or(name).into(), points }
    };
    Panel { title: holds.first().map(|held| name_of(held.met)).unwrap_or_default(), lines: Mode::ALL.map(line).into() }
}

fn hold_finding(holds: &[Held]) -> String {
    let of = |(mode, name): (Mode, &str)| {
        let all: Vec<&Held> = holds.iter().filter(|held| held.mode == mode).collect();
        let still = all.iter().filter(|held| held.is_still()).count();
        let gone = all.iter().filter(|held| !held.is_there()).count();
        let gone = if gone > 0 { format!(", and {gone} are left without a force") } else { String::new() };
        let worst = all.iter().max_by(|a, b| a.force.deviation.total_cmp(&b.force.deviation));
        let worst = worst.map_or_else(String::new, |held| {
            let Held { met, profile, rate, force, .. } = held;
            let at = format!("{}, {profile}, {rate:.0} Hz", name_of(*met));
            format!(" (the noisiest {:.2} mN of {:.2} N: {at})", 1e3 * force.deviation, force.mean)
        });
        format!("{name} {still} of {}{worst}{gone}", all.len())
    };
    format!("Still enough are: {}.", Mode::ALL.map(of).join("; "))
}

/// Forces while sliding.
pub fn slides(slides: &[Slid]) -> Result<Section> {
    let mut table = Table::new(["device", "rate, Hz", "loop", "force, N"]);
    for phase in ["touch", "slide"] {
        table.heads.extend(["played", "contact", "raw wrench"].map(|what| format!("{phase}: {what}, mN (%)")));
    }
    for slid in slides {
        let name = Mode::ALL.iter().find(|(mode, _)| *mode == slid.mode).map_or("", |(_, name)| name);
        let cell = |c: &Change| format!("{:.1} ({:.1})", 1e3 * c.newtons, percent(c));
        let mut row =
            vec![slid.profile.into(), format!("{:.0}", slid.rate), name.into(), format!("{:.2}", slid.force.mean)];
        for changes in [&slid.touch, &slid.slide] {
            row.extend([&changes.played, &changes.contact, &changes.raw].map(cell));
        }
        table.rows.push(row);
    }
    Ok(Section {
        title: "How far the force jumps while sliding over the head".into(),
        question: format!(
            "A person presses the sphere into the cheek of the head of touch-head and slides {:.0} mm along it at {:.0} mm/s, a \
             step of the engine being as long as the interval between steps. Which change of the force is the furthest beyond \
             the allowed {:.0} % of the force or {ALLOWED} N (in brackets: of the force there)? Played force and contact from \
             one tick to the next; the raw wrench, which is kept between steps, from one step to the next. `touch` is all \
             before the slide, first contact among it. Drawn is the end of the first slide.",
            1e3 * WAY,
            1e3 * SPEED,
            1e2 * ALLOWED_SHARE
        ),
        table,
        plot: slides.first().map(|slid| Ok(("slide.svg".into(), trace(slid)?))).transpose()?,
        finding: slide_finding(slides),
    })
}

fn percent(change: &Change) -> f64 {
    if change.force > 0.0 { 1e2 * change.newtons / change.force } else { 0.0 }
}

fn trace(slid: &Slid) -> Result<String> {
    let last = &slid.trace[slid.trace.len().saturating_sub(POINTS)..];
    let line = |k: usize, name: &str| Line {
        name: name.into(),
        points: last.iter().map(|point| (point[0] - last[0][0], point[k])).collect(),
    };
    let axis = Axis { label: format!("time, s ({} at {:.0} Hz)", slid.profile, slid.rate), names: Vec::new() };
    lines(&axis, "force, N", &[line(1, "played"), line(2, "contact"), line(3, "raw")])
}

fn slide_finding(slides: &[Slid]) -> String {
    let of = |(mode, name): (Mode, &str)| {
        let all: Vec<&Slid> = slides.iter().filter(|slid| slid.mode == mode).collect();
        let gone = all.iter().filter(|slid| slid.force.mean < crate::bench::haptics::hold::LEAST).count();
        let phase = |what: &str, of: fn(&Slid) -> &Changes| {
            let worst = all.iter().map(|slid| of(slid).played).max_by(|a, b| a.excess.total_cmp(&b.excess));
            let Change { newtons, excess, .. } = worst.unwrap_or_default();
            let share = percent(&worst.unwrap_or_default());
            let verdict = if excess <= 1.0 { "within" } else { "beyond" };
            format!("{:.1} mN ({share:.1} %) while {what}, {verdict} what is allowed", 1e3 * newtons)
        };
        let gone = if gone > 0 { format!(", {gone} of {} without a force", all.len()) } else { String::new() };
        format!(
            "{name} at worst {} and {}{gone}",
            phase("touching", |slid| &slid.touch),
            phase("sliding", |slid| &slid.slide)
        )
    };
    let raw = range(slides.iter().map(|slid| 1e3 * slid.slide.raw.newtons), |x| format!("{x:.1}"));
    format!(
        "The played force changes: {}. The raw wrench jumps by {raw} mN while sliding.",
        Mode::ALL.map(of).join("; ")
    )
}
