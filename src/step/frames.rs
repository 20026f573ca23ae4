//! Rigid coordinate frames on the host, in f64: the pose of each at the start and at the end of the step, and links,
//! the relative placements of two frames. The displacements of nodes are measured in these frames: up to rounding,
//! results do not depend on where a frame is put, but a frame that moves with its nodes keeps displacements small.
//! Driven frames follow a trajectory, floating frames are fitted to the nodes of a soft body without cores, and dynamic
//! frames are those of dynamic cores (rigid bodies to which nodes are attached and which the solver moves). The twist
//! of a frame is its linear and angular velocity.

mod crossing;
mod saved;

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::prepare::FrameMotion;
use crate::scene::Key;
use crate::shaders::{Fit, Frame, Link, NONE};
use crate::stages::model::{FramePlace, Model, Motion};
use crate::step::tool::{Tool, gyroscopic_impulse};
use crate::step::trajectory::{Trajectory, rotation_vector};
pub use saved::SavedFrame;

/// Rotation per step, rad, beyond which a frame turns too far. The elements of its nodes keep the rotations of the
/// step's start and the nodes move along tangents, so that a body that turns by x rad is stretched by the factor 1 +
/// x^2 / 2 without resistance; below this limit the stretch is less than a hundredth. Below the limit, box-shaped
/// bodies that spin freely gain up to a thousandth of their energy (`palpate stability --only spin`).
const MOST_TURN: f64 = 0.12;
/// A second limit, for stiff bodies that spin freely, on the number q = (turn per step, rad) x (length of the step, s)
/// / (time that a pressure wave takes across the body, s). The stretch described at [`MOST_TURN`] raises the energy of
/// such a spinning body by a fraction of the order of q^2. For box-shaped bodies with a Young's modulus from 1 MPa to
/// 10 GPa, the fraction at this limit is estimated as 0.4 % in the first step; smaller gains are not flagged. A limit
/// of 0.0079 (a gain of some 0.03 %) also flagged bodies with a modulus of 2 MPa that roll, rub or are struck; whether
/// those bodies gain any energy is not known.
const MOST_STIFF_TURN: f64 = 0.03;
/// The limit on q (see [`MOST_STIFF_TURN`]) for steps with several Newton iterations. With several iterations, a stiff
/// box-shaped body that spins loses energy instead of gaining it, up to a modulus of 10 GPa.
const MOST_STIFF_TURN_TWICE: f64 = 1.0;

/// Pose of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// World position of the frame's centre, m.
    pub centre: DVec3,
    /// Rotation from the frame to the world.
    pub rotation: DQuat,
}

/// All frames of a model, over one step.
pub struct Frames {
    states: Vec<State>,
    /// Per frame: whether displacements of nodes are measured in it.
    has_nodes: Vec<bool>,
    /// Per frame: the time that a pressure wave takes across the part of the body that is measured in it, s; see
    /// [`crossing::crossing_times`].
    crossing_times: Vec<Option<f64>>,
    links: Vec<[usize; 2]>,
    /// Indices of the floating frames, in the model's order.
    floating: Vec<usize>,
    /// Indices of the frames of dynamic cores, in the model's order.
    dynamic: Vec<usize>,
}

struct State {
    rest_centre: DVec3,
    mover: Mover,
    start: Place,
    end: Place,
}

enum Mover {
    Fixed,
    Kinematic(Trajectory),
    Tool,
    Floating(Box<Floating>),
    /// A frame of a dynamic core: its twist in world axes (m/s, rad/s); the inertia about its centre, in frame axes, kg
    /// m^2; its hinge axis, a unit vector in world axes, zero without a hinge.
    Dynamic {
        velocity: DVec3,
        spin: DVec3,
        inertia: DMat3,
        hinge: DVec3,
    },
}

/// The fit of a floating frame to its nodes at the end of the last step.
struct Floating {
    mass: f64,
    /// Inertia about the centre at rest, frame axes, kg m^2.
    inertia: DMat3,
    /// Translation from the frame to the fit, frame axes, m.
    shift: DVec3,
    /// Rotation vector from the frame to the fit, frame axes, rad.
    turn: DVec3,
    /// Linear and angular velocity of the nodes as a whole, world axes, m/s and rad/s.
    velocity: DVec3,
    spin: DVec3,
}

impl Frames {
    /// Frames as placed in the scene; driven frames in the poses that their trajectories have at time zero. `velocity`:
    /// the initial velocity of the body that a frame belongs to, m/s.
    pub fn new(model: &Model, velocity: impl Fn(usize) -> DVec3) -> Frames {
        let mut states: Vec<State> =
            model.frames.iter().enumerate().map(|(i, place)| State::new(place, velocity(i))).collect();
        for core in &model.cores {
            if let Mover::Dynamic { velocity, inertia, hinge, .. } = &mut states[core.frame].mover {
                *inertia = model.inertia_of(core);
                *hinge = core.hinge;
                *velocity = if core.hinge == DVec3::ZERO { *velocity } else { DVec3::ZERO };
            }
        }
        // A scene of planes alone has no frames, and so nothing that its one link, of frame 0 with itself, could link.
        let links = model.links.iter().map(|link| link.map(|frame| frame as usize));
        let links = links.filter(|link| link.iter().all(|frame| *frame < states.len())).collect();
        let floating = model.floating.iter().map(|f| f.frame).collect();
        let mut has_nodes = vec![false; states.len()];
        model.node_info.iter().for_each(|node| has_nodes[node[2] as usize] = true);
        let dynamic = model.cores.iter().map(|core| core.frame).collect();
        Frames { has_nodes, crossing_times: crossing::crossing_times(model), states, links, floating, dynamic }
    }

    /// Pose of a frame at the start of the step.
    pub fn place(&self, frame: usize) -> Place {
        self.states[frame].start
    }

    /// The twist (linear, angular) of a dynamic core, world axes; `None` for any other frame.
    pub fn twist(&self, frame: usize) -> Option<(DVec3, DVec3)> {
        match &self.states[frame].mover {
            Mover::Dynamic { velocity, spin, .. } => Some((*velocity, *spin)),
            _ => None,
        }
    }

    /// Pose of a frame at the end of the current step. For a dynamic core this pose is not known before the solve, and
    /// the returned value has no meaning.
    pub fn end(&self, frame: usize) -> Place {
        self.states[frame].end
    }

    /// World position, at the start of the step, of a point `local` that is given relative to a frame's centre in the
    /// frame's axes, m.
    pub fn world(&self, frame: usize, local: DVec3) -> DVec3 {
        let Place { centre, rotation } = self.states[frame].start;
        centre + rotation * local
    }

    /// Prepares a step of `h` seconds that ends at `time`: sets the poses of the frames at its end, where these are
    /// known before the solve.
    pub fn set_out(&mut self, time: f64, h: f64, tool: Option<&Tool>) {
        for state in &mut self.states {
            state.set_out(time, h, tool);
        }
    }

    /// Writes the GPU's frames and links for a step of `h` seconds; positions are relative to `origin`.
    pub fn write(&self, origin: DVec3, h: f64, frames: &mut [Frame], links: &mut [Link]) {
        for (frame, state) in frames.iter_mut().zip(&self.states) {
            *frame = state.frame(origin, h);
        }
        for (core, frame) in self.dynamic.iter().enumerate() {
            frames[*frame].core = core as u32;
        }
        self.write_links(links);
    }

    /// Writes the GPU's links: the current relative placement of each pair of frames in both of which a tetrahedron,
    /// collision proxy (convex hull over a part of a skin, a body's surface mesh) or chunk (group of skin vertices) has
    /// nodes.
    pub fn write_links(&self, links: &mut [Link]) {
        for (link, [to, from]) in links.iter_mut().zip(&self.links) {
            let (to, from) = (&self.states[*to], &self.states[*from]);
            let back = to.start.rotation.conjugate();
            let rest = from.rest_centre - to.rest_centre;
            let offset = back * (from.start.centre - to.start.centre) - rest;
            *link = Link {
                turn: unwound(back * from.start.rotation).as_quat().to_array(),
                offset: offset.as_vec3().to_array(),
                ..Link::default()
            };
        }
    }

    /// Writes the current poses of all frames, relative to `origin`, without their velocities.
    pub fn write_places(&self, origin: DVec3, tool: Option<&Tool>, frames: &mut [Frame]) {
        for (frame, state) in frames.iter_mut().zip(&self.states) {
            let Place { centre, rotation } = match (&state.mover, tool) {
                (Mover::Tool, Some(tool)) => Place { centre: tool.centre, rotation: tool.orientation },
                _ => state.start,
            };
            frame.rotation = rotation.as_quat().to_array();
            frame.centre = (centre - origin).as_vec3().to_array();
        }
    }

    /// Ends a step of `h` seconds. `fits`: the GPU's sums over the nodes of floating frames; `changes`: the changes of
    /// twist of dynamic cores. Both are empty where the step was not accepted; in that case floating and dynamic frames
    /// stay as they were.
    pub fn arrive(&mut self, h: f64, fits: &[Fit], changes: &[[f32; 6]]) {
        for (frame, change) in self.dynamic.iter().zip(changes) {
            self.states[*frame].push(h, change.map(f64::from));
        }
        let known = |state: &&mut State| !matches!(state.mover, Mover::Floating(_) | Mover::Dynamic { .. });
        for state in self.states.iter_mut().filter(known) {
            state.start = state.end;
        }
        for (frame, fit) in self.floating.iter().zip(fits) {
            let state = &mut self.states[*frame];
            state.start = state.end;
            if let Mover::Floating(floating) = &mut state.mover {
                floating.fit(fit, state.start.rotation);
            }
        }
    }

    /// Makes a driven frame go uniformly from its pose at `time` to a key (a pose at a given time). Returns false where
    /// the frame is not driven.
    pub fn lead(&mut self, frame: usize, time: f64, key: Key) -> bool {
        match &mut self.states[frame].mover {
            Mover::Kinematic(trajectory) => {
                trajectory.lead(time, key);
                true
            }
            _ => false,
        }
    }

    /// Whether any driven frame moves between two times, s.
    pub fn has_kinematic_motion(&self, from: f64, to: f64) -> bool {
        let moves = |state: &State| match &state.mover {
            Mover::Kinematic(trajectory) => trajectory.pose(from) != trajectory.pose(to),
            _ => false,
        };
        self.states.iter().any(moves)
    }

    /// Whether a frame turns further in a step of `h` seconds than its elements allow (see [`MOST_TURN`],
    /// [`MOST_STIFF_TURN`]). For a driven frame the turn of the current step counts, for other frames their present
    /// angular velocity times `h`. Frames without nodes, which are those of a rigid tool and of rigid bodies that are
    /// not dynamic, do not count, since nothing deforms there. `newton_iterations`: number of Newton iterations of a
    /// step.
    pub fn turns_too_far(&self, h: f64, newton_iterations: u32) -> bool {
        let most = if newton_iterations > 1 { MOST_STIFF_TURN_TWICE } else { MOST_STIFF_TURN };
        let all = self.states.iter().zip(&self.has_nodes).zip(&self.crossing_times);
        let mut bending = all.filter(|((_, has_nodes), _)| **has_nodes);
        bending.any(|((state, _), time)| {
            let turn = state.turn(h);
            let is_free = matches!(state.mover, Mover::Floating(_) | Mover::Dynamic { .. });
            turn > MOST_TURN || is_free && time.is_some_and(|time| turn * h / time > most)
        })
    }

    /// Stops floating and dynamic frames where they are.
    pub fn stop(&mut self) {
        for state in &mut self.states {
            let (velocity, spin) = match &mut state.mover {
                Mover::Floating(floating) => (&mut floating.velocity, &mut floating.spin),
                Mover::Dynamic { velocity, spin, .. } => (velocity, spin),
                Mover::Fixed | Mover::Kinematic(_) | Mover::Tool => continue,
            };
            (*velocity, *spin) = (DVec3::ZERO, DVec3::ZERO);
        }
    }
}

impl State {
    fn new(place: &FramePlace, velocity: DVec3) -> State {
        let rest_centre = place.rest_centre;
        let mover = match &place.motion {
            Motion::Tool => Mover::Tool,
            Motion::Prepared(FrameMotion::Fixed) => Mover::Fixed,
            Motion::Prepared(FrameMotion::Kinematic(keys)) => Mover::Kinematic(Trajectory::new(
                keys,
                Key { time: 0.0, position: place.position, orientation: place.orientation },
            )),
            Motion::Prepared(FrameMotion::Dynamic { .. }) => {
                Mover::Dynamic { velocity, spin: DVec3::ZERO, inertia: DMat3::ZERO, hinge: DVec3::ZERO }
            }
            Motion::Prepared(FrameMotion::Floating { mass, inertia }) => Mover::Floating(Box::new(Floating {
                mass: *mass,
                inertia: *inertia,
                shift: DVec3::ZERO,
                turn: DVec3::ZERO,
                velocity,
                spin: DVec3::ZERO,
            })),
        };
        let (position, orientation) = match &mover {
            Mover::Kinematic(trajectory) => trajectory.pose(0.0),
            _ => (place.position, place.orientation),
        };
        let start = Place { centre: position + orientation * rest_centre, rotation: orientation };
        State { rest_centre, mover, start, end: start }
    }

    fn set_out(&mut self, time: f64, h: f64, tool: Option<&Tool>) {
        match (&self.mover, tool) {
            (Mover::Kinematic(trajectory), _) => {
                let (position, orientation) = trajectory.pose(time);
                self.end = Place { centre: position + orientation * self.rest_centre, rotation: orientation };
            }
            (Mover::Floating(floating), _) => {
                let Place { centre, rotation } = self.start;
                let turned = DQuat::from_scaled_axis(h * floating.spin) * rotation;
                self.end = Place {
                    centre: centre + rotation * floating.shift + h * floating.velocity,
                    rotation: (turned * DQuat::from_scaled_axis(floating.turn)).normalize(),
                };
            }
            (Mover::Tool, Some(tool)) => {
                self.start = Place { centre: tool.centre, rotation: tool.orientation };
                let turned = DQuat::from_scaled_axis(h * tool.angular_velocity) * tool.orientation;
                self.end = Place { centre: tool.centre + h * tool.velocity, rotation: turned.normalize() };
            }
            (Mover::Fixed | Mover::Dynamic { .. }, _) | (Mover::Tool, None) => {}
        }
    }

    /// Rotation of the frame in a step of `h` seconds, rad.
    fn turn(&self, h: f64) -> f64 {
        match &self.mover {
            Mover::Floating(floating) => h * floating.spin.length(),
            Mover::Dynamic { spin, .. } => h * spin.length(),
            Mover::Kinematic(_) => {
                rotation_vector(unwound(self.end.rotation * self.start.rotation.conjugate())).length()
            }
            Mover::Fixed | Mover::Tool => 0.0,
        }
    }

    /// Changes a dynamic core's twist and moves the core for `h` seconds.
    fn push(&mut self, h: f64, change: [f64; 6]) {
        if let Mover::Dynamic { velocity, spin, hinge, .. } = &mut self.mover {
            let turned = DVec3::from_slice(&change[3..]);
            if *hinge == DVec3::ZERO {
                *velocity += DVec3::from_slice(&change[..3]);
                *spin += turned;
            } else {
                // The frame's centre is on the hinge and stays where it is.
                *spin += hinge.dot(turned) * *hinge;
            }
            self.start.centre += h * *velocity;
            self.start.rotation = (DQuat::from_scaled_axis(h * *spin) * self.start.rotation).normalize();
        }
    }

    fn frame(&self, origin: DVec3, h: f64) -> Frame {
        let Place { centre, rotation } = self.start;
        if let Mover::Dynamic { velocity, spin, inertia, hinge } = &self.mover {
            let turn = DMat3::from_quat(rotation);
            // On a hinge there is no gyroscopic term: the hinge resists all gyroscopic torque.
            let gyroscopic = match *hinge {
                DVec3::ZERO => gyroscopic_impulse(turn * *inertia * turn.transpose(), *spin, h),
                _ => DVec3::ZERO,
            };
            return Frame {
                rotation: rotation.as_quat().to_array(),
                centre: (centre - origin).as_vec3().to_array(),
                linear: velocity.as_vec3().to_array(),
                angular: spin.as_vec3().to_array(),
                turn: [0.0, 0.0, 0.0, 1.0],
                gyroscopic: gyroscopic.as_vec3().to_array(),
                core: NONE,
                ..Frame::default()
            };
        }
        let turned = unwound(self.end.rotation * rotation.conjugate());
        Frame {
            rotation: rotation.as_quat().to_array(),
            centre: (centre - origin).as_vec3().to_array(),
            linear: ((self.end.centre - centre) / h).as_vec3().to_array(),
            angular: (rotation_vector(turned) / h).as_vec3().to_array(),
            turn: unwound(self.end.rotation.conjugate() * rotation).as_quat().to_array(),
            gyroscopic: [0.0; 3],
            core: NONE,
            ..Frame::default()
        }
    }
}

impl Floating {
    /// Shape matching, one iteration per step: finds the shift to the centre of mass of the nodes, and the small
    /// rotation that removes the antisymmetric part of sum m (r + d) r^T (m, r, d: mass, rest position and displacement
    /// of a node). Where both vanish, the frame is the best fit (M. Mueller and others 2005).
    fn fit(&mut self, fit: &Fit, rotation: DQuat) {
        let wide = |x: [f32; 3]| DVec3::from(x.map(f64::from));
        let turn = DMat3::from_quat(rotation);
        let momentum = wide(fit.momentum);
        self.shift = wide(fit.shift) / self.mass;
        self.turn = self.inertia.inverse() * wide(fit.twist);
        self.velocity = momentum / self.mass;
        let about_centre_of_mass = wide(fit.spin) - (turn * self.shift).cross(momentum);
        self.spin = turn * (self.inertia.inverse() * (turn.transpose() * about_centre_of_mass));
    }
}

/// Of q and -q, which stand for the same rotation, the one whose w is not negative; a small rotation is then near the
/// identity quaternion.
pub(super) fn unwound(q: DQuat) -> DQuat {
    if q.w < 0.0 { -q } else { q }
}
