//! Pose stage, the first stage of a step: places the collision proxies (convex hulls that cover the skins, the bodies'
//! surface meshes) in the world and bounds them, clears the step's counters, and sets the velocities of nodes attached
//! to moving frames. At the end of the step, a separate pass makes the sums for fitting the floating frames (of soft
//! bodies without cores) to their nodes. A frame is a rigid coordinate frame, a core a rigid body to which nodes are
//! attached.

use std::sync::Arc;

use super::elastic::Elastic;
use super::model::Model;
use super::solve::Solve;
use super::{Common, array, count, upload};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::shaders::{Fit, ProxyBounds};

/// The collision proxies at rest and in the world.
pub struct Pose {
    place: Kernel,
    proxy_count: u32,
    hull_rest: Buffer,
    face_rest: Buffer,
    /// The nodes whose displacements move the skin that a proxy covers, proxy by proxy.
    pub proxy_nodes: Buffer,
    /// The collision proxies of all bodies.
    pub proxies: Buffer,
    /// Hull vertices of all proxies, in world axes, relative to an origin that each step chooses near the tool (for the
    /// precision of f32), m.
    pub hull: Buffer,
    /// Face planes of all proxies in world axes: unit normal, and offset from the same origin (m).
    pub faces: Buffer,
    /// One [`ProxyBounds`] per proxy.
    pub bounds: Buffer,
}

impl Pose {
    /// Kernels and arrays for a model.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Pose> {
        let constants = [("SPANS", Const::Bool(model.spans_frames()))];
        Ok(Pose {
            place: Kernel::new(context, "pose/place", Size::Reduce, &constants)?,
            proxy_count: model.proxies.len() as u32,
            hull_rest: upload(context, "hull_rest", &model.hull)?,
            face_rest: upload(context, "face_rest", &model.faces)?,
            proxy_nodes: upload(context, "proxy_nodes", &model.proxy_nodes)?,
            proxies: upload(context, "proxies", &model.proxies)?,
            hull: array::<[f32; 4]>(context, "hull", model.hull.len())?,
            faces: array::<[f32; 4]>(context, "faces", model.faces.len())?,
            bounds: array::<ProxyBounds>(context, "bounds", model.proxies.len())?,
        })
    }

    /// Records one pass, with a workgroup per proxy.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("pose");
        let arguments = shaders::pose::Place {
            frames: &common.frames,
            proxies: &self.proxies,
            hull_rest: &self.hull_rest,
            face_rest: &self.face_rest,
            proxy_nodes: &self.proxy_nodes,
            displacement: &elastic.displacement,
            node_rest: Some(&elastic.node_rest),
            links: Some(&common.links),
            hull: &self.hull,
            faces: &self.faces,
            bounds: &self.bounds,
            counts: &common.counts,
            args: &common.args,
        };
        recorder.dispatch_groups(&self.place, &arguments, self.proxy_count);
    }
}

/// The nodes attached to moving frames, which are frames that follow a trajectory (driven frames) and frames of dynamic
/// cores (cores that forces move).
pub struct AttachedNodes {
    carry: Kernel,
    count: u32,
    nodes: Buffer,
}

impl AttachedNodes {
    /// Kernel and node list; `None` where no node is attached to a moving frame.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Option<AttachedNodes>> {
        if model.attached_nodes.is_empty() {
            return Ok(None);
        }
        let nodes = ("ATTACHED_NODES", count(model.attached_nodes.len()));
        let rigids = ("RIGIDS", count(model.cores.len() + usize::from(model.tool_frame.is_some())));
        Ok(Some(AttachedNodes {
            carry: Kernel::new(context, "pose/carry", Size::Group, &[nodes, rigids])?,
            count: model.attached_nodes.len() as u32,
            nodes: upload(context, "attached_nodes", &model.attached_nodes)?,
        }))
    }

    /// Records one pass over the attached nodes, at the start of the step.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic, solve: &Solve) {
        recorder.stage("pose");
        let arguments = shaders::pose::Carry {
            params: &common.params,
            frames: &common.frames,
            attached_nodes: &self.nodes,
            node_info: &elastic.node_info,
            node_rest: &elastic.node_rest,
            solve: &solve.state,
            iterates: &solve.iterates,
            rigid_trends: &solve.trend.rigids,
            velocity: &elastic.velocity,
            solution: &solve.solution,
            trend: &solve.trend.nodes,
        };
        recorder.dispatch(&self.carry, &arguments, self.count);
    }
}

/// The floating frames, and the kernel for their fit.
pub struct Floating {
    fit: Kernel,
    count: u32,
    frames: Buffer,
    /// One [`Fit`] per floating frame: the sums over its nodes from which the host fits the frame.
    pub fits: Buffer,
}

impl Floating {
    /// Kernel and arrays; `None` where no frame floats.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Option<Floating>> {
        if model.floating.is_empty() {
            return Ok(None);
        }
        let of = |f: &super::model::Floating| [f.frame as u32, f.nodes.start as u32, f.nodes.len() as u32, 0];
        let frames: Vec<[u32; 4]> = model.floating.iter().map(of).collect();
        Ok(Some(Floating {
            fit: Kernel::new(context, "pose/fit", Size::Reduce, &[])?,
            count: frames.len() as u32,
            frames: upload(context, "floating", &frames)?,
            fits: Buffer::new(context, "fits", (frames.len() * size_of::<Fit>()) as u64, Memory::Readback)?,
        }))
    }

    /// Records one pass at the end of the step, with a workgroup per floating frame.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        recorder.stage("fit");
        let arguments = shaders::pose::Fit {
            frames: &common.frames,
            floating: &self.frames,
            node_rest: &elastic.node_rest,
            displacement: &elastic.displacement,
            velocity: &elastic.velocity,
            fits: &self.fits,
        };
        recorder.dispatch_groups(&self.fit, &arguments, self.count);
    }
}
