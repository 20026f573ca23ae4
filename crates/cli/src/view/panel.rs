//! The panel of the window: contact force and state of the simulation, times of steps and frames (rendered images), and
//! sliders for materials, contact and the virtual coupling (spring and damper between haptic device and tool). A frame
//! is drawn in *slices*, between which the simulation can do steps.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use egui::{Color32, Pos2, RichText, Sense, Slider, SliderClamping, Stroke, Ui, Vec2};
use palpate::internal::haptics::event::Event;
use palpate::scene::{Contact, Coupling, Material};
use palpate_view::live::{Command, Sample, Settings, Snapshot, State};
use palpate_view::overlay::{Overlay, Overlays};
use palpate_view::turns::Delays;

/// Width of the panel, points (egui's unit of length).
pub const WIDTH: f32 = 250.0;
/// Simulated time that the force plot covers, s.
const SPAN: f64 = 4.0;
/// Distance between hand and tool above which the panel says so, m.
const FAR: f64 = 0.01;
/// Height of the force plot, points.
const TRACE: f32 = 56.0;
/// Least time between two commands of a slider that is being dragged: setting a material takes as long as a few steps.
const OFTEN: Duration = Duration::from_millis(200);
/// Number of notes, lines of text at the end of the panel, that are kept.
const LINES: usize = 5;
/// Number of stages of a step whose times are listed, the slowest first.
const STAGES: usize = 6;

const HELP: &str = "left drag: move the tool   with wheel: in depth\narrows, q, e: turn the tool   Tab: the next tool\nright drag: orbit   \
    middle drag: pan   wheel: zoom\nspace: pause   . : one step   r: reset\ns: save an image   t: start or end a \
    recording\n1 pressure   2 depth   3 force\n4 proxies   5 contact patches   6 layer   7 cores\n8 strain energy   \
    9 displacement   0 materials\nv von Mises stress   p hydrostatic pressure\nh: this help   Esc: close";

/// State of the panel between frames.
pub struct Panel {
    samples: VecDeque<Sample>,
    lines: VecDeque<String>,
    frame: Frames,
    /// The settings whose slider is being dragged.
    dragged: Option<Dragged>,
    /// Whether the present values of the dragged settings were sent to the simulation.
    is_sent: bool,
    /// When a value was last sent to the simulation.
    sent: Instant,
    pub shows_help: bool,
    pub overlays: Overlays,
    /// Progress in preparing a surface file that was dropped onto the window.
    pub progress: Option<String>,
}

#[derive(Debug, Default)]
struct Frames {
    took: f64,
    slices: usize,
    recent: VecDeque<Instant>,
}

#[derive(Debug, Clone)]
enum Dragged {
    Material(usize, usize, Material),
    Contact(Contact),
    Coupling(Coupling),
}

impl Dragged {
    fn command(&self) -> Command {
        match self.clone() {
            Dragged::Material(body, index, material) => Command::Material(body, index, material),
            Dragged::Contact(law) => Command::Contact(law),
            Dragged::Coupling(coupling) => Command::Coupling(coupling),
        }
    }
}

impl Panel {
    pub fn new() -> Panel {
        Panel {
            samples: VecDeque::new(),
            lines: VecDeque::new(),
            frame: Frames::default(),
            dragged: None,
            is_sent: true,
            sent: Instant::now(),
            shows_help: false,
            overlays: Overlays::of(&[Overlay::Pressure, Overlay::Arrows]),
            progress: None,
        }
    }

    /// Adds a line of text at the end of the panel.
    pub fn say(&mut self, line: String) {
        self.lines.push_back(line);
        while self.lines.len() > LINES {
            self.lines.pop_front();
        }
    }

    /// Adds samples to the force plot; drops samples that are too old for the plot, and all samples from before a
    /// reset.
    pub fn take(&mut self, samples: impl Iterator<Item = Sample>) {
        for sample in samples {
            if self.samples.back().is_some_and(|last| sample.time < last.time) {
                self.samples.clear();
            }
            self.samples.push_back(sample);
        }
        let first = self.samples.back().map_or(0.0, |last| last.time - SPAN);
        while self.samples.front().is_some_and(|sample| sample.time < first) {
            self.samples.pop_front();
        }
    }

    /// Counts a frame that was shown.
    pub fn shown(&mut self, took: f64, slices: usize) {
        let frame = &mut self.frame;
        (frame.took, frame.slices) = (took, slices);
        frame.recent.push_back(Instant::now());
        while frame.recent.front().is_some_and(|at| at.elapsed() > Duration::from_secs(1)) {
            frame.recent.pop_front();
        }
    }

    /// Lays out the panel; returns the command that a slider gives to the simulation, if any. `tool`: index of the chosen
    /// tool, and of several its name.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        snapshot: &Snapshot,
        tool: (usize, Option<&str>),
        delays: &Delays,
    ) -> Option<Command> {
        let mut command = None;
        egui::Panel::right("panel").exact_size(WIDTH).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| {
                ui.spacing_mut().slider_width = 64.0;
                self.state(ui, snapshot);
                self.felt(ui, snapshot, tool);
                self.cost(ui, snapshot, delays);
                command = self.sliders(ui, &snapshot.settings, tool.0 == 0);
                ui.separator();
                self.progress.iter().chain(&self.lines).for_each(|line| drop(ui.label(RichText::new(line).small())));
            });
        });
        command
    }

    fn state(&self, ui: &mut Ui, snapshot: &Snapshot) {
        let (text, colour) = match &snapshot.state {
            State::Running => ("running".into(), Color32::LIGHT_GREEN),
            State::Paused => ("paused".into(), Color32::LIGHT_YELLOW),
            State::Recording(file) => (format!("recording {}", file.display()), Color32::LIGHT_RED),
            State::Failed(why) => (format!("failed: {why}; press r to reset"), Color32::LIGHT_RED),
            State::Ended => ("ended".into(), Color32::GRAY),
        };
        ui.label(RichText::new(text).color(colour).strong());
        let shown = Overlay::ALL.into_iter().filter(|(overlay, _)| self.overlays.has(*overlay)).map(|(_, name)| name);
        let shown: Vec<&str> = shown.collect();
        if !shown.is_empty() {
            ui.label(format!("shown: {}", shown.join(", ")));
        }
        ui.label(if self.shows_help { HELP } else { "h: help" });
    }

    fn felt(&self, ui: &mut Ui, snapshot: &Snapshot, (index, name): (usize, Option<&str>)) {
        name.into_iter().for_each(|name| drop(ui.label(format!("tool {name}   Tab: the next"))));
        let Some(row) = &snapshot.row else { return };
        ui.separator();
        if let Some(tool) = row.tools().nth(index) {
            let (force, torque) = (tool.force.length(), tool.torque.length());
            ui.label(format!("force {force:.3} N   torque {:.2} mN m", 1e3 * torque));
            let behind = tool.device.position.distance(tool.tool.position);
            if behind > FAR {
                let words = format!("the tool is {:.0} mm behind the hand", 1e3 * behind);
                let meaning = "It cannot follow through what it touches. Far behind, it may be drawn into a body, out of \
                               sight: move the hand back, or press r to reset.";
                ui.colored_label(Color32::LIGHT_RED, words).on_hover_text(meaning);
            }
            self.trace(ui, index);
        }
        let depth = 1e3 * row.max_depth.unwrap_or(0.0);
        ui.label(format!("contacts {}   depth {depth:.2} mm", row.contacts.unwrap_or(0)));
        ui.label(format!("time {:.3} s   iterations {}   residual {:.1e}", row.time, row.iterations, row.residual));
        for (_, words) in row.flags.explained() {
            let label = ui.colored_label(Color32::LIGHT_RED, words.title);
            label.on_hover_text(format!("{} {}", words.meaning, words.remedy.unwrap_or_default()));
        }
        if let Some(state) = snapshot.haptics.get(index) {
            let [median, p99, most] = state.late.map(|s| 1e3 * s);
            ui.label(format!("haptic loop late by {median:.2} / {p99:.2} / {most:.2} ms (median, p99, worst)"));
            for words in state.events.iter().filter_map(|name| Event::named(name)).map(Event::explained) {
                let label = ui.label(RichText::new(words.title).small());
                label.on_hover_text(format!("{} {}", words.meaning, words.remedy.unwrap_or_default()));
            }
        }
    }

    /// Plots the contact force on the tool of this index over the last seconds; the full height of the plot stands for the
    /// greatest of these forces.
    fn trace(&self, ui: &mut Ui, tool: usize) {
        let (response, painter) = ui.allocate_painter(Vec2::new(ui.available_width(), TRACE), Sense::hover());
        let area = response.rect;
        painter.rect_filled(area, 2.0, Color32::from_black_alpha(60));
        let most = self.samples.iter().map(|sample| sample.forces[tool].length()).fold(0.0, f64::max);
        let Some(last) = self.samples.back() else { return };
        let scale = if most > 0.0 { f64::from(area.height() - 4.0) / most } else { 0.0 };
        let place = |sample: &Sample| {
            let ago = (last.time - sample.time) / SPAN;
            let x = f64::from(area.right()) - ago * f64::from(area.width());
            Pos2::new(x as f32, (f64::from(area.bottom() - 2.0) - scale * sample.forces[tool].length()) as f32)
        };
        // Only about as many points are drawn as can be distinguished.
        let every = (self.samples.len() / 400).max(1);
        painter.line(self.samples.iter().step_by(every).map(place).collect(), Stroke::new(1.5, Color32::LIGHT_BLUE));
        let text = format!("force up to {most:.3} N in the last {SPAN} s");
        let font = egui::FontId::proportional(10.0);
        painter.text(area.left_top() + Vec2::new(3.0, 1.0), egui::Align2::LEFT_TOP, text, font, Color32::GRAY);
    }

    fn cost(&self, ui: &mut Ui, snapshot: &Snapshot, delays: &Delays) {
        ui.separator();
        let step = snapshot.row.as_ref().map_or(0.0, |row| 1e-3 * row.step_us);
        let (frame, rate) = (1e3 * self.frame.took, self.frame.recent.len());
        ui.label(format!("step {step:.2} ms   frame {frame:.1} ms, {rate} per s"));
        let [last, median, most] = [delays.last, delays.median, delays.most].map(|s| 1e3 * s);
        ui.label(format!("steps wait for drawing {last:.2} / {median:.2} / {most:.2} ms (last, median, longest)"));
        ui.label(format!("{} slices per frame, longest {:.2} ms", self.frame.slices, 1e3 * delays.longest_slice));
        let mut stages: Vec<&(String, f64)> = snapshot.stages.iter().collect();
        stages.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (stage, us) in stages.into_iter().take(STAGES) {
            ui.label(RichText::new(format!("{:.2} ms  {stage}", 1e-3 * us)).small());
        }
    }

    /// Lays out the sliders. A slider gives commands while it is dragged, but not too often, and when it is released. The
    /// coupling is that of the first tool, and shown if that `is_first` chosen.
    fn sliders(&mut self, ui: &mut Ui, settings: &Settings, is_first: bool) -> Option<Command> {
        let mut touched = None;
        let mut is_let_go = false;
        let mut slide = |ui: &mut Ui, value: &mut f64, range: [f64; 2], text: &str, is_log: bool| {
            // A value outside the slider's range stays as the scene has it until the user moves the slider.
            let slider = Slider::new(value, range[0]..=range[1]).text(text).logarithmic(is_log);
            let slider = slider.clamping(SliderClamping::Never).update_while_editing(false);
            let response = ui.add(slider.custom_formatter(|x, _| shown(x)));
            is_let_go |= response.drag_stopped() || (response.changed() && !response.dragged());
            response.changed() || response.drag_stopped()
        };
        for (body, index, name, material) in &settings.materials {
            ui.collapsing(format!("material of {name}"), |ui| {
                let mut new = match &self.dragged {
                    Some(Dragged::Material(b, k, new)) if (b, k) == (body, index) => *new,
                    _ => *material,
                };
                let mut changed = slide(ui, &mut new.young, [1e2, 1e7], "Young, Pa", true);
                changed |= slide(ui, &mut new.poisson, [0.0, 0.49], "Poisson", false);
                changed |= slide(ui, &mut new.damping_stiffness, [0.0, 0.05], "damping, s", false);
                if changed {
                    touched = Some(Dragged::Material(*body, *index, new));
                }
            });
        }
        if let Some(law) = &settings.contact {
            ui.collapsing("contact", |ui| {
                let mut new = match &self.dragged {
                    Some(Dragged::Contact(new)) => new.clone(),
                    _ => law.clone(),
                };
                let mut changed = false;
                let mut stiffness = new.stiffness.unwrap_or(settings.stiffness);
                if slide(ui, &mut stiffness, [1e5, 1e10], "stiffness, N/m^3", true) {
                    (new.stiffness, changed) = (Some(stiffness), true);
                }
                changed |= slide(ui, &mut new.friction, [0.0, 1.5], "friction", false);
                if changed {
                    touched = Some(Dragged::Contact(new));
                }
            });
        }
        if let Some(coupling) = settings.coupling.filter(|_| is_first) {
            ui.collapsing("coupling", |ui| {
                let mut new = match &self.dragged {
                    Some(Dragged::Coupling(new)) => *new,
                    _ => coupling,
                };
                let mut changed = slide(ui, &mut new.stiffness, [10.0, 1e4], "stiffness, N/m", true);
                changed |= slide(ui, &mut new.damping, [0.0, 100.0], "damping, N s/m", false);
                if settings.has_device {
                    ui.label(
                        RichText::new("requested gains; the haptic loop lowers unstable ones and restarts").small(),
                    );
                }
                if changed {
                    touched = Some(Dragged::Coupling(new));
                }
            });
        }
        let Some(touched) = touched else {
            // If the mouse rests during a drag, the value at which it rests is sent as well.
            let is_due = !self.is_sent && self.sent.elapsed() >= OFTEN;
            let waiting = self.dragged.as_ref().filter(|dragged| is_due && !matches!(dragged, Dragged::Coupling(_)));
            let command = waiting.map(Dragged::command)?;
            (self.is_sent, self.sent) = (true, Instant::now());
            return Some(command);
        };
        // A new coupling restarts the haptic loop, so it is sent only when the slider is released.
        let waits = matches!(touched, Dragged::Coupling(_)) || self.sent.elapsed() < OFTEN;
        if waits && !is_let_go {
            (self.dragged, self.is_sent) = (Some(touched), false);
            return None;
        }
        (self.is_sent, self.sent) = (true, Instant::now());
        self.dragged = (!is_let_go).then(|| touched.clone());
        Some(touched.command())
    }
}

/// A slider's value as text, with at most four significant digits.
fn shown(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    let power = x.abs().log10().floor();
    if !(-3.0..=5.0).contains(&power) {
        return format!("{x:.2e}");
    }
    let text = format!("{x:.0$}", (3.0 - power).max(0.0) as usize);
    let trimmed = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    trimmed.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_sliders_are_short_and_read_back() {
        let all = [
            (0.0, "0"),
            (20_000.0, "20000"),
            (0.45, "0.45"),
            (1.0 / 3.0, "0.3333"),
            (2e-3, "0.002"),
            (3.1e8, "3.10e8"),
        ];
        for (x, text) in all {
            assert_eq!(shown(x), text);
            assert!((text.parse::<f64>().unwrap() - x).abs() <= 1e-3 * x);
        }
    }
}
