//! f64 reference implementations ("twins", together the "oracle") of every stage of a simulation step and of the whole
//! step; they share no code with the engine's `shaders/`.
//!
//! vk-tests compare each shader with its reference implementation here, and reports of the engine's error compare its
//! motion with that of [`step::Simulation`]. Units are SI; axes are the world's unless a name or comment says `rest`
//! (axes of the undeformed body).
//!
//! A layered body is a skin (high-resolution surface mesh) embedded in a layer (tetrahedral simulation mesh), some of
//! whose nodes are attached to rigid cores. A core is dynamic if the solver finds its motion. A proxy is a convex hull
//! of part of a skin, for the broad phase of collision detection. A contact patch is a column of space in which two
//! bodies may touch, with one normal. The tool is the rigid body that the haptic device moves by virtual coupling
//! (spring and damper).
//!
//! | module | content |
//! | --- | --- |
//! | [`body`] | state of soft bodies and dynamic cores |
//! | [`elastic`] | element rotations, elastic forces, the stiffness operator |
//! | [`skin`] | skin positions and velocities from nodes |
//! | [`cull`] | broad phase: separation and penetration of convex hulls |
//! | [`proximity`] | broad phase: placement and bounds of proxies, contact normals |
//! | [`contact_patches`] | bounds of parts of a skin, blending of several contact patches at a vertex |
//! | [`contact`], [`rays`], [`overlap`] | narrow phase: depth by exact rays or overlaps of triangles, contacts |
//! | [`contact_law`], [`material_law`], [`neo_hookean`] | the contact and material laws |
//! | [`friction`] | friction of contacts |
//! | [`linear`], [`step`], `newton` | the implicit step, solved directly |
//! | [`joint`] | springs between dynamic cores |
//! | [`tool`] | the rigid tool and its virtual coupling |
//! | [`coarse`] | the coarse space of the solver's preconditioner |
//! | [`wrench`] | net force, torque, stiffness and damping on the tool |
//! | [`gap`] | shortest ways from the tool to a skin |
//! | [`statics`] | linear static equilibrium, for tests only |

pub mod body;
pub mod coarse;
pub mod compression;
pub mod contact;
pub mod contact_law;
pub mod contact_patches;
pub mod cull;
pub mod elastic;
pub mod friction;
pub mod gap;
pub mod joint;
pub mod linear;
pub mod loads;
pub mod material_law;
pub mod neo_hookean;
mod newton;
pub mod overlap;
pub mod proximity;
pub mod rays;
pub mod skin;
pub mod statics;
pub mod step;
pub mod tool;
pub mod wrench;

#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
