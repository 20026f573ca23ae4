//! C functions that change a simulation between two steps: its materials, the contact law, the virtual coupling (spring
//! and damper between haptic device and tool), and the poses of driven (kinematic) rigid cores. A rigid core is a rigid
//! body inside a soft one, to which nodes of the soft body's mesh are attached; here a rigid body counts as its own
//! core.

use std::time::Duration;

use palpate::scene::{Contact, Coupling, Material};

use super::handles;
use super::simulation::{SimulationObject, palpate_pose, palpate_simulation, pose_of};
use super::sized::{self, Field, Sized32, fields};
use super::state::change;
use super::status::{Failure, Outcome, guarded, palpate_status};

/// Parameters of an elastic material. The material law itself is chosen with the scene and cannot be changed.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_material {
    /// Size of the struct in bytes: sizeof(palpate_material).
    pub size: u32,
    /// Reserved: must be 0.
    pub reserved: u32,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Poisson's ratio, from -0.5 to below 0.5.
    pub poisson: f64,
    /// Density, kg/m^3.
    pub density: f64,
    /// Mass-proportional Rayleigh damping, 1/s.
    pub damping_mass: f64,
    /// Stiffness-proportional Rayleigh damping, s.
    pub damping_stiffness: f64,
}

/// The contact law: penalty forces between touching bodies, with damping and friction. A projected area is an area of a
/// body's surface projected along the contact normal.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_contact_law {
    /// Size of the struct in bytes: sizeof(palpate_contact_law).
    pub size: u32,
    /// Reserved: must be 0.
    pub reserved: u32,
    /// Penalty stiffness per projected area, N/m^3; below zero: chosen from the bodies' materials.
    pub stiffness: f64,
    /// Penalty damping per projected area, N s/m^3; below zero: chosen from the stiffness.
    pub damping: f64,
    /// Coulomb friction coefficient.
    pub friction: f64,
    /// Sliding speed below which friction is viscous, m/s.
    pub friction_speed: f64,
    /// Penetration depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m.
    pub depth_limit: f64,
}

/// The virtual coupling: a spring and damper between haptic device and tool.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_coupling {
    /// Size of the struct in bytes: sizeof(palpate_coupling).
    pub size: u32,
    /// Reserved: must be 0.
    pub reserved: u32,
    /// Stiffness of the coupling, N/m.
    pub stiffness: f64,
    /// Damping of the coupling, N s/m.
    pub damping: f64,
    /// Angular stiffness of the coupling, N m/rad.
    pub angular_stiffness: f64,
    /// Angular damping of the coupling, N m s/rad.
    pub angular_damping: f64,
}

/// Implements [`Sized32`] (a struct that begins with its size) for a struct whose fields are all numbers. `$least` is
/// the size of the struct's first version, bytes.
macro_rules! numbers {
    ($name:ident, $least:expr, { $($field:ident),+ }) => {
        // SAFETY: the struct is `repr(C)`, its first field is the size, and all fields are numbers: any bytes are a
        // value.
        unsafe impl Sized32 for $name {
            const NAME: &str = stringify!($name);
            const LEAST: usize = $least;
            const FIELDS: &'static [Field] = fields!($name { $($field),+ });

            fn unset() -> Self {
                // SAFETY: all fields of the struct are numbers, for which zero bytes are a value.
                Self { size: size_of::<Self>() as u32, ..unsafe { std::mem::zeroed() } }
            }
        }
    };
}

numbers!(palpate_material, 48, { size, reserved, young, poisson, density, damping_mass, damping_stiffness });
numbers!(palpate_contact_law, 48, { size, reserved, stiffness, damping, friction, friction_speed, depth_limit });
numbers!(palpate_coupling, 40, { size, reserved, stiffness, damping, angular_stiffness, angular_damping });

/// Reads one of the structs above, which must not be null; its `reserved` field must be 0.
///
/// # Safety
/// The conditions of [`sized::read`] hold for `from`.
unsafe fn needed<T: Sized32>(from: *const T, name: &str, reserved: impl Fn(&T) -> u32) -> Outcome<T> {
    if from.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; pass the struct")));
    }
    // SAFETY: the caller keeps the conditions under `# Safety`.
    let value = unsafe { sized::read(from)? };
    match reserved(&value) {
        0 => Ok(value),
        other => Err(Failure::new(palpate_status::Argument, format!("{}.reserved is {other}; set it to 0", T::NAME))),
    }
}

/// Reads a material of a soft body: `index` 0 is the material of the body itself, and 1 and above are the materials of
/// the body's regions (parts with a material of their own) in the order of the scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_material_get(
    simulation: *mut palpate_simulation,
    body: u32,
    index: u32,
    material: *mut palpate_material,
) -> palpate_status {
    guarded(|| {
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let told = material_at(&object.simulation, body, index)?;
            let Material { young, poisson, density, damping_mass, damping_stiffness, .. } = told;
            let unset = palpate_material::unset();
            let told = palpate_material { young, poisson, density, damping_mass, damping_stiffness, ..unset };
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::tell(material, &told, "material") }
        })
    })
}

/// Replaces a material of a soft body from the next step on; `index` counts as in `palpate_material_get`. No body is
/// prepared again, and no GPU commands are recorded again. Whether the solver's preconditioner has a coarse space (a
/// second level) for the body was decided when the simulation was made, and stays so. PALPATE_STATUS_ARGUMENT: there is
/// no such material, a value is out of range, or the body has several materials and the new density would move the
/// body's centre of mass.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_material_set(
    simulation: *mut palpate_simulation,
    body: u32,
    index: u32,
    material: *const palpate_material,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let given = unsafe { needed(material, "material", |m| m.reserved)? };
        let palpate_material { young, poisson, density, damping_mass, damping_stiffness, .. } = given;
        handles::with(simulation as usize, |object: &mut SimulationObject| material_at(&object.simulation, body, index))
            .and_then(|old| {
                let new = Material { young, poisson, density, damping_mass, damping_stiffness, ..old };
                change(simulation, |simulation| simulation.set_material(body as usize, index as usize, new))
            })
    })
}

fn material_at(simulation: &palpate::Simulation, body: u32, index: u32) -> Outcome<Material> {
    let all = simulation.materials(body as usize);
    all.get(index as usize).copied().ok_or_else(|| {
        let problem = format!("body {body} has {} materials, counted from 0, and none at {index}", all.len());
        Failure::new(palpate_status::Argument, problem)
    })
}

/// Reads the contact law in force; a stiffness or damping that is chosen automatically reads as -1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_get(
    simulation: *mut palpate_simulation,
    law: *mut palpate_contact_law,
) -> palpate_status {
    guarded(|| {
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let Contact { stiffness, damping, friction, friction_speed, depth_limit, .. } =
                object.simulation.scene().contact;
            let (stiffness, damping) = (stiffness.unwrap_or(-1.0), damping.unwrap_or(-1.0));
            let unset = palpate_contact_law::unset();
            let told = palpate_contact_law { stiffness, damping, friction, friction_speed, depth_limit, ..unset };
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            unsafe { sized::tell(law, &told, "law") }
        })
    })
}

/// Replaces the contact law from the next step on. Switching friction on in a scene that had none records the GPU
/// commands of the step anew, which takes about as long as making the simulation did.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_set(
    simulation: *mut palpate_simulation,
    law: *const palpate_contact_law,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let given = unsafe { needed(law, "law", |law| law.reserved)? };
        let palpate_contact_law { friction, friction_speed, depth_limit, .. } = given;
        // A finite negative number asks for the automatic choice. NaN and infinities are passed on, so that the engine
        // refuses them.
        let chosen = |x: f64| if x < 0.0 && x.is_finite() { None } else { Some(x) };
        let (stiffness, damping) = (chosen(given.stiffness), chosen(given.damping));
        change(simulation, |simulation| {
            let old = simulation.scene().contact.clone();
            simulation.set_contact(&Contact { stiffness, damping, friction, friction_speed, depth_limit, ..old })
        })
    })
}

/// Replaces the virtual coupling between haptic device and tool, of several tools the first, from the next step on; null
/// removes it, and the tool moves freely.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_coupling_set(
    simulation: *mut palpate_simulation,
    coupling: *const palpate_coupling,
) -> palpate_status {
    guarded(|| {
        let given = match coupling.is_null() {
            true => None,
            // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
            false => Some(unsafe { needed(coupling, "coupling", |coupling| coupling.reserved)? }),
        };
        let plain = |c: palpate_coupling| Coupling {
            stiffness: c.stiffness,
            damping: c.damping,
            angular_stiffness: c.angular_stiffness,
            angular_damping: c.angular_damping,
        };
        change(simulation, |simulation| simulation.set_coupling(given.map(plain)))
    })
}

/// Reads the pose of a rigid core of a body: the world pose of the coordinate frame of the body's mesh, as if that
/// frame were fixed to the core. The cores of a body are counted from 0, with the bones of its skeleton first; a rigid
/// body counts as one core.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_core_pose(
    simulation: *mut palpate_simulation,
    body: u32,
    core: u32,
    pose: *mut palpate_pose,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let pose = unsafe { sized::answer(pose, "pose")? };
        handles::with(simulation as usize, |object: &mut SimulationObject| {
            let told = object
                .simulation
                .core_pose(body as usize, core as usize)
                .ok_or_else(|| Failure::new(palpate_status::Argument, format!("body {body} has no core {core}")))?;
            *pose = palpate_pose { position: told.position.to_array(), orientation: told.orientation.to_array() };
            Ok(())
        })
    })
}

/// Moves a driven (kinematic) core from its present pose to `pose` (defined as in `palpate_core_pose`) at constant
/// speed, and leaves it there. The motion takes `seconds` of simulated time, or one step if a step is longer. The
/// remaining keyframes of the core are discarded. Call this function before every step to animate a core.
/// PALPATE_STATUS_ARGUMENT: the core is not driven.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_core_move(
    simulation: *mut palpate_simulation,
    body: u32,
    core: u32,
    pose: *const palpate_pose,
    seconds: f64,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the C caller keeps the rules for pointers at the top of palpate.h.
        let pose = unsafe { sized::given(pose, "pose")? };
        let pose = pose.ok_or_else(|| Failure::new(palpate_status::Null, "pose is null; pass the pose of the core"))?;
        let pose = pose_of(pose, "pose")?;
        let time = Duration::try_from_secs_f64(seconds).map_err(|_| {
            let problem = format!("seconds is {seconds}; give 0 (one step) or more");
            Failure::new(palpate_status::Argument, problem)
        })?;
        change(simulation, |simulation| simulation.move_core(body as usize, core as usize, pose, time))
    })
}
