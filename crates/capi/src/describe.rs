//! What scenes are built of, as C describes it: plain structs, of which `tables.rs` makes the tables of a scene file.

use std::ffi::c_char;
use std::mem::offset_of;

use super::simulation::palpate_pose;
use super::sized::{Field, Sized32, fields};

/// It does not move. The kinds of motion: of a core, or of a rigid body.
pub const PALPATE_MOTION_FIXED: u32 = 0;
/// It follows `keys`.
pub const PALPATE_MOTION_DRIVEN: u32 = 1;
/// Forces move it.
pub const PALPATE_MOTION_DYNAMIC: u32 = 2;

/// Linear in the strain that a tetrahedron has beside its rotation. The laws of a material.
pub const PALPATE_LAW_COROTATIONAL: u32 = 0;
/// Stable neo-Hookean.
pub const PALPATE_LAW_NEO_HOOKEAN: u32 = 1;

/// A volumetric strain to each tetrahedron. Over what a soft body's volumetric strain is one number.
pub const PALPATE_DILATATION_ELEMENT: u32 = 0;
/// One to each patch of neighbouring tetrahedra: for materials that keep their volume (Poisson's ratio near one half).
pub const PALPATE_DILATATION_PATCH: u32 = 1;

/// What holds for a whole scene; its `[step]`, `[solver]` and `[contact]`. Zero is the usual value for all of it but the size.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_settings {
    /// sizeof(palpate_settings).
    pub size: u32,
    /// Newton iterations a step; 0: 1.
    pub newton: u32,
    /// Time step, s; 0: 0.001.
    pub dt: f64,
    /// Acceleration of gravity, m/s^2; zero: 0, -9.81, 0.
    pub gravity: [f64; 3],
    /// 1: there is no gravity, and `gravity` is zero.
    pub weightless: u32,
    /// Of the solver, at most; 0: 200.
    pub max_iterations: u32,
    /// Relative residual at which the solver stops; 0: 1e-5.
    pub tolerance: f64,
    /// Penalty stiffness per projected area, N/m^3; 0: chosen.
    pub contact_stiffness: f64,
    /// Penalty damping per projected area, N s/m^3; 0: chosen.
    pub contact_damping: f64,
    /// Coulomb's coefficient.
    pub friction: f64,
    /// Speed below which friction is viscous, m/s; 0: 0.001.
    pub friction_speed: f64,
    /// Depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m; 0: 0.02.
    pub depth_limit: f64,
}

/// A pose at a time.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_key {
    /// s; each after the one before.
    pub time: f64,
    /// World; an orientation of four zeros turns nothing.
    pub pose: palpate_pose,
}

/// A rigid core of a soft body: nodes that move as one. Exactly one of `inset`, the box, the sphere, `nodes` and `all` says
/// which; places are in the coordinates of the mesh, before scale and pose.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_core {
    /// sizeof(palpate_core).
    pub size: u32,
    /// PALPATE_MOTION_*.
    pub motion: u32,
    /// Its name, unlike other cores' of the body.
    pub name: *const c_char,
    /// Of a driven core: where the centre of the mass that it carries is, `key_count` of them. Null for others.
    pub keys: *const palpate_key,
    /// How many keys there are.
    pub key_count: usize,
    /// Of a dynamic core, kg; 0: that of what it holds.
    pub mass: f64,
    /// Nodes at least this deep below the skin, m, above 0.
    pub inset: f64,
    /// Nodes in a box: its least corner.
    pub box_low: [f64; 3],
    /// Its greatest corner.
    pub box_high: [f64; 3],
    /// Nodes in a sphere: its centre.
    pub sphere_centre: [f64; 3],
    /// Its radius, m.
    pub sphere_radius: f64,
    /// These nodes, by their places in the layer's array, `node_count` of them.
    pub nodes: *const u32,
    /// How many nodes there are.
    pub node_count: usize,
    /// 1: every node.
    pub all: u32,
    /// 0.
    pub reserved: u32,
}

/// A body, of one of three kinds. Soft: it has a layer (a mesh, cells that fill the surface, or a box) and a material; without
/// a surface the layer's boundary is its skin. Rigid: it has a surface and no layer. A plane: it has `plane` and nothing else
/// but a name. What is zero or null is as where a scene file leaves the key out.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_body {
    /// sizeof(palpate_body).
    pub size: u32,
    /// Of a rigid body: PALPATE_MOTION_*.
    pub motion: u32,
    /// Its name: letters, digits, '_', '-' and '.'; unlike other bodies', and not "tool".
    pub name: *const c_char,
    /// Its skin: the name of a surface that `palpate_scene_add_surface` took.
    pub surface: *const c_char,
    /// Its layer: the name of one that `palpate_scene_add_layer` took.
    pub layer: *const c_char,
    /// Or cells that fill the surface: their edge, m, in the surface's coordinates.
    pub cell: f64,
    /// Or so many cells along the surface's largest extent.
    pub across: u32,
    /// Of cells: how much larger they may be deep inside; 0, 1, 2, 4 or 8.
    pub grade: u32,
    /// Of cells: depth of the shell that is filled, m; 0: all of it.
    pub thickness: f64,
    /// Or a box: its least corner.
    pub box_low: [f64; 3],
    /// Its greatest corner.
    pub box_high: [f64; 3],
    /// Its cells along each axis.
    pub box_cells: [u32; 3],
    /// Of a soft body: PALPATE_LAW_*.
    pub law: u32,
    /// Of a soft body: PALPATE_DILATATION_*.
    pub dilatation: u32,
    /// 1: a surface that would need repair is refused.
    pub strict: u32,
    /// Young's modulus, Pa. This and the next four: the material of a soft body.
    pub young: f64,
    /// Poisson's ratio, from -0.5 to below 0.5.
    pub poisson: f64,
    /// kg/m^3.
    pub density: f64,
    /// Rayleigh damping by mass, 1/s.
    pub damping_mass: f64,
    /// Rayleigh damping by stiffness, s.
    pub damping_stiffness: f64,
    /// A fixed half-space: outward normal n and offset d; it is where n . x <= d.
    pub plane: [f64; 4],
    /// Of the mesh's coordinates; 0: 1.
    pub scale: f64,
    /// Where the mesh's origin is, world, m.
    pub position: [f64; 3],
    /// World orientation, unit quaternion x, y, z, w; four zeros turn nothing.
    pub orientation: [f64; 4],
    /// At the start, world, m/s.
    pub velocity: [f64; 3],
    /// Of a dynamic rigid body, kg.
    pub mass: f64,
    /// Of a driven rigid body: where the centre of its volume is, `key_count` of them. Null for others.
    pub keys: *const palpate_key,
    /// How many keys there are.
    pub key_count: usize,
    /// Of a soft body: `core_count` of them, all of the size that the first says.
    pub cores: *const palpate_core,
    /// How many cores there are.
    pub core_count: usize,
    /// Convex hulls that stand for it where bodies are far apart, at most; 0: the usual number.
    pub hulls: u32,
    /// 0.
    pub reserved: u32,
}

/// What the device holds: exactly one of a sphere, a surface and a body of the scene; and the spring that holds it. Without
/// one (all of it zero) the tool moves freely.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_tool {
    /// sizeof(palpate_tool).
    pub size: u32,
    /// 1: a surface that would need repair is refused.
    pub strict: u32,
    /// Radius of a sphere, m.
    pub sphere: f64,
    /// The name of a surface that `palpate_scene_add_surface` took.
    pub surface: *const c_char,
    /// The name of a body of the scene, held by its first core, which is dynamic. It has its own mass and pose.
    pub body: *const c_char,
    /// kg.
    pub mass: f64,
    /// Where its centre is at the start, world, m.
    pub position: [f64; 3],
    /// World orientation at the start; four zeros turn nothing.
    pub orientation: [f64; 4],
    /// At the start, world, m/s.
    pub velocity: [f64; 3],
    /// Of the surface's coordinates; 0: 1.
    pub scale: f64,
    /// Of the spring between device and tool, N/m.
    pub stiffness: f64,
    /// N s/m.
    pub damping: f64,
    /// N m/rad.
    pub angular_stiffness: f64,
    /// N m s/rad.
    pub angular_damping: f64,
}

/// Zero bytes are a value of all of them: numbers, null pointers. The least size is that of the first version.
macro_rules! grows {
    ($name:ident, $last:ident, { $($field:ident),+ }) => {
        // SAFETY: `repr(C)`, the size comes first, and any bytes are a value: a pointer is only followed as the header says.
        unsafe impl Sized32 for $name {
            const NAME: &str = stringify!($name);
            const LEAST: usize = offset_of!($name, $last) + 8;
            const FIELDS: &'static [Field] = fields!($name { $($field),+ });

            fn unset() -> Self {
                // SAFETY: as above.
                let zero: Self = unsafe { std::mem::zeroed() };
                $name { size: size_of::<Self>() as u32, ..zero }
            }
        }
    };
}

grows!(palpate_settings, depth_limit, { size, newton, dt, gravity, weightless, max_iterations, tolerance, contact_stiffness, contact_damping, friction, friction_speed, depth_limit });
grows!(palpate_core, all, { size, motion, name, keys, key_count, mass, inset, box_low, box_high, sphere_centre, sphere_radius, nodes, node_count, all, reserved });
grows!(palpate_body, hulls, { size, motion, name, surface, layer, cell, across, grade, thickness, box_low, box_high, box_cells, law, dilatation, strict, young, poisson, density, damping_mass, damping_stiffness, plane, scale, position, orientation, velocity, mass, keys, key_count, cores, core_count, hulls, reserved });
grows!(palpate_tool, angular_damping, { size, strict, sphere, surface, body, mass, position, orientation, velocity, scale, stiffness, damping, angular_stiffness, angular_damping });
