//! Keeps a rigid tool from tunnelling, that is, from passing through a body between two searches for contact. Contact is
//! searched for at the start of a step, so a tool that moves further than its own extent may come out behind a thin body
//! without a contact. A step in which that could happen is done in several shorter ones; if the tool still moves too far
//! in one of these, a flag says so.

use glam::DVec3;

use crate::stages::model::Model;
use crate::step::tool::Tool;

/// Greatest displacement of the tool in a part of a step, as a share of the tool's extent along it. Then most of the tool is
/// still in front of a sheet when contact with it is found.
const SHARE: f64 = 1.0 / 3.0;
/// Greatest number of parts of a step; in a haptic loop, where each part costs real time, and otherwise.
const MOST_PARTS: [u32; 2] = [4, 16];
/// How far a body may reach from its frame's centre when it is deformed, in units of how far it reaches at rest.
const STRETCH: f64 = 1.5;

/// The shapes by which [`Passing::parts`] decides.
pub(super) struct Passing {
    /// Vertices of the tool's hulls, in tool axes, relative to its centre, m.
    hull: Vec<DVec3>,
    /// Radius of the ball about the tool's centre that contains the tool, m.
    radius: f64,
    /// Frames of the bodies that the tool may touch, each with how far its skin may reach from the frame's centre, m.
    reaches: Vec<(usize, f64)>,
}

impl Passing {
    /// `None` without a rigid tool, or where it can touch nothing but half-spaces, which nothing can pass through.
    pub(super) fn new(model: &Model) -> Option<Passing> {
        let tool_frame = model.tool_frame? as u32;
        let hull_of = |proxy: &crate::shaders::Proxy| {
            let own = proxy.hull_first as usize..(proxy.hull_first + proxy.hull_count) as usize;
            model.hull[own].iter().map(|[x, y, z, _]| DVec3::new((*x).into(), (*y).into(), (*z).into()))
        };
        let hull: Vec<DVec3> = model.proxies.iter().filter(|p| p.frame == tool_frame).flat_map(hull_of).collect();
        let mut reaches: Vec<(usize, f64)> = Vec::new();
        for pair in model.pairs.iter().filter(|pair| pair.is_plane == 0) {
            let side = |k: usize| &model.proxies[pair.first_proxy[k] as usize..][..pair.proxy_count[k] as usize];
            let is_tool = |k: usize| side(k).iter().any(|proxy| proxy.frame == tool_frame);
            let Some(tool_side) = (0..2).find(|k| is_tool(*k)) else { continue };
            for proxy in side(1 - tool_side) {
                let reach = hull_of(proxy).map(|x| x.length()).fold(0.0, f64::max) + f64::from(proxy.margin);
                match reaches.iter_mut().find(|(frame, _)| *frame == proxy.frame as usize) {
                    Some((_, known)) => *known = known.max(STRETCH * reach),
                    None => reaches.push((proxy.frame as usize, STRETCH * reach)),
                }
            }
        }
        (!hull.is_empty() && !reaches.is_empty()).then_some(Passing { hull, radius: model.tool_radius, reaches })
    }

    /// Number of parts in which a step is to be done that moves the tool by about `displacement` (m, world axes). `centre` gives
    /// the world position of a frame's centre; `in_loop`: whether the step is one of a haptic loop.
    pub(super) fn parts(
        &self,
        tool: &Tool,
        displacement: DVec3,
        in_loop: bool,
        centre: impl Fn(usize) -> DVec3,
    ) -> u32 {
        let ratio = self.ratio(tool, displacement);
        // NaN counts as no displacement: the step itself reports it.
        if ratio.is_nan() || ratio <= SHARE || !self.is_near(tool.centre, displacement, centre) {
            return 1;
        }
        (ratio / SHARE).ceil().min(f64::from(MOST_PARTS[usize::from(!in_loop)])) as u32
    }

    /// Whether the tool, which moved by `displacement` (m) to where it is now, may have passed through a body.
    pub(super) fn may_have_passed(&self, tool: &Tool, displacement: DVec3, centre: impl Fn(usize) -> DVec3) -> bool {
        self.ratio(tool, displacement) > 1.0 && self.is_near(tool.centre, -displacement, centre)
    }

    /// The length of a displacement, in units of the tool's extent along it.
    fn ratio(&self, tool: &Tool, displacement: DVec3) -> f64 {
        let Some(along) = (tool.orientation.conjugate() * displacement).try_normalize() else { return 0.0 };
        let (low, high) = self.hull.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            let height = x.dot(along);
            (low.min(height), high.max(height))
        });
        // A hull that is flat has no extent along its normal.
        displacement.length() / (high - low).max(1e-3 * self.radius)
    }

    /// Whether a tool that moves by `displacement` from `start` may meet a body.
    fn is_near(&self, start: DVec3, displacement: DVec3, centre: impl Fn(usize) -> DVec3) -> bool {
        self.reaches.iter().any(|(frame, reach)| {
            let from = centre(*frame) - start;
            let share = (from.dot(displacement) / displacement.length_squared()).clamp(0.0, 1.0);
            from.distance(share * displacement) < reach + self.radius
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};

    use super::*;

    fn tool(turn: DQuat) -> Tool {
        Tool {
            mass: 1.0,
            inertia: DMat3::IDENTITY,
            coupling: None,
            centre: DVec3::ZERO,
            orientation: turn,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
        }
    }

    #[test]
    fn a_step_is_divided_by_the_extent_along_the_way_and_only_near_a_body() {
        // A plate of 1 mm, 60 mm wide.
        let corners = [-1.0, 1.0].map(|y| [-1.0, 1.0].map(|x| DVec3::new(0.03 * x, 0.0005 * y, 0.0)));
        let hull: Vec<DVec3> = corners.concat();
        let passing = Passing { radius: 0.03, hull, reaches: vec![(0, 0.1)] };
        let flat = tool(DQuat::IDENTITY);
        let at = |y: f64| move |_| y * DVec3::Y;
        assert_eq!(passing.parts(&flat, 0.0003 * DVec3::Y, false, at(0.0)), 1);
        assert_eq!(passing.parts(&flat, 0.0019 * DVec3::NEG_Y, false, at(0.0)), 6);
        assert_eq!(passing.parts(&flat, 0.0019 * DVec3::NEG_Y, true, at(0.0)), 4);
        assert_eq!(passing.parts(&flat, 0.1 * DVec3::NEG_Y, false, at(0.0)), MOST_PARTS[1]);
        assert_eq!(passing.parts(&flat, 0.0019 * DVec3::X, false, at(0.0)), 1);
        let on_edge = tool(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2));
        assert_eq!(passing.parts(&on_edge, 0.0019 * DVec3::Y, false, at(0.0)), 1);
        assert_eq!(passing.parts(&flat, 0.0019 * DVec3::NEG_Y, false, at(0.2)), 1);
        // Towards the body, which is then near at the end of the displacement.
        assert_eq!(passing.parts(&flat, 0.1 * DVec3::Y, false, at(0.2)), MOST_PARTS[1]);
        assert!(passing.may_have_passed(&flat, 0.0011 * DVec3::Y, at(0.0)));
        assert!(!passing.may_have_passed(&flat, 0.0009 * DVec3::Y, at(0.0)));
        assert!(!passing.may_have_passed(&flat, 0.0011 * DVec3::Y, at(0.2)));
        assert_eq!(passing.parts(&flat, DVec3::ZERO, false, at(0.0)), 1);
    }
}
