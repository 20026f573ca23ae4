//! The motion of all rigid coordinate frames, for saving it with a simulation's state and restoring it; masses and
//! joints are not saved. Driven frames follow a trajectory, floating frames are fitted to nodes, and dynamic frames are
//! moved by forces.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Frames, Mover, Place, State};
use crate::step::trajectory::Trajectory;

/// The motion of one frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SavedFrame {
    start: Place,
    end: Place,
    /// Linear and angular velocity, world axes, m/s and rad/s; zero except for floating and dynamic frames.
    twist: [DVec3; 2],
    /// Translation (m) and rotation vector (rad) from the frame to the fit of its nodes; zero except for floating
    /// frames.
    fit: [DVec3; 2],
    /// Reference trajectory; `None` except for driven frames.
    trajectory: Option<Trajectory>,
}

impl SavedFrame {
    /// Whether the frame's trajectory, if there is one, has at least one key and so gives a pose at any time.
    pub fn is_whole(&self) -> bool {
        self.trajectory.as_ref().is_none_or(Trajectory::is_whole)
    }
}

impl Frames {
    /// The motion of all frames.
    pub fn saved(&self) -> Vec<SavedFrame> {
        self.states.iter().map(State::saved).collect()
    }

    /// Restores the motion of all frames, which must be those of the model that was saved.
    pub fn restore(&mut self, saved: &[SavedFrame]) {
        self.states.iter_mut().zip(saved).for_each(|(state, saved)| state.restore(saved));
    }
}

impl State {
    fn saved(&self) -> SavedFrame {
        let (mut twist, mut fit, mut path) = ([DVec3::ZERO; 2], [DVec3::ZERO; 2], None);
        match &self.mover {
            Mover::Floating(f) => (twist, fit) = ([f.velocity, f.spin], [f.shift, f.turn]),
            Mover::Dynamic { velocity, spin, .. } => twist = [*velocity, *spin],
            Mover::Kinematic(trajectory) => path = Some(trajectory.clone()),
            Mover::Fixed | Mover::Tool => {}
        }
        SavedFrame { start: self.start, end: self.end, twist, fit, trajectory: path }
    }

    fn restore(&mut self, saved: &SavedFrame) {
        (self.start, self.end) = (saved.start, saved.end);
        match &mut self.mover {
            Mover::Floating(f) => ([f.velocity, f.spin], [f.shift, f.turn]) = (saved.twist, saved.fit),
            Mover::Dynamic { velocity, spin, .. } => [*velocity, *spin] = saved.twist,
            Mover::Kinematic(trajectory) => {
                if let Some(saved) = &saved.trajectory {
                    trajectory.clone_from(saved);
                }
            }
            Mover::Fixed | Mover::Tool => {}
        }
    }
}
