//! Reduces long curves to what a plot can show: time is divided into spans, and of each span the first, the last, the
//! least and the greatest value of every quantity are kept. A plot whose pixel columns are at least as wide as the
//! spans looks as it would with all values. Memory is bounded, whatever the number of values and their spacing in time.

/// Greatest number of spans; for values that are evenly spaced in time at least half of these are in use.
const SPANS: usize = 1024;
/// Greatest number of values that are kept unreduced: a curve with no more values is drawn as it is.
const KEPT: usize = 4 * SPANS;

/// The values of `K` quantities at times in ascending order; they are reduced if there are many.
#[derive(Debug, Clone)]
pub struct Reduced<const K: usize> {
    /// All values, as long as there are at most [`KEPT`] of them or all belong to the same time.
    kept: Vec<Sample<K>>,
    /// Spans in the order of time; `None` for a span without values.
    spans: Vec<Option<Span<K>>>,
    start: f64,
    /// Length of a span in time; 0 before values are reduced.
    length: f64,
    count: u64,
}

/// Values of all quantities at one time; NaN where a quantity has no value.
#[derive(Debug, Clone, Copy)]
struct Sample<const K: usize> {
    index: u64,
    time: f64,
    values: [f64; K],
}

#[derive(Debug, Clone)]
struct Span<const K: usize> {
    ends: [Sample<K>; 2],
    /// For each quantity the samples with its least and its greatest value, if it has any value.
    extremes: [Option<[Sample<K>; 2]>; K],
}

impl<const K: usize> Default for Reduced<K> {
    fn default() -> Self {
        Reduced { kept: Vec::new(), spans: Vec::new(), start: 0.0, length: 0.0, count: 0 }
    }
}

impl<const K: usize> Reduced<K> {
    /// Adds the values of all quantities at a time, which must not be before the time of values added earlier. Values
    /// that are not finite count as missing; if the time is not finite, nothing is added.
    pub fn add(&mut self, time: f64, values: [f64; K]) {
        let last = self.kept.last().map_or(f64::NEG_INFINITY, |sample| sample.time);
        if !time.is_finite() || (self.length == 0.0 && time < last) || (self.length > 0.0 && time < self.start) {
            return;
        }
        let values = values.map(|value| if value.is_finite() { value } else { f64::NAN });
        let sample = Sample { index: self.count, time, values };
        self.count += 1;
        if self.length > 0.0 {
            self.place(Span::of(sample));
            return;
        }
        self.kept.push(sample);
        let (first, last) = (self.kept[0].time, time);
        // Values that all belong to the same time cannot be divided into spans.
        if self.kept.len() > KEPT && last > first {
            (self.start, self.length) = (first, 2.0 * (last - first) / SPANS as f64);
            std::mem::take(&mut self.kept).into_iter().for_each(|sample| self.place(Span::of(sample)));
        }
    }

    /// Merges values into the span of their time; doubles the length of all spans until there is such a span.
    fn place(&mut self, new: Span<K>) {
        while (new.ends[0].time - self.start) / self.length >= SPANS as f64 {
            self.length *= 2.0;
            let mut spans = std::mem::take(&mut self.spans).into_iter();
            while let Some(first) = spans.next() {
                self.spans.push(match (first, spans.next().flatten()) {
                    (Some(first), Some(second)) => Some(first.merged(&second)),
                    (one, other) => one.or(other),
                });
            }
        }
        let at = ((new.ends[0].time - self.start) / self.length) as usize;
        if self.spans.len() <= at {
            self.spans.resize(at + 1, None);
        }
        let span = &mut self.spans[at];
        *span = Some(span.take().map_or_else(|| new.clone(), |old| old.merged(&new)));
    }

    /// Number of times at which values were added.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Whether the curves leave out values.
    pub fn is_reduced(&self) -> bool {
        self.length > 0.0
    }

    /// The curve of a quantity over time; times at which the quantity has no value are left out.
    pub fn over_time(&self, quantity: usize) -> Vec<(f64, f64)> {
        self.points(&[quantity], |sample| (sample.time, sample.values[quantity]))
    }

    /// The curve of the quantity `y` over the quantity `x`, in the order of time.
    pub fn over(&self, x: usize, y: usize) -> Vec<(f64, f64)> {
        self.points(&[x, y], |sample| (sample.values[x], sample.values[y]))
    }

    fn points(&self, quantities: &[usize], point: impl Fn(&Sample<K>) -> (f64, f64)) -> Vec<(f64, f64)> {
        let mut samples = self.kept.clone();
        for span in self.spans.iter().flatten() {
            let extremes = quantities.iter().filter_map(|quantity| span.extremes[*quantity]).flatten();
            let mut all: Vec<Sample<K>> = extremes.chain(span.ends).collect();
            all.sort_by_key(|sample| sample.index);
            all.dedup_by_key(|sample| sample.index);
            samples.extend(all);
        }
        samples.iter().map(point).filter(|(x, y)| x.is_finite() && y.is_finite()).collect()
    }
}

impl<const K: usize> Span<K> {
    fn of(sample: Sample<K>) -> Span<K> {
        let extremes = std::array::from_fn(|k| (!sample.values[k].is_nan()).then_some([sample; 2]));
        Span { ends: [sample; 2], extremes }
    }

    /// This span merged with the span `next`, which follows it in time.
    fn merged(mut self, next: &Span<K>) -> Span<K> {
        self.ends[1] = next.ends[1];
        for (k, (own, new)) in self.extremes.iter_mut().zip(&next.extremes).enumerate() {
            match (own.as_mut(), new) {
                (Some([least, most]), Some([low, high])) => {
                    if low.values[k] < least.values[k] {
                        *least = *low;
                    }
                    if high.values[k] > most.values[k] {
                        *most = *high;
                    }
                }
                (None, new) => *own = *new,
                (Some(_), None) => {}
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_curve_is_kept_whole_and_gaps_are_left_out() {
        let mut curve = Reduced::<2>::default();
        for (k, y) in [1.0, f64::NAN, 3.0, f64::INFINITY].into_iter().enumerate() {
            curve.add(0.5 * k as f64, [y, -(k as f64)]);
        }
        assert_eq!(curve.over_time(0), [(0.0, 1.0), (1.0, 3.0)]);
        assert_eq!(curve.over(1, 0), [(-0.0, 1.0), (-2.0, 3.0)]);
        assert!(!curve.is_reduced() && curve.count() == 4);
        assert!(Reduced::<1>::default().over_time(0).is_empty());
    }

    #[test]
    fn a_long_uneven_curve_keeps_every_extreme_in_bounded_memory() {
        // The time between values grows, so that the spans are doubled often; a few values, the spikes, exceed all
        // others by far.
        let mut curve = Reduced::<2>::default();
        let mut time = 0.0;
        let mut spikes = Vec::new();
        for k in 0..300_000_u32 {
            time += 1e-3 * (1.0 + f64::from(k) / 1e4);
            let spike = k % 30_011 == 5;
            curve.add(time, [if spike { 100.0 + f64::from(k) } else { (f64::from(k) / 5e3).sin() }, f64::from(k)]);
            spikes.extend(spike.then_some((time, 100.0 + f64::from(k))));
        }
        let points = curve.over_time(0);
        assert!(curve.is_reduced() && curve.count() == 300_000);
        assert!(
            points.len() <= 4 * SPANS && curve.spans.len() <= SPANS,
            "too many points or spans: {} points",
            points.len()
        );
        assert!(spikes.iter().all(|spike| points.contains(spike)), "a spike is missing");
        assert!(points.windows(2).all(|w| w[0].0 < w[1].0), "points must be in the order of time");
        assert_eq!(points.last().map(|last| last.0), Some(time));
        assert!(curve.over(1, 0).len() <= 6 * SPANS && curve.over(1, 0).windows(2).all(|w| w[0].0 < w[1].0));
    }

    #[test]
    fn values_of_one_time_only_cannot_be_divided_and_are_kept() {
        let mut curve = Reduced::<1>::default();
        (0..10).for_each(|k| curve.add(1.0, [f64::from(k)]));
        curve.add(0.5, [7.0]);
        curve.add(f64::NAN, [7.0]);
        assert_eq!(curve.over_time(0).len(), 10);
    }
}
