//! Meshes that are drawn in addition to the skins (surface meshes of the bodies). They are made once on the host, and
//! the GPU updates their positions whenever they are shown. A frame is a rigid coordinate frame.

use std::sync::Arc;

use glam::DVec3;

use super::super::model::texel;
use super::super::upload;
use super::Points;
use crate::Result;
use crate::gpu::{Buffer, Context, Memory};
use crate::shaders::NONE;

/// A mesh while it is being made on the host.
#[derive(Debug, Clone, Default)]
pub struct Outline {
    nodes: Vec<[u32; 4]>,
    weights: Vec<[f32; 4]>,
    frames: Vec<u32>,
    values: Vec<f32>,
    /// Three vertices per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Outline {
    /// Number of vertices so far.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is no vertex yet.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Adds a vertex at a node, with a value to colour it by, and returns its index.
    pub fn add_node(&mut self, node: u32, value: f32) -> u32 {
        self.add([node; 4], [1.0, 0.0, 0.0, 0.0], NONE, value)
    }

    /// Adds a vertex attached to a frame, at a position `local` in the frame (m), and returns its index.
    pub fn add_rigid(&mut self, frame: u32, local: DVec3, value: f32) -> u32 {
        self.add([NONE, 0, 0, 0], texel(local, 0.0), frame, value)
    }

    fn add(&mut self, nodes: [u32; 4], weights: [f32; 4], frame: u32, value: f32) -> u32 {
        self.nodes.push(nodes);
        self.weights.push(weights);
        self.frames.push(frame);
        self.values.push(value);
        self.nodes.len() as u32 - 1
    }
}

/// A mesh on the GPU.
pub struct Mesh {
    /// The vertices of the mesh.
    pub points: Points,
    /// The three vertices of each triangle, a u32 each, without gaps; the array is padded to a whole texel of four u32.
    pub triangles: Buffer,
    /// One float per vertex to colour it by, without gaps; the array is padded to a whole texel of four floats.
    pub values: Buffer,
    /// Two u32, the range of all vertices: 0, and the number of vertices.
    pub range: Buffer,
    /// The greatest of `values`, one float.
    pub most: Buffer,
}

impl Mesh {
    /// The mesh of an outline, copied to the GPU.
    pub fn new(context: &Arc<Context>, name: &str, outline: &Outline) -> Result<Mesh> {
        let nodes = upload(context, &format!("nodes of {name}"), &outline.nodes)?.known_as(&["skin_nodes"]);
        let weights = upload(context, &format!("weights of {name}"), &outline.weights)?.known_as(&["skin_weights"]);
        let words = outline.triangles.as_flattened();
        let triangles = Buffer::shared(context, &format!("triangles of {name}"), texels(words.len()))?;
        triangles.write(words)?;
        let values = Buffer::shared(context, &format!("values of {name}"), texels(outline.values.len()))?;
        let values = values.known_as(&["values"]);
        values.write(&outline.values)?;
        let greatest = outline.values.iter().copied().fold(0.0f32, f32::max);
        Ok(Mesh {
            points: Points::new(context, outline.len(), nodes, weights, &outline.frames)?,
            triangles,
            values,
            range: upload(context, "ranges", &[[0, outline.len() as u32]])?,
            most: Buffer::from_slice(context, "most", &[greatest], Memory::Readback)?,
        })
    }
}

/// Size in bytes of this many 32-bit words, in whole texels of 16 bytes, at least one.
fn texels(words: usize) -> u64 {
    (4 * words.max(1)).next_multiple_of(16) as u64
}
