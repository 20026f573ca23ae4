//! What is changed between two steps: materials, the contact law, the coupling, where driven cores go.

use std::time::Duration;

use palpate::scene::{Contact, Coupling, Material};

use super::handles;
use super::simulation::{SimulationObject, palpate_pose, palpate_simulation, pose_of};
use super::sized::{self, Field, Sized32, fields};
use super::state::change;
use super::status::{Failure, Outcome, guarded, palpate_status};

/// An elastic material, without its law, which stays as it was made.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_material {
    /// sizeof(palpate_material).
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Poisson's ratio, from -0.5 to below 0.5.
    pub poisson: f64,
    /// kg/m^3.
    pub density: f64,
    /// Rayleigh damping by mass, 1/s.
    pub damping_mass: f64,
    /// Rayleigh damping by stiffness, s.
    pub damping_stiffness: f64,
}

/// What holds touching bodies apart.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_contact_law {
    /// sizeof(palpate_contact_law).
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Penalty stiffness per projected area, N/m^3; below zero: from the bodies' materials.
    pub stiffness: f64,
    /// Penalty damping per projected area, N s/m^3; below zero: from the stiffness.
    pub damping: f64,
    /// Coulomb's coefficient.
    pub friction: f64,
    /// Speed below which friction is viscous, m/s.
    pub friction_speed: f64,
    /// Depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m.
    pub depth_limit: f64,
}

/// What joins device and tool.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_coupling {
    /// sizeof(palpate_coupling).
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// N/m.
    pub stiffness: f64,
    /// N s/m.
    pub damping: f64,
    /// N m/rad.
    pub angular_stiffness: f64,
    /// N m s/rad.
    pub angular_damping: f64,
}

/// What these structs have in common: all of it are numbers.
macro_rules! numbers {
    ($name:ident, $least:expr, { $($field:ident),+ }) => {
        // SAFETY: `repr(C)`, the size comes first, and all of it are numbers.
        unsafe impl Sized32 for $name {
            const NAME: &str = stringify!($name);
            const LEAST: usize = $least;
            const FIELDS: &'static [Field] = fields!($name { $($field),+ });

            fn unset() -> Self {
                // SAFETY: all of it are numbers.
                Self { size: size_of::<Self>() as u32, ..unsafe { std::mem::zeroed() } }
            }
        }
    };
}

numbers!(palpate_material, 48, { size, reserved, young, poisson, density, damping_mass, damping_stiffness });
numbers!(palpate_contact_law, 48, { size, reserved, stiffness, damping, friction, friction_speed, depth_limit });
numbers!(palpate_coupling, 40, { size, reserved, stiffness, damping, angular_stiffness, angular_damping });

/// Reads one of the structs, which must be there; `reserved` is zero.
unsafe fn needed<T: Sized32>(from: *const T, name: &str, reserved: impl Fn(&T) -> u32) -> Outcome<T> {
    if from.is_null() {
        return Err(Failure::new(palpate_status::Null, format!("{name} is null; say what it is to be")));
    }
    // SAFETY: the caller's promise.
    let value = unsafe { sized::read(from)? };
    match reserved(&value) {
        0 => Ok(value),
        other => Err(Failure::new(palpate_status::Argument, format!("{}.reserved is {other}; set it to 0", T::NAME))),
    }
}

/// The material of a soft body: its own at `index` 0, then those of its regions in the order of the scene.
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
            // SAFETY: the caller's, as the header says.
            unsafe { sized::tell(material, &told, "material") }
        })
    })
}

/// Gives a soft body another material from the next step on, `index` as for `palpate_material_get`. Nothing is prepared or
/// recorded again; whether the solver has a coarse level for the body stays as it was chosen. PALPATE_STATUS_ARGUMENT: there is
/// no such material, or it cannot be so; or the body has several and the density would move its centre of mass.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_material_set(
    simulation: *mut palpate_simulation,
    body: u32,
    index: u32,
    material: *const palpate_material,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
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
        let problem = format!("body {body} has {} materials, and none at {index}", all.len());
        Failure::new(palpate_status::Argument, problem)
    })
}

/// The contact law in force; numbers that are chosen from the materials are -1.
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
            // SAFETY: the caller's, as the header says.
            unsafe { sized::tell(law, &told, "law") }
        })
    })
}

/// Another contact law from the next step on. Friction in a scene that had none is recorded first, which takes some time once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_contact_set(
    simulation: *mut palpate_simulation,
    law: *const palpate_contact_law,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let given = unsafe { needed(law, "law", |law| law.reserved)? };
        let palpate_contact_law { friction, friction_speed, depth_limit, .. } = given;
        // What is no number is neither chosen nor below zero, and is refused.
        let chosen = |x: f64| if x < 0.0 && x.is_finite() { None } else { Some(x) };
        let (stiffness, damping) = (chosen(given.stiffness), chosen(given.damping));
        change(simulation, |simulation| {
            let old = simulation.scene().contact.clone();
            simulation.set_contact(&Contact { stiffness, damping, friction, friction_speed, depth_limit, ..old })
        })
    })
}

/// Another coupling between device and tool from the next step on; null: none, and the tool moves freely.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_coupling_set(
    simulation: *mut palpate_simulation,
    coupling: *const palpate_coupling,
) -> palpate_status {
    guarded(|| {
        let given = match coupling.is_null() {
            true => None,
            // SAFETY: the caller's, as the header says.
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

/// Where a core of a body is: the pose of the origin of the body's file, carried along. Cores are counted from 0, bones first;
/// a rigid body has one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_core_pose(
    simulation: *mut palpate_simulation,
    body: u32,
    core: u32,
    pose: *mut palpate_pose,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
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

/// Takes a driven core from where it is to a pose (as `palpate_core_pose` tells it), evenly, within `seconds` of simulated time
/// but a step at least, and leaves it there; keys that it had are forgotten. Call it before every step to animate it. A core
/// that is not driven gives PALPATE_STATUS_ARGUMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn palpate_core_move(
    simulation: *mut palpate_simulation,
    body: u32,
    core: u32,
    pose: *const palpate_pose,
    seconds: f64,
) -> palpate_status {
    guarded(|| {
        // SAFETY: the caller's, as the header says.
        let pose = unsafe { sized::given(pose, "pose")? };
        let pose = pose.ok_or_else(|| Failure::new(palpate_status::Null, "pose is null; say where the core goes"))?;
        let pose = pose_of(pose, "pose")?;
        let time = Duration::try_from_secs_f64(seconds).map_err(|_| {
            let problem = format!("seconds is {seconds}; give a time, 0 for the next step");
            Failure::new(palpate_status::Argument, problem)
        })?;
        change(simulation, |simulation| simulation.move_core(body as usize, core as usize, pose, time))
    })
}
