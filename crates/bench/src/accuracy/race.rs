//! Runs the settings of an accuracy curve alternately and measures their times and errors. Each setting (an entrant)
//! does a few steps in turn, and every second turn has the reverse order, so that a change of the machine's speed
//! favours none of them. A round is one run of every entrant, or several runs of an entrant whose run is short. Where
//! there are more entrants than fit into memory, a round is split into heats, each with a part of the entrants.

use std::time::Instant;

use glam::DVec3;
use palpate::{Flags, Options, Result, Scene, Simulation};

use super::curve::Point;

/// Number of turns into which a run is split if it has enough steps.
const TURNS: usize = 10;
/// Least number of steps of a turn; a run of fewer than twice this number is done in one turn.
const TURN: usize = 6;
/// One step in this number of steps has its stages timed. Timestamps take time, so that the wall time of such a step
/// does not count.
const TIMED_EVERY: u64 = 4;
/// Steps at the start of each turn whose times do not count, because they find caches cold.
const WARM_UP: usize = 1;
/// Largest number of simulations that are open at once, that is, of entrants in a heat: each simulation has GPU kernels
/// of its own, which take some 150 MB on the CPU driver lavapipe. Each heat takes settings from all over the list and
/// every second round runs the heats in reverse order, so that a change of the machine's speed does not look like a
/// property of neighbouring settings.
const MOST_AT_ONCE: usize = 12;

/// One setting that takes part: its scene, and the number of its steps.
#[derive(Debug, Clone)]
pub struct Entrant {
    /// Names of the setting, and its value of the knob (the varied value); [`race`] fills in times and errors.
    pub point: Point,
    /// The scene, with the setting in it.
    pub scene: Scene,
    /// Number of steps of a run, which starts from rest.
    pub steps: usize,
}

/// How often the entrants are run, and which stages are timed.
#[derive(Debug, Clone, Copy)]
pub struct Rules<'a> {
    /// Number of rounds.
    pub rounds: usize,
    /// Least number of steps of an entrant in a round. Shorter runs are repeated, since a median over few steps is
    /// uncertain.
    pub timed_steps: usize,
    /// Names of the stages whose times are summed; see [`palpate::internal::stages`].
    pub stages: &'a [&'a str],
    /// Options with which the engine is opened: GPU device and others.
    pub options: &'a Options,
}

impl Rules<'_> {
    /// How often a run of `steps` steps is repeated in a round.
    fn repeats(&self, steps: usize) -> usize {
        self.timed_steps.div_ceil(steps.max(1)).max(1)
    }
}

/// Results of one run.
#[derive(Debug, Clone, Default)]
pub struct Run {
    /// Time at the end of each step, s.
    pub times: Vec<f64>,
    /// Force on the tool (rigid body that the haptic device leads) at the end of each step, world axes, N; empty
    /// without a tool.
    pub forces: Vec<DVec3>,
    /// Displacements of the first body's nodes after the last step, in the axes of the body at rest, m; empty if that
    /// body is not soft.
    pub displacement: Vec<DVec3>,
    /// Solver iterations of each step.
    pub iterations: Vec<u32>,
    /// All flags (warnings) that any step raised.
    pub flags: Flags,
    step_us: Vec<f64>,
    stage_us: Vec<f64>,
}

/// Relative errors of a run: of the force and of the displacements. `None`: the error is not finite, or was not
/// measured.
pub type Errors = (Option<f64>, Option<f64>);

/// Runs all entrants for all rounds and returns their points. `errors(index, run)` returns the errors of the first run
/// of each entrant; all later runs of a setting give the same results.
pub fn race(
    entrants: Vec<Entrant>,
    rules: &Rules,
    watch: &mut dyn FnMut(&str),
    errors: &mut dyn FnMut(usize, &Run) -> Errors,
) -> Result<Vec<Point>> {
    let mut points: Vec<Point> = entrants.iter().map(|entrant| entrant.point.clone()).collect();
    for round in 0..rules.rounds {
        watch(&format!("round {} of {}", round + 1, rules.rounds));
        for (index, (runs, point)) in one_round(&entrants, rules, round)?.into_iter().zip(&mut points).enumerate() {
            if let (0, Some(run)) = (round, runs.first()) {
                (point.force_error, point.displacement_error) = errors(index, run);
                point.iterations = crate::median(&run.iterations.iter().map(|&n| n.into()).collect::<Vec<_>>());
                point.flags = run.flags.names().map(String::from).collect();
            }
            point.step_us.push(runs.iter().flat_map(|run| run.step_us.clone()).collect());
            point.stage_us.push(runs.iter().flat_map(|run| run.stage_us.clone()).collect());
        }
    }
    Ok(points)
}

/// Runs one scene by itself without timing it; this is how references are computed.
pub fn run(scene: &Scene, steps: usize, options: &Options) -> Result<Run> {
    let mut simulation = Simulation::open(scene, options)?;
    let mut run = Run::default();
    run.add_steps(&mut simulation, steps, &[])?;
    run.finish(&simulation)
}

/// Does one round: all runs of each entrant.
fn one_round(entrants: &[Entrant], rules: &Rules, round: usize) -> Result<Vec<Vec<Run>>> {
    let repeats: Vec<usize> = entrants.iter().map(|entrant| rules.repeats(entrant.steps)).collect();
    let again = |k: usize| repeats.iter().enumerate().filter(move |(_, own)| k < **own).map(|(index, _)| index);
    let most = repeats.iter().max().copied().unwrap_or(0);
    let mut all: Vec<usize> = (0..most).flat_map(again).collect();
    mix(&mut all);
    let mut heats: Vec<&[usize]> = all.chunks(MOST_AT_ONCE).collect();
    if round % 2 == 1 {
        heats.reverse();
    }
    let mut runs = vec![Vec::new(); entrants.len()];
    for own in heats {
        for (index, run) in own.iter().zip(heat(entrants, own, rules, round)?) {
            runs[*index].push(run);
        }
    }
    Ok(runs)
}

/// Reorders the entrants, if there are more than one heat holds, so that each heat has entrants from every part of the
/// list: sorts them by their index times the golden ratio modulo 2^64, which spreads neighbours evenly.
fn mix(all: &mut [usize]) {
    if all.len() > MOST_AT_ONCE {
        all.sort_by_cached_key(|index| (*index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    }
}

/// Runs each of the entrants with the indices `own` once, in turns.
fn heat(entrants: &[Entrant], own: &[usize], rules: &Rules, round: usize) -> Result<Vec<Run>> {
    let open = |index: &usize| -> Result<(Simulation, Run)> {
        let mut simulation = Simulation::open(&entrants[*index].scene, rules.options)?;
        simulation.time_every(TIMED_EVERY)?;
        Ok((simulation, Run::default()))
    };
    let mut under_way = own.iter().map(open).collect::<Result<Vec<_>>>()?;
    for turn in 1..=TURNS {
        let forward = (0..under_way.len()).collect::<Vec<_>>();
        let order = if (turn + round) % 2 == 1 { forward } else { forward.into_iter().rev().collect() };
        for k in order {
            let (simulation, run) = &mut under_way[k];
            let due = done(entrants[own[k]].steps, turn) - run.times.len();
            run.add_steps(simulation, due, rules.stages)?;
        }
    }
    under_way.into_iter().map(|(simulation, run)| run.finish(&simulation)).collect()
}

/// Number of steps that a run of `steps` steps has done after turn `turn`. A short run takes part in fewer turns,
/// spread about the middle of all turns: otherwise most of its steps would be the first of a turn and find caches cold.
fn done(steps: usize, turn: usize) -> usize {
    let own = (steps / TURN).clamp(1, TURNS);
    steps * ((turn * own + TURNS / 2) / TURNS) / own
}

impl Run {
    fn add_steps(&mut self, simulation: &mut Simulation, steps: usize, stages: &[&str]) -> Result<()> {
        for step in 0..steps {
            let begun = Instant::now();
            let row = simulation.step()?;
            let time = begun.elapsed().as_secs_f64() * 1e6;
            if step >= WARM_UP {
                match simulation.stage_times() {
                    Some(times) => self.add_stage(times, stages),
                    None => self.step_us.push(time),
                }
            }
            self.times.push(row.time);
            self.forces.extend(row.tool.map(|tool| tool.force));
            self.iterations.push(row.iterations);
            self.flags |= row.flags;
        }
        Ok(())
    }

    /// Adds the summed time of `stages`. In every second timed step the stages of the proximity query (those from pose
    /// to contact, which find the contacts) are timed as one, so that `stages` may be missing from `times`; then
    /// nothing is added.
    fn add_stage(&mut self, times: &[(String, f64)], stages: &[&str]) {
        let own: Vec<f64> =
            times.iter().filter(|(name, _)| stages.contains(&name.as_str())).map(|(_, us)| *us).collect();
        if !own.is_empty() {
            self.stage_us.push(own.iter().sum());
        }
    }

    fn finish(mut self, simulation: &Simulation) -> Result<Run> {
        self.displacement = simulation.nodes(0)?.map_or(Vec::new(), |(displacement, _)| displacement);
        Ok(self)
    }
}

/// The largest difference between `found` and `reference`, divided by the largest length in `reference`. `None` where
/// the quotient is not finite, all of `reference` is zero, or the lists differ in length.
pub fn relative_error(found: &[DVec3], reference: &[DVec3]) -> Option<f64> {
    let largest = reference.iter().map(|x| x.length()).fold(0.0, f64::max);
    let differences = found.iter().zip(reference).map(|(a, b)| a.distance(*b));
    // This maximum keeps NaN, which `f64::max` drops.
    let error = differences.fold(0.0, |a: f64, b| if a > b || a.is_nan() { a } else { b }) / largest;
    (error.is_finite() && largest > 0.0 && found.len() == reference.len()).then_some(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_run_is_done_in_turns_of_enough_steps() {
        for steps in 1..400 {
            let turns: Vec<usize> = (1..=TURNS).map(|turn| done(steps, turn) - done(steps, turn - 1)).collect();
            assert_eq!((done(steps, 0), done(steps, TURNS)), (0, steps));
            assert!(
                turns.iter().all(|&own| own == 0 || own >= TURN.min(steps)),
                "a run of {steps} steps is split into turns of {turns:?} steps, some of them too short"
            );
        }
        let turns = |steps| (1..=TURNS).filter(|turn| done(steps, *turn) > done(steps, turn - 1)).count();
        assert_eq!([6, 12, 60, 384].map(turns), [1, 2, 10, 10]);
        let options = Options::default();
        let rules = |timed_steps| Rules { rounds: 1, timed_steps, stages: &[], options: &options };
        assert_eq!([6, 12, 23, 24, 384].map(|steps| rules(24).repeats(steps)), [4, 2, 2, 1, 1]);
        assert_eq!([0, 6, 384].map(|steps| rules(0).repeats(steps)), [1, 1, 1]);
    }

    #[test]
    fn errors_are_of_the_largest_and_none_where_they_are_no_numbers() {
        let reference = [DVec3::ZERO, DVec3::new(0.0, 3.0, 4.0)];
        assert_eq!(relative_error(&[DVec3::X * 0.5, reference[1]], &reference), Some(0.1));
        for found in [vec![DVec3::NAN, reference[1]], vec![DVec3::ZERO, DVec3::NAN], vec![DVec3::ZERO]] {
            assert_eq!(relative_error(&found, &reference), None);
        }
        assert_eq!(relative_error(&[DVec3::X], &[DVec3::ZERO]), None);
    }
}
