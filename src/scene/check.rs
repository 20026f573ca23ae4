//! The rules for the values of a scene (the bodies, the tool and the settings of a simulation).
//! [`super::SceneBuilder`] checks whole structs; the reader of scene files (`keys.rs`) also checks single numbers, so
//! that it can report the line of a wrong number. A soft body has a skin (surface mesh), a layer (tetrahedral mesh) and
//! cores (rigid bodies inside it, to which nodes of the layer are attached). The tool is the rigid body that the haptic
//! device moves. A *key* is the name of a value in a scene file; the key of a trajectory is a pose at a given time.

use std::fmt::Debug;
use std::ops::RangeInclusive;

use glam::{DQuat, DVec3};

use super::joint::closes_loop;
use super::{
    Bind, Body, Contact, Core, Coupling, DeviceKind, Dilatation, FurtherTool, Group, HAPTIC_RATES, Haptics, Hinge,
    Joint, Key, Layer, MOST_HULLS, Material, Motion, Place, Probe, Scene, Shape, Solver, Step, Surface, Tool,
    ToolShape,
};

/// Greatest magnitude of a number. The greatest number of single precision, 3e38, is so much greater that the number
/// may be multiplied by 1e8 without overflow.
pub const LARGEST: f64 = 1e30;
/// Least value of a number that must be greater than zero. The least normal number of single precision, 1e-38, is so
/// much less that the number may be multiplied by small factors without becoming zero.
const SMALLEST: f64 = 1e-30;
/// Greatest length of a name, in characters: a name with an extension must be a valid file name on every system.
const LONGEST_NAME: usize = 100;
/// Greatest difference between a quaternion's length and one: a smaller difference is rounding, a larger one is a
/// typing error.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Greatest difference between one and the length of a normal or an axis that a program gives. Vectors from a scene
/// file are normalised when they are read.
const NORMAL_TOLERANCE: f64 = 1e-6;
/// Greatest number of iterations of the linear solver: all of them are recorded in command buffers before they run.
pub const MOST_ITERATIONS: u32 = 10_000;
/// Greatest number of Newton iterations in a step.
pub const MOST_LINEARISATIONS: u32 = 100;
/// Time step, s, above which a scene gets a note.
const LONG_STEP: f64 = 0.1;
/// Least speed, m/s, at which friction may change from viscous (at lower speeds) to Coulomb friction.
const SLOWEST: f64 = 1e-6;
/// Greatest number of cells, along the largest extent of a surface, in the lattice from which its layer is generated.
pub const MOST_ACROSS: u32 = 1000;
/// Greatest number of cells along an axis of a box layer, that is, a layer that is generated as a box of cells.
pub const MOST_CELLS: u32 = 1 << 20;
/// Greatest number of tetrahedra that a scene may ask of a box layer. The module `crate::prepare`, which generates the
/// layer, has a lower limit.
const MOST_BOX_TETRAHEDRA: u64 = 1 << 27;
/// Greatest number of tools of a scene.
pub const MOST_TOOLS: usize = 4;
/// Range of Poisson's ratio. At -0.5 the bulk modulus is a sixth of the shear modulus; towards -1 the share falls to 0.
const POISSON: std::ops::Range<f64> = -0.5..0.5;
/// Names that no probe (a skin vertex whose positions are recorded) may have, because the trace (a CSV file with the
/// results of a run) already has columns whose names begin with them.
const RESERVED_PROBES: [&str; 4] = ["tool", "device", "force", "torque"];
/// Remedy for a wrong key of a trajectory; it explains what a key is.
pub const KEY_REMEDY: &str =
    "a key is t,x,y,z or t,x,y,z,qx,qy,qz,qw: numbers below 1e30, unit quaternion, times increasing";

/// An error in a value, and its remedy.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    /// Dotted path of the wrong key, relative to the value that was checked; empty if that whole value is wrong.
    pub key: String,
    /// What is wrong.
    pub problem: String,
    /// What the user can do about it.
    pub remedy: String,
}

/// The result of a check: `Ok` if the value is valid, otherwise the problem.
pub type Check<T = ()> = std::result::Result<T, Problem>;

impl Problem {
    /// A problem of the whole value that was checked.
    pub fn new(problem: impl Into<String>, remedy: impl Into<String>) -> Problem {
        Problem { key: String::new(), problem: problem.into(), remedy: remedy.into() }
    }

    /// A problem of one key of the value that was checked.
    pub fn of(key: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> Problem {
        Problem { key: key.into(), problem: problem.into(), remedy: remedy.into() }
    }

    /// Puts `key`, the key of the value that was checked, before the problem's own key.
    pub fn within(mut self, key: impl AsRef<str>) -> Problem {
        let dot = if self.key.is_empty() || self.key.starts_with('[') { "" } else { "." };
        self.key = format!("{}{dot}{}", key.as_ref(), self.key);
        self
    }
}

/// Prefixes the key of a problem, if a check found one; see [`Problem::within`].
pub(super) trait Under {
    fn under(self, key: impl AsRef<str>) -> Self;
}

impl<T> Under for Check<T> {
    fn under(self, key: impl AsRef<str>) -> Self {
        self.map_err(|problem| problem.within(key))
    }
}

fn is(x: impl Debug, remedy: impl Into<String>) -> Problem {
    Problem::new(format!("is {x:?}"), remedy)
}

/// Checks that a number is finite and not greater than [`LARGEST`] in magnitude.
pub fn finite(x: f64) -> Check {
    let sound = x.is_finite() && x.abs() <= LARGEST;
    if sound { Ok(()) } else { Err(is(x, "give a finite number below 1e30 in magnitude")) }
}

/// Checks that a number is greater than zero.
pub fn positive(x: f64) -> Check {
    finite(x)?;
    let remedy = || format!("give a number greater than zero, {SMALLEST:e} at least");
    if x >= SMALLEST { Ok(()) } else { Err(is(x, remedy())) }
}

/// Checks that a number is zero or more.
pub fn not_negative(x: f64) -> Check {
    finite(x)?;
    if x >= 0.0 { Ok(()) } else { Err(is(x, "give zero or a number greater than zero")) }
}

/// Checks Poisson's ratio.
pub fn poisson(x: f64) -> Check {
    finite(x)?;
    if POISSON.contains(&x) { Ok(()) } else { Err(is(x, "give a number from -0.5 to below 0.5")) }
}

/// Checks the relative residual at which the linear solver stops.
pub fn tolerance(x: f64) -> Check {
    positive(x)?;
    if x < 1.0 { Ok(()) } else { Err(is(x, "give a number below one")) }
}

/// Checks the speed below which friction is viscous, m/s.
pub fn friction_speed(x: f64) -> Check {
    finite(x)?;
    let remedy = "give 1e-6 m/s or more: smaller values are lost in single precision";
    if x >= SLOWEST { Ok(()) } else { Err(is(x, remedy)) }
}

/// Checks the rate of the haptic loop, Hz.
pub fn rate(rate: f64) -> Check {
    positive(rate)?;
    let [low, high] = HAPTIC_RATES;
    if (low..=high).contains(&rate) { Ok(()) } else { Err(is(rate, format!("give {low:?} to {high:?} Hz"))) }
}

/// Checks the resolution of a haptic device's positions, m.
pub fn resolution(resolution: f64) -> Check {
    positive(resolution)?;
    if resolution <= 0.01 { Ok(()) } else { Err(is(resolution, "give at most 0.01 m")) }
}

/// Checks an angle that limits a joint, rad.
pub fn limit(angle: f64) -> Check {
    positive(angle)?;
    let remedy = "give an angle below pi (rad), or leave it out for no limit";
    if angle < std::f64::consts::PI { Ok(()) } else { Err(is(angle, remedy)) }
}

/// Checks the grade of a layer: the edge of its largest cells, deep inside, over the edge of its cells at the surface.
pub fn grade(grade: u32) -> Check {
    let sound = (1..=8).contains(&grade) && grade.is_power_of_two();
    if sound { Ok(()) } else { Err(is(grade, "give 1, 2, 4 or 8")) }
}

/// Checks that a whole number lies in a range.
pub fn whole(x: u32, range: RangeInclusive<u32>) -> Check {
    let remedy = || format!("give a whole number from {} to {}", range.start(), range.end());
    if range.contains(&x) { Ok(()) } else { Err(is(x, remedy())) }
}

/// Checks a name: it may consist of letters, digits, `_`, `-` and `.`, because it becomes part of file names and column
/// headings.
pub fn name(text: &str) -> Check {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    if text.is_empty() || text.starts_with('.') || !text.chars().all(allowed) {
        let remedy = "use letters, digits, '_', '-' and '.', and do not start with '.'";
        return Err(Problem::new(format!("\"{}\" cannot be a name", text.escape_debug()), remedy));
    }
    if text.len() > LONGEST_NAME {
        let problem = format!("a name of {} characters", text.len());
        return Err(Problem::new(problem, format!("use at most {LONGEST_NAME}: names become part of file names")));
    }
    Ok(())
}

/// Checks that the least corner of a box, `low`, is below the greatest corner, `high`, on every axis.
pub fn corners(low: DVec3, high: DVec3) -> Check {
    let remedy = "give the least corner first";
    if low.cmplt(high).all() {
        Ok(())
    } else {
        Err(Problem::new(format!("{low} is not below {high} on every axis"), remedy))
    }
}

/// Checks the radius of a sphere, m.
pub fn radius(radius: f64) -> Check {
    finite(radius)?;
    let remedy = "give x, y, z and a radius above zero";
    if radius > 0.0 { Ok(()) } else { Err(Problem::new(format!("has radius {radius:?}"), remedy)) }
}

/// Checks that a box layer has not too many tetrahedra, six in each cell; `cells`: numbers of cells along the axes.
pub fn box_cells(cells: [u32; 3]) -> Check {
    let total = cells.iter().try_fold(6_u64, |product, &count| product.checked_mul(count.into()));
    if total.is_some_and(|total| total <= MOST_BOX_TETRAHEDRA) {
        return Ok(());
    }
    Err(Problem::new("makes too many tetrahedra", format!("give at most {MOST_BOX_TETRAHEDRA}, 6 in each cell")))
}

/// The normalised quaternion x y z w; fails where its length differs from one by more than rounding.
pub fn unit_quaternion(q: [f64; 4]) -> Check<DQuat> {
    let quaternion = DQuat::from_array(q);
    let length = quaternion.length();
    if (length - 1.0).abs() <= UNIT_TOLERANCE {
        Ok(quaternion.normalize())
    } else {
        Err(Problem::new(format!("quaternion has length {length:.4e}"), "give a unit quaternion x y z w"))
    }
}

/// Checks that the time of a trajectory's key (s) comes after `before`, the time of the key before it.
pub fn key_time(time: f64, before: Option<f64>) -> Check {
    match before {
        Some(before) if before >= time => {
            Err(Problem::new(format!("time {time:?} does not come after {before:?}"), KEY_REMEDY))
        }
        _ => Ok(()),
    }
}

/// Checks that the name of a probe is neither reserved nor the name of one of the other probes, `others`.
pub fn probe_name(name: &str, others: &[Probe]) -> Check {
    if others.iter().any(|probe| probe.name == name) {
        return Err(Problem::of("name", format!("\"{name}\" is taken by another probe"), "choose another name"));
    }
    if RESERVED_PROBES.contains(&name) {
        let problem = format!("\"{name}\" is a column of the trace already");
        return Err(Problem::of("name", problem, "choose another name"));
    }
    Ok(())
}

/// Checks the three numbers of a vector.
pub(super) fn vector(x: DVec3) -> Check {
    for (k, x) in x.to_array().into_iter().enumerate() {
        finite(x).under(format!("[{k}]"))?;
    }
    Ok(())
}

/// Checks that a vector has unit length.
pub(super) fn direction(x: DVec3) -> Check {
    vector(x)?;
    let length = x.length();
    let sound = (length - 1.0).abs() <= NORMAL_TOLERANCE;
    if sound { Ok(()) } else { Err(Problem::new(format!("has length {length:.4e}"), "give a unit vector")) }
}

fn orientation(q: DQuat) -> Check {
    unit_quaternion(q.to_array()).map(|_| ())
}

/// Checks all keys of a trajectory.
pub fn keys(keys: &[Key]) -> Check {
    if keys.is_empty() {
        return Err(Problem::new("is empty", "give at least one key"));
    }
    let mut before = None;
    for (k, key) in keys.iter().enumerate() {
        let numbers = || {
            finite(key.time)?;
            vector(key.position)?;
            orientation(key.orientation)?;
            key_time(key.time, before)
        };
        numbers().under(format!("[{k}]"))?;
        before = Some(key.time);
    }
    Ok(())
}

impl Scene {
    /// Values that are allowed but most likely a mistake, one sentence each.
    #[doc(hidden)]
    pub fn notes(&self) -> Vec<String> {
        let dt = self.step.dt;
        let is_long = dt > LONG_STEP;
        let long = format!(
            "`step.dt`: a step of {dt} s leaves out all that happens within it; steps of 0.001 to 0.01 s are usual, and \
             what is felt needs them"
        );
        is_long.then_some(long).into_iter().collect()
    }
}

impl Step {
    /// Checks all values, and returns the first problem.
    pub(crate) fn check(&self) -> Check {
        positive(self.dt).under("dt")?;
        vector(self.gravity).under("gravity")?;
        whole(self.newton, 1..=MOST_LINEARISATIONS).under("newton")
    }
}

impl Solver {
    /// Checks all values, and returns the first problem.
    pub(crate) fn check(&self) -> Check {
        self.tolerance.map_or(Ok(()), tolerance).under("tolerance")?;
        whole(self.max_iterations, 1..=MOST_ITERATIONS).under("max_iterations")
    }
}

impl Contact {
    /// Checks all values, and returns the first problem.
    pub(crate) fn check(&self) -> Check {
        self.stiffness.map_or(Ok(()), positive).under("stiffness")?;
        self.damping.map_or(Ok(()), not_negative).under("damping")?;
        not_negative(self.friction).under("friction")?;
        friction_speed(self.friction_speed).under("friction_speed")?;
        self.texel.map_or(Ok(()), positive).under("texel")?;
        positive(self.depth_limit).under("depth_limit")
    }
}

impl Coupling {
    /// Checks all values, and returns the first problem.
    pub(crate) fn check(&self) -> Check {
        not_negative(self.stiffness).under("stiffness")?;
        not_negative(self.damping).under("damping")?;
        not_negative(self.angular_stiffness).under("angular_stiffness")?;
        not_negative(self.angular_damping).under("angular_damping")
    }
}

impl Material {
    /// Checks all values, and returns the first problem.
    pub(crate) fn check(&self) -> Check {
        positive(self.young).under("young")?;
        poisson(self.poisson).under("poisson")?;
        positive(self.density).under("density")?;
        not_negative(self.damping_mass).under("damping_mass")?;
        not_negative(self.damping_stiffness).under("damping_stiffness")
    }
}

impl Haptics {
    /// Checks the values, and returns the first problem. Two groups of settings are checked only when a file is read:
    /// those of the service that connects to a Haply device, and those of the simulated hand.
    pub(crate) fn check(&self) -> Check {
        rate(self.rate).under("rate")?;
        self.resolution.map_or(Ok(()), resolution).under("resolution")?;
        let limits = &self.limits;
        let limits = [
            ("max_force", limits.force),
            ("max_torque", limits.torque),
            ("max_slew", limits.slew),
            ("workspace", limits.workspace),
            ("watchdog", limits.watchdog),
        ];
        limits.into_iter().try_for_each(|(key, limit)| limit.map_or(Ok(()), positive).under(key))?;
        if self.recording.is_some() && self.device != DeviceKind::Replay {
            return Err(Problem::of("recording", "belongs to device = \"replay\"", "remove it or set `device`"));
        }
        self.check_unit().map_err(|(problem, remedy)| Problem::of("unit", problem, remedy))?;
        self.check_profile().map_err(|(problem, remedy)| Problem::of("profile", problem, remedy))?;
        positive(self.trust).under("trust")?;
        positive(self.longest_step).under("longest_step")
    }
}

impl Tool {
    /// Checks all values, and returns the first problem.
    pub(crate) fn check(&self) -> Check {
        name(&self.name).under("name")?;
        match &self.shape {
            ToolShape::Sphere(radius) => positive(*radius).under("sphere")?,
            ToolShape::Surface(surface) => check_surface(surface).under("surface")?,
            ToolShape::Body(body) => name(body).under("body")?,
        }
        let (is_body, is_sphere) =
            (matches!(self.shape, ToolShape::Body(_)), matches!(self.shape, ToolShape::Sphere(_)));
        let (shape, given): (_, &[(&str, bool)]) = match (is_body, is_sphere) {
            // A tool that is a body of the scene has that body's mass and pose.
            (true, _) => (
                "body",
                &[
                    ("mass", self.mass != 0.0),
                    ("position", self.position != DVec3::ZERO),
                    ("orientation", self.orientation != DQuat::IDENTITY),
                    ("velocity", self.velocity != DVec3::ZERO),
                    ("units", self.units.is_some()),
                    ("scale", self.scale != 1.0),
                ],
            ),
            (_, true) => ("sphere", &[("units", self.units.is_some()), ("scale", self.scale != 1.0)]),
            _ => ("surface", &[]),
        };
        if let Some((key, _)) = given.iter().find(|(_, is_given)| *is_given) {
            return Err(Problem::of(*key, format!("has no meaning together with `{shape}`"), "remove it"));
        }
        if is_body {
            return Ok(());
        }
        positive(self.mass).under("mass")?;
        vector(self.position).under("position")?;
        orientation(self.orientation).under("orientation")?;
        vector(self.velocity).under("velocity")?;
        self.units.map_or(Ok(()), positive).under("units")?;
        positive(self.scale).under("scale")
    }
}

impl Body {
    /// Checks all values, and returns the first problem. Whether the bodies in the list `collides` exist is not checked
    /// here.
    pub(crate) fn check(&self) -> Check {
        name(&self.name).under("name")?;
        self.check_shape()?;
        self.hulls.map_or(Ok(()), |hulls| whole(hulls, 1..=MOST_HULLS)).under("hulls")?;
        self.units.map_or(Ok(()), positive).under("units")?;
        positive(self.scale).under("scale")?;
        vector(self.position).under("position")?;
        orientation(self.orientation).under("orientation")?;
        vector(self.velocity).under("velocity")?;
        for (k, core) in self.cores.iter().enumerate() {
            let key = if self.is_soft() { format!("core.{}", core.name) } else { String::new() };
            core.check(self.is_soft()).map_err(|problem| if key.is_empty() { problem } else { problem.within(key) })?;
            if self.cores[..k].iter().any(|other| other.name == core.name) {
                let problem = format!("\"{}\" is taken by another core", core.name);
                return Err(Problem::of("core", problem, "choose another name"));
            }
        }
        let bones = self.skeleton.iter().flat_map(|skeleton| &skeleton.bones);
        for (k, bone) in bones.enumerate() {
            if self.cores.get(k).is_none_or(|core| core.name != bone.name) {
                let problem = format!("core {k} of the body is not that of bone \"{}\"", bone.name);
                return Err(Problem::of("skeleton", problem, "let the bones' cores come first, in the bones' order"));
            }
        }
        for (k, joint) in self.joints.iter().enumerate() {
            self.check_joint(k, joint).under(format!("joint[{k}]"))?;
        }
        for (k, load) in self.loads.iter().enumerate() {
            load.check(&self.cores, &self.loads[..k]).under(format!("load.{}", load.name))?;
        }
        for (k, support) in self.supports.iter().enumerate() {
            support.check(&self.cores, &self.supports[..k]).under(format!("support.{}", support.name))?;
        }
        Ok(())
    }

    fn is_soft(&self) -> bool {
        matches!(self.shape, Shape::Soft { .. })
    }

    fn check_shape(&self) -> Check {
        match &self.shape {
            Shape::Soft { surface, layer } => {
                surface.as_ref().map_or(Ok(()), check_surface).under("surface")?;
                if surface.is_none() && matches!(layer, Layer::Cell { .. } | Layer::Across { .. }) {
                    let remedy = "a layer of cells is made around a `surface`: add one";
                    return Err(Problem::of("surface", "missing", remedy));
                }
                layer.check().under("layer")?;
                let Some(material) = &self.material else {
                    let remedy = "a soft body (one with a layer) needs a material";
                    return Err(Problem::of("material", "missing", remedy));
                };
                material.check().under("material")?;
                let groups = matches!(layer, Layer::File(_));
                for (k, region) in self.regions.iter().enumerate() {
                    region.place.check(groups).under(format!("region[{k}]"))?;
                    region.material.check().under(format!("region[{k}].material"))?;
                }
            }
            Shape::Rigid { surface } => {
                check_surface(surface).under("surface")?;
                self.check_has_no_layer("a rigid body has none")?;
                let [core] = &self.cores[..] else {
                    let problem = format!("the body has {} cores", self.cores.len());
                    return Err(Problem::of("motion", problem, "give a rigid body exactly one core, with its motion"));
                };
                let is_dynamic = matches!(core.motion, Motion::Dynamic);
                if is_dynamic && core.mass.is_none() {
                    return Err(Problem::of("mass", "missing", "a dynamic rigid body needs a mass"));
                }
                if !is_dynamic && self.velocity != DVec3::ZERO {
                    let problem = "has no meaning for a rigid body that is not dynamic";
                    return Err(Problem::of("velocity", problem, "remove it"));
                }
            }
            Shape::Plane { normal, offset } => {
                let length = normal.length();
                if length.is_nan() || (length - 1.0).abs() > NORMAL_TOLERANCE {
                    let remedy = "give nx, ny, nz, d with a unit normal (nx, ny, nz)";
                    return Err(Problem::of("plane", format!("has a normal of length {length}"), remedy));
                }
                finite(*offset).under("plane")?;
                self.check_has_no_layer("a plane has none")?;
                let given = [
                    ("core", !self.cores.is_empty()),
                    ("hulls", self.hulls.is_some()),
                    ("load", !self.loads.is_empty()),
                    ("units", self.units.is_some()),
                    ("scale", self.scale != 1.0),
                    ("position", self.position != DVec3::ZERO),
                    ("orientation", self.orientation != DQuat::IDENTITY),
                    ("velocity", self.velocity != DVec3::ZERO),
                ];
                if let Some((key, _)) = given.iter().find(|(_, is_given)| *is_given) {
                    let problem = "has no meaning for a plane, which is rigid and fixed where `plane` puts it";
                    return Err(Problem::of(*key, problem, "remove it"));
                }
            }
        }
        Ok(())
    }

    /// Fails if the body has anything that only a body with a layer may have; `why` is the text of the problem.
    fn check_has_no_layer(&self, why: &str) -> Check {
        let given = [
            ("material", self.material.is_some()),
            ("region", !self.regions.is_empty()),
            ("dilatation", self.dilatation != Dilatation::default()),
            ("joint", !self.joints.is_empty()),
            ("skeleton", self.skeleton.is_some()),
            ("support", !self.supports.is_empty()),
            ("reactions", self.reactions.is_some()),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            Some((key, _)) => Err(Problem::of(*key, why, "remove it")),
            None => Ok(()),
        }
    }

    fn check_joint(&self, index: usize, joint: &Joint) -> Check {
        vector(joint.point).under("point")?;
        let resistance = &joint.resistance;
        not_negative(resistance.stiffness).under("stiffness")?;
        not_negative(resistance.damping).under("damping")?;
        resistance.swing.map_or(Ok(()), limit).under("swing")?;
        resistance.twist.map_or(Ok(()), limit).under("twist")?;
        if resistance.swing.or(resistance.twist).is_some() {
            direction(resistance.axis).under("axis")?;
        }
        if let Some(missing) = joint.cores.iter().find(|core| **core >= self.cores.len()) {
            let problem = format!("names core {missing}, but there are {} cores, counted from 0", self.cores.len());
            return Err(Problem::of("cores", problem, "name two cores"));
        }
        if joint.cores[0] == joint.cores[1] {
            return Err(Problem::of("cores", "is the same core twice", "name two cores"));
        }
        if !joint.cores.iter().any(|core| matches!(self.cores[*core].motion, Motion::Dynamic)) {
            let remedy = "give one of them motion = \"dynamic\", or remove the joint";
            return Err(Problem::of("cores", "neither core is dynamic", remedy));
        }
        if closes_loop(&self.joints[..index], joint, &self.cores) {
            let [a, b] = joint.cores.map(|core| &self.cores[core].name);
            let problem = format!("\"{a}\" and \"{b}\" are already connected through other joints");
            return Err(Problem::new(problem, "remove one: joints between dynamic cores must not form a loop"));
        }
        Ok(())
    }
}

impl Probe {
    /// Checks all values, and returns the first problem; `others` are the other probes.
    pub(crate) fn check(&self, others: &[Probe]) -> Check {
        name(&self.name).under("name")?;
        probe_name(&self.name, others)?;
        vector(self.nearest).under("nearest")
    }
}

/// Checks that a tool's name is not one of `others`, the names of other tools.
pub(super) fn tool_name<'a>(name: &str, mut others: impl Iterator<Item = &'a str>) -> Check {
    match others.any(|other| other == name) {
        true => Err(Problem::of("name", format!("\"{name}\" is taken by another tool"), "choose another name")),
        false => Ok(()),
    }
}

impl FurtherTool {
    /// Checks all values, and that the tool can come after `first` and the further tools `before`; returns the first
    /// problem.
    pub(super) fn check(&self, first: Option<&Tool>, before: &[FurtherTool]) -> Check {
        name(&self.name).under("name")?;
        let others = before.iter().map(|tool| &tool.name).chain(first.map(|tool| &tool.name));
        tool_name(&self.name, others.map(String::as_str))?;
        if before.len() + 1 >= MOST_TOOLS {
            let problem = format!("is one tool too many: a scene has {MOST_TOOLS} at most");
            return Err(Problem { key: String::new(), problem, remedy: "leave it out".into() });
        }
        name(&self.body).under("body")?;
        self.coupling.as_ref().map_or(Ok(()), Coupling::check).under("coupling")?;
        self.haptics.as_ref().map_or(Ok(()), Haptics::check).under("haptics")?;
        if self.trajectory.is_empty() { Ok(()) } else { keys(&self.trajectory).under("drive.keys") }
    }
}

fn check_surface(surface: &Surface) -> Check {
    let Surface::Model { model, vertices } = surface else { return Ok(()) };
    let range = *model.vertices().start() as u32..=*model.vertices().end() as u32;
    whole(u32::try_from(*vertices).unwrap_or(u32::MAX), range).under("vertices")
}

impl Layer {
    fn check(&self) -> Check {
        let filled = |own: u32, thickness: Option<f64>| {
            grade(own).under("grade")?;
            thickness.map_or(Ok(()), positive).under("thickness")
        };
        match *self {
            Layer::Cell { cell, grade, thickness } => {
                positive(cell).under("cell")?;
                filled(grade, thickness)
            }
            Layer::Across { cells, grade, thickness } => {
                whole(cells, 1..=MOST_ACROSS).under("across")?;
                filled(grade, thickness)
            }
            Layer::Box { low, high, cells } => {
                vector(low).and_then(|()| vector(high)).and_then(|()| corners(low, high)).under("box")?;
                for (k, count) in cells.into_iter().enumerate() {
                    whole(count, 1..=MOST_CELLS).under(format!("cells[{k}]"))?;
                }
                box_cells(cells).under("cells")
            }
            Layer::File(_) | Layer::Mesh(_) => Ok(()),
        }
    }
}

impl Place {
    /// Checks the place of a material region (a part of a soft body with its own material). `groups`: whether the layer
    /// can have groups of tetrahedra, as a mesh file can.
    fn check(&self, groups: bool) -> Check {
        match self {
            Place::Group(_) if !groups => {
                let problem = "the layer is generated and has no groups";
                Err(Problem::of("group", problem, "give `box` or `sphere`, or a layer from a file"))
            }
            Place::Group(Group::Name(_) | Group::Number(_)) => Ok(()),
            Place::Box { low, high } => {
                vector(*low).and_then(|()| vector(*high)).and_then(|()| corners(*low, *high)).under("box")
            }
            Place::Sphere { centre, radius: own } => vector(*centre).and_then(|()| radius(*own)).under("sphere"),
        }
    }
}

impl Core {
    /// Checks a core. `is_soft`: whether the core's body is soft, so that nodes are attached to the core.
    fn check(&self, is_soft: bool) -> Check {
        name(&self.name).under("name")?;
        if let Motion::Kinematic(list) = &self.motion {
            keys(list).under("keys")?;
        }
        let is_dynamic = matches!(self.motion, Motion::Dynamic);
        for (key, is_given) in [("mass", self.mass.is_some()), ("hinge", self.hinge.is_some())] {
            if is_given && !is_dynamic {
                return Err(Problem::of(key, "belongs to motion = \"dynamic\"", "remove it"));
            }
        }
        self.mass.map_or(Ok(()), positive).under("mass")?;
        if let Some(Hinge { point, axis }) = self.hinge {
            vector(point).under("hinge.point")?;
            direction(axis).under("hinge.axis")?;
        }
        match (&self.bind, is_soft) {
            (Some(bind), true) => bind.check().under("bind"),
            (None, true) => Err(Problem::of("bind", "missing", "give `bind`, the nodes attached to the core")),
            (Some(_), false) => Err(Problem::of("bind", "belongs to a soft body, and this one is rigid", "remove it")),
            (None, false) => Ok(()),
        }
    }
}

impl Bind {
    pub(super) fn check(&self) -> Check {
        match self {
            Bind::Inset(depth) => not_negative(*depth).under("inset"),
            Bind::Box { low, high } => {
                vector(*low).and_then(|()| vector(*high)).and_then(|()| corners(*low, *high)).under("box")
            }
            Bind::Sphere { centre, radius: own } => vector(*centre).and_then(|()| radius(*own)).under("sphere"),
            Bind::Capsule(capsule) => {
                capsule.ends.iter().try_for_each(|end| vector(*end)).under("ends")?;
                capsule.radii.iter().try_for_each(|radius| positive(*radius)).under("radii")
            }
            Bind::Nodes(nodes) if nodes.is_empty() => {
                Err(Problem::of("nodes", "is empty", "name at least one node (zero-based, file order)"))
            }
            Bind::Nodes(_) | Bind::Group(_) | Bind::All => Ok(()),
        }
    }
}
