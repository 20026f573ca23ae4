//! Makes `report.html`, the page of a run, which needs no other files and no scripts. Flags (marks of what went wrong
//! in a step) come first, then what the tool (the rigid body that the haptic device leads) felt, with pictures and
//! curves, then the session (one run of the haptic loop with a device), then what the run cost, then how to repeat the
//! run.

use std::fmt::Write;

use data_encoding::BASE64;
use palpate::internal::haptics::session::Report;
use palpate::{Explanation, Result, Scene};
use palpate_page::page::{escaped, figure, set, table, whole};
use palpate_page::plot::{self, Curve};
use palpate_page::{Reduced, Table};

use super::curves::{CONTACTS, Curves, FORCE, INDENTATION, ITERATIONS};
use super::felt::{self, Distance};
use super::haptics::{happened, times};
use super::summary::{Facts, Tally, quantiles};

/// All that the page is made from.
pub struct Page<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// What the engine reports of itself: Vulkan device, stages, memory and files.
    pub facts: &'a Facts,
    /// Sums and extremes over the step reports of the run.
    pub tally: &'a Tally,
    /// The curves of force, indentation, contacts and iterations over the steps.
    pub curves: &'a Curves,
    /// The force (N) over time (s) on each tool after the first, in the scene's order.
    pub further_forces: &'a [Reduced<1>],
    /// What each haptic device of a session did; empty if the run had none.
    pub sessions: &'a [Session<'a>],
    /// How a signal cut the run short, in words.
    pub interrupted: Option<&'a str>,
    /// The body that was nearest to the tool at the end, if the tool never touched anything.
    pub nearest: Option<&'a Distance>,
    /// Pictures of the state at the end of the run, or the reason why there are none.
    pub pictures: std::result::Result<&'a [Shot], &'a str>,
    /// The command line of the run.
    pub command: &'a str,
}

/// What the page tells of a session with a haptic device.
pub struct Session<'a> {
    /// What the haptic loop reports.
    pub report: &'a Report,
    /// The force played (commanded to the device), N, over the time since the haptic loop began, s.
    pub played: &'a Reduced<1>,
}

/// A picture.
pub struct Shot {
    /// The image as a PNG file.
    pub png: Vec<u8>,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// What the picture shows, in words.
    pub caption: &'static str,
}

impl Page<'_> {
    /// The page as HTML.
    pub fn html(&self) -> Result<String> {
        let mut body = String::from("<div class=\"run\">\n");
        self.write_flags(&mut body);
        self.write_felt(&mut body);
        self.write_pictures(&mut body);
        self.write_curves(&mut body)?;
        for session in self.sessions {
            session.write(&mut body)?;
        }
        self.write_cost(&mut body);
        self.write_run(&mut body);
        body.push_str("</div>\n");
        Ok(whole(&format!("palpate: {}", self.scene.name()), &body))
    }

    fn write_flags(&self, body: &mut String) {
        let ended = self.sessions.first().and_then(|session| session.report.ended.as_deref());
        let raised: Vec<_> = self.tally.raised().collect();
        if raised.is_empty() && ended.is_none() && self.interrupted.is_none() {
            return;
        }
        body.push_str("<section class=\"flags\">\n<h2>What went wrong</h2>\n");
        for (words, count) in raised {
            paragraph(body, words, &format!("in {count} of {} steps", self.tally.steps));
        }
        if let Some(how) = self.interrupted {
            let _ = writeln!(body, "<p><b>The run was {}</b>.</p>", escaped(how));
        }
        if let Some(reason) = ended {
            let _ = writeln!(body, "<p><b>The session ended early</b>: {}</p>", escaped(reason));
        }
        body.push_str("</section>\n");
    }

    fn write_felt(&self, body: &mut String) {
        let _ = writeln!(body, "<p class=\"finding headline\">{}</p>", set(&felt::headline(self.tally)));
        if let Some(remedy) = felt::remedy(self.tally, felt::advice(self.scene), self.nearest) {
            let _ = writeln!(body, "<p>{}</p>", escaped(&remedy));
        }
        if self.tally.raised().next().is_none() {
            body.push_str("<p>No step raised a flag.</p>\n");
        }
    }

    fn write_pictures(&self, body: &mut String) {
        match self.pictures {
            Err(reason) => drop(writeln!(body, "<p>{}</p>", set(reason))),
            Ok(shots) => {
                body.push_str("<div class=\"plots\">\n");
                for Shot { png, size: [width, height], caption } in shots {
                    let caption = escaped(caption);
                    let _ = writeln!(
                        body,
                        "<figure><img width=\"{width}\" height=\"{height}\" alt=\"{caption}\" \
                         src=\"data:image/png;base64,{}\"/><figcaption>{caption}</figcaption></figure>",
                        BASE64.encode(png)
                    );
                }
                body.push_str("</div>\n");
            }
        }
    }

    fn write_curves(&self, body: &mut String) -> Result<()> {
        let curves = self.curves;
        let felt = self.tally.touch.as_ref().map(|touch| touch.felt()).filter(|felt| felt.touched);
        let time = "simulated time, s";
        body.push_str("<h2>Over time</h2>\n");
        if felt.is_some() {
            let _ = writeln!(body, "<p>Force is the net force of all contacts on the tool. {}</p>", felt::INDENTATION);
        }
        if curves.is_reduced() {
            let _ = writeln!(
                body,
                "<p>The curves of {} steps are reduced: of each span of time, shorter than a pixel of the plot is wide, \
                 the first, the last, the least and the greatest value are drawn. <code>trace.csv</code> has all of \
                 them.</p>",
                curves.count()
            );
        }
        body.push_str("<div class=\"plots\">\n");
        let mut draw = |title: &str, [x, y]: [&str; 2], points: &[(f64, f64)], at: Option<(f64, f64)>| -> Result<()> {
            let mark = at.map(|at| (at, "peak"));
            body.push_str(&figure(&plot::curve(&Curve { title, x, y, points, mark })?, &format!("{title}.")));
            Ok(())
        };
        let [of_force, of_depth] = ["force, N", "indentation, mm"];
        if let Some(felt) = &felt {
            let (force, peak) = (felt.peak_force_n, felt.peak_time_s);
            let depth = felt.indentation_at_peak_m.map(|depth| 1e3 * depth);
            let at = peak.map(|time| (time, force));
            draw("Force over time", [time, of_force], &curves.over_time(FORCE), at)?;
            draw("Indentation over time", [time, of_depth], &curves.over_time(INDENTATION), peak.zip(depth))?;
            let at = depth.map(|depth| (depth, force));
            draw("Force over indentation", [of_depth, of_force], &curves.over(INDENTATION, FORCE), at)?;
        }
        for ((name, touch), force) in self.tally.further_touches.iter().zip(self.further_forces) {
            let felt = touch.felt();
            let at = felt.peak_time_s.map(|time| (time, felt.peak_force_n));
            draw(&format!("Force on the tool {name} over time"), [time, of_force], &force.over_time(0), at)?;
        }
        if self.tally.most_contacts.is_some() {
            draw("Contacts over time", [time, "contacts"], &curves.over_time(CONTACTS), None)?;
        }
        let iterations = curves.over_time(ITERATIONS);
        draw("Solver iterations over time", [time, "iterations in a step"], &iterations, None)?;
        body.push_str("</div>\n");
        Ok(())
    }

    fn write_cost(&self, body: &mut String) {
        let of_step = quantiles(&self.tally.step_us);
        let stages = self.facts.stages.iter().map(|stage| (stage.stage.as_str(), stage.passes, stage.quantiles()));
        let rows: Vec<_> = stages.chain([("step", self.facts.passes_per_step, of_step)]).collect();
        let longest = rows.iter().filter_map(|(_, _, times)| *times).fold(0.0, |most: f64, (_, p99)| most.max(p99));
        body.push_str(
            "<h2>What it cost</h2>\n<p>Times are those of a step; the row <code>step</code> is the wall time of the \
             whole step, the others are measured on the device. Thick bars: median; thin bars: 99th percentile.</p>\n\
             <div class=\"table\"><table>\n<thead><tr><th class=\"text\">stage</th><th>passes</th><th>median, ms</th>\
             <th>99 %, ms</th><th class=\"text\"></th></tr></thead>\n<tbody>\n",
        );
        for (stage, passes, times) in rows {
            let cell = |us: Option<f64>| us.map_or("-".into(), |us| format!("{:.3}", 1e-3 * us));
            let (median, p99) = (times.map(|times| times.0), times.map(|times| times.1));
            let bar = |us: Option<f64>| {
                let share = if longest > 0.0 { 100.0 * us.unwrap_or(0.0) / longest } else { 0.0 };
                format!("<div style=\"width:{share:.1}%\"></div>")
            };
            let _ = writeln!(
                body,
                "<tr><td class=\"text\">{}</td><td>{passes}</td><td>{}</td><td>{}</td><td class=\"bar\">{}{}</td></tr>",
                escaped(stage),
                cell(median),
                cell(p99),
                bar(median),
                bar(p99)
            );
        }
        let mean = self.tally.iterations as f64 / self.tally.steps.max(1) as f64;
        let _ = writeln!(
            body,
            "</tbody>\n</table></div>\n<p>Solver iterations: {mean:.1} per step, {} at most. Memory on the device: \
             {:.1} MB.</p>",
            self.tally.most_iterations,
            1e-6 * self.facts.bytes_device as f64
        );
    }

    fn write_run(&self, body: &mut String) {
        let (scene, facts) = (self.scene, self.facts);
        let dt = match self.sessions {
            [] => format!("{:?} s", scene.step.dt),
            _ => {
                let longest = scene.longest_step();
                format!("as long as a step takes to compute, from {:?} s to {longest:?} s", scene.step.dt)
            }
        };
        let preset = match &scene.preset {
            None => "none".into(),
            Some(chosen) => {
                let set: Vec<String> = chosen.set.iter().map(|(key, value)| format!("{key} = {value}")).collect();
                format!(
                    "{}, which set {}",
                    chosen.preset,
                    if set.is_empty() { "nothing".into() } else { set.join(", ") }
                )
            }
        };
        let bodies: Vec<&str> = scene.bodies.iter().map(|body| body.name.as_str()).collect();
        let rows = [
            ("Scene", scene.file.display().to_string()),
            ("Bodies", bodies.join(", ")),
            ("Preset", preset),
            ("Time step", dt),
            ("Steps", self.tally.steps.to_string()),
            ("Device", facts.device.clone()),
            ("Driver", facts.driver.clone()),
            ("Arrays", facts.arrays.clone()),
            ("Version", format!("palpate {}", env!("CARGO_PKG_VERSION"))),
        ];
        body.push_str("<h2>This run</h2>\n<dl>\n");
        for (name, value) in rows {
            let _ = writeln!(body, "<dt>{name}</dt><dd>{}</dd>", escaped(&value));
        }
        let command = escaped(self.command);
        let _ = writeln!(body, "<dt>Command to repeat it</dt><dd><code>{command}</code></dd>\n</dl>");
        let notes = facts.files.iter().flat_map(|(_, report)| &report.notes);
        if notes.clone().next().is_some() {
            body.push_str("<h3>What was changed in the scene's files</h3>\n");
            body.push_str(&list(notes));
        }
        body.push_str(
            "<p>Beside this page are <code>trace.csv</code> (a row for each step), <code>summary.json</code> (these \
             numbers), and for each soft body its deformed layer (<code>.vtk</code>) and skin (<code>.obj</code>).</p>\n",
        );
    }
}

/// Writes a paragraph that explains a flag, or an event of the haptic loop, and says how often it happened.
fn paragraph(body: &mut String, words: &Explanation, often: &str) {
    let Explanation { title, meaning, remedy } = words;
    let _ = write!(body, "<p><b>{}</b>, {}. {}", escaped(&capital(title)), escaped(often), escaped(meaning));
    if let Some(remedy) = remedy {
        let _ = write!(body, " <i>Remedy:</i> {}", escaped(remedy));
    }
    body.push_str("</p>\n");
}

/// A list of notes as HTML.
fn list<'a>(notes: impl Iterator<Item = &'a String>) -> String {
    let items: String = notes.map(|note| format!("<li>{}</li>\n", set(note))).collect();
    format!("<ul class=\"notes\">\n{items}</ul>\n")
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

impl Session<'_> {
    fn write(&self, body: &mut String) -> Result<()> {
        let Session { report, played } = self;
        let [of_played, of_contact] = report.end.map(|wrench| wrench.force.length());
        let _ = writeln!(
            body,
            "<h2>The haptic device{}</h2>\n<p>Profile {}. The greatest force played was {} N; at the end {} N were \
             played, and the contact force was {} N. Simulated time ran at {:.0} % of real time.</p>",
            if report.tool.is_empty() { String::new() } else { format!(" of {}", escaped(&report.tool)) },
            escaped(report.profile),
            felt::newtons(report.peak_force),
            felt::newtons(of_played),
            felt::newtons(of_contact),
            100.0 * report.pace
        );
        let points = played.over_time(0);
        let title = "Force played over time";
        let curve =
            Curve { title, x: "time since the loop began, s", y: "force played, N", points: &points, mark: None };
        let reduced = if played.is_reduced() {
            format!(" It is reduced from {} updates: of each span of time the extremes are drawn.", played.count())
        } else {
            String::new()
        };
        let _ = write!(
            body,
            "<div class=\"plots\">\n{}</div>\n",
            figure(&plot::curve(&curve)?, &format!("{title}, as commanded to the device.{reduced}"))
        );
        self.write_lateness(body);
        self.write_energy(body);
        self.write_events(body);
        if !report.notes.is_empty() {
            body.push_str(&list(report.notes.iter()));
        }
        Ok(())
    }

    fn write_lateness(&self, body: &mut String) {
        let heads = ["", "updates", "median, us", "99 %, us", "99.9 %, us", "worst, us", "more than 2 ms late"];
        let mut late = Table::new(heads);
        let loops = [
            ("haptic loop", Some(&self.report.lateness)),
            ("a thread that only sleeps, for comparison", self.report.bare.as_ref()),
        ];
        for (name, lateness) in loops.into_iter().filter_map(|(name, lateness)| Some((name, lateness?))) {
            let us = |share| format!("{:.0}", 1e6 * lateness.quantile(share));
            let worst = format!("{:.0}", 1e6 * lateness.worst());
            let missed = format!("{} ({:.3} %)", lateness.missed(), 100.0 * lateness.share_missed());
            let ticks = lateness.ticks().to_string();
            late.rows.push(vec![name.into(), ticks, us(0.5), us(0.99), us(0.999), worst, missed]);
        }
        let ages = [0.5, 0.99, 1.0].map(|share| 1e3 * self.report.staleness.quantile(share));
        let _ = writeln!(
            body,
            "<h3>How late updates of the force began</h3>\n{}<p>The contact force that was played was out of date by \
             {:.1} ms (median), {:.1} ms (99 %), {:.1} ms (worst).{}</p>",
            table(&late),
            ages[0],
            ages[1],
            ages[2],
            match self.report.lost {
                0 => String::new(),
                lost => format!(" {lost} updates are missing from these figures, since their queue was full."),
            }
        );
    }

    fn write_energy(&self, body: &mut String) {
        let energy = self.report.energy;
        let (taken, given) = (energy.taken.iter().sum::<f64>(), energy.given.iter().sum::<f64>());
        let rows = [
            ("given by the hand", taken),
            ("received by the hand", given),
            ("received in advance, before the hand gave it", energy.lent),
            ("stored", energy.stored),
            ("dissipated", energy.dissipated()),
            ("dissipated by passivity control", energy.damped),
        ];
        let rows = rows.map(|(name, joules)| vec![name.to_string(), format!("{:.3}", 1e3 * joules)]);
        let table = table(&Table { rows: rows.into(), ..Table::new(["energy", "mJ"]) });
        let _ = writeln!(body, "<h3>Energy between hand and device</h3>\n{table}");
    }

    fn write_events(&self, body: &mut String) {
        body.push_str("<h3>Events</h3>\n");
        let mut events = happened(&self.report.events).peekable();
        if events.peek().is_none() {
            body.push_str("<p>There were none.</p>\n");
        }
        for (words, begun, ticks) in events {
            let plural = if ticks == 1 { "" } else { "s" };
            paragraph(body, words, &format!("{}, in {ticks} update{plural} of the force in all", times(begun)));
        }
    }
}
