//! Ball joints between the cores of soft bodies (rigid bodies inside a soft one, to which nodes are attached): their
//! constants, which are known before the first step, and the trees that joints make of the dynamic cores (cores that
//! forces move). Each core has a rigid coordinate frame.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use glam::DVec3;

use super::model::{Core, Model};
use crate::scene::{self, Resistance};

/// How many times as stiff a joint, or a limit of its range, is as the cores that it joins, in one step of the scene: a
/// load that would move the unjoined cores apart by some distance in a step opens the joint by a hundredth of that
/// distance.
const STIFFNESS_RATIO: f64 = 100.0;

/// A ball joint between two cores of a soft body.
#[derive(Debug, Clone)]
pub struct Joint {
    /// The frames of the two cores; springs and limits resist the rotation of the second frame relative to the first.
    pub frames: [usize; 2],
    /// The dynamic cores of these frames; `None` for a core that forces do not move.
    pub cores: [Option<usize>; 2],
    /// From the centre of each frame to the joint at rest, frame axes, m.
    pub arms: [DVec3; 2],
    /// Springs, damping and limits that resist rotation; their axis is given at rest, where both frames have the same
    /// axes.
    pub resistance: Resistance,
    /// Stiffness of the spring that holds the two cores together at the joint, N/m.
    pub stiffness: f64,
    /// Stiffness of the springs that push the second frame back within its limits, N m/rad: first for the swing (angle
    /// between the joint's axis in the one and in the other frame), then for the twist (rotation about that axis).
    pub limit_stiffness: [f64; 2],
}

impl Model {
    /// Adds the joints of a soft body whose frames have been added already, from index `frame_first` on.
    pub(super) fn add_joints(&mut self, joints: &[scene::Joint], frame_first: usize) {
        for joint in joints {
            let frames = joint.cores.map(|core| frame_first + core);
            let arms = frames.map(|frame| joint.point - self.frames[frame].rest_centre);
            let resistance = joint.resistance;
            let (stiffness, limit_stiffness) = (0.0, [0.0; 2]);
            self.joints.push(Joint { frames, cores: [None; 2], arms, resistance, stiffness, limit_stiffness });
        }
    }

    /// Sorts the dynamic cores so that those connected by joints are consecutive (a group), each after its parent in
    /// the tree of joints.
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

    /// Chooses the stiffness of all joints for steps of `dt` seconds.
    pub(super) fn stiffen_joints(&mut self, dt: f64) {
        if self.joints.is_empty() {
            return;
        }
        let blocks: Vec<Mat<f64>> = self.cores.iter().map(|core| self.core_block(core, dt)).collect();
        // Compliance of the two cores of a joint: the relative velocity along a direction that a unit impulse between
        // the cores causes at the joint (1/kg), or the relative angular velocity about an axis that a unit angular
        // impulse between them causes (1/(kg m^2)).
        let readiness = |joint: &Joint, along: DVec3, about: DVec3| -> f64 {
            let side = |(core, arm): (&Option<usize>, &DVec3)| {
                let Some(core) = *core else { return 0.0 };
                let turn = about + arm.cross(along);
                let six = [along.x, along.y, along.z, turn.x, turn.y, turn.z];
                let hinge = self.frames[self.cores[core].frame].orientation.conjugate() * self.cores[core].hinge;
                answer(&blocks[core], hinge, six)
            };
            joint.cores.iter().zip(&joint.arms).map(side).sum()
        };
        let stiffness = |joint: &Joint| {
            let axis = joint.resistance.axis;
            let all = |of: &dyn Fn(DVec3) -> f64| DVec3::AXES.map(of).iter().sum::<f64>();
            let apart = all(&|d| readiness(joint, d, DVec3::ZERO)) / 3.0;
            let twist = readiness(joint, DVec3::ZERO, axis);
            let swing = (all(&|d| readiness(joint, DVec3::ZERO, d)) - twist) / 2.0;
            // Cores that cannot move apart need no spring.
            [apart, swing, twist].map(|r| if r > 0.0 { STIFFNESS_RATIO / (r * dt * dt) } else { 0.0 })
        };
        let all: Vec<[f64; 3]> = self.joints.iter().map(stiffness).collect();
        for (joint, [apart, swing, twist]) in self.joints.iter_mut().zip(all) {
            (joint.stiffness, joint.limit_stiffness) = (apart, [swing, twist]);
        }
    }

    /// Adds the springs and dampers of the joints at rest, for steps of `dt` seconds, to a matrix that acts on the
    /// twists (linear and angular velocity) of cores in the axes of their frames. `first`: index of the first of a
    /// core's six rows, `None` where the matrix does not contain the core.
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

/// Compliance of a core in the direction `row` of its twist: row^T block^-1 row, where `block` is the core's 6x6
/// diagonal block of the solver's matrix. Where the core is on a hinge with axis `hinge` (zero without a hinge), only
/// rotation about that axis counts.
fn answer(block: &Mat<f64>, hinge: DVec3, row: [f64; 6]) -> f64 {
    let angular = |i: usize, k: usize| hinge[i] * block[(3 + i, 3 + k)] * hinge[k];
    let spin = DVec3::from_slice(&row[3..]).dot(hinge).powi(2);
    let alone = || (0..3).flat_map(|i| (0..3).map(move |k| (i, k))).map(|(i, k)| angular(i, k)).sum::<f64>();
    if hinge != DVec3::ZERO {
        return spin / alone();
    }
    let column = Mat::from_fn(6, 1, |i, _| row[i]);
    block.llt(Side::Lower).map_or(0.0, |factor| (column.transpose() * factor.solve(&column))[(0, 0)])
}

/// Adds `size` times row row^T to the matrix.
fn add_outer(matrix: &mut Mat<f64>, row: &[(usize, f64)], size: f64) {
    for (i, x) in row {
        row.iter().for_each(|(j, y)| matrix[(*i, *j)] += size * x * y);
    }
}
