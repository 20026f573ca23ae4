//! Extracts the zero surface of a solid (a signed distance function) as a triangle mesh, by marching tetrahedra over a
//! body-centred cubic lattice, then smooths the mesh while its vertices stay on the zero surface.
//!
//! Marching tetrahedra (A. Doi and A. Koide 1991) always give a closed manifold, because the linear interpolant in a
//! tetrahedron has no ambiguous case.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use super::solid::gradient;
use crate::prepare::lattice::Lattice;
use crate::prepare::layer::FACES;

/// Step of the numerical gradient, m: far smaller than any feature of a solid, far larger than rounding errors.
const GRADIENT_STEP: f64 = 1e-5;
/// Number of Newton iterations that bring a vertex onto the surface. The solids are nearly distance functions, so after
/// three iterations the vertex is off the surface by less than a thousandth of the mesh's edge length.
const NEWTON_STEPS: usize = 3;

/// Orders of a tetrahedron's nodes (two inside the solid, then two outside), each an even permutation.
const PAIRS: [[usize; 4]; 6] = [[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 2, 0], [2, 3, 0, 1]];

/// The closed surface, oriented outwards, of a solid within the box `low..high`, from a lattice with cell edge `cell`
/// (all m). It is the connected piece that a ray from the point `inside` along x meets first. Vertices are numbered in
/// lattice order.
///
/// Only cells at the surface and their neighbours are visited: the search spreads from cell to neighbouring cell (B.
/// Wyvill and others 1986).
pub fn surface(
    solid: &impl Fn(DVec3) -> f64,
    [low, high]: [DVec3; 2],
    inside: DVec3,
    cell: f64,
) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut field = Field { solid, lattice: Lattice::around(low, high - low, cell), values: HashMap::new() };
    let cells = field.crossed(inside);
    let tetrahedra: Vec<[u32; 4]> = cells.into_iter().flat_map(|cell| field.tetrahedra(cell)).collect();
    let mut vertices = Vec::new();
    // The map is only looked up and never iterated, so that the numbering does not depend on hashing.
    let mut numbers: HashMap<(u32, u32), u32> = HashMap::new();
    let mut triangles = Vec::new();
    for nodes in tetrahedra {
        let values = nodes.map(|n| field.value(n));
        let inside = values.map(|v| v < 0.0);
        let mut cross = |i: usize, j: usize| {
            let (i, j) = if nodes[i] < nodes[j] { (i, j) } else { (j, i) };
            *numbers.entry((nodes[i], nodes[j])).or_insert_with(|| {
                let t = values[i] / (values[i] - values[j]);
                vertices.push(field.lattice.position(nodes[i]) * (1.0 - t) + field.lattice.position(nodes[j]) * t);
                vertices.len() as u32 - 1
            })
        };
        match inside.iter().filter(|&&i| i).count() {
            count @ (1 | 3) => {
                let odd = (0..4).find(|&k| inside[k] == (count == 1)).unwrap_or(0);
                let [a, b, c] = FACES[odd].map(|k| cross(odd, k));
                triangles.push(if count == 1 { [a, b, c] } else { [a, c, b] });
            }
            2 => {
                if let Some([i, j, k, l]) = PAIRS.into_iter().find(|p| inside[p[0]] && inside[p[1]]) {
                    let (ik, il, jl, jk) = (cross(i, k), cross(i, l), cross(j, l), cross(j, k));
                    triangles.extend([[ik, il, jl], [ik, jl, jk]]);
                }
            }
            _ => {}
        }
    }
    (vertices, triangles)
}

/// The solid's values at the lattice's nodes, evaluated when they are needed.
struct Field<'a, S> {
    solid: &'a S,
    lattice: Lattice,
    /// Values by node; the map is only looked up and never iterated.
    values: HashMap<u32, f64>,
}

impl<S: Fn(DVec3) -> f64> Field<'_, S> {
    fn value(&mut self, node: u32) -> f64 {
        let at = || (self.solid)(self.lattice.position(node));
        *self.values.entry(node).or_insert_with(at)
    }

    fn tetrahedra(&self, cell: [usize; 3]) -> Vec<[u32; 4]> {
        let mut tetrahedra = Vec::with_capacity(12);
        (0..3).for_each(|axis| tetrahedra.extend(self.lattice.on_face(cell, axis)));
        tetrahedra
    }

    fn crosses(&mut self, cell: [usize; 3]) -> bool {
        self.tetrahedra(cell).into_iter().any(|nodes| {
            let first = self.value(nodes[0]) < 0.0;
            nodes[1..].iter().any(|&n| (self.value(n) < 0.0) != first)
        })
    }

    /// The cells that one connected piece of the surface passes, in lattice order: the piece that a ray from `inside`
    /// along x meets first.
    fn crossed(&mut self, inside: DVec3) -> Vec<[usize; 3]> {
        let [x, y, z] = self.lattice.cell_at(inside);
        let last = self.lattice.size().map(|s| s - 1);
        let mut queue: Vec<_> = (x..=last[0]).map(|x| [x, y, z]).find(|&c| self.crosses(c)).into_iter().collect();
        let mut seen: HashSet<[usize; 3]> = queue.iter().copied().collect();
        let mut found = Vec::new();
        while let Some(cell) = queue.pop() {
            if !self.crosses(cell) {
                continue;
            }
            found.push(cell);
            let [xs, ys, zs] = [0, 1, 2].map(|k| cell[k].saturating_sub(1)..=(cell[k] + 1).min(last[k]));
            for z in zs {
                for y in ys.clone() {
                    queue.extend(xs.clone().map(|x| [x, y, z]).filter(|&near| seen.insert(near)));
                }
            }
        }
        found.sort_unstable_by_key(|&[x, y, z]| [z, y, x]);
        found
    }
}

/// Moves every vertex along the surface, halfway towards the mean of its neighbours, and projects the vertex back onto
/// the surface. This is done `rounds` times.
pub fn smooth(solid: &impl Fn(DVec3) -> f64, vertices: &mut Vec<DVec3>, triangles: &[[u32; 3]], rounds: usize) {
    for _ in 0..rounds {
        // On a closed surface each directed edge occurs in one triangle, so the sums count each neighbour once.
        let mut sums = vec![(DVec3::ZERO, 0.0); vertices.len()];
        for t in triangles {
            for k in 0..3 {
                let sum = &mut sums[t[k] as usize];
                sum.0 += vertices[t[(k + 1) % 3] as usize];
                sum.1 += 1.0;
            }
        }
        let moved = vertices.iter().zip(&sums).map(|(&v, &(sum, count))| {
            let step = 0.5 * (sum / f64::max(count, 1.0) - v);
            onto(solid, v, step)
        });
        *vertices = moved.collect();
    }
}

/// Moves a point by the tangential part of `step`, then onto the surface by Newton's method. All iterations use the
/// gradient at the start, because a gradient costs six evaluations and changes little over a step. The distance that an
/// iteration moves the point is limited, because it could be far too long at a crease.
fn onto(solid: &impl Fn(DVec3) -> f64, from: DVec3, step: DVec3) -> DVec3 {
    let slope = gradient(solid, from, GRADIENT_STEP);
    let steepness = slope.length_squared().max(0.1);
    let mut p = from + step - slope * (slope.dot(step) / steepness);
    for _ in 0..NEWTON_STEPS {
        p -= (solid(p) / steepness * slope).clamp_length_max(step.length());
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{mass, skin};

    #[test]
    fn a_ball_is_extracted_closed_outward_and_projected() {
        let ball = |p: DVec3| p.length() - 0.1;
        let (mut vertices, triangles) = surface(&ball, [DVec3::splat(-0.1), DVec3::splat(0.1)], DVec3::ZERO, 0.02);
        smooth(&ball, &mut vertices, &triangles, 3);
        assert_eq!(vertices.len() + triangles.len() - 3 * triangles.len() / 2, 2);
        assert!(vertices.iter().all(|v| (v.length() - 0.1).abs() < 1e-5));
        let skin = skin::build(vertices, triangles);
        assert_eq!(skin::defects(&skin.triangles), (0, 0));
        let volume = mass::properties(&skin.vertices, &skin.triangles).volume;
        let whole = 4.0 / 3.0 * std::f64::consts::PI * 1e-3;
        assert!(
            volume > 0.97 * whole && volume < whole,
            "volume of the extracted ball {volume} m^3, of the exact ball {whole} m^3"
        );
    }
}
