//! Pairs of bodies: fills the model (the scene's static arrays, made before the first step) with the pairs of bodies
//! that may touch, the stiffness of their contact, and the pairs of collision proxies (convex hulls that cover a body's
//! skin, its surface mesh) that culling tests. A pair proxy is one collision proxy in one pair of bodies. A skin vertex
//! gathers contacts if it is tested for contact with the other body.

use std::ops::Range;

use super::contact_law::{self, Law, Yielding};
use super::model::{Model, Plane};
use super::{samples as choice, tips};
use crate::prepare::{Body, FrameMotion, Shape};
use crate::scene::{Samples, Scene, Sides};
use crate::shaders::{NONE, Pair, PairProxy};
use crate::stages::{CHUNK_TRIANGLES, CHUNK_VERTICES};

impl Model {
    /// Adds every pair of bodies that may touch: each lists the other as one to collide with, or has no such list, and
    /// at least one of them can move. Of two tools that are bodies, one must list the other. The tool's own body, if there
    /// is one, is the last of `all`; `ranges`: the proxies of each body.
    pub(super) fn add_pairs(&mut self, scene: &Scene, all: &[&Body], has_tool: bool, ranges: &[Range<usize>]) {
        let tool = if has_tool { all.len() - 1 } else { all.len() };
        // Whether body i lists body j; `None` where it has no list.
        let listed = |i: usize, j: usize| {
            let name = if j == tool { "tool" } else { all[j].name.as_str() };
            let list = scene.bodies.get(i).and_then(|body| body.collides.as_ref())?;
            Some(list.iter().any(|n| n == name))
        };
        let mut tools: Vec<usize> = scene.tool_bodies().collect();
        tools.extend(has_tool.then_some(tool));
        let moves = |i: usize| match &all[i].shape {
            Shape::Soft { .. } | Shape::Rigid { motion: FrameMotion::Dynamic { .. }, .. } => true,
            _ => i == tool,
        };
        let is_plane = |i: usize| matches!(all[i].shape, Shape::Plane { .. });
        let yieldings: Vec<Option<Yielding>> = all.iter().map(|body| Yielding::of(body)).collect();
        for i in 0..all.len() {
            for j in i + 1..all.len() {
                let are_tools = tools.contains(&i) && tools.contains(&j);
                let may_touch = match (listed(i, j), listed(j, i)) {
                    (None, None) => !are_tools,
                    (one, other) => one != Some(false) && other != Some(false),
                };
                if !may_touch || !(moves(i) || moves(j)) {
                    continue;
                }
                let (a, b) = if is_plane(i) { (j, i) } else { (i, j) };
                let law = contact_law::parameters(scene, [yieldings[a], yieldings[b]], &yieldings);
                self.add_pair(all, (a, b), &tools, ranges, law, (scene.contact.sides, scene.contact.samples));
            }
        }
        self.stiffen_tips(all);
        self.add_pair_proxies();
    }

    /// Adds the pair proxies of all pairs of bodies, in the order of the pairs: first those whose vertices gather
    /// contacts, then the others.
    pub(super) fn add_pair_proxies(&mut self) {
        for gathering in [true, false] {
            for (index, pair) in self.pairs.iter_mut().enumerate() {
                for side in 0..2 {
                    let gathers = pair.lone_side == 0 || pair.lone_side == side as u32 + 1;
                    if gathers != gathering {
                        continue;
                    }
                    pair.first_pair_proxy[side] = self.pair_proxies.len() as u32;
                    for proxy in (pair.first_proxy[side]..).take(pair.proxy_count[side] as usize) {
                        let chunk_first = self.pair_proxy_chunks as u32;
                        self.pair_proxies.push(PairProxy { pair: index as u32, side: side as u32, proxy, chunk_first });
                        self.pair_proxy_chunks += self.proxies[proxy as usize].chunk_count as usize;
                    }
                }
            }
            if gathering {
                (self.gathering_pair_proxies, self.gathering_chunks) =
                    (self.pair_proxies.len(), self.pair_proxy_chunks);
            }
        }
        self.drop_unused_fans();
    }

    /// Removes from the model's lists the triangles around vertices that gather no contacts: normals are needed only at
    /// vertices that gather contacts.
    fn drop_unused_fans(&mut self) {
        let mut gathers = vec![false; self.skin_nodes.len()];
        for pair_proxy in &self.pair_proxies[..self.gathering_pair_proxies] {
            let proxy = &self.proxies[pair_proxy.proxy as usize];
            for chunk in &self.chunks[proxy.chunk_first as usize..][..proxy.chunk_count as usize] {
                let own = &self.chunk_vertices[chunk.vertex_first as usize..][..chunk.vertex_count as usize];
                own.iter().for_each(|vertex| gathers[*vertex as usize] = true);
            }
        }
        let (mut first, mut fans) = (vec![0], Vec::new());
        for (range, gathers) in self.fan_first.windows(2).zip(gathers) {
            if gathers {
                fans.extend(&self.fans[range[0] as usize..range[1] as usize]);
            }
            first.push(fans.len() as u32);
        }
        (self.fan_first, self.fans) = (first, fans);
    }

    /// Adds the pair of the bodies a and b. `tools`: indices of the bodies that are tools, the tool's own body among them.
    pub(super) fn add_pair(
        &mut self,
        all: &[&Body],
        (a, b): (usize, usize),
        tools: &[usize],
        ranges: &[Range<usize>],
        law: Law,
        (sides, samples): (Sides, Samples),
    ) {
        let plane = match all[b].shape {
            Shape::Plane { normal, offset } => Some(Plane { normal, offset }),
            _ => None,
        };
        let (a_proxies, b_proxies) = (ranges[a].clone(), ranges[b].clone());
        let first_proxy_pair = self.proxy_pairs.len() as u32;
        for p in a_proxies.clone() {
            self.proxy_pairs.extend(b_proxies.clone().map(|q| [p as u32, q as u32, 0, 0]));
        }
        let by_triangles = choice::side_by_triangles(samples, [all[a], all[b]]);
        let lone_side = match (by_triangles, sides) {
            (Some(side), _) => 1 + side as u32,
            (None, Sides::One) if plane.is_none() => 1 + u32::from(mean_area(all[b]) < mean_area(all[a])),
            _ => 0,
        };
        let kinematic_frame = |index: usize| match &all[index].shape {
            Shape::Rigid { motion: FrameMotion::Kinematic(_), .. } => self.body_frames[index],
            _ => NONE,
        };
        let tool = |index: usize| tools.iter().position(|&tool| tool == index).map_or(NONE, |at| at as u32);
        self.pairs.push(Pair {
            first_proxy_pair,
            proxy_pair_count: self.proxy_pairs.len() as u32 - first_proxy_pair,
            first_proxy: [a_proxies.start as u32, b_proxies.start as u32],
            proxy_count: [a_proxies.len() as u32, b_proxies.len() as u32],
            // The pair proxies are added once all pairs are known.
            first_pair_proxy: [0; 2],
            stiffness: law.stiffness as f32,
            damping: law.damping as f32,
            tool_sign: if tools.contains(&a) { 1.0 } else { -f32::from(u8::from(tools.contains(&b))) },
            tools: [tool(a), tool(b)],
            is_plane: u32::from(plane.is_some()),
            kinematic_frame: [kinematic_frame(a), kinematic_frame(b)],
            lone_side,
            by_triangles: u32::from(by_triangles.is_some()),
            stiffens_tips: law.stiffens_tips[0].into(),
            damps_tips: law.stiffens_tips[1].into(),
            direction: [0.0; 4],
            plane: [0.0; 4],
        });
        self.pair_planes.push(plane);
        self.pair_bodies.push([a, b]);
        self.pair_softer.push(law.softer);
    }

    /// Sets the stiffening of the triangles of each rigid body that a soft body's triangles are tested against. Of
    /// several such soft bodies, the one with the smallest cells counts.
    fn stiffen_tips(&mut self, all: &[&Body]) {
        let mut cells = vec![f64::INFINITY; all.len()];
        for (pair, bodies) in self.pairs.iter().zip(&self.pair_bodies).filter(|(pair, _)| pair.by_triangles != 0) {
            let [own, other] = [0, 1].map(|k| bodies[(pair.lone_side as usize - 1) ^ k]);
            if let Shape::Soft { layer, .. } = &all[own].shape {
                cells[other] = cells[other].min(contact_law::mean_edge(layer));
            }
        }
        let mut first = 0;
        for (body, cell) in all.iter().zip(cells) {
            let (Shape::Soft { skin, .. } | Shape::Rigid { skin, .. }) = &body.shape else { continue };
            if cell.is_finite() {
                for (triangle, stiffening) in self.triangles[first..].iter_mut().zip(tips::stiffening(skin, cell)) {
                    triangle[3] = stiffening.to_bits();
                }
            }
            first += skin.triangles.len();
        }
    }

    /// Whether any two skins may meet; all other pairs are those of a skin and a half-space.
    pub fn has_skin_pairs(&self) -> bool {
        self.pairs.iter().any(|pair| pair.is_plane == 0)
    }

    /// Whether any pair needs the depth stage, which casts rays from vertices of one skin to triangles of another.
    pub fn needs_depth(&self) -> bool {
        self.pairs.iter().any(|pair| pair.is_plane == 0 && pair.by_triangles == 0)
    }

    /// Whether the contacts of any pair are found by triangles.
    pub fn needs_overlaps(&self) -> bool {
        self.pairs.iter().any(|pair| pair.by_triangles != 0)
    }

    /// Number of places for candidates that an active chunk has: one for each vertex, or for each triangle where
    /// triangles are tested for contact.
    pub fn slots(&self) -> usize {
        if self.needs_overlaps() { CHUNK_TRIANGLES } else { CHUNK_VERTICES }
    }
}

/// Mean skin area per vertex of a body, m^2. Where the vertices of only one body of a pair gather contacts, that is the
/// body with the finer skin (less area per vertex), since its vertices resolve the contact better; where both skins are
/// equally fine, it is the first body.
fn mean_area(body: &Body) -> f64 {
    match &body.shape {
        Shape::Soft { skin, .. } | Shape::Rigid { skin, .. } => {
            skin.areas.iter().sum::<f64>() / skin.areas.len().max(1) as f64
        }
        Shape::Plane { .. } => f64::INFINITY,
    }
}
