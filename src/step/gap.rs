//! The gap between the tool (the rigid body that the haptic device leads) and the nearest body, at the end of a step of
//! the haptic loop: the shortest of the gaps to skins (surface meshes), which the GPU found, and to half-spaces.

use glam::DVec3;

use super::Simulation;
use crate::Result;
use crate::shaders::{GAP_FAR, NONE, Report, SkinGap};
use crate::stages::gap;
use crate::step::{Flags, Gap};

/// Depth of first contact, m: the tool's bounding sphere, of radius R, is taken to touch an area of 2 pi R times this
/// depth.
const FIRST_TOUCH: f64 = 1e-3;
/// Skin that faces away from the tool counts as nearer than skin that faces it only if it is nearer by more than this
/// fraction, since distances to an edge that two triangles share differ by rounding.
const ROUNDING: f64 = 1e-5;

impl Simulation {
    /// Stores the gap with the last step's contact wrench, where a haptic loop holds the tool and the tool touches
    /// nothing.
    pub(super) fn add_gap(&mut self, report: &Report) -> Result<()> {
        // The GPU searches for a gap only in a haptic loop, in which the tool has no weight, and not in a frozen step,
        // in which no attempt succeeded.
        let is_known = self.is_in_haptic_loop() && !Flags(report.flags).contains(Flags::FROZEN);
        let touches = self.last_wrench.is_some_and(|w| w.pressing > 0.0 || w.wrench.force != DVec3::ZERO);
        if is_known && !touches {
            let gap = self.gap()?;
            if let Some(wrench) = &mut self.last_wrench {
                wrench.gap = gap;
            }
        }
        Ok(())
    }

    /// The shortest gap to any body; `None` where the tool is a body of the scene, where it lies within a body, or
    /// where nothing is near.
    fn gap(&self) -> Result<Option<Gap>> {
        let model = &self.model;
        if model.tool_frame.is_none() {
            return Ok(None);
        }
        let (is_within, mut shortest) = self.skin_gap()?;
        if is_within {
            return Ok(None);
        }
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
            if shortest.is_none_or(|known| distance < known.distance) {
                shortest = self.within_range(index, plane.normal, distance).or(shortest);
            }
        }
        Ok(shortest)
    }

    /// Whether the tool is within a body (a sphere by its centre, another tool by any point of its surface); if not,
    /// the shortest gap to a skin.
    fn skin_gap(&self) -> Result<(bool, Option<Gap>)> {
        let Some(stage) = &self.stages.gap else { return Ok((false, None)) };
        let found = stage.gaps.mapped::<SkinGap>()?;
        let back = found.iter().map(|gap| f64::from(gap.back)).fold(f64::INFINITY, f64::min);
        let ways = found.iter().zip(&stage.pairs).filter(|(gap, _)| gap.triangle != NONE).map(|(gap, pair)| {
            let along = DVec3::from(gap.way.map(f64::from));
            (along, along.length(), gap.triangle, *pair)
        });
        // Where several triangles are equally near to the tool, the one with the lowest index counts.
        let shortest = ways.min_by(|(_, a, t, _), (_, b, u, _)| a.total_cmp(b).then(t.cmp(u)));
        if back < (1.0 - ROUNDING) * shortest.map_or(f64::from(GAP_FAR), |way| way.1) {
            return Ok((true, None));
        }
        let radius = self.model.tool_sphere.unwrap_or(0.0);
        let gap = shortest.and_then(|(along, length, _, pair)| {
            along.try_normalize().and_then(|along| self.within_range(pair, -along, length - radius))
        });
        Ok((false, gap))
    }

    /// A gap of this distance (m), or `None` where the distance is beyond the range of the search. The distance is
    /// negative where, in a step that began without contact, a spherical tool came into contact, or any tool came into
    /// contact with a half-space. The gap's stiffness is the pair's contact stiffness times the area over which a
    /// sphere of the tool's radius touches at first; its compliance is that of a half-space under a rigid cylinder of
    /// the tool's radius R, 1 / (2 E* R) with the softer body's plane strain modulus E* (K. Johnson, "Contact
    /// Mechanics", 1985, section 3.4). On a thick body a sphere's area of contact is smaller, and the body yields more; a
    /// thin layer, or one of coarse cells, may yield less.
    fn within_range(&self, pair: usize, normal: DVec3, distance: f64) -> Option<Gap> {
        let area = 2.0 * std::f64::consts::PI * self.model.tool_radius * FIRST_TOUCH;
        let stiffness = f64::from(self.model.pairs[pair].stiffness) * area;
        let compliance = 0.5 / (self.model.pair_moduli[pair] * self.model.tool_radius);
        (distance <= gap::RANGE).then_some(Gap { normal, distance, stiffness, compliance, pair: pair as u32 })
    }
}
