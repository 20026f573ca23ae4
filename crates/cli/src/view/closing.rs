//! The lines that are printed when a window closes: how fast frames (rendered images) were drawn, and how much drawing
//! delayed the simulation's steps. A frame is drawn in *slices*, each of them short, between which the simulation can
//! do steps.

use std::time::Instant;

use palpate::internal::haptics::clock::Lateness;

/// Statistics of the frames that a window showed.
#[derive(Default)]
pub struct Frames {
    first: Option<Instant>,
    last: Option<Instant>,
    /// Duration of each frame, s.
    took: Vec<f32>,
    slices: usize,
}

impl Frames {
    /// Adds a frame that was shown. The first frame of a simulation, during which pipelines are compiled, is not
    /// counted and resets the statistics.
    pub fn add(&mut self, took: f64, slices: usize, is_first: bool) {
        let now = Instant::now();
        if is_first {
            *self = Frames { first: Some(now), ..Frames::default() };
            return;
        }
        self.last = Some(now);
        self.took.push(took as f32);
        self.slices += slices;
    }

    /// Two lines of text on the frames, and on `delays`, the times that steps waited for drawing; an empty text if no
    /// frame was counted.
    pub fn summary(&self, delays: &Lateness) -> String {
        let (Some(first), Some(last), false) = (self.first, self.last, self.took.is_empty()) else {
            return String::new();
        };
        let (count, seconds) = (self.took.len() as f64, (last - first).as_secs_f64());
        let mut took = self.took.clone();
        took.sort_unstable_by(f32::total_cmp);
        let [median, most] = [took[took.len() / 2], took[took.len() - 1]].map(|s| 1e3 * s);
        let [rate, slices] = [count / seconds.max(1e-3), self.slices as f64 / count];
        let frames = format!(
            "frames: {count} in {seconds:.1} s, {rate:.1} per second, each drawn in {slices:.1} parts between steps"
        );
        let [waited, often, longest] = [delays.quantile(0.5), delays.quantile(0.99), delays.worst()].map(|s| 1e3 * s);
        let steps = delays.ticks();
        format!(
            "{frames}; each took {median:.1} ms (median), {most:.1} ms (longest)\n\
             steps: {steps}; each waited for drawing {waited:.2} ms (median), {often:.2} ms (p99), {longest:.2} ms \
             (longest)\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_shown_is_nothing_said() {
        let mut frames = Frames::default();
        assert_eq!(frames.summary(&Lateness::new()), "");
        frames.add(0.5, 3, true);
        assert_eq!(frames.summary(&Lateness::new()), "", "the first frame is not counted");
        (0..4).for_each(|k| frames.add(0.01 * f64::from(k + 1), 2, false));
        let mut delays = Lateness::new();
        [0.001, 0.002, 0.003].into_iter().for_each(|delay| delays.add(delay, f64::INFINITY));
        let said = frames.summary(&delays);
        assert!(
            said.starts_with("frames: 4 in ")
                && said.contains("in 2.0 parts between steps; each took 30.0 ms (median), 40.0 ms (longest)"),
            "wrong summary: {said}"
        );
        assert!(
            said.ends_with("steps: 3; each waited for drawing 2.00 ms (median), 3.00 ms (p99), 3.00 ms (longest)\n"),
            "wrong summary: {said}"
        );
    }
}
