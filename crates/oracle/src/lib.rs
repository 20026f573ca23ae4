//! f64 twins of every stage and of the whole step, in plain Rust; they share nothing with `shaders/`.
//!
//! vk-tests hold each shader against its twin here, and error reports take their reference trajectory from
//! [`step::Simulation`]. Clear before fast. Units are SI; vectors are in world axes unless a name says `rest`.
//!
//! | twin | stage |
//! | --- | --- |
//! | [`body`] | state of soft bodies and dynamic cores |
//! | [`elastic`] | element rotations, elastic forces, the stiffness operator |
//! | [`skin`] | skin positions and velocities from nodes |
//! | [`cull`] | separation and penetration of convex hulls |
//! | [`proximity`] | placement, bounds, directions |
//! | [`regions`] | boxes of chunks, what a vertex makes of several regions |
//! | [`contact`], [`rays`] | depth by exact rays, gathered contacts |
//! | [`contact_law`], [`material_law`] | the laws, once each |
//! | [`linear`], [`step`], `newton` | the implicit step, solved directly |
//! | [`joint`] | springs between dynamic cores |
//! | [`coarse`] | the coarse level of the solver's preconditioner |
//! | [`wrench`] | net force, torque, stiffness and damping on the tool |
//! | [`gap`] | the ways from a tool to a skin |
//! | [`statics`] | linear static equilibrium, for laws only |

pub mod body;
pub mod coarse;
pub mod contact;
pub mod contact_law;
pub mod cull;
pub mod elastic;
pub mod friction;
pub mod gap;
pub mod joint;
pub mod linear;
pub mod material_law;
pub mod neo_hookean;
mod newton;
pub mod proximity;
pub mod rays;
pub mod regions;
pub mod skin;
pub mod statics;
pub mod step;
pub mod tool;
pub mod wrench;

#[cfg(test)]
mod laws;
#[cfg(test)]
mod testing;
