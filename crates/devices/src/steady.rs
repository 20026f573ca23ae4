//! Tests in virtual time (no clock is awaited) of the force *played* (commanded to the haptic device), with the
//! passivity controller on, which bounds the energy that the hand receives. The device leads a rigid *tool* by a spring
//! and a damper, the *virtual coupling*. Some tests press a soft body slowly, hold it and release it, with a scripted
//! device or with the simulated hand, and check that the force at rest is the static force. Others check that the hand
//! receives no energy beyond what the controller has lent it, whatever happens to the simulation; they sum the energy
//! themselves. The controller *lends* energy for a force that appears late, after the hand has already moved unopposed;
//! energy that the hand receives beyond the lent energy is *unpaid*.

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::haptics::environment::{Cushion, Environment};
use palpate::internal::haptics::event::Event;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::{Servo, Settings, Tick};
use palpate::internal::haptics::virtual_time::Schedule;
use palpate::internal::haptics::{Device, coupling};
use palpate::internal::step::ContactWrench;
use palpate::internal::step::tool::Tool;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::profile::Profile;
use palpate::scene::{Haptics, Key, Lowered};

use super::{Hand, HandParameters, Scripted};

/// Period of a tick (iteration of the haptic loop), s.
const PERIOD: f64 = 1e-3;
/// Height of the device and the tool above the soft body's surface at the start, m.
const ABOVE: f64 = 0.005;
/// Time at which the press begins, s.
const BEGIN: f64 = 0.3;
/// Greatest relative difference, at rest, of the played force from the static force and from the force that the newest
/// simulation step computed.
const WITHIN: f64 = 0.03;
/// Bounds for the standard deviation of the force at rest, the greater of which holds: a share of the mean force, and a
/// force in N.
const STILL: [f64; 2] = [0.01, 0.01];
/// Greatest share of the ticks of a slow press, hold and release in which the passivity controller may act.
const ACTING: f64 = 0.01;
/// Names of device profiles with a low, a middling and a high limit of force.
const PROFILES: [&str; 3] = ["touch", "premium", "sigma.7"];

/// Parameters of a press and of its disturbances.
#[derive(Clone, Copy)]
struct Case {
    profile: &'static str,
    /// Whether a scripted device presses, and not the simulated hand.
    is_scripted: bool,
    /// Stiffness of the cushion, the soft body of one degree of freedom that is pressed, N/m.
    stiffness: f64,
    /// Number of simulation steps a second, Hz.
    rate: f64,
    /// Speed of the press, m/s.
    speed: f64,
    /// Whether contact wrenches report the gap between tool and body before they touch.
    tells_gap: bool,
    /// Height (m) of the far end of the cushion's spring as a function of time (s).
    far_end: fn(f64) -> f64,
    /// Delay of a contact wrench after the end of its simulation step, ticks.
    late: u64,
    /// First and last tick of each stall, a time in which the simulation does not step.
    stalls: &'static [[u64; 2]],
    /// Depth below the undeformed surface to which the device goes, m; `None`: a depth that gives a few newtons.
    depth: Option<f64>,
    /// Duration of the hold, s.
    hold: f64,
}

const SLOW: Case = Case {
    profile: "premium",
    is_scripted: false,
    stiffness: 300.0,
    rate: 60.0,
    speed: 0.01,
    tells_gap: true,
    far_end: |_| 0.0,
    late: 0,
    stalls: &[],
    depth: None,
    hold: 2.0,
};

/// Result of a press.
struct Came {
    ticks: Vec<Tick>,
    /// Contact force of each simulation step, N.
    steps: Vec<f64>,
    /// Begin and end of the hold without its first half second, s.
    hold: [f64; 2],
    depth: f64,
    /// Stiffness of the virtual coupling, N/m.
    coupling: f64,
    /// Force limit of the device's profile, N.
    limit: f64,
    /// Stiffness of the cushion as the tool feels it, N/m.
    felt: f64,
}

impl Case {
    fn name(&self) -> String {
        let Case { profile, is_scripted, stiffness, rate, speed, tells_gap, .. } = self;
        format!(
            "profile {profile}, scripted device {is_scripted}, stiffness {stiffness} N/m, {rate} steps a second, speed \
             {speed} m/s, gap reported {tells_gap}"
        )
    }

    fn run(&self) -> Came {
        let profile = Profile::named(self.profile).unwrap();
        let (limits, _) = Limits::new(profile, &Lowered::default());
        let gains = coupling::choose(profile, PERIOD, 0.0, 0.05, 2e-6, None);
        let tool = Tool {
            mass: 0.05,
            inertia: DMat3::IDENTITY * 2e-6,
            coupling: Some(gains.coupling),
            centre: DVec3::Y * ABOVE,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
        };
        let settings = Settings {
            period: PERIOD,
            limits,
            local_model: true,
            passivity: true,
            most_damping: gains.most_damping,
            trust: Haptics::default().trust,
            arm: 6e-3,
            resolution: profile.step(),
        };
        let enough = if self.is_scripted { (2e-3 + 2.0 / self.stiffness).min(8e-3) } else { 0.012 };
        let depth = self.depth.unwrap_or(enough);
        let press = (ABOVE + depth) / self.speed;
        let ends = [0.0, BEGIN, BEGIN + press, BEGIN + press + self.hold, BEGIN + 2.0 * press + self.hold];
        let heights = [ABOVE, ABOVE, -depth, -depth, ABOVE];
        let key = |(time, y): (f64, f64)| Key { time, position: DVec3::Y * y, orientation: DQuat::IDENTITY };
        let keys: Vec<Key> = ends.into_iter().zip(heights).map(key).collect();
        let trajectory = Trajectory::new(&keys, keys[0]);
        let mut device: Box<dyn Device> = match self.is_scripted {
            true => Box::new(Scripted::new(trajectory, profile.clone(), PERIOD)),
            false => Box::new(Hand::new(HandParameters::default(), trajectory, profile.clone()).unwrap()),
        };
        device.open().unwrap();
        let mut cushion = Cushion {
            far_end: self.far_end,
            tells_gap: self.tells_gap,
            tells_kinematic_motion: true,
            ..Cushion::new(self.stiffness, tool.clone())
        };
        let felt = cushion.felt();
        let (ticks, steps) = self.ticks(device.as_mut(), Servo::new(settings, tool), &mut cushion, ends[4] + 0.5);
        let (limit, coupling) = (limits.force, gains.coupling.stiffness);
        Came { ticks, steps, hold: [ends[2] + 0.5, ends[3]], depth, coupling, limit, felt }
    }

    fn ticks(
        &self,
        device: &mut dyn Device,
        mut servo: Servo,
        cushion: &mut Cushion,
        seconds: f64,
    ) -> (Vec<Tick>, Vec<f64>) {
        let interval = u64::from(Schedule::at(self.rate, PERIOD).ticks_a_step);
        let mut newest = servo.newest();
        let mut coming: Vec<(u64, ContactWrench)> = Vec::new();
        let (mut ticks, mut steps): (Vec<Tick>, Vec<f64>) = (Vec::new(), Vec::new());
        for k in 0..(seconds / PERIOD) as u64 {
            let is_stalled = self.stalls.iter().any(|[first, last]| (*first..=*last).contains(&k));
            if k % interval == 0 && !is_stalled {
                let wrench = cushion.feel(&servo.input(), interval as f64 * PERIOD).unwrap();
                steps.push(wrench.wrench.force.y);
                coming.push((k + interval + self.late, wrench));
            }
            if !is_stalled && let Some(at) = coming.iter().rposition(|(due, _)| *due <= k) {
                newest = coming.drain(..=at).next_back().unwrap().1;
            }
            let time = k as f64 * PERIOD;
            let reading = device.read(time);
            let tick = servo.tick(time, 0.0, reading, &newest);
            device.write(&tick.played).unwrap();
            ticks.push(tick);
        }
        (ticks, steps)
    }
}

impl Came {
    /// Two energies, J. The first is the energy that the hand has received beyond the lent energy, at the tick where
    /// this excess is greatest, computed from readings and played forces alone. The second is a bound on the first: the
    /// error that encoders of resolution `quantum` (m) may cause.
    fn unpaid(&self, quantum: f64) -> (f64, f64) {
        let (mut net, mut worst, mut peak, mut variation) = (0.0f64, 0.0f64, 0.0f64, 0.0);
        for pair in self.ticks.windows(2) {
            let [from, to] = [&pair[0], &pair[1]].map(|tick| tick.reading.unwrap().state.position);
            net += pair[0].played.force.dot(to - from);
            worst = worst.max(net - pair[1].energy.lent);
            peak = peak.max(pair[0].played.force.length());
            variation += (pair[1].played.force - pair[0].played.force).length();
        }
        (worst, (quantum * (peak + 0.5 * variation)).max(1e-6))
    }

    fn greatest_loan(&self) -> f64 {
        self.ticks.iter().map(|tick| tick.energy.lent).fold(0.0, f64::max)
    }

    fn held(&self) -> impl Iterator<Item = &Tick> + Clone {
        let [from, to] = self.hold;
        self.ticks.iter().filter(move |tick| (from..to).contains(&tick.time))
    }

    /// Mean and standard deviation of the played force during the hold, N.
    fn force(&self) -> (f64, f64) {
        let count = self.held().count() as f64;
        let mean = self.held().map(|tick| tick.played.force.y).sum::<f64>() / count;
        (mean, (self.held().map(|tick| (tick.played.force.y - mean).powi(2)).sum::<f64>() / count).sqrt())
    }

    /// The force of the step that was newest when the hold ended, N.
    fn of_step(&self) -> f64 {
        self.held().last().and_then(|tick| self.steps.get(tick.step as usize - 1).copied()).unwrap()
    }

    /// Share of all ticks in which the passivity controller damped the force, or slowed the change to a new contact
    /// wrench.
    fn acting(&self) -> f64 {
        let acts = |tick: &&Tick| tick.events.has_any(&[Event::Damped, Event::Unpaid]);
        self.ticks.iter().filter(acts).count() as f64 / self.ticks.len() as f64
    }

    /// Static force, N: cushion and virtual coupling are springs in series, pressed to where the device is at the end
    /// of the hold; the force is cut at the force limit.
    fn at_rest(&self) -> f64 {
        let device = self.held().last().unwrap().reading.unwrap().state.position.y;
        (-device / (1.0 / self.felt + 1.0 / self.coupling)).min(self.limit)
    }
}

#[test]
fn a_steady_force_is_played_as_it_is_and_the_controller_leaves_it_alone() {
    for stiffness in [300.0, 2000.0, 20_000.0] {
        for (profile, is_scripted) in PROFILES.into_iter().flat_map(|name| [(name, false), (name, true)]) {
            for rate in [30.0, 60.0, 250.0] {
                let case = Case { profile, is_scripted, stiffness, rate, ..SLOW };
                let (came, name) = (case.run(), case.name());
                let (force, deviation) = came.force();
                let [step, still] = [came.of_step(), came.at_rest()].map(|own| (force / own - 1.0).abs());
                assert!(force > 0.5 && came.depth > 0.0, "{name}: played force {force} N");
                assert!(
                    step < WITHIN && still < WITHIN,
                    "{name}: played force {force} N, force of the step {} N, static force {} N",
                    came.of_step(),
                    came.at_rest()
                );
                assert!(
                    deviation < (STILL[0] * force).max(STILL[1]),
                    "{name}: mean force {force} N, standard deviation {deviation} N"
                );
                assert!(
                    came.acting() < ACTING,
                    "{name}: the passivity controller acts in a share of {} of all ticks",
                    came.acting()
                );
                let quantum = if is_scripted { 0.0 } else { Profile::named(profile).unwrap().step() };
                let (unpaid, most) = came.unpaid(quantum);
                assert!(
                    unpaid <= most && came.greatest_loan() <= most,
                    "{name}: {unpaid} J unpaid, {} J lent, {most} J allowed for each",
                    came.greatest_loan()
                );
            }
        }
    }
}

#[test]
fn a_force_that_needs_more_than_the_device_has_is_the_limit_everywhere() {
    // The device goes so deep that coupling and cushion in series would push with 7 N.
    let case = Case { profile: "touch", is_scripted: true, stiffness: 450.0, speed: 0.02, rate: 125.0, ..SLOW };
    let came = Case { depth: Some(0.045), ..case }.run();
    let profile = Profile::named(case.profile).unwrap();
    let (force, deviation) = came.force();
    assert!(
        (force - profile.max_force).abs() < 1e-3 && deviation < 1e-3,
        "mean force {force} N, standard deviation {deviation} N"
    );
    assert!((came.of_step() - profile.max_force).abs() < 0.03, "the simulation presses with {} N", came.of_step());
}

/// Even with steps of up to 250 ms and a fast hand the force at rest is the static force. Energy is lent only where the
/// body reports no gap before contact, and then at most the greatest contact force times the depth of the press.
#[test]
fn slow_steps_do_not_mute() {
    for (profile, is_scripted) in PROFILES.into_iter().flat_map(|name| [(name, false), (name, true)]) {
        for (rate, tells_gap) in [(8.0, true), (8.0, false), (4.0, true)] {
            let case = Case { profile, is_scripted, rate, tells_gap, speed: 0.05, hold: 6.0, ..SLOW };
            let (mut came, name) = (case.run(), case.name());
            // At these step rates a few steps take a second, so the force needs longer to settle.
            came.hold[0] += 4.0;
            let (force, _) = came.force();
            let still = came.at_rest();
            assert!((force / still - 1.0).abs() < WITHIN, "{name}: force {force} N, static force {still} N");
            let quantum = if is_scripted { 0.0 } else { Profile::named(profile).unwrap().step() };
            let (unpaid, most) = came.unpaid(quantum);
            assert!(unpaid <= most, "{name}: {unpaid} J unpaid, {most} J allowed");
            let loan = came.greatest_loan();
            let peak = came.ticks.iter().map(|tick| tick.contact.force.length()).fold(0.0, f64::max);
            assert!(if tells_gap { loan <= most } else { loan <= peak * came.depth }, "{name}: {loan} J lent");
        }
    }
}

#[test]
fn whatever_the_simulation_does_the_hand_gets_no_more_than_it_is_lent() {
    let swings: fn(f64) -> f64 = |t| 5e-4 * (40.0 * t).sin();
    let heaves: fn(f64) -> f64 = |t| 1e-3 * (12.0 * t).sin();
    let still: fn(f64) -> f64 = |_| 0.0;
    type Trouble = (u64, &'static [[u64; 2]], fn(f64) -> f64);
    let troubles: [Trouble; 8] = [
        (15, &[], still),
        (60, &[], still),
        (0, &[[500, 600]], still),
        (0, &[[400, 1400]], still),
        (0, &[[1600, 3100]], still),
        (0, &[[700, 1000], [1300, 1600], [1900, 2200]], still),
        (0, &[], swings),
        (0, &[], heaves),
    ];
    for (late, stalls, far_end) in troubles {
        for (stiffness, rate, speed) in [(300.0, 60.0, 0.05), (2000.0, 30.0, 0.05), (20_000.0, 1000.0, 0.01)] {
            for (profile, is_scripted) in PROFILES.into_iter().flat_map(|name| [(name, false), (name, true)]) {
                let tells_gap = far_end(0.1) == 0.0;
                let base = Case { profile, is_scripted, stiffness, rate, speed, tells_gap, ..SLOW };
                let case = Case { late, stalls, far_end, ..base };
                let came = case.run();
                let quantum = if is_scripted { 0.0 } else { Profile::named(profile).unwrap().step() };
                let (unpaid, most) = came.unpaid(quantum);
                assert!(
                    unpaid <= most,
                    "{}, wrenches late by {late} ticks, stalls {stalls:?}: {unpaid} J unpaid, {most} J allowed",
                    case.name()
                );
            }
        }
    }
}

#[test]
fn repeated_stalls_lend_no_more_than_one() {
    // The watchdog lets the force fade when the newest contact wrench is more than 1 s out of date. In the three rows
    // below the stalls are shorter than 1 s, about 1 s long, and so long that the force fades in each stall.
    let stalls: [[&[[u64; 2]]; 2]; 3] = [
        [&[[2000, 2900]], &[[2000, 2900], [3500, 4400], [5000, 5900], [6500, 7400]]],
        [&[[2000, 3000]], &[[2000, 3000], [3500, 4500], [5000, 6000], [6500, 7500]]],
        [&[[2000, 3200]], &[[2000, 3200], [3500, 4700], [5000, 6200], [6500, 7700]]],
    ];
    for (profile, tells_gap) in PROFILES.into_iter().flat_map(|name| [(name, false), (name, true)]) {
        for [once, often] in stalls {
            let [one, all] = [once, often].map(|stalls| {
                let case = Case { profile, stalls, speed: 0.05, hold: 9.0, tells_gap, rate: 30.0, ..SLOW };
                case.run().greatest_loan()
            });
            assert!(
                all <= 1.05 * one + 1e-6,
                "{profile}, gap reported {tells_gap}: {all} J lent in the stalls {often:?}, {one} J in the first alone"
            );
        }
    }
}

#[test]
fn a_kinematic_body_that_pushes_gives_a_tenth_of_a_watt() {
    let push: fn(f64) -> f64 = |t| 0.02 * (t - 2.0).clamp(0.0, 1.0);
    for (profile, is_scripted) in PROFILES.into_iter().flat_map(|name| [(name, false), (name, true)]) {
        let case = Case { profile, is_scripted, far_end: push, stiffness: 2000.0, speed: 0.05, hold: 4.0, ..SLOW };
        let came = case.run();
        // Only energy that was lent since the push began counts.
        let before = came.ticks.iter().filter(|tick| tick.time < 2.0).map(|tick| tick.energy.lent).fold(0.0, f64::max);
        let lent = came.greatest_loan() - before;
        let quantum = if is_scripted { 0.0 } else { Profile::named(profile).unwrap().step() };
        let (unpaid, most) = came.unpaid(quantum);
        assert!(
            unpaid <= most && lent <= 0.1 * 1.1,
            "{}: {unpaid} J unpaid, {most} J allowed; {lent} J lent",
            case.name()
        );
        // The body pushes the hand away, so some energy must be lent.
        assert!(lent > 1e-3, "{}: only {lent} J were lent", case.name());
    }
}
