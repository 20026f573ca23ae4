//! Sources of contact wrenches (forces and torques) for the haptic loop: the simulation, and one-dimensional models of
//! known stiffness for measurements of the loop. In each step an environment gets pose and twist of the haptic device
//! and of the tool (the rigid body that the device leads by a virtual coupling), and returns the contact wrench on the
//! tool. A wrench without contact may report *gaps*: distances and directions to bodies.

use glam::DVec3;

use super::local_model::in_series;
use crate::step::tool::{Rows, Tool};
use crate::step::{ContactWrench, DeviceInput, Gap, RigidState, Simulation, Wrench};
use crate::{Error, Result};

/// A source of contact wrenches: each step computes one for each tool from the loops' states.
pub trait Environment {
    /// Simulates `h` s from the given poses and twists of devices and tools, those of the first tools of the environment,
    /// and returns the contact wrench on each at the end of the step.
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>>;

    /// Like [`Environment::feel_each`], with one device.
    fn feel(&mut self, input: &DeviceInput, h: f64) -> Result<ContactWrench> {
        self.feel_each(std::slice::from_ref(input), h).map(|wrenches| wrenches[0])
    }

    /// Called after each step when the loop has its wrench: what takes time, but the wrench need not wait for, is done
    /// here.
    fn after(&mut self) -> Result<()> {
        Ok(())
    }
}

/// The input of the device for an environment that has one tool.
///
/// # Errors
/// [`Error::Usage`]: there are several devices, or none.
pub fn of_one(inputs: &[DeviceInput]) -> Result<&DeviceInput> {
    let problem = || format!("{} haptic devices are given for what has one tool; give one", inputs.len());
    if let [input] = inputs { Ok(input) } else { Err(Error::Usage(problem())) }
}

impl Environment for Simulation {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        self.step_device_inputs(inputs, h)?;
        Ok(self.contact_wrenches(inputs))
    }
}

/// A fixed wall that fills y < 0 and pushes a point-like tool up: F = max(0, -k y - d y') with stiffness k, damping d,
/// the tool's height y and its velocity y'.
#[derive(Debug, Clone)]
pub struct Wall {
    /// Stiffness k, N/m.
    pub stiffness: f64,
    /// Damping d, N s/m.
    pub damping: f64,
    /// Whether a wrench without contact reports the gap to the wall.
    pub tells_gap: bool,
    /// The tool, with the same mass, inertia and coupling as the tool of the haptic loop.
    pub tool: Tool,
    /// Number of steps done.
    pub steps: u64,
}

impl Environment for Wall {
    /// Steps as the simulation does: moves the tool by implicit Euler towards the device's pose, with the device taken
    /// to be at rest; then evaluates the wall's force at the end of the step.
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        let input = of_one(inputs)?;
        let tool = &mut self.tool;
        tool.coupling = input.coupling;
        let RigidState { position, orientation, velocity, angular_velocity } = input.tool;
        (tool.centre, tool.orientation) = (position, orientation);
        (tool.velocity, tool.angular_velocity) = (velocity, angular_velocity);
        let device = RigidState::at_rest(input.device.position, input.device.orientation);
        let device = tool.within_reach(&device, input.max_force);
        let rows = tool.rows(h, DVec3::ZERO, &device);
        let force = |y: f64, v: f64| -self.stiffness * y - self.damping * v;
        let mut change: [f64; 6] = std::array::from_fn(|k| rows.rhs[k] / rows.matrix[k][k]);
        if position.y + h * (velocity.y + change[1]) < 0.0 {
            let held_up = rows.rhs[1] + h * force(position.y + h * velocity.y, velocity.y);
            change[1] = held_up / (rows.matrix[1][1] + h * (self.damping + h * self.stiffness));
        }
        tool.advance(h, change);
        self.steps += 1;
        let depth = (-tool.centre.y).max(0.0);
        let push = if depth > 0.0 { force(tool.centre.y, tool.velocity.y).max(0.0) } else { 0.0 };
        let mut wrench = ContactWrench {
            step: self.steps,
            time: input.time,
            h,
            wrench: Wrench { force: DVec3::Y * push, torque: DVec3::ZERO },
            pressing: push,
            ..ContactWrench::none(tool.state())
        };
        if push > 0.0 {
            (wrench.stiffness[1][1], wrench.damping[1][1]) = (self.stiffness, self.damping);
        } else if self.tells_gap {
            let distance = tool.centre.y.max(0.0);
            wrench.gap = Some(Gap::rigid(DVec3::Y, distance, self.stiffness));
        }
        Ok(vec![wrench])
    }
}

/// A soft body with one degree of freedom: a surface with mass on a spring and a damper, which the tool presses down.
/// Contact between tool and surface is a penalty spring. A wrench reports the stiffness of the penalty spring alone,
/// which is several times the stiffness that is felt. The wrenches of the simulation are like this: their contact
/// stiffness leaves out the body's own compliance.
#[derive(Debug, Clone)]
pub struct Cushion {
    /// Stiffness of the body's spring, N/m.
    pub stiffness: f64,
    /// Damping of the body's damper, N s/m.
    pub damping: f64,
    /// Mass of the surface, kg.
    pub mass: f64,
    /// Stiffness of the penalty contact, N/m.
    pub penalty: f64,
    /// Height (m) of the spring's far end as a function of time (s); 0 at time 0.
    pub far_end: fn(f64) -> f64,
    /// Whether wrenches report that a kinematic body (one with prescribed motion; here the spring's far end) moved.
    pub tells_kinematic_motion: bool,
    /// Whether a wrench without contact reports the gap to the surface.
    pub tells_gap: bool,
    /// The tool, with the same mass, inertia and coupling as the tool of the haptic loop.
    pub tool: Tool,
    /// Height (m) and velocity (m/s) of the surface.
    pub surface: [f64; 2],
    /// Time simulated so far, s.
    pub time: f64,
    /// Number of steps done.
    pub steps: u64,
}

impl Cushion {
    /// A cushion at rest with its surface at y = 0; the penalty contact is three times as stiff as the spring.
    pub fn new(stiffness: f64, tool: Tool) -> Cushion {
        Cushion {
            stiffness,
            damping: 2.0 * (0.005 * stiffness).sqrt(),
            mass: 0.005,
            penalty: 3.0 * stiffness,
            far_end: |_| 0.0,
            tells_kinematic_motion: false,
            tells_gap: true,
            tool,
            surface: [0.0; 2],
            time: 0.0,
            steps: 0,
        }
    }

    /// Stiffness that is felt under a constant load, N/m: the penalty spring and the body's spring in series.
    pub fn felt(&self) -> f64 {
        in_series(self.penalty, 1.0 / self.stiffness)
    }

    /// One step of `h` s by implicit Euler, with contact if `touches`: returns the velocity changes of tool and surface
    /// (m/s) and the force between them (N).
    fn solve(&self, rows: &Rows, h: f64, touches: bool) -> [f64; 3] {
        let penalty = if touches { self.penalty } else { 0.0 };
        let [y, v] = self.surface;
        let begun = penalty * (y - self.tool.centre.y + h * (v - self.tool.velocity.y));
        let sunk = y + h * v - (self.far_end)(self.time + h);
        let (tool, both) = (rows.matrix[1][1] + h * h * penalty, -h * h * penalty);
        let surface = self.mass + h * self.damping + h * h * (self.stiffness + penalty);
        let rhs = [rows.rhs[1] + h * begun, -h * (begun + self.stiffness * sunk + self.damping * v)];
        let determinant = tool * surface - both * both;
        let changes = [(rhs[0] * surface - both * rhs[1]) / determinant, (tool * rhs[1] - both * rhs[0]) / determinant];
        [changes[0], changes[1], begun + penalty * h * (changes[1] - changes[0])]
    }
}

impl Environment for Cushion {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        let input = of_one(inputs)?;
        let device = RigidState::at_rest(input.device.position, input.device.orientation);
        let tool = &mut self.tool;
        tool.coupling = input.coupling;
        (tool.centre, tool.orientation) = (input.tool.position, input.tool.orientation);
        (tool.velocity, tool.angular_velocity) = (input.tool.velocity, input.tool.angular_velocity);
        let rows = tool.rows(h, DVec3::ZERO, &tool.within_reach(&device, input.max_force));
        let touching = self.solve(&rows, h, true);
        let [moved, sunk, force] = if touching[2] > 0.0 { touching } else { self.solve(&rows, h, false) };
        let mut change: [f64; 6] = std::array::from_fn(|k| rows.rhs[k] / rows.matrix[k][k]);
        change[1] = moved;
        self.tool.advance(h, change);
        self.surface[1] += sunk;
        self.surface[0] += h * self.surface[1];
        let has_kinematic_motion =
            self.tells_kinematic_motion && (self.far_end)(self.time) != (self.far_end)(self.time + h);
        self.time += h;
        self.steps += 1;
        let push = force.max(0.0);
        let mut wrench = ContactWrench {
            step: self.steps,
            time: input.time,
            h,
            wrench: Wrench { force: DVec3::Y * push, torque: DVec3::ZERO },
            pressing: push,
            has_kinematic_motion,
            ..ContactWrench::none(self.tool.state())
        };
        if push > 0.0 {
            wrench.stiffness[1][1] = self.penalty;
        } else if self.tells_gap {
            let distance = self.tool.centre.y - self.surface[0];
            // Half of the true compliance: the estimate of a simulation's gap is a lower bound for thick bodies, too.
            let compliance = 0.5 / self.stiffness;
            wrench.gap = Some(Gap { compliance, ..Gap::rigid(DVec3::Y, distance, self.penalty) });
        }
        Ok(vec![wrench])
    }
}
