//! Joints between frames: what is known of them before the first step, and how they put dynamic cores in order.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use glam::DVec3;

use super::model::{Core, Model};
use crate::scene::{self, Resistance};

/// How much stiffer a joint, or the end of what it allows, is than what it joins resists at the scene's step: what pushes the
/// two apart leaves a hundredth of the way it would push them in a step.
const STIFFNESS_RATIO: f64 = 100.0;

/// A ball joint.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Its two frames; the second turns about the first.
    pub frames: [usize; 2],
    /// The cores that they are; `None`: one that does not move by forces.
    pub cores: [Option<usize>; 2],
    /// From the frames' centres to it at rest, frame axes, m.
    pub arms: [DVec3; 2],
    /// What resists turning; the axis in frame axes.
    pub resistance: Resistance,
    /// What holds the two together, N/m.
    pub stiffness: f64,
    /// What holds the second within its limits, N m/rad.
    pub limit_stiffness: f64,
}

impl Model {
    /// Joints of a soft body, whose frames are in already and begin at `frame_first`.
    pub(super) fn add_joints(&mut self, joints: &[scene::Joint], frame_first: usize) {
        for joint in joints {
            let frames = joint.cores.map(|core| frame_first + core);
            let arms = frames.map(|frame| joint.point - self.frames[frame].rest_centre);
            let resistance = joint.resistance;
            let (stiffness, limit_stiffness) = (0.0, 0.0);
            self.joints.push(Joint { frames, cores: [None; 2], arms, resistance, stiffness, limit_stiffness });
        }
    }

    /// Puts cores that joints join next to each other, each after the one it hangs on.
    pub(super) fn group_cores(&mut self) {
        let core_of = |frame: usize| self.cores.iter().position(|core| core.frame == frame);
        let joined: Vec<[usize; 2]> = self
            .joints
            .iter()
            .filter_map(|joint| Some([core_of(joint.frames[0])?, core_of(joint.frames[1])?]))
            .collect();
        let mut order: Vec<(usize, Option<usize>, usize)> = Vec::new();
        for root in 0..self.cores.len() {
            if order.iter().any(|(core, ..)| *core == root) {
                continue;
            }
            let first = order.len();
            order.push((root, None, first));
            let mut next = first;
            while next < order.len() {
                let own = order[next].0;
                for other in joined.iter().filter_map(|[a, b]| (*a == own).then_some(*b).or((*b == own).then_some(*a)))
                {
                    if !order.iter().any(|(core, ..)| *core == other) {
                        order.push((other, Some(next), first));
                    }
                }
                next += 1;
            }
        }
        let place = |(core, parent, first): &(usize, Option<usize>, usize)| {
            let end = order.iter().rposition(|(.., other)| other == first).map_or(0, |last| last + 1);
            Core { group: *first..end, parent: *parent, ..self.cores[*core].clone() }
        };
        self.cores = order.iter().map(place).collect();
        for joint in &mut self.joints {
            joint.cores = joint.frames.map(|frame| self.cores.iter().position(|core| core.frame == frame));
        }
    }

    /// Chooses how stiff joints are in steps of `dt` seconds.
    pub(super) fn stiffen_joints(&mut self, dt: f64) {
        if self.joints.is_empty() {
            return;
        }
        let blocks: Vec<Mat<f64>> = self.cores.iter().map(|core| self.core_block(core, dt)).collect();
        // How readily a core is pushed at the joint, 1/kg, and turned, 1/(kg m^2), by mean over directions.
        let readiness = |core: usize, arm: DVec3| {
            let Ok(factor) = blocks[core].llt(Side::Lower) else { return [0.0; 2] };
            let mean = |six: &dyn Fn(DVec3) -> [f64; 6]| {
                let of = |axis: DVec3| {
                    let row = six(axis);
                    let column = Mat::from_fn(6, 1, |i, _| row[i]);
                    (column.transpose() * factor.solve(&column))[(0, 0)] / 3.0
                };
                DVec3::AXES.map(of).iter().sum::<f64>()
            };
            let push = |axis: DVec3| {
                let moment = arm.cross(axis);
                [axis.x, axis.y, axis.z, moment.x, moment.y, moment.z]
            };
            [mean(&push), mean(&|axis| [0.0, 0.0, 0.0, axis.x, axis.y, axis.z])]
        };
        let stiffness = |joint: &Joint| {
            let sides = joint.cores.iter().zip(&joint.arms);
            let both = sides.filter_map(|(core, arm)| core.map(|core| readiness(core, *arm)));
            let [along, about] = both.fold([0.0, 0.0], |sum, side| [sum[0] + side[0], sum[1] + side[1]]);
            [along, about].map(|readiness| STIFFNESS_RATIO / (readiness * dt * dt))
        };
        let all: Vec<[f64; 2]> = self.joints.iter().map(stiffness).collect();
        for (joint, [along, about]) in self.joints.iter_mut().zip(all) {
            (joint.stiffness, joint.limit_stiffness) = (along, about);
        }
    }

    /// Adds the joints at rest, in steps of `dt` seconds, to a matrix of cores' twists in frame axes; `first`: the first of
    /// a core's six, if it is among them.
    pub(super) fn add_springs(&self, matrix: &mut Mat<f64>, dt: f64, first: impl Fn(usize) -> Option<usize>) {
        for joint in &self.joints {
            let sides: Vec<(usize, f64, DVec3)> = joint
                .cores
                .iter()
                .zip([1.0, -1.0])
                .zip(joint.arms)
                .filter_map(|((core, sign), arm)| Some((core.and_then(&first)?, sign, arm)))
                .collect();
            let Resistance { stiffness, damping, .. } = joint.resistance;
            for axis in DVec3::AXES {
                let along = |(at, sign, arm): &(usize, f64, DVec3)| {
                    let six = axis.to_array().into_iter().chain(arm.cross(axis).to_array());
                    six.enumerate().map(|(k, x)| (at + k, sign * x)).collect::<Vec<_>>()
                };
                let about = |(at, sign, _): &(usize, f64, DVec3)| {
                    axis.to_array().into_iter().enumerate().map(|(k, x)| (at + 3 + k, sign * x)).collect::<Vec<_>>()
                };
                let row: Vec<(usize, f64)> = sides.iter().flat_map(along).collect();
                add_outer(matrix, &row, dt * dt * joint.stiffness);
                let row: Vec<(usize, f64)> = sides.iter().flat_map(about).collect();
                add_outer(matrix, &row, dt * (dt * stiffness + damping));
            }
        }
    }
}

/// Adds size row row^T.
fn add_outer(matrix: &mut Mat<f64>, row: &[(usize, f64)], size: f64) {
    for (i, x) in row {
        row.iter().for_each(|(j, y)| matrix[(*i, *j)] += size * x * y);
    }
}
