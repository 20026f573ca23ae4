//! The structs of palpate.h that describe a scene for `build.rs`: settings, bodies, rigid cores (rigid bodies inside
//! soft ones, to which nodes of the soft body's mesh are attached) and the tool (what the haptic device moves).
//! `tables.rs` turns them into the tables of a scene file, where their values are checked.

use std::ffi::c_char;
use std::mem::offset_of;

use super::simulation::palpate_pose;
use super::sized::{Field, Sized32, fields};

/// Kind of motion of a rigid core or of a rigid body: fixed, that is, the core or body does not move.
pub const PALPATE_MOTION_FIXED: u32 = 0;
/// Kind of motion: driven (kinematic), that is, the core or body follows its keyframes, `keys`.
pub const PALPATE_MOTION_DRIVEN: u32 = 1;
/// Kind of motion: dynamic, that is, forces move the core or body.
pub const PALPATE_MOTION_DYNAMIC: u32 = 2;

/// Material law: corotational, that is, linear in the strain that remains when the rotation of a tetrahedron is
/// removed.
pub const PALPATE_LAW_COROTATIONAL: u32 = 0;
/// Material law: stable neo-Hookean.
pub const PALPATE_LAW_NEO_HOOKEAN: u32 = 1;

/// Volumetric strain of a soft body: each tetrahedron has its own volumetric strain.
pub const PALPATE_DILATATION_ELEMENT: u32 = 0;
/// Volumetric strain of a soft body: averaged over patches of neighbouring tetrahedra (F-bar), against locking in
/// nearly incompressible materials (Poisson's ratio near 0.5).
pub const PALPATE_DILATATION_PATCH: u32 = 1;

/// Settings of a whole scene: the tables `[step]`, `[solver]` and `[contact]` of a scene file. In every field but
/// `size`, zero is the default. A projected area is an area of a body's surface projected along the contact normal.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_settings {
    /// Size of the struct in bytes: sizeof(palpate_settings).
    pub size: u32,
    /// Number of Newton iterations per step; 0: 1 iteration.
    pub newton: u32,
    /// Time step, s; 0: 0.001.
    pub dt: f64,
    /// Acceleration of gravity, m/s^2; all zero: 0, -9.81, 0.
    pub gravity: [f64; 3],
    /// 1: there is no gravity, and `gravity` must be zero. 0: there is gravity.
    pub weightless: u32,
    /// Greatest number of conjugate gradient iterations per solve; 0: 200.
    pub max_iterations: u32,
    /// Relative residual at which the solver stops; 0: between 1e-2 and 1e-5, by the error of the time step.
    pub tolerance: f64,
    /// Penalty stiffness per projected area, N/m^3; 0: chosen from the bodies' materials.
    pub contact_stiffness: f64,
    /// Penalty damping per projected area, N s/m^3; 0: chosen from the stiffness.
    pub contact_damping: f64,
    /// Coulomb friction coefficient; 0: no friction.
    pub friction: f64,
    /// Sliding speed below which friction is viscous, m/s; 0: 0.001.
    pub friction_speed: f64,
    /// Penetration depth beyond which PALPATE_FLAG_DEPTH_BEYOND_LIMIT is raised, m; 0: 0.02.
    pub depth_limit: f64,
}

/// A keyframe: a pose at a time.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_key {
    /// Time of the key, s; later than the time of the previous key.
    pub time: f64,
    /// World pose at that time; an orientation of four zeros is no rotation.
    pub pose: palpate_pose,
}

/// A rigid core of a soft body: the nodes of the body's layer (its tetrahedral simulation mesh) that are attached to
/// the core move as one rigid body. Exactly one of `inset`, the box, the sphere, `nodes` and `all` selects these nodes;
/// coordinates and lengths are those of the mesh, before scale and pose.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_core {
    /// Size of the struct in bytes: sizeof(palpate_core).
    pub size: u32,
    /// How the core moves: PALPATE_MOTION_*.
    pub motion: u32,
    /// Name of the core, different from those of the body's other cores.
    pub name: *const c_char,
    /// Keyframes of a driven core, `key_count` of them. As in a scene file, each is a world pose of the body's
    /// coordinate frame, with which the core moves rigidly: a key that equals the body's position and orientation puts
    /// the core at its place in the undeformed body. Null for other cores.
    pub keys: *const palpate_key,
    /// Number of elements of `keys`.
    pub key_count: usize,
    /// Mass of a dynamic core, kg; 0: the mass of the part of the body that is attached to the core.
    pub mass: f64,
    /// Selects nodes at least this deep below the skin (the body's surface mesh), m; above 0.
    pub inset: f64,
    /// Selects nodes in a box: its corner of least coordinates.
    pub box_low: [f64; 3],
    /// Corner of greatest coordinates of that box.
    pub box_high: [f64; 3],
    /// Selects nodes in a sphere: its centre.
    pub sphere_centre: [f64; 3],
    /// Radius of that sphere, m.
    pub sphere_radius: f64,
    /// Selects single nodes by their indices in the layer, `node_count` of them.
    pub nodes: *const u32,
    /// Number of elements of `nodes`.
    pub node_count: usize,
    /// 1: selects every node.
    pub all: u32,
    /// Reserved: must be 0.
    pub reserved: u32,
}

/// A body of one of three kinds. Soft: it has a material and a layer, the tetrahedral simulation mesh (handed over,
/// made of cells that fill the surface, or a box); its surface mesh, the skin, is `surface`, or else the layer's
/// boundary. Rigid: it has a surface and no layer. A plane: it has `plane` and nothing else but a name. A field that is
/// zero or null means what a missing key means in a scene file.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_body {
    /// Size of the struct in bytes: sizeof(palpate_body).
    pub size: u32,
    /// How a rigid body moves: PALPATE_MOTION_*.
    pub motion: u32,
    /// Name of the body: letters, digits, '_', '-' and '.'; different from other bodies' names and from "tool".
    pub name: *const c_char,
    /// Name of the surface that is the body's skin, as given to `palpate_scene_add_surface`.
    pub surface: *const c_char,
    /// Layer, first way: name of a mesh, as given to `palpate_scene_add_layer`.
    pub layer: *const c_char,
    /// Layer, second way: cells that fill the surface; their edge, m, in the coordinates of the surface before `scale`.
    pub cell: f64,
    /// Instead of `cell`: number of such cells along the surface's largest extent.
    pub across: u32,
    /// Edge of the largest cells deep inside, as a multiple of the edge of the cells at the surface: 1, 2, 4 or 8; 0
    /// means 1.
    pub grade: u32,
    /// Depth below the surface to which cells fill the body, as a shell, m, in the coordinates of the surface before
    /// `scale`; 0: cells fill the whole inside.
    pub thickness: f64,
    /// Layer, third way: a box cut into cells; its corner of least coordinates.
    pub box_low: [f64; 3],
    /// Corner of greatest coordinates of that box.
    pub box_high: [f64; 3],
    /// Number of the box's cells along each axis.
    pub box_cells: [u32; 3],
    /// Material law of a soft body: PALPATE_LAW_*.
    pub law: u32,
    /// Volumetric strain of a soft body: PALPATE_DILATATION_*.
    pub dilatation: u32,
    /// 1: a surface that would need repair is refused; 0: it is repaired.
    pub strict: u32,
    /// Young's modulus, Pa. This field and the next four are the material of a soft body.
    pub young: f64,
    /// Poisson's ratio, from -0.5 to below 0.5.
    pub poisson: f64,
    /// Density, kg/m^3.
    pub density: f64,
    /// Mass-proportional Rayleigh damping, 1/s.
    pub damping_mass: f64,
    /// Stiffness-proportional Rayleigh damping, s.
    pub damping_stiffness: f64,
    /// A fixed half-space with outward normal n and offset d (m); the half-space fills all x with n . x <= d.
    pub plane: [f64; 4],
    /// Factor by which the coordinates of the body's meshes are multiplied; 0: 1.
    pub scale: f64,
    /// World position of the mesh's origin, m.
    pub position: [f64; 3],
    /// World orientation, unit quaternion x, y, z, w; four zeros are no rotation.
    pub orientation: [f64; 4],
    /// Velocity at the start, world axes, m/s.
    pub velocity: [f64; 3],
    /// Mass of a dynamic rigid body, kg.
    pub mass: f64,
    /// Keyframes of a driven rigid body, `key_count` of them: world poses of the mesh's coordinate frame, as `position`
    /// and `orientation` are. Null for other bodies.
    pub keys: *const palpate_key,
    /// Number of elements of `keys`.
    pub key_count: usize,
    /// Rigid cores of a soft body, `core_count` of them; all must have the same `size`.
    pub cores: *const palpate_core,
    /// Number of elements of `cores`.
    pub core_count: usize,
    /// Greatest number of convex collision proxies that cover the body for the broad phase; 0: the default.
    pub hulls: u32,
    /// Reserved: must be 0.
    pub reserved: u32,
}

/// The tool that the haptic device moves: exactly one of a sphere, a surface and a body of the scene. The last four
/// fields are the virtual coupling, a spring and damper between device and tool. Without a coupling (its four fields
/// zero) the tool moves freely.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_tool {
    /// Size of the struct in bytes: sizeof(palpate_tool).
    pub size: u32,
    /// 1: a surface that would need repair is refused; 0: it is repaired.
    pub strict: u32,
    /// Radius of a spherical tool, m; 0: the tool is no sphere.
    pub sphere: f64,
    /// Name of the tool's surface, as given to `palpate_scene_add_surface`; null: none.
    pub surface: *const c_char,
    /// Name of a body of the scene that is the tool; null: none. The virtual coupling acts on that body's first core,
    /// which must be dynamic. Mass and pose of the tool are then those of the body.
    pub body: *const c_char,
    /// Mass of the tool, kg.
    pub mass: f64,
    /// World position of the tool's centre at the start, m.
    pub position: [f64; 3],
    /// World orientation at the start, unit quaternion x, y, z, w; four zeros are no rotation.
    pub orientation: [f64; 4],
    /// Velocity at the start, world axes, m/s.
    pub velocity: [f64; 3],
    /// Factor by which the surface's coordinates are multiplied; 0: 1.
    pub scale: f64,
    /// Stiffness of the virtual coupling, N/m.
    pub stiffness: f64,
    /// Damping of the virtual coupling, N s/m.
    pub damping: f64,
    /// Angular stiffness of the virtual coupling, N m/rad.
    pub angular_stiffness: f64,
    /// Angular damping of the virtual coupling, N m s/rad.
    pub angular_damping: f64,
}

/// Implements [`Sized32`] (a struct that begins with its size) for a struct of numbers and pointers, for which zero
/// bytes are a valid value. The least size is that of the struct's first version, which ended 8 bytes after the start
/// of the field `$last`.
macro_rules! grows {
    ($name:ident, $last:ident, { $($field:ident),+ }) => {
        // SAFETY: the struct is `repr(C)`, its first field is the size, and any bytes are a valid value of its numbers
        // and pointers; a pointer is followed only under the rules of the comment at the top of palpate.h.
        unsafe impl Sized32 for $name {
            const NAME: &str = stringify!($name);
            const LEAST: usize = offset_of!($name, $last) + 8;
            const FIELDS: &'static [Field] = fields!($name { $($field),+ });

            fn unset() -> Self {
                // SAFETY: zero bytes are a value of all fields, which are numbers and pointers.
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
