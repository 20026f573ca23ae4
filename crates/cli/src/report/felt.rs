//! What the tool (the rigid body that the haptic device leads) felt in a run, in numbers for `summary.json` and in
//! words for the terminal and for the page `report.html`.
//!
//! A step is *in contact* if the net force of all contacts on the tool is not zero at its end. The *indentation* is the
//! distance that the tool's centre has moved since the step of first touch, along minus the direction of the peak
//! force. The indentation tells how far the tool pressed in; where a body is free to move, the indentation includes the
//! distance by which the body as a whole gave way.

use glam::DVec3;
use palpate::scene::DeviceKind;
use palpate::{Scene, StepReport, ToolReport};
use serde::Serialize;

use super::Tally;

/// A sentence for the page that says what indentation means.
pub const INDENTATION: &str = "Indentation is the distance that the tool's centre has moved since the step of first \
                               touch, along minus the direction of the peak force.";

/// What the tool felt so far, gathered step by step.
#[derive(Debug, Clone, Default)]
pub struct Touch {
    /// Time, s, and the tool's centre, m, at the end of the first step in contact.
    pub first: Option<(f64, DVec3)>,
    peak: Option<Peak>,
    steps: u64,
    /// Contact force on the tool at the end of the last step, N.
    pub last_force: DVec3,
}

/// The step with the greatest contact force on the tool so far.
#[derive(Debug, Clone, Copy)]
struct Peak {
    time: f64,
    force: DVec3,
    centre: DVec3,
}

/// The entry `felt` of `summary.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Felt {
    /// Whether the tool touched anything.
    pub touched: bool,
    /// Time at the end of the first step in contact, s.
    pub first_touch_s: Option<f64>,
    /// Greatest net contact force on the tool, N.
    pub peak_force_n: f64,
    /// First time at which the contact force on the tool was greatest, s.
    pub peak_time_s: Option<f64>,
    /// Indentation at the time of the greatest force, m.
    pub indentation_at_peak_m: Option<f64>,
    /// Number of steps in contact.
    pub steps_in_contact: u64,
}

impl Touch {
    /// Adds a step; `tool` is what the step's report says of the tool.
    pub fn add(&mut self, row: &StepReport, tool: &ToolReport) {
        self.last_force = tool.force;
        let (force, centre) = (tool.force, tool.tool.position);
        // A step counts as in contact only if it has a finite force that is not zero.
        if !force.is_finite() || !centre.is_finite() || force == DVec3::ZERO {
            return;
        }
        self.steps += 1;
        self.first.get_or_insert((row.time, centre));
        if self.peak.is_none_or(|peak| force.length_squared() > peak.force.length_squared()) {
            self.peak = Some(Peak { time: row.time, force, centre });
        }
    }

    /// Unit vector along which the tool presses in: minus the direction of the peak force. `None` if nothing was
    /// touched.
    pub fn inwards(&self) -> Option<DVec3> {
        self.peak.and_then(|peak| (-peak.force).try_normalize())
    }

    /// Indentation, m, when the tool's centre is at the point `centre`; `None` if nothing was touched.
    pub fn indentation(&self, centre: DVec3) -> Option<f64> {
        let ((_, first), inwards) = (self.first?, self.inwards()?);
        Some((centre - first).dot(inwards))
    }

    /// The numbers for `summary.json`.
    pub fn felt(&self) -> Felt {
        Felt {
            touched: self.first.is_some(),
            first_touch_s: self.first.map(|(time, _)| time),
            peak_force_n: self.peak.map_or(0.0, |peak| peak.force.length()),
            peak_time_s: self.peak.map(|peak| peak.time),
            indentation_at_peak_m: self.peak.and_then(|peak| self.indentation(peak.centre)),
            steps_in_contact: self.steps,
        }
    }
}

/// How far the tool was from a body at the end of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Distance {
    /// Name of the body.
    pub body: String,
    /// Distance, m.
    pub distance: f64,
    /// Whether the distance is that of the tool's surface, as for spheres, and not that of the tool's centre.
    pub is_of_surface: bool,
}

/// A sentence that says what was felt, and one for each further tool.
pub fn headline(tally: &Tally) -> String {
    let Some(touch) = &tally.touch else {
        let contacts = match tally.most_contacts {
            None => "nothing in it can collide".into(),
            Some(0) => "its bodies never touched each other".into(),
            Some(most) => format!("its bodies had up to {most} contacts with each other"),
        };
        return format!("The scene has no tool, so no force was felt; {contacts}.");
    };
    let name = if tally.further_touches.is_empty() { "The tool" } else { "The first tool" };
    let further = tally.further_touches.iter().map(|(name, touch)| sentence(&format!("The tool {name}"), touch, tally));
    [sentence(name, touch, tally)].into_iter().chain(further).collect::<Vec<_>>().join(" ")
}

/// A sentence that says what a tool felt.
fn sentence(tool: &str, touch: &Touch, tally: &Tally) -> String {
    let felt = touch.felt();
    let (Some(first), Some(time), Some(depth)) = (felt.first_touch_s, felt.peak_time_s, felt.indentation_at_peak_m)
    else {
        return format!("{tool} never touched anything.");
    };
    format!(
        "{tool} felt at most {} N, at {} s, with an indentation of {} mm since its first touch at {} s; it was in \
         contact in {} of {} {}.",
        newtons(felt.peak_force_n),
        seconds(time),
        millimetres(depth),
        seconds(first),
        felt.steps_in_contact,
        tally.steps,
        if tally.steps == 1 { "step" } else { "steps" }
    )
}

/// How the user makes the tool of a scene touch a body.
pub fn advice(scene: &Scene) -> &'static str {
    if !scene.further_tools.is_empty() && !scene.haptics.device.is_real() {
        return "Give the tools keys in `drive` that lead them into a body, or place their bodies elsewhere.";
    }
    match (scene.haptics.device, scene.trajectory.is_empty()) {
        (device, _) if device.is_real() => {
            "Move the device so that the tool meets a body, or place the tool nearer to one."
        }
        (DeviceKind::Replay, _) => "The recorded motion leads the tool past all bodies.",
        (_, false) => "Let the keys of [drive] lead the tool into a body, or simulate for longer.",
        (_, true) => {
            "Give keys in [drive] that lead the tool into a body, or place the tool elsewhere by tool.position."
        }
    }
}

/// What to tell the user if no tool ever touched anything: how far away the first was, and the `advice` for the scene.
/// `None` if a tool touched something, or if there is none.
pub fn remedy(tally: &Tally, advice: &str, nearest: Option<&Distance>) -> Option<String> {
    let mut all = tally.touch.iter().chain(tally.further_touches.iter().map(|(_, touch)| touch));
    if tally.touch.is_none() || all.any(|touch| touch.first.is_some()) {
        return None;
    }
    let which = if tally.further_touches.is_empty() { "the tool" } else { "the first tool" };
    let away = nearest.map_or(String::new(), |Distance { body, distance, is_of_surface }| {
        let what = if *is_of_surface { "surface" } else { "centre" };
        format!(
            "At the end {which}'s {what} was {} mm from {body}, the nearest soft body or plane. ",
            millimetres(*distance)
        )
    });
    Some(format!("{away}{advice}"))
}

/// A force, N, as text: to a tenth of a millinewton or, if it is below a millinewton, with three significant digits.
pub fn newtons(force: f64) -> String {
    if force != 0.0 && force < 1e-3 { format!("{force:.2e}") } else { format!("{force:.4}") }
}

/// A time, s, as text: to a tenth of a millisecond or, if it is below a millisecond, with two significant digits.
fn seconds(time: f64) -> String {
    let text = format!("{time:.4}");
    if time < 1e-3 { format!("{time:.1e}") } else { text.trim_end_matches('0').trim_end_matches('.').into() }
}

/// A length, m, as text in millimetres, to a hundredth of a millimetre.
fn millimetres(length: f64) -> String {
    // A negative length that rounds to 0 is written without its sign.
    let text = format!("{:.2}", 1e3 * length);
    if text == "-0.00" { "0.00".into() } else { text }
}

#[cfg(test)]
mod tests {
    use palpate::Pose;

    use super::*;

    fn tally(rows: &[(f64, f64)]) -> Tally {
        let mut tally = Tally::default();
        for (k, (y, force)) in rows.iter().enumerate() {
            let tool = Pose { position: DVec3::new(1.0, *y, 0.0), ..Pose::default() };
            let tool = ToolReport { tool, force: DVec3::Y * *force, ..ToolReport::default() };
            tally.add(&StepReport { time: 0.1 * (k + 1) as f64, tool: Some(tool), ..StepReport::default() });
        }
        tally
    }

    #[test]
    fn indentation_is_counted_from_first_touch_against_the_peak_force() {
        let tally = tally(&[(0.05, 0.0), (0.04, 0.5), (0.03, 2.0), (0.025, 1.0), (0.06, 0.0), (0.0, f64::NAN)]);
        let felt = tally.touch.as_ref().unwrap().felt();
        assert!(felt.touched && felt.steps_in_contact == 3, "3 steps in contact are expected: {felt:?}");
        assert_eq!((felt.peak_force_n, felt.peak_time_s, felt.first_touch_s), (2.0, Some(0.1 * 3.0), Some(0.2)));
        assert!(
            (felt.indentation_at_peak_m.unwrap() - 0.01).abs() < 1e-15,
            "an indentation of 0.01 m is expected: {felt:?}"
        );
        let expected = "The tool felt at most 2.0000 N, at 0.3 s, with an indentation of 10.00 mm since its first \
                        touch at 0.2 s; it was in contact in 3 of 6 steps.";
        assert_eq!(headline(&tally), expected);
        assert_eq!(remedy(&tally, "", None), None);
    }

    #[test]
    fn each_of_several_tools_has_a_sentence() {
        let mut tally = Tally::new(["right".to_owned()].into_iter());
        let [tool, further] = [0.0, 2.0].map(|y| ToolReport { force: DVec3::Y * y, ..ToolReport::default() });
        tally.add(&StepReport { time: 0.5, tool: Some(tool), further_tools: vec![further], ..StepReport::default() });
        let expected = "The first tool never touched anything. The tool right felt at most 2.0000 N, at 0.5 s, with an \
                        indentation of 0.00 mm since its first touch at 0.5 s; it was in contact in 1 of 1 step.";
        assert_eq!(headline(&tally), expected);
        assert_eq!(remedy(&tally, "Press.", None), None);
    }

    #[test]
    fn a_run_that_touched_nothing_says_so_and_what_to_do() {
        let never = tally(&[(0.05, 0.0)]);
        let distance = Distance { body: "head".into(), distance: 0.0123, is_of_surface: true };
        assert_eq!(headline(&never), "The tool never touched anything.");
        let said = remedy(&never, "Press.", Some(&distance)).unwrap();
        assert!(said.contains("12.30 mm from head") && said.ends_with("Press."), "wrong advice: {said}");
        let felt = never.touch.as_ref().unwrap().felt();
        assert_eq!(felt, Felt::default());
        let mut without = Tally::default();
        assert!(headline(&without).contains("has no tool") && headline(&without).contains("nothing in it can collide"));
        without.add(&StepReport { contacts: Some(7), ..StepReport::default() });
        assert!(headline(&without).contains("up to 7 contacts") && remedy(&without, "", None).is_none());
    }
}
