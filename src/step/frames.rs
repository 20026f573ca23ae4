//! Frames on the host, in f64: where each is at the start of the step and at its end, and how points of one lie in
//! another. What the device does is the same wherever a frame is put, up to rounding; a good frame keeps displacements
//! small.

mod crossing;
mod saved;

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::prepare::FrameMotion;
use crate::scene::Key;
use crate::shaders::{Fit, Frame, Link, NONE};
use crate::stages::model::{FramePlace, Model, Motion};
use crate::step::drive::{Drive, rotation_vector};
use crate::step::tool::{Tool, gyroscopic_impulse};
pub use saved::SavedFrame;

/// rad a step, beyond which a frame turns too far: what it carries keeps the rotations of the step's start, nodes go along
/// tangents, and what turns by x is stretched by x^2 / 2 unopposed, here by less than a hundredth;
/// free blocks that spin gain up to a thousandth of their energy by it (`palpate stability --only spin`).
const MOST_TURN: f64 = 0.12;
/// What is stiff and spins free gains more energy from the same stretch, (turn x step / crossing time)^2 of what it spins with.
/// Where turn times step over the time that a pressure wave takes across it is this, a block gains some 0.4 % in its first step,
/// by an estimate from 1 MPa to 10 GPa: below, that is not told. With 0.0079, at some 0.03 %,
/// bodies of 2 MPa that roll, rub or are struck were told as well, of which it is not known whether they gain any.
const MOST_STIFF_TURN: f64 = 0.03;
/// The same where a step is linearised more than once, which takes energy instead, up to 10 GPa in such a block.
const MOST_STIFF_TURN_TWICE: f64 = 1.0;

/// Where a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// World position of its centre, m.
    pub centre: DVec3,
    /// Frame to world.
    pub rotation: DQuat,
}

/// All frames of a model, over one step.
pub struct Frames {
    states: Vec<State>,
    /// Which of them nodes are measured from.
    has_nodes: Vec<bool>,
    /// Of each: see [`crossing::crossing_times`].
    crossing_times: Vec<Option<f64>>,
    links: Vec<[usize; 2]>,
    /// The states that are fitted, in the model's order.
    floating: Vec<usize>,
    /// The states that the solver moves, in the model's order.
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
    Driven(Drive),
    Tool,
    Floating(Box<Floating>),
    /// World twist; inertia about the centre, frame axes, kg m^2; the axis of its hinge, world, zero where there is none.
    Dynamic {
        velocity: DVec3,
        spin: DVec3,
        inertia: DMat3,
        hinge: DVec3,
    },
}

/// What was fitted to the nodes at the end of the last step.
struct Floating {
    mass: f64,
    /// About the centre at rest, frame axes, kg m^2.
    inertia: DMat3,
    /// From the frame to the fit, frame axes, m.
    shift: DVec3,
    /// From the frame to the fit, a rotation vector, frame axes.
    turn: DVec3,
    /// Of the nodes, world, m/s and rad/s.
    velocity: DVec3,
    spin: DVec3,
}

impl Frames {
    /// Frames as placed; driven ones where their keys put them at time zero. `velocity`: initial, of each frame's body.
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
        let links = model.links.iter().map(|link| link.map(|frame| frame as usize)).collect();
        let floating = model.floating.iter().map(|f| f.frame).collect();
        let mut has_nodes = vec![false; states.len()];
        model.node_info.iter().for_each(|node| has_nodes[node[2] as usize] = true);
        let dynamic = model.cores.iter().map(|core| core.frame).collect();
        Frames { has_nodes, crossing_times: crossing::crossing_times(model), states, links, floating, dynamic }
    }

    /// Where a frame is at the start of the step.
    pub fn place(&self, frame: usize) -> Place {
        self.states[frame].start
    }

    /// The twist (linear, angular) of a dynamic core, world; `None` for any other frame.
    pub fn twist(&self, frame: usize) -> Option<(DVec3, DVec3)> {
        match &self.states[frame].mover {
            Mover::Dynamic { velocity, spin, .. } => Some((*velocity, *spin)),
            _ => None,
        }
    }

    /// Where a frame is at the end of the step that it has set out for; of a dynamic core nobody knows.
    pub fn end(&self, frame: usize) -> Place {
        self.states[frame].end
    }

    /// A point of the rest frame's coordinates relative to the frame's centre, in the world.
    pub fn world(&self, frame: usize, local: DVec3) -> DVec3 {
        let Place { centre, rotation } = self.states[frame].start;
        centre + rotation * local
    }

    /// Sets out for the end of the step at `time`, `h` seconds long.
    pub fn set_out(&mut self, time: f64, h: f64, tool: Option<&Tool>) {
        for state in &mut self.states {
            state.set_out(time, h, tool);
        }
    }

    /// Writes the device's frames and links; positions relative to `origin`.
    pub fn write(&self, origin: DVec3, h: f64, frames: &mut [Frame], links: &mut [Link]) {
        for (frame, state) in frames.iter_mut().zip(&self.states) {
            *frame = state.frame(origin, h);
        }
        for (core, frame) in self.dynamic.iter().enumerate() {
            frames[*frame].core = core as u32;
        }
        self.write_links(links);
    }

    /// Writes how frames that something spans lie to each other now.
    pub fn write_links(&self, links: &mut [Link]) {
        for (link, [to, from]) in links.iter_mut().zip(&self.links) {
            let (to, from) = (&self.states[*to], &self.states[*from]);
            let back = to.start.rotation.conjugate();
            let rest = from.rest_centre - to.rest_centre;
            let offset = back * (from.start.centre - to.start.centre) - rest;
            *link = Link {
                turn: unwound(back * from.start.rotation).as_quat().to_array(),
                offset: offset.as_vec3().to_array(),
            };
        }
    }

    /// Writes where all frames are now, relative to `origin`, and nothing of how they move.
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

    /// The step of `h` seconds is over. `fits`: what the device summed, `changes`: of the twists of dynamic cores; empty where
    /// it did not accept the step: then frames that float or are dynamic stay as they were.
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

    /// Takes a driven frame from where it is at `time` evenly to a key; false: it is not driven.
    pub fn lead(&mut self, frame: usize, time: f64, key: Key) -> bool {
        match &mut self.states[frame].mover {
            Mover::Driven(drive) => {
                drive.lead(time, key);
                true
            }
            _ => false,
        }
    }

    /// Whether a frame moves as it is told between two times, s.
    pub fn is_any_driven(&self, from: f64, to: f64) -> bool {
        let moves = |state: &State| match &state.mover {
            Mover::Driven(drive) => drive.pose(from) != drive.pose(to),
            _ => false,
        };
        self.states.iter().any(moves)
    }

    /// Whether a frame turns further in a step of `h` seconds than what it carries can bear (see [`MOST_TURN`],
    /// [`MOST_STIFF_TURN`]): one that is driven on the way it has set out for, others by what they turn at now. Rigid bodies have
    /// no nodes, and nothing that bends.
    pub fn turns_too_far(&self, h: f64, linearisations: u32) -> bool {
        let most = if linearisations > 1 { MOST_STIFF_TURN_TWICE } else { MOST_STIFF_TURN };
        let all = self.states.iter().zip(&self.has_nodes).zip(&self.crossing_times);
        let mut bending = all.filter(|((_, has_nodes), _)| **has_nodes);
        bending.any(|((state, _), time)| {
            let turn = state.turn(h);
            let is_free = matches!(state.mover, Mover::Floating(_) | Mover::Dynamic { .. });
            turn > MOST_TURN || is_free && time.is_some_and(|time| turn * h / time > most)
        })
    }

    /// Stops frames that float or are dynamic where they are.
    pub fn stop(&mut self) {
        for state in &mut self.states {
            let (velocity, spin) = match &mut state.mover {
                Mover::Floating(floating) => (&mut floating.velocity, &mut floating.spin),
                Mover::Dynamic { velocity, spin, .. } => (velocity, spin),
                Mover::Fixed | Mover::Driven(_) | Mover::Tool => continue,
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
            Motion::Prepared(FrameMotion::Driven(keys)) => Mover::Driven(Drive::new(
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
            Mover::Driven(drive) => drive.pose(0.0),
            _ => (place.position, place.orientation),
        };
        let start = Place { centre: position + orientation * rest_centre, rotation: orientation };
        State { rest_centre, mover, start, end: start }
    }

    fn set_out(&mut self, time: f64, h: f64, tool: Option<&Tool>) {
        match (&self.mover, tool) {
            (Mover::Driven(drive), _) => {
                let (position, orientation) = drive.pose(time);
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

    fn turn(&self, h: f64) -> f64 {
        match &self.mover {
            Mover::Floating(floating) => h * floating.spin.length(),
            Mover::Dynamic { spin, .. } => h * spin.length(),
            Mover::Driven(_) => rotation_vector(unwound(self.end.rotation * self.start.rotation.conjugate())).length(),
            Mover::Fixed | Mover::Tool => 0.0,
        }
    }

    /// A dynamic core's new twist and pose.
    fn push(&mut self, h: f64, change: [f64; 6]) {
        if let Mover::Dynamic { velocity, spin, hinge, .. } = &mut self.mover {
            let turned = DVec3::from_slice(&change[3..]);
            if *hinge == DVec3::ZERO {
                *velocity += DVec3::from_slice(&change[..3]);
                *spin += turned;
            } else {
                // The centre is on the hinge and stays there.
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
            // A hinge bears all of it.
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
        }
    }
}

impl Floating {
    /// Shape matching, one round a step: the shift to the centre of mass, and the small turn that takes the antisymmetric
    /// part of sum m (r + d) r^T away; where both vanish the frame is the best fit (M. Mueller and others 2005).
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

/// The same rotation with w not negative, so that it is near the identity where the rotation is.
pub(super) fn unwound(q: DQuat) -> DQuat {
    if q.w < 0.0 { -q } else { q }
}
