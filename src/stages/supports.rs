//! Supports of soft bodies (conditions on the motion of nodes), and the reactions of what holds the bodies: the forces
//! of supports and of cores of prescribed motion (rigid parts of a body that the solver does not move). The solver's
//! kernels restrict their equations to what the supports leave to each node; one pass at the end of a solve sums the
//! impulses that hold the nodes.

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat3, DQuat};

use super::elastic::Elastic;
use super::model::{Model, texel};
use super::{Common, upload, upload_or_nothing};
use crate::Result;
use crate::gpu::{Buffer, Context, Kernel, Memory, Recorder, Size};
use crate::prepare::supports::{Freedom, Supports};
use crate::shaders;

/// What holds the soft bodies of a scene, as arrays for the kernels. All are empty where supports hold no node and no
/// reaction is reported.
#[derive(Debug, Clone, Default)]
pub struct Held {
    /// Per node what its supports leave to it, as in shaders/shared/support.glsl.
    pub nodes: Vec<[f32; 4]>,
    /// The supports and cores whose reactions are reported, body by body.
    pub holders: Vec<Holder>,
    /// Their nodes, holder by holder.
    pub list: Vec<u32>,
    /// For each of these nodes, the rows of the matrix that maps the force that holds it to the holder's share, in world
    /// axes.
    pub shares: Vec<[f32; 4]>,
}

/// A support or core whose reaction is reported.
#[derive(Debug, Clone)]
pub struct Holder {
    /// Names of the body and of the support or core, with a dot between them.
    pub name: String,
    /// Its nodes, a range of [`Held::list`].
    pub nodes: Range<usize>,
}

impl Model {
    /// Adds what holds a soft body whose nodes were added already, from index `node_first` on. `name` and `orientation`
    /// are those of the body.
    pub(super) fn add_supports(&mut self, name: &str, orientation: DQuat, supports: &Supports, node_first: usize) {
        if supports.freedom.is_empty() {
            return;
        }
        self.held.nodes.resize(node_first, [0.0; 4]);
        for (k, freedom) in supports.freedom.iter().enumerate() {
            let (direction, kind) = match freedom {
                Freedom::Free => (glam::DVec3::ZERO, shaders::SUPPORT_NONE),
                Freedom::Plane(normal) => (*normal, shaders::SUPPORT_PLANE),
                Freedom::Axis(direction) => (*direction, shaders::SUPPORT_AXIS),
                Freedom::Held => (glam::DVec3::ZERO, shaders::SUPPORT_HELD),
            };
            self.held.nodes.push(texel(orientation * direction, f64::from(kind)));
            if self.is_free(node_first + k) {
                let velocity = glam::Vec3::from_slice(&self.velocity[node_first + k][..3]).as_dvec3();
                let left = orientation * (freedom.projection() * (orientation.conjugate() * velocity));
                self.velocity[node_first + k] = texel(left, 0.0);
            }
        }
        let turn = DMat3::from_quat(orientation);
        for holder in &supports.holders {
            let first = self.held.list.len();
            for (node, share) in &holder.nodes {
                self.held.list.push(node_first as u32 + node);
                let rows = (turn * *share * turn.transpose()).transpose();
                self.held.shares.extend([rows.x_axis, rows.y_axis, rows.z_axis].map(|row| texel(row, 0.0)));
            }
            self.held
                .holders
                .push(Holder { name: format!("{name}.{}", holder.name), nodes: first..self.held.list.len() });
        }
    }

    /// Whether the solver has an equation for a node of a soft body that is not attached to a dynamic core: for free
    /// nodes, and for those of prescribed motion whose reaction is reported.
    pub(super) fn has_equation(&self, node: usize) -> bool {
        self.is_free(node)
            || self.node_info[node][3] == shaders::NODE_KINEMATIC && self.support_of(node) == shaders::SUPPORT_HELD
    }

    fn support_of(&self, node: usize) -> u32 {
        self.held.nodes.get(node).map_or(shaders::SUPPORT_NONE, |support| support[3] as u32)
    }

    /// The projection of a node's velocity onto what its supports leave to it, in the axes of the body at rest; `None`
    /// where no support holds the node.
    pub(super) fn projection_of(&self, node: usize) -> Option<DMat3> {
        let [x, y, z, _] = self.held.nodes.get(node)?.map(f64::from);
        let frame = self.node_info[node][2] as usize;
        let direction = (self.frames[frame].orientation.conjugate() * glam::DVec3::new(x, y, z)).normalize_or_zero();
        match self.support_of(node) {
            shaders::SUPPORT_PLANE => Some(Freedom::Plane(direction).projection()),
            shaders::SUPPORT_AXIS => Some(Freedom::Axis(direction).projection()),
            shaders::SUPPORT_HELD => Some(DMat3::ZERO),
            _ => None,
        }
    }
}

/// The arrays of supports on the GPU, and the kernel that sums reactions.
pub struct SupportArrays {
    kernel: Kernel,
    holder_count: u32,
    /// One [`shaders::Supported`] per node.
    pub(super) nodes: Buffer,
    holders: Buffer,
    list: Buffer,
    shares: Buffer,
    /// Six numbers per holder, read by the host: force (N) and torque about the origin of the step's positions (N m).
    pub reactions: Buffer,
}

impl SupportArrays {
    /// The arrays for a model; `None` where nothing is held and no reaction is reported.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Option<SupportArrays>> {
        let held = &model.held;
        if held.nodes.is_empty() {
            return Ok(None);
        }
        let supported = |left: &[f32; 4]| shaders::Supported { left: *left, ..bytemuck::Zeroable::zeroed() };
        let mut nodes: Vec<shaders::Supported> = held.nodes.iter().map(supported).collect();
        nodes.resize(model.node_rest.len(), bytemuck::Zeroable::zeroed());
        let ranges: Vec<[u32; 2]> =
            held.holders.iter().map(|holder| [holder.nodes.start as u32, holder.nodes.len() as u32]).collect();
        let holder_count = ranges.len();
        Ok(Some(SupportArrays {
            kernel: Kernel::new(context, "solve/reactions", Size::Reduce, &[])?,
            holder_count: holder_count as u32,
            nodes: upload(context, "supported", &nodes)?,
            holders: upload_or_nothing(context, "holders", &ranges)?,
            list: upload_or_nothing(context, "held_nodes", &held.list)?,
            shares: upload_or_nothing(context, "held_shares", &held.shares)?,
            reactions: Buffer::new(context, "reactions", 24 * holder_count.max(1) as u64, Memory::Readback)?,
        }))
    }

    /// Records the pass that sums the reactions, after the last pass of a solve that gathers products.
    pub(super) fn record(&self, recorder: &mut Recorder, common: &Common, elastic: &Elastic) {
        if self.holder_count == 0 {
            return;
        }
        let arguments = shaders::solve::Reactions {
            params: &common.params,
            frames: &common.frames,
            node_info: &elastic.node_info,
            node_rest: &elastic.node_rest,
            displacement: &elastic.displacement,
            supported: &self.nodes,
            holders: &self.holders,
            held_nodes: &self.list,
            held_shares: &self.shares,
            reactions: &self.reactions,
        };
        recorder.dispatch_groups(&self.kernel, &arguments, self.holder_count);
    }
}
