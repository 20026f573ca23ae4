//! Functions that make a simulation of a scene (bodies, tool and settings) on a context (an open Vulkan device), do its
//! steps, and read its results. The tool is the rigid body that the haptic device leads; the wrench, which a step
//! gives, is the contact force and torque on the tool.

use std::ffi::{c_char, c_void};
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::gpu::watched;
use palpate::internal::prepare::Cache;
use palpate::{Pose, Simulation, StepReport, Wrench};

use super::build::{palpate_progress, tell, tell_of_kernels};
use super::context::{opened, palpate_context, room};
use super::handles::{self, Handled};
use super::scene::{SceneObject, palpate_scene};
use super::sized::{self, Field, Sized32, fields};
use super::status::{Failure, Outcome, guarded, palpate_status};
use super::steps::{self, SimulationSteps, Stepped};

/// A simulation, which moves the bodies and the tool of a scene step by step.
pub struct palpate_simulation {
    _opaque: [u8; 0],
}

/// A pose in world coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct palpate_pose {
    /// Position, m.
    pub position: [f64; 3],
    /// Orientation, a unit quaternion: x, y, z, w.
    pub orientation: [f64; 4],
}

/// Result of a step. In a scene without a tool, `force`, `torque` and the positions are zero, and the orientations are
/// the identity.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_wrench {
    /// Size of the struct in bytes: sizeof(palpate_wrench).
    pub size: u32,
    /// Warnings about the step: PALPATE_FLAG_*, one bit each; 0: there are none.
    pub flags: u32,
    /// Number of steps that the simulation has done, including this one.
    pub step: u64,
    /// Simulated time at the end of the step, s.
    pub time: f64,
    /// Net contact force on the tool, world axes, N.
    pub force: [f64; 3],
    /// Net contact torque on the tool about its centre, world axes, N m.
    pub torque: [f64; 3],
    /// Pose of the tool at the end of the step.
    pub tool: palpate_pose,
    /// Pose of the haptic device at the end of the step.
    pub device: palpate_pose,
    /// Greatest penetration depth among the contacts, m.
    pub max_depth: f64,
    /// Relative residual of the linear system at the end of the last solve.
    pub residual: f64,
    /// Number of contacts: vertices of one body's surface mesh that lie inside another body. Of two bodies that touch,
    /// the vertices of both count, unless the scene's `contact.sides` is "one"; where triangles are tested for contact
    /// (`contact.samples`), those of one body count instead.
    pub contacts: u32,
    /// Number of conjugate gradient iterations in all solves of the step.
    pub iterations: u32,
}

// SAFETY: the struct is `repr(C)`, its first field is its size, and all fields are numbers, so any bytes are a value.
unsafe impl Sized32 for palpate_wrench {
    const NAME: &str = "palpate_wrench";
    const LEAST: usize = 208;
    const FIELDS: &'static [Field] = fields!(palpate_wrench {
        size,
        flags,
        step,
        time,
        force,
        torque,
        tool,
        device,
        max_depth,
        residual,
        contacts,
        iterations
    });

    fn unset() -> Self {
        let pose = palpate_pose { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] };
        palpate_wrench {
            size: size_of::<Self>() as u32,
            flags: 0,
            step: 0,
            time: 0.0,
            force: [0.0; 3],
            torque: [0.0; 3],
            tool: pose,
            device: pose,
            max_depth: 0.0,
            residual: 0.0,
            contacts: 0,
            iterations: 0,
        }
    }
}

/// Flag of a step: at the end of the solve the residual is far above the solver's tolerance, and also far above what
/// single precision can reach.
pub const PALPATE_FLAG_NOT_CONVERGED: u32 = 1;
/// Flag of a step: the arrays have too little room for the contact patches (places where two bodies may touch, with one
/// normal each).
pub const PALPATE_FLAG_REGION_OVERFLOW: u32 = 2;
/// Flag of a step: the arrays have too little room for the contacts, or for the hits of the rays that search for them.
pub const PALPATE_FLAG_CONTACT_OVERFLOW: u32 = 4;
/// Flag of a step: a contact was deeper than the scene's `depth_limit`.
pub const PALPATE_FLAG_DEPTH_BEYOND_LIMIT: u32 = 8;
/// Flag of a step: a skin (surface mesh) folds over itself along the normal of a contact patch, so that the penetration
/// depth is not unique there.
pub const PALPATE_FLAG_NOT_A_HEIGHT_FIELD: u32 = 16;
/// Flag of a step: a number was not finite, so the step was repeated (PALPATE_FLAG_STEP_RETRIED) or given up
/// (PALPATE_FLAG_FROZEN).
pub const PALPATE_FLAG_NON_FINITE: u32 = 32;
/// Flag of a step: the step failed and was repeated as several shorter time steps.
pub const PALPATE_FLAG_STEP_RETRIED: u32 = 64;
/// Flag of a step: the step failed with shorter time steps too, so everything that forces move was stopped where it
/// was.
pub const PALPATE_FLAG_FROZEN: u32 = 128;
/// Flag of a step: contacts under tension were released, but after the last release other contacts are under tension.
pub const PALPATE_FLAG_ADHESIVE_DROPPED_TWICE: u32 = 256;
/// Flag of a step: a body, or a rigid core in it, turned so far within the step that the body may gain energy.
pub const PALPATE_FLAG_TURNS_TOO_FAR: u32 = 512;
/// Flag of a step: a tetrahedron was inverted, or pressed so flat that its rotation was not found.
pub const PALPATE_FLAG_INVERTED: u32 = 1024;
/// Flag of a step: the Newton iterations left much of the step's nonlinear equations unsolved.
pub const PALPATE_FLAG_NEWTON_NOT_CONVERGED: u32 = 2048;
/// Flag of a step: the tool moved further than its own extent in a step near a body, which it may have passed through.
pub const PALPATE_FLAG_MOVED_TOO_FAR: u32 = 4096;

/// The object for which the handle of a simulation (the number by which a C caller names it) stands.
pub(super) struct SimulationObject {
    pub simulation: Simulation,
    /// Whether a step failed halfway, so that no further step is possible until a saved state is restored.
    pub has_failed: bool,
    /// The report of the last step; that of step 0 before the first, and after a saved state was restored.
    pub last: StepReport,
}

impl SimulationObject {
    pub fn new(simulation: Simulation) -> SimulationObject {
        SimulationObject { simulation, has_failed: false, last: StepReport::default() }
    }

    /// Number of tools of the scene.
    fn tools(&self) -> usize {
        let scene = self.simulation.scene();
        usize::from(scene.tool.is_some()) + scene.further_tools.len()
    }
}

impl Handled for SimulationObject {
    const NAME: &str = "simulation";
}

/// Makes a simulation of a scene on a context. The call prepares the bodies that palpate_scene_prepare has not
/// prepared, compiles the GPU kernels that the context has not compiled before, and records the GPU commands of a step.
/// All of it can take a minute where nothing is in a cache; palpate_simulation_create_with_progress tells how far it is.
/// Afterwards the scene may be destroyed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_simulation_create(
    context: *mut palpate_context,
    scene: *mut palpate_scene,
    simulation: *mut *mut palpate_simulation,
) -> palpate_status {
    // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
    unsafe { palpate_simulation_create_with_progress(context, scene, None, std::ptr::null_mut(), simulation) }
}

/// Makes a simulation as palpate_simulation_create does, and calls `progress` with `user` on this thread: as
/// palpate_progress describes for the bodies, and then, with an empty `body` and the stage "kernels", before each GPU
/// kernel that is compiled; there `done` is the number of those compiled so far, and `total` is 0, since their number is
/// not known before. `progress` may be null. If the callback cancels (PALPATE_STATUS_CANCELLED), no simulation is made;
/// the next call does not compile again what the context has compiled, but prepares again what neither
/// palpate_scene_prepare nor a cache has kept.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_simulation_create_with_progress(
    context: *mut palpate_context,
    scene: *mut palpate_scene,
    progress: palpate_progress,
    user: *mut c_void,
    simulation: *mut *mut palpate_simulation,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let simulation = unsafe { sized::answer(simulation, "simulation")? };
        *simulation = std::ptr::null_mut();
        let context = opened(context)?;
        let (scene, mut bodies) = handles::with(scene as usize, |object: &mut SceneObject| Ok(object.parts()))?;
        Simulation::check_room(&context, &scene)?;
        bodies.complete(&scene, &Cache::of(&context), &mut |state| tell(progress, user, &state))?;
        let watch = Box::new(move |done| tell_of_kernels(progress, user, done));
        let mut made = watched(watch, || Simulation::with_bodies(&context, &scene, bodies))?;
        made.time_every(0)?;
        *simulation = handles::insert_with(SimulationObject::new(made), Arc::new(SimulationSteps::default()))
            as *mut palpate_simulation;
        Ok(())
    })
}

/// Destroys a simulation, after waiting for a step of palpate_step_submit that is under way. If a haptic loop uses the
/// simulation, the simulation is destroyed when the loop ends. With null the call does nothing.
#[unsafe(no_mangle)]
pub extern "C" fn palpate_simulation_destroy(simulation: *mut palpate_simulation) -> palpate_status {
    guarded(|| if simulation.is_null() { Ok(()) } else { steps::remove::<SimulationObject>(simulation as usize) })
}

/// Does one step, whose length is the scene's `dt`, and waits for the step to end. `device`: pose of the haptic device
/// at the end of the step, which it reaches at constant speed from its pose at the start; null: the pose on the scene's
/// trajectory (`[drive]`), or, if an earlier call gave a pose, the last pose given. `wrench` receives the result, and
/// may be null. After a step that fails in Vulkan or in the solver, the simulation can be read and destroyed, and
/// further steps give PALPATE_STATUS_SIMULATION until a saved state is restored.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_step(
    simulation: *mut palpate_simulation,
    device: *const palpate_pose,
    wrench: *mut palpate_wrench,
) -> palpate_status {
    guarded(|| {
        // SAFETY (this block and the next): the C caller keeps the rules for pointers at the top of palpate.h.
        let device = unsafe { sized::given(device, "device")? }.map(|pose| pose_of(pose, "device")).transpose()?;
        // The size of the caller's struct `wrench` is checked here, before the step changes anything.
        if !wrench.is_null() {
            unsafe { sized::read(wrench.cast_const())? };
        }
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let told = steps::of(simulation)?.step_now(object, device.as_slice())?;
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            if wrench.is_null() { Ok(()) } else { unsafe { sized::write(wrench, &told) } }
        })
    })
}

impl Stepped for SimulationObject {
    fn is_fit(&self) -> Outcome {
        let problem = "an earlier step failed halfway; restore a saved state or create the simulation again";
        if self.has_failed { Err(Failure::new(palpate_status::Simulation, problem)) } else { Ok(()) }
    }

    fn step_to(&mut self, devices: &[Pose]) -> Outcome<palpate_wrench> {
        self.is_fit()?;
        let row = match devices {
            [] => self.simulation.step(),
            [pose] => self.simulation.step_at(*pose),
            poses => self.simulation.step_at_poses(poses),
        };
        self.has_failed = row.is_err();
        self.last = row?;
        Ok(wrench_of_tool(&self.last, 0))
    }
}

/// Tells in `count` how many tools the scene of a simulation has: 0 without a tool, more than 1 where the scene lists
/// several (`[[tool]]`).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_tool_count(simulation: *mut palpate_simulation, count: *mut u32) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let count = unsafe { sized::answer(count, "count")? };
        *count = handles::with(simulation as usize, |object: &mut SimulationObject| Ok(object.tools() as u32))?;
        Ok(())
    })
}

/// Does one step as palpate_step does, and leads the haptic device of each tool: to the `count` poses `devices`, one for
/// each tool in the scene's order. palpate_step leads that of the first tool; the devices of the others then follow their
/// trajectories (`drive`), or stay at the last poses that this function gave them; so they do in a submitted step and in
/// a haptic loop. palpate_tool_wrench reads the results.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_step_tools(
    simulation: *mut palpate_simulation,
    devices: *const palpate_pose,
    count: usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let given = unsafe { sized::array(devices, count, "devices")? };
        let pose = |(k, given)| pose_of(given, &format!("devices[{k}]"));
        let poses = given.iter().enumerate().map(pose).collect::<Outcome<Vec<Pose>>>()?;
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let tools = object.tools();
            if tools == 0 {
                return Err(Failure::new(palpate_status::Argument, "the scene has no tool; add a [tool]"));
            }
            if tools != poses.len() {
                let problem = format!("count is {count}, but the scene has {tools} tools; give one pose for each tool");
                return Err(Failure::new(palpate_status::Argument, problem));
            }
            steps::of(simulation)?.step_now(object, &poses).map(|_| ())
        })
    })
}

/// Reads what the last finished step, of whatever function or haptic loop, left of a tool: `tool` is its position in the
/// scene, from 0. Force, torque and poses of `wrench` are those of this tool; its other fields are those of the step.
/// Before the first step, and after a saved state was restored, all of it is zero, and orientations are the identity.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_tool_wrench(
    simulation: *mut palpate_simulation,
    tool: u32,
    wrench: *mut palpate_wrench,
) -> palpate_status {
    guarded(|| {
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let tools = object.tools();
            if tool as usize >= tools {
                let problem = format!("tool is {tool}, but the scene has {tools} tools, counted from 0");
                return Err(Failure::new(palpate_status::Argument, problem));
            }
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::tell(wrench, &wrench_of_tool(&object.last, tool as usize), "wrench") }
        })
    })
}

/// Converts a pose of the caller. Errors: a number is not finite, or the orientation is no unit quaternion; the message
/// names the pose by `what`.
pub(super) fn pose_of(given: &palpate_pose, what: &str) -> Outcome<Pose> {
    let wrong = |problem: String| Failure::new(palpate_status::Argument, format!("{what}.{problem}"));
    for (name, values) in [("position", &given.position[..]), ("orientation", &given.orientation[..])] {
        if let Some(k) = values.iter().position(|x| !x.is_finite()) {
            return Err(wrong(format!("{name}[{k}] is {}; give a finite number", values[k])));
        }
    }
    let orientation = DQuat::from_array(given.orientation);
    let length = orientation.length();
    if (length - 1.0).abs() > 1e-3 {
        return Err(wrong(format!("orientation has length {length}; give a unit quaternion, x y z w")));
    }
    Ok(Pose { position: DVec3::from_array(given.position), orientation: orientation.normalize() })
}

/// What a step left of the tool of this index.
pub(super) fn wrench_of_tool(row: &StepReport, index: usize) -> palpate_wrench {
    let pose =
        |pose: &Pose| palpate_pose { position: pose.position.to_array(), orientation: pose.orientation.to_array() };
    let mut wrench = palpate_wrench {
        flags: row.flags.0,
        step: row.step,
        time: row.time,
        max_depth: row.max_depth.unwrap_or_default(),
        residual: row.residual,
        contacts: row.contacts.unwrap_or_default(),
        iterations: row.iterations,
        ..palpate_wrench::unset()
    };
    if let Some(told) = row.tools().nth(index) {
        (wrench.force, wrench.torque) = (told.force.to_array(), told.torque.to_array());
        (wrench.tool, wrench.device) = (pose(&told.tool), pose(&told.device));
    }
    wrench
}

/// Copies the world positions of the nodes of a soft body's layer (its tetrahedral mesh), m: three numbers per node, in
/// the order of the layer. `body` is the body's position in the scene, from 0. `count` receives the number of nodes,
/// which is 0 if the body is not soft. `positions` has room for `capacity` nodes, and may be null if `capacity` is 0.
/// PALPATE_STATUS_TOO_SMALL: there are more nodes than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_nodes(
    simulation: *mut palpate_simulation,
    body: u32,
    positions: *mut [f64; 3],
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    let size = |simulation: &Simulation, body| simulation.node_count(body);
    let read =
        |simulation: &mut Simulation, body| Ok(simulation.node_positions(body)?.iter().map(|x| x.to_array()).collect());
    // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
    unsafe { list_of_layer(simulation, body, (positions, "positions"), capacity, count, size, read) }
}

/// Copies Cauchy's stress in each tetrahedron of a soft body's layer after the last step, Pa, world axes: xx, yy, zz, xy,
/// yz, xz, in the order of the layer. The stress is that of the material's law, with the penalty on compression below a
/// stretch of 0.3, without damping; it is zero in a tetrahedron that is flat or inside out. `body` is the body's position
/// in the scene, from 0. `count` receives the number of tetrahedra, which is 0 if the body is not soft. `stresses` has
/// room for `capacity` of them, and may be null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are more tetrahedra
/// than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_stresses(
    simulation: *mut palpate_simulation,
    body: u32,
    stresses: *mut [f64; 6],
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    let size = |simulation: &Simulation, body| simulation.tetrahedron_range(body).len();
    let read = |simulation: &mut Simulation, body| {
        let six = |s: &DMat3| [s.x_axis.x, s.y_axis.y, s.z_axis.z, s.x_axis.y, s.y_axis.z, s.x_axis.z];
        Ok(simulation.stresses(body)?.iter().map(six).collect())
    };
    // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
    unsafe { list_of_layer(simulation, body, (stresses, "stresses"), capacity, count, size, read) }
}

/// Lists what each node, or each tetrahedron, of a body has: `size` tells how many there are, and `read` reads them.
///
/// # Safety
/// `to` and `count` are pointers as the top of palpate.h describes them.
unsafe fn list_of_layer<T: Copy>(
    simulation: *mut palpate_simulation,
    body: u32,
    (to, name): (*mut T, &str),
    capacity: usize,
    count: *mut usize,
    size: impl FnOnce(&Simulation, usize) -> usize,
    read: impl FnOnce(&mut Simulation, usize) -> palpate::Result<Vec<T>>,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller keeps the conditions under `# Safety`.
        let count = unsafe { sized::answer(count, "count")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let bodies = object.simulation.bodies().len();
            if body as usize >= bodies {
                let problem = format!("body is {body}; the scene has {bodies} bodies, counted from 0");
                return Err(Failure::new(palpate_status::Argument, problem));
            }
            if capacity == 0 {
                *count = size(&object.simulation, body as usize);
                return Ok(());
            }
            let all = read(&mut object.simulation, body as usize)?;
            // SAFETY: the caller keeps the conditions under `# Safety`.
            unsafe { sized::list(&all, to, capacity, count, name) }
        })
    })
}

/// Force and torque by which a support, or a fixed or driven core, acts on its soft body.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_reaction {
    /// Names of the body and of the support or core, with a dot between them.
    pub name: [c_char; 208],
    /// Force, world axes, N.
    pub force: [f64; 3],
    /// Torque about the world's origin, N m.
    pub torque: [f64; 3],
}

/// Lists the reactions of the last step: of each fixed or driven core, and then each support, of each body whose scene
/// asks for them; none before the first step, and after a state was restored. `count` receives their number;
/// `reactions` has room for `capacity` of them, and may be null if `capacity` is 0. PALPATE_STATUS_TOO_SMALL: there are
/// more reactions than `capacity`, and none was written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_reactions(
    simulation: *mut palpate_simulation,
    reactions: *mut palpate_reaction,
    capacity: usize,
    count: *mut usize,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let count = unsafe { sized::answer(count, "count")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let simulation = &object.simulation;
            let reaction = |(name, wrench): (&str, &Wrench)| palpate_reaction {
                name: room(name),
                force: wrench.force.to_array(),
                torque: wrench.torque.to_array(),
            };
            let all: Vec<_> = simulation.reaction_names().zip(simulation.reactions()).map(reaction).collect();
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::list(&all, reactions, capacity, count, "reactions") }
        })
    })
}

#[cfg(test)]
mod tests {
    use palpate::Flags;

    use super::*;

    #[test]
    fn every_flag_has_its_constant() {
        let own = [
            PALPATE_FLAG_NOT_CONVERGED,
            PALPATE_FLAG_REGION_OVERFLOW,
            PALPATE_FLAG_CONTACT_OVERFLOW,
            PALPATE_FLAG_DEPTH_BEYOND_LIMIT,
            PALPATE_FLAG_NOT_A_HEIGHT_FIELD,
            PALPATE_FLAG_NON_FINITE,
            PALPATE_FLAG_STEP_RETRIED,
            PALPATE_FLAG_FROZEN,
            PALPATE_FLAG_ADHESIVE_DROPPED_TWICE,
            PALPATE_FLAG_TURNS_TOO_FAR,
            PALPATE_FLAG_INVERTED,
            PALPATE_FLAG_NEWTON_NOT_CONVERGED,
            PALPATE_FLAG_MOVED_TOO_FAR,
        ];
        assert_eq!(Flags::ALL.map(|(flag, _)| flag.0), own);
    }

    #[test]
    fn poses_that_are_none_are_refused() {
        let good = palpate_pose { position: [1.0, 2.0, 3.0], orientation: [0.0, 0.0, 0.0, 1.0] };
        assert!(pose_of(&good, "device").is_ok());
        let mut bad = good;
        bad.position[1] = f64::NAN;
        assert!(pose_of(&bad, "device").unwrap_err().message.contains("device.position[1] is NaN"));
        for orientation in [[0.0; 4], [0.0, 0.0, 0.0, 2.0], [f64::INFINITY, 0.0, 0.0, 1.0]] {
            assert_eq!(
                pose_of(&palpate_pose { orientation, ..good }, "device").unwrap_err().status,
                palpate_status::Argument
            );
        }
    }
}
