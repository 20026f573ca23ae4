//! Gap pass, a part of the wrench stage: finds the shortest way from a rigid tool to the skins (surface meshes) that the
//! tool may touch, in steps of a haptic loop, and for a spherical tool one in each of several sectors of directions. A
//! skin is searched in parts, each by one workgroup. A part is up to 64 chunks (groups of at most 64 skin vertices with
//! their triangles) of one collision proxy (convex hull that covers some of the skin).

use std::sync::Arc;

use glam::Vec3;

use super::cull::Cull;
use super::elastic::Elastic;
use super::model::Model;
use super::pose::Pose;
use super::skin::Skin;
use super::solve::Solve;
use super::{Common, count, upload};
use crate::Result;
use crate::gpu::{Buffer, Const, Context, Kernel, Memory, Recorder, Size};
use crate::shaders;
use crate::shaders::{Chunk, SkinGap, SkinPart};

/// Distance from the tool's surface within which skins are searched for, m.
pub const RANGE: f64 = 0.03;
/// Largest number of chunks of a part, first for a spherical tool, then for any other tool, with which the search of a
/// chunk takes longer.
const SHARE: [usize; 2] = [64, 8];
/// Sectors of directions in each of which a way from a spherical tool is found, and one for the shortest way.
pub const SECTORS: usize = 27;
/// Ways that are longer than the shortest one of their part by at most this are found in all sectors, m: a fast hand
/// moves so far while a step of 30 ms is done.
pub const MARGIN: f64 = 0.006;

/// The kernel of the gap pass and its arrays.
pub struct Gap {
    kernel: Kernel,
    parts: Buffer,
    /// One [`SkinGap`] per part and sector, read by the host.
    pub gaps: Buffer,
    /// Per part and sector: index of the pair of bodies that the part belongs to, and whether the sector is that for the
    /// shortest way of the part.
    pub entries: Vec<(usize, bool)>,
}

/// The stages that hold the skins.
pub struct Skins<'a> {
    /// Collision proxies.
    pub pose: &'a Pose,
    /// Chunks of the skins.
    pub cull: &'a Cull,
    /// Vertices of the skins.
    pub skin: &'a Skin,
}

/// A part of a skin, and the pair of bodies that it belongs to.
#[derive(Debug, Clone, Copy)]
pub struct PairPart {
    /// The pair's index.
    pub pair: usize,
    /// The part of the skin.
    pub part: SkinPart,
}

/// The parts of all skins that a rigid tool may touch. Half-spaces have no parts, and there are none at all where the
/// tool is a body of the scene.
pub fn parts(model: &Model) -> Vec<PairPart> {
    if model.tool_frame.is_none() {
        return Vec::new();
    }
    let share = SHARE[usize::from(model.tool_sphere.is_none())] as u32;
    let mut parts = Vec::new();
    for (index, pair) in model.pairs.iter().enumerate().filter(|(_, pair)| pair.tool_sign != 0.0 && pair.is_plane == 0)
    {
        let side = usize::from(pair.tool_sign > 0.0);
        let first = pair.first_proxy[side];
        for proxy_index in first..first + pair.proxy_count[side] {
            let proxy = &model.proxies[proxy_index as usize];
            let end = proxy.chunk_first + proxy.chunk_count;
            for chunk_first in (proxy.chunk_first..end).step_by(share as usize) {
                let chunk_count = share.min(end - chunk_first);
                let chunks = &model.chunks[chunk_first as usize..][..chunk_count as usize];
                let (low, high) = box_of(chunks);
                let part = SkinPart { proxy: proxy_index, chunk_first, chunk_count, low, high };
                parts.push(PairPart { pair: index, part });
            }
        }
    }
    parts
}

/// Number of workgroups of the gap pass, one per part.
pub fn part_count(model: &Model) -> usize {
    parts(model).len()
}

/// Box that contains the boxes of some chunks at rest, in their rigid coordinate frame: least and greatest corner, m.
fn box_of(chunks: &[Chunk]) -> ([f32; 3], [f32; 3]) {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for chunk in chunks {
        let (centre, half) = (Vec3::from(chunk.centre), Vec3::from(chunk.half_extent));
        let [u, v] = chunk.axes.map(Vec3::from);
        let reach = half.x * u.abs() + half.y * v.abs() + half.z * u.cross(v).abs();
        (low, high) = (low.min(centre - reach), high.max(centre + reach));
    }
    (low.to_array(), high.to_array())
}

/// The chunks of the tool's skin: index of the first, and their number. `pair`: index of a pair of bodies one of which
/// is the tool.
fn tool_chunks(model: &Model, pair: usize) -> (u32, u32) {
    let pair = &model.pairs[pair];
    let side = usize::from(pair.tool_sign < 0.0);
    let proxies = &model.proxies[pair.first_proxy[side] as usize..][..pair.proxy_count[side] as usize];
    (proxies.first().map_or(0, |p| p.chunk_first), proxies.iter().map(|p| p.chunk_count).sum())
}

/// Vertices of a rigid tool's skin, relative to the tool's centre, in the tool's axes, m.
pub fn tool_vertices(model: &Model) -> impl Iterator<Item = Vec3> + '_ {
    let frame = model.tool_frame.map(|frame| frame as u32);
    let proxies = model.proxies.iter().filter(move |proxy| Some(proxy.frame) == frame);
    let chunks = proxies.flat_map(|p| &model.chunks[p.chunk_first as usize..][..p.chunk_count as usize]);
    let vertices = chunks.flat_map(|c| &model.chunk_vertices[c.vertex_first as usize..][..c.vertex_count as usize]);
    vertices.map(|vertex| Vec3::from_slice(&model.skin_weights[*vertex as usize][..3]))
}

/// Radius of the ball about a rigid tool's centre that contains the whole tool, m; for a sphere its own radius.
pub(super) fn tool_radius(model: &Model) -> f64 {
    model.tool_sphere.unwrap_or_else(|| tool_vertices(model).map(|x| x.as_dvec3().length()).fold(0.0, f64::max))
}

impl Gap {
    /// Kernel and arrays for a model; `None` where [`parts`] finds no part.
    pub fn new(context: &Arc<Context>, model: &Model) -> Result<Option<Gap>> {
        let all = parts(model);
        let (Some(first), Some(tool_frame)) = (all.first(), model.tool_frame) else { return Ok(None) };
        let (chunk_first, chunk_count) = tool_chunks(model, first.pair);
        let is_round = model.tool_sphere.is_some();
        let sectors = if is_round { SECTORS } else { 1 };
        let constants = [
            ("RIGIDS", count(model.cores.len() + 1)),
            ("SPANS", Const::Bool(model.spans_frames())),
            ("SHARE", count(SHARE[usize::from(!is_round)])),
            ("ROUND", is_round.into()),
            ("RADIUS", Const::Float(model.tool_radius as f32)),
            ("REACH", Const::Float((RANGE + model.tool_sphere.unwrap_or(0.0)) as f32)),
            ("TOOL_FRAME", count(tool_frame)),
            ("TOOL_CHUNK_FIRST", chunk_first.into()),
            ("TOOL_CHUNKS", chunk_count.into()),
            ("SECTORS", count(sectors)),
            ("MARGIN", Const::Float(if is_round { MARGIN as f32 } else { 0.0 })),
        ];
        let found = (sectors * all.len() * size_of::<SkinGap>()) as u64;
        let of_part =
            |part: &PairPart| (0..sectors).map(|sector| (part.pair, sector == sectors / 2)).collect::<Vec<_>>();
        let entries = all.iter().flat_map(of_part).collect();
        let all: Vec<SkinPart> = all.iter().map(|part| part.part).collect();
        Ok(Some(Gap {
            kernel: Kernel::new(context, "wrench/gap", Size::Reduce, &constants)?,
            parts: upload(context, "parts", &all)?,
            entries,
            gaps: Buffer::new(context, "gaps", found, Memory::Readback)?,
        }))
    }

    /// Records one pass, which runs only where the step's solution is accepted and a haptic loop holds the tool. The
    /// pass overwrites the skin positions that the contact stage used, which are no longer needed, by positions at the
    /// end of the step.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, skins: &Skins, elastic: &Elastic, solve: &Solve) {
        recorder.stage("wrench");
        let Skins { pose, cull, skin } = skins;
        let arguments = shaders::wrench::Gap {
            params: &common.params,
            frames: &common.frames,
            solve: &solve.state,
            iterates: &solve.iterates,
            parts: &self.parts,
            proxies: &pose.proxies,
            chunks: &cull.chunks,
            proxy_nodes: &pose.proxy_nodes,
            chunk_nodes: &cull.chunk_nodes,
            chunk_vertices: &skin.chunk_vertices,
            chunk_triangles: Some(&skin.chunk_triangles),
            triangles: Some(&skin.triangles),
            skin_nodes: &skin.skin_nodes,
            skin_weights: &skin.skin_weights,
            node_rest: &elastic.node_rest,
            displacement: &elastic.displacement,
            node_info: &elastic.node_info,
            links: &common.links,
            skin: &skin.skin,
            gaps: &self.gaps,
        };
        recorder.dispatch_indirect(&self.kernel, &arguments, &common.args, shaders::ARGS_GAP);
    }
}
