//! What the solver's kernels share.

use bytemuck::{Pod, Zeroable};

/// A dynamic core, or the tool: its six rows of the system.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Rigid {
    /// Among the frames.
    pub frame: u32,
    /// Into the nodes of blocks.
    pub node_first: u32,
    /// Nodes it carries.
    pub node_count: u32,
    /// First block of those.
    pub block_first: u32,
    /// How many.
    pub block_count: u32,
    /// First slot of their modes.
    pub slot_first: u32,
    /// Unit axis through its centre that is all it may turn about, world; zero: it moves freely.
    pub hinge: [f32; 3],
    /// First of its joints, into the sides of joints.
    pub joint_first: u32,
    /// How many.
    pub joint_count: u32,
    /// First of its group: the rigid bodies that joints join to it, itself included.
    pub group_first: u32,
    /// How many.
    pub group_count: u32,
    /// The one of its group that it hangs on, or [`super::NONE`].
    pub parent: u32,
    /// First number of its group's inverse.
    pub inverse_first: u32,
    /// e . M^-1 e, e the magnitudes that b is made of: what rounding leaves of it at rest, but for the unit of rounding.
    pub rounding: f32,
    /// Right-hand side.
    pub b: [f32; 6],
    /// Before the loop A x, after it b - A x, of the newest solution.
    pub image: [f32; 6],
    /// b - A x of the last accepted step.
    pub leftover: [f32; 6],
}

/// What iterations change of it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct RigidIterate {
    /// Change of its twist.
    pub x: [f32; 6],
    /// Residual.
    pub r: [f32; 6],
    /// Preconditioned residual.
    pub u: [f32; 6],
    /// Direction.
    pub p: [f32; 6],
    /// Its image.
    pub s: [f32; 6],
}

/// A ball joint of which a dynamic core is a side.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct Joint {
    /// Its sides among the rigid bodies; [`super::NONE`]: its motion is known.
    pub rigid: [u32; 2],
    /// From the centre of each to the joint, world axes, m.
    pub arm: [[f32; 3]; 2],
    /// h^2 k, kg.
    pub linear: f32,
    /// h^2 K + h D of the relative spin: xx yy zz, xy xz yz, world axes, kg m^2.
    pub angular: [f32; 6],
    /// On the first side, N s.
    pub impulse: [f32; 3],
    /// On the first side besides, N m s.
    pub twist: [f32; 3],
}

/// State of the solver between passes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Solve {
    /// Factor on the last solution.
    pub warm: f32,
    /// b . M^-1 b.
    pub rhs_norm2: f32,
    /// What rounding leaves of it.
    pub floor_norm2: f32,
    /// 0 running, 1 converged, 2 stopped, 3 broke down.
    pub status: u32,
    /// The set with the newest iterate.
    pub current: u32,
    /// How often it was solved again without pulling contacts.
    pub retries: u32,
    /// How often elasticity was linearised again in this step.
    pub linearisations: u32,
}

/// Scalars of an iteration.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Iteration {
    /// r . M^-1 r.
    pub gamma: f32,
    /// Step length.
    pub alpha: f32,
    /// Iterations done.
    pub count: u32,
}
