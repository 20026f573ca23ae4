//! Ticks (iterations of the haptic loop) and simulation steps of a recording as flat lists of named values. A replay
//! compares these values, and a CSV table shows them.

use glam::DVec3;
use palpate::internal::haptics::device::Reading;
use palpate::internal::haptics::event::{Event, Events};
use palpate::internal::haptics::passivity::Energy;
use palpate::internal::haptics::servo::Tick;
use palpate::internal::step::{ContactWrench, DeviceInput, Gap};
use palpate::scene::Coupling;
use palpate::{RigidState, Wrench};

const XYZ: [&str; 3] = ["_x", "_y", "_z"];
/// Suffixes of the names of six components: three linear ones, then three angular ones.
const SIX: [&str; 6] = ["_x", "_y", "_z", "_rx", "_ry", "_rz"];

/// One named value; the name is made of up to three parts.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    name: [&'static str; 3],
    /// The value. Its variant does not depend on the tick or step, only on the name.
    pub value: Value,
}

/// A value of a field. A number is `None` where there is none, as where the device could not be read.
#[derive(Debug, Clone, Copy)]
pub enum Value {
    /// A whole number.
    Count(Option<u64>),
    /// A number, of which every bit is compared.
    Number(Option<f64>),
    /// A set of events, shown as names joined with `|`.
    Events(Events),
}

impl Field {
    /// The field's name, which is also the head of its column.
    pub fn name(&self) -> String {
        self.name.concat()
    }

    /// The value as text; a number in the shortest form that reads back as the same f64.
    pub fn text(&self) -> String {
        match self.value {
            Value::Count(count) => count.map_or(String::new(), |count| count.to_string()),
            Value::Number(number) => number.map_or(String::new(), |number| format!("{number:?}")),
            Value::Events(events) => events.names().collect::<Vec<_>>().join("|"),
        }
    }

    /// The value as a message shows it: values that differ never look alike.
    pub fn told(&self) -> String {
        match self.value {
            Value::Count(None) | Value::Number(None) => "nothing".into(),
            Value::Number(Some(number)) if number.is_nan() => format!("NaN ({:#x})", number.to_bits()),
            Value::Events(events) if events.0 >> Event::ALL.len() != 0 => format!("{:#x}", events.0),
            Value::Events(Events(0)) => "none".into(),
            _ => self.text(),
        }
    }

    /// Whether two values agree in every bit.
    pub fn is_same(&self, other: &Field) -> bool {
        match (self.value, other.value) {
            (Value::Count(a), Value::Count(b)) => a == b,
            (Value::Number(a), Value::Number(b)) => a.map(f64::to_bits) == b.map(f64::to_bits),
            (Value::Events(a), Value::Events(b)) => a == b,
            _ => false,
        }
    }
}

/// All values of a tick, in world axes. The names of a pose's values end in `_x _y _z` (m) and `_qx _qy _qz _qw`, those
/// of a twist (velocity and angular velocity) in `_vx _vy _vz` (m/s) and `_wx _wy _wz` (rad/s). The energies
/// `energy_taken` and `energy_given` (J) are listed for motion along each axis (`_x _y _z`) and for rotation about it
/// (`_rx _ry _rz`); the net energy given to the hand is `energy_given` minus `energy_taken`.
pub fn of_tick(tick: &Tick) -> Vec<Field> {
    let Tick {
        index,
        time,
        late,
        reading,
        device,
        tool,
        contact,
        played,
        step,
        staleness,
        gain,
        damping,
        energy,
        events,
    } = *tick;
    let mut fields = List::default();
    fields.count("tick", index);
    fields.number("time_s", time);
    fields.number("late_s", late);
    fields.reading(reading);
    fields.state("device", &device);
    fields.state("tool", &tool);
    fields.wrench(["contact_force", "contact_torque"], contact);
    fields.wrench(["played_force", "played_torque"], played);
    fields.count("step", step);
    fields.number("age_s", staleness);
    fields.number("gain", gain);
    fields.number("damping", damping);
    let Energy { taken, given, damped, lent, stored } = energy;
    fields.numbers("energy_taken", SIX, taken);
    fields.numbers("energy_given", SIX, given);
    fields.number("energy_damped", damped);
    fields.number("energy_lent", lent);
    fields.number("energy_stored", stored);
    fields.add(["events", "", ""], Value::Events(events));
    fields.0
}

/// All values of a simulation step that belong to one tool: its inputs (named `held_...`), its length, and the contact
/// wrench that it returned.
pub fn of_step(input: &DeviceInput, h: f64, wrench: &ContactWrench) -> Vec<Field> {
    let mut fields = List::default();
    let DeviceInput { ticks, time, device, tool, coupling, max_force } = *input;
    fields.count("held_ticks", ticks);
    fields.number("held_time_s", time);
    fields.state("held_device", &device);
    fields.state("held_tool", &tool);
    let gain = |of: fn(&Coupling) -> f64| Value::Number(coupling.as_ref().map(of));
    fields.add(["held_stiffness", "", ""], gain(|c| c.stiffness));
    fields.add(["held_damping", "", ""], gain(|c| c.damping));
    fields.add(["held_stiffness", "_angular", ""], gain(|c| c.angular_stiffness));
    fields.add(["held_damping", "_angular", ""], gain(|c| c.angular_damping));
    fields.number("held_max_force", max_force);
    fields.number("h_s", h);
    let ContactWrench {
        step,
        time,
        h: _,
        tool,
        wrench,
        stiffness,
        damping,
        pressing,
        friction,
        most_friction,
        gap,
        farther,
        has_kinematic_motion,
    } = *wrench;
    fields.count("step", step);
    fields.number("time_s", time);
    fields.state("tool", &tool);
    fields.wrench(["force", "torque"], wrench);
    for (group, matrix) in [("stiffness", stiffness), ("damping", damping)] {
        for (row, numbers) in SIX.into_iter().zip(matrix) {
            SIX.into_iter().zip(numbers).for_each(|(k, x)| fields.add([group, row, k], Value::Number(Some(x))));
        }
    }
    fields.number("pressing_n", pressing);
    fields.numbers("friction", XYZ, friction.to_array());
    fields.number("most_friction_n", most_friction);
    fields.count("is_driven", has_kinematic_motion.into());
    let names = ["gap", "gap2", "gap3", "gap4", "gap5", "gap6"];
    names.into_iter().zip([gap].into_iter().chain(farther)).for_each(|(name, gap)| fields.gap(name, gap));
    fields.0
}

#[derive(Default)]
struct List(Vec<Field>);

impl List {
    fn add(&mut self, name: [&'static str; 3], value: Value) {
        self.0.push(Field { name, value });
    }

    fn count(&mut self, name: &'static str, count: u64) {
        self.add([name, "", ""], Value::Count(Some(count)));
    }

    fn number(&mut self, name: &'static str, number: f64) {
        self.add([name, "", ""], Value::Number(Some(number)));
    }

    fn numbers<const N: usize>(&mut self, group: &'static str, parts: [&'static str; N], numbers: [f64; N]) {
        parts.into_iter().zip(numbers).for_each(|(part, x)| self.add([group, part, ""], Value::Number(Some(x))));
    }

    fn state(&mut self, group: &'static str, state: &RigidState) {
        let RigidState { position, orientation, velocity, angular_velocity } = *state;
        self.numbers(group, XYZ, position.to_array());
        self.numbers(group, ["_qx", "_qy", "_qz", "_qw"], orientation.to_array());
        self.numbers(group, ["_vx", "_vy", "_vz"], velocity.to_array());
        self.numbers(group, ["_wx", "_wy", "_wz"], angular_velocity.to_array());
    }

    fn wrench(&mut self, [linear, angular]: [&'static str; 2], wrench: Wrench) {
        self.numbers(linear, XYZ, wrench.force.to_array());
        self.numbers(angular, XYZ, wrench.torque.to_array());
    }

    fn gap(&mut self, name: &'static str, gap: Option<Gap>) {
        let mut add = |part: &'static str, of: fn(&Gap) -> f64| {
            self.add([name, part, ""], Value::Number(gap.as_ref().map(of)));
        };
        add("_normal_x", |gap| gap.normal.x);
        add("_normal_y", |gap| gap.normal.y);
        add("_normal_z", |gap| gap.normal.z);
        add("_m", |gap| gap.distance);
        add("_stiffness", |gap| gap.stiffness);
        add("_steepness", |gap| gap.steepness);
        add("_compliance", |gap| gap.compliance);
        add("_retardation_s", |gap| gap.retardation);
        add("_pair", |gap| gap.pair.into());
    }

    /// Adds a reading as the device gave it, or empty values if there is no reading.
    fn reading(&mut self, reading: Option<Reading>) {
        let first = self.0.len();
        let nothing = Reading { time: 0.0, state: RigidState::at_rest(DVec3::ZERO, Default::default()), buttons: 0 };
        let Reading { time, state, buttons } = reading.unwrap_or(nothing);
        self.number("read_time_s", time);
        self.state("read", &state);
        self.count("buttons", buttons.into());
        if reading.is_none() {
            self.0[first..].iter_mut().for_each(|field| {
                field.value = match field.value {
                    Value::Count(_) => Value::Count(None),
                    Value::Number(_) => Value::Number(None),
                    Value::Events(events) => Value::Events(events),
                }
            });
        }
    }
}
