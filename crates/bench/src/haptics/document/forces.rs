//! The sections of the haptics report about forces while a simulated person holds still, and about forces while
//! sliding. A tick is one iteration of the haptic loop; a wrench is the contact wrench that a simulation step finds.

use palpate::Result;

use super::range;
use crate::haptics::hold::{WITHIN, is_still, is_there};
use crate::haptics::slide::{ALLOWED, ALLOWED_SHARE, SPEED, WAY};
use crate::haptics::width::{STILL, STILL_SHARE};
use crate::haptics::{Change, Changes, HoldResult, Met, Mode, Slid, Spread};
use crate::plot::{Axis, Line, Logarithmic, Panel, lines, panels};
use crate::{Section, Table};

/// Noise (standard deviation of a force) below this value is drawn at this value, N, since the axis is logarithmic.
const DRAWN: f64 = 1e-6;
/// Greatest number of points that the plot of a slide shows; earlier points are left out.
const POINTS: usize = 60;

fn name_of(met: Met) -> String {
    match met {
        Met::Wall(stiffness) => format!("wall, {stiffness:.0} N/m"),
        Met::Head => "head".into(),
    }
}

fn quantum([stiffness, damping]: &[f64; 2]) -> String {
    format!("{:.0} + {:.0}", 1e3 * stiffness, 1e3 * damping)
}

/// The section about held forces: how much noise they contain.
pub fn holds(holds: &[HoldResult]) -> Result<Section> {
    let mut table = Table::new(["against", "device", "rate, Hz"]);
    for (_, name) in Mode::ALL {
        table.heads.extend([
            format!("{name}: mean force, N"),
            "its standard deviation (range), mN".into(),
            "the same, device without friction, mN".into(),
        ]);
    }
    table.heads.extend(["range of the position read, um", "force of an encoder's step, mN"].map(Into::into));
    for group in holds.chunk_by(|a, b| a.met == b.met && a.profile == b.profile && a.rate == b.rate) {
        let Some(first) = group.first() else { continue };
        let mut row = vec![name_of(first.met), first.profile.clone(), format!("{:.0}", first.rate)];
        for (mode, _) in Mode::ALL {
            let noise = |f: Spread| format!("{:.2} ({:.2})", 1e3 * f.deviation, 1e3 * f.swing);
            let hold_result = group.iter().find(|hold_result| hold_result.mode == mode);
            row.push(hold_result.map_or_else(String::new, |hold_result| format!("{:.3}", hold_result.force.mean)));
            row.push(hold_result.map_or_else(String::new, |hold_result| noise(hold_result.force)));
            row.push(hold_result.and_then(|hold_result| hold_result.no_friction).map_or_else(String::new, noise));
        }
        row.extend([format!("{:.0}", 1e6 * first.reading.swing), quantum(&first.quantum_forces)]);
        table.rows.push(row);
    }
    let axes = Logarithmic { x: "rate of the simulation, Hz", y: "noise, N", level: Some(STILL) };
    let drawn: Vec<Panel> = holds.chunk_by(|a, b| a.met == b.met).map(noise).collect();
    Ok(Section {
        title: "How still a held force is".into(),
        question: format!(
            "How much noise is in the force when a person means to press {:.0} mm deep, over the last of three \
             seconds? Allowed are {:.0} % of the force or {STILL} N. The range goes from the least to the greatest \
             value; it and the standard deviation are over all axes together. `without friction` gives \
             both for a device without friction for the hand to rest in, against walls only. The position read is \
             the device's, as the loop reads it in the mode `as in a session`. An encoder's step is one quantum of \
             its readings: by the coupling's stiffness + by its damping over a tick. The plots show the worst of all \
             devices; values below {DRAWN:.0e} N are drawn there.",
            1e3 * WITHIN,
            1e2 * STILL_SHARE
        ),
        table,
        plot: Some(panels(&axes, &drawn)?),
        finding: hold_finding(holds),
        ..Section::default()
    })
}

/// A plot with a line for each mode (way in which the loop uses wrenches): the noise of the noisiest held force among
/// all haptic devices, against the rate of the simulation.
fn noise(holds: &[HoldResult]) -> Panel {
    let short = [(Mode::Session, "session"), (Mode::Local, "local"), (Mode::Raw, "raw")];
    let line = |(mode, name)| {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for hold_result in holds.iter().filter(|hold_result| hold_result.mode == mode && is_there(&hold_result.force)) {
            let noise = hold_result.force.deviation.max(DRAWN);
            match points.iter_mut().find(|point| point.0 == hold_result.rate) {
                Some(point) => point.1 = point.1.max(noise),
                None => points.push((hold_result.rate, noise)),
            }
        }
        Line { name: String::from(name), points, ..Line::default() }
    };
    Panel {
        title: holds.first().map(|hold_result| name_of(hold_result.met)).unwrap_or_default(),
        lines: short.map(line).into(),
    }
}

fn hold_finding(holds: &[HoldResult]) -> String {
    let of = |(mode, name): (Mode, &str)| {
        let all = || holds.iter().filter(move |hold_result| hold_result.mode == mode);
        let [own, slippery] =
            [|hold_result: &HoldResult| Some(hold_result.force), |hold_result: &HoldResult| hold_result.no_friction]
                .map(|of| {
                    judged(&all().filter_map(|hold_result| Some((hold_result, of(hold_result)?))).collect::<Vec<_>>())
                });
        format!("{name} {own}; without friction {slippery}")
    };
    format!("Number of forces that are still enough: {}.", Mode::ALL.map(of).join("; "))
}

/// Says how many of the forces are still (have no more noise than is allowed), which force is the noisiest, and how
/// many forces have vanished.
fn judged(forces: &[(&HoldResult, Spread)]) -> String {
    let still = forces.iter().filter(|(_, force)| is_still(force)).count();
    let there = || forces.iter().filter(|(_, force)| is_there(force));
    let gone = forces.len() - there().count();
    let gone = if gone > 0 { format!(", {gone} left without a force") } else { String::new() };
    let worst = there().max_by(|a, b| a.1.deviation.total_cmp(&b.1.deviation));
    let worst = worst.map_or_else(String::new, |(hold_result, force)| {
        let at = format!("{}, {}, {:.0} Hz", name_of(hold_result.met), hold_result.profile, hold_result.rate);
        format!(" (the noisiest {:.2} mN of {:.2} N: {at})", 1e3 * force.deviation, force.mean)
    });
    format!("{still} of {}{worst}{gone}", forces.len())
}

/// The section about forces while sliding: how much they change from one tick to the next.
pub fn slides(slides: &[Slid]) -> Result<Section> {
    let mut table = Table::new(["device", "rate, Hz", "loop", "force, N"]);
    for phase in ["touch", "slide"] {
        table.heads.extend(
            ["force played", "local model's contact force", "simulated wrench"]
                .map(|what| format!("{phase}: {what}, mN (%)")),
        );
    }
    for slid in slides {
        let cell = |c: &Change| format!("{:.1} ({:.1})", 1e3 * c.newtons, percent(c));
        let mut row = vec![
            slid.profile.clone(),
            format!("{:.0}", slid.rate),
            slid.mode.name().into(),
            format!("{:.2}", slid.force.mean),
        ];
        for changes in [&slid.touch, &slid.slide] {
            row.extend([&changes.played, &changes.contact, &changes.raw].map(cell));
        }
        row.push(quantum(&slid.quantum_forces));
        table.rows.push(row);
    }
    table.heads.push("encoder's step, mN".into());
    Ok(Section {
        title: "How far the force jumps while sliding over the head".into(),
        question: format!(
            "A person presses the sphere into the cheek of the head of `touch-head.toml` and slides {:.0} mm along it \
             at {:.0} mm/s; each step simulates the time that passes until the next one starts. Which change of the \
             force exceeds most the allowed {:.0} % of the force or {ALLOWED} N (in brackets: % of the force at that time)? \
             The played force and the contact force of the local model are compared from one tick to the next; the \
             simulated wrench, which is kept between steps, from one step to the next. `touch` is the time before the \
             slide, with the first contact. The plot shows the end of the first slide.",
            1e3 * WAY,
            1e3 * SPEED,
            1e2 * ALLOWED_SHARE
        ),
        table,
        plot: slides.first().map(trace).transpose()?,
        finding: slide_finding(slides),
        ..Section::default()
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
        ..Line::default()
    };
    let axis = Axis { label: format!("time, s ({} at {:.0} Hz)", slid.profile, slid.rate), names: Vec::new() };
    lines(&axis, "force, N", &[line(1, "played"), line(2, "contact"), line(3, "raw")])
}

fn slide_finding(slides: &[Slid]) -> String {
    let of = |(mode, name): (Mode, &str)| {
        let all: Vec<&Slid> = slides.iter().filter(|slid| slid.mode == mode).collect();
        let there: Vec<&&Slid> = all.iter().filter(|slid| is_there(&slid.force)).collect();
        let phase = |what: &str, of: fn(&Slid) -> &Changes| {
            let worst =
                there.iter().map(|slid| (of(slid).played, slid)).max_by(|a, b| a.0.excess.total_cmp(&b.0.excess))?;
            let (change, slid) = worst;
            let kept = there.iter().filter(|slid| of(slid).played.excess <= 1.0).count();
            let at = format!("{}, {:.0} Hz", slid.profile, slid.rate);
            let (newtons, share) = (1e3 * change.newtons, percent(&change));
            Some(format!("{kept} of {} while {what} (at worst {newtons:.1} mN, {share:.1} %: {at})", all.len()))
        };
        let phases = [phase("touching", |slid| &slid.touch), phase("sliding", |slid| &slid.slide)];
        let gone = all.len() - there.len();
        let gone = (gone > 0).then(|| format!("{gone} of {} left without a force", all.len()));
        format!("{name} {}", phases.into_iter().flatten().chain(gone).collect::<Vec<_>>().join(", "))
    };
    let raw = range(slides.iter().map(|slid| 1e3 * slid.slide.raw.newtons), |x| format!("{x:.1}"));
    let all = Mode::ALL.map(of).join("; ");
    format!(
        "Changes of the played force are within what is allowed in: {all}. The simulated wrench jumps by {raw} mN \
         while sliding."
    )
}
