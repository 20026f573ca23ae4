//! The gaps between the tool (the rigid body that the haptic device leads) and the bodies near it, at the end of a step of
//! the haptic loop: to skins (surface meshes), which the GPU found, and to half-spaces. Besides the shortest those in other
//! directions count, since what the tool meets first depends on the way that it goes.

use glam::DVec3;

use super::Simulation;
use crate::Result;
use crate::shaders::{GAP_FAR, NONE, Report, SkinGap};
use crate::stages::gap;
use crate::step::{FARTHER, Flags, Gap};

/// Depth of the first touch between triangles, m.
const FIRST_TOUCH: f64 = 5e-4;
/// Skin that faces away from the tool counts as nearer than skin that faces it only if it is nearer by more than this
/// fraction, since distances to an edge that two triangles share differ by rounding.
const ROUNDING: f64 = 1e-5;
/// Gaps are told apart by the cosine of the angle between their normals: at most this (23 degrees). The angle is wider
/// than that by which a way may differ from its triangle's normal, so that a flat skin has one gap.
const APART: f64 = 0.92;

impl Simulation {
    /// Stores the gap with the last step's contact wrench, where a haptic loop holds the tool and the tool touches
    /// nothing.
    pub(super) fn add_gap(&mut self, report: &Report) -> Result<()> {
        // The GPU searches for a gap only in a haptic loop, in which the tool has no weight, and not in a frozen step,
        // in which no attempt succeeded.
        let is_known = self.is_in_haptic_loop() && !Flags(report.flags).contains(Flags::FROZEN);
        let touches = self.last_wrench.is_some_and(|w| w.pressing > 0.0 || w.wrench.force != DVec3::ZERO);
        if is_known && !touches {
            let gaps = self.gaps()?;
            if let Some(wrench) = &mut self.last_wrench {
                let mut gaps = gaps.into_iter();
                wrench.gap = gaps.next();
                wrench.farther = std::array::from_fn(|_| gaps.next());
            }
        }
        Ok(())
    }

    /// The gaps to bodies, the shortest first; none where the tool is a body of the scene, where it lies within a body,
    /// or where nothing is near.
    fn gaps(&self) -> Result<Vec<Gap>> {
        let model = &self.model;
        if model.tool_frame.is_none() {
            return Ok(Vec::new());
        }
        let (is_within, nearest, mut others) = self.skin_gaps()?;
        if is_within {
            return Ok(Vec::new());
        }
        let mut nearest = Vec::from_iter(nearest);
        for (index, plane) in model.pair_planes.iter().enumerate().filter(|(i, _)| model.pairs[*i].tool_sign != 0.0) {
            let (Some(plane), Some(tool)) = (plane, &self.tool) else { continue };
            let lowest = match model.tool_sphere {
                Some(radius) => -radius,
                None => {
                    let normal = tool.orientation.inverse() * plane.normal;
                    gap::tool_vertices(model).map(|x| normal.dot(x.as_dvec3())).fold(f64::INFINITY, f64::min)
                }
            };
            let distance = plane.normal.dot(tool.centre) - plane.offset + lowest;
            nearest.extend(self.within_range(index, plane.normal, distance));
        }
        nearest.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        others.extend(nearest.iter().skip(1));
        others.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        Ok(told_apart(nearest.into_iter().take(1).chain(others)))
    }

    /// Whether the tool is within a body (a sphere by its centre, another tool by any point of its surface); if not, the
    /// shortest gap to a skin, and the gaps to planes of the skins in other directions, which may be shorter than that: a
    /// bump of the skin ends before its planes do.
    fn skin_gaps(&self) -> Result<(bool, Option<Gap>, Vec<Gap>)> {
        let Some(stage) = &self.stages.gap else { return Ok((false, None, Vec::new())) };
        let found = stage.gaps.mapped::<SkinGap>()?;
        let back = found.iter().map(|gap| f64::from(gap.back)).fold(f64::INFINITY, f64::min);
        let ways = found.iter().zip(&stage.entries).filter(|(gap, _)| gap.triangle != NONE);
        let ways = ways.map(|(gap, entry)| (DVec3::from(gap.way.map(f64::from)), gap.triangle, *entry));
        let (of_parts, of_planes): (Vec<_>, Vec<_>) = ways.partition(|(_, _, (_, is_shortest))| *is_shortest);
        // Where several triangles are equally near to the tool, the one with the lowest index counts.
        let shortest =
            of_parts.into_iter().min_by(|(a, t, _), (b, u, _)| a.length().total_cmp(&b.length()).then(t.cmp(u)));
        if back < (1.0 - ROUNDING) * shortest.map_or(f64::from(GAP_FAR), |(along, ..)| along.length()) {
            return Ok((true, None, Vec::new()));
        }
        let radius = self.model.tool_sphere.unwrap_or(0.0);
        let gap = |(along, _, (pair, _)): (DVec3, u32, (usize, bool))| {
            self.within_range(pair, -along.try_normalize()?, along.length() - radius)
        };
        Ok((false, shortest.and_then(gap), of_planes.into_iter().filter_map(gap).collect()))
    }

    /// A gap of this distance (m), or `None` where the distance is beyond the range of the search. The distance is
    /// negative where, in a step that began without contact, a spherical tool came into contact, or any tool came into
    /// contact with a half-space. The law of contact is that of a sphere of the tool's radius R that goes into a plane
    /// by a depth d, where the pressure is kappa, the pair's contact stiffness, times the depth at each point: the
    /// force is pi kappa R d^2. Triangles touch over an area at once, which counts like the cap of the sphere at the depth
    /// FIRST_TOUCH. The compliance is what such a sphere finds on the softer body.
    fn within_range(&self, pair: usize, normal: DVec3, distance: f64) -> Option<Gap> {
        let steepness = std::f64::consts::PI * self.model.tool_radius * f64::from(self.model.pairs[pair].stiffness);
        let stiffness = 2.0 * FIRST_TOUCH * steepness;
        let softer = self.model.pair_softer[pair];
        let compliance = softer.map_or(0.0, |softer| softer.compliance(self.model.tool_radius));
        let retardation = softer.map_or(0.0, |softer| softer.retardation);
        let gap = Gap { normal, distance, stiffness, steepness, compliance, retardation, pair: pair as u32 };
        (distance <= gap::RANGE).then_some(gap)
    }
}

/// The first of some gaps, and those in other directions than the ones before them.
fn told_apart(gaps: impl Iterator<Item = Gap>) -> Vec<Gap> {
    let mut kept: Vec<Gap> = Vec::new();
    for gap in gaps {
        if kept.len() <= FARTHER && kept.iter().all(|other| other.normal.dot(gap.normal) <= APART) {
            kept.push(gap);
        }
    }
    kept
}
