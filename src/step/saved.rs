//! Saves the state of a simulation between two steps as bytes, and restores it. The state is all that the next step
//! starts from, so a restored simulation gives the same results to the last bit. What a user sets (the parameters of
//! materials, of contact and of the coupling between haptic device and tool) is not part of the state: restoring leaves
//! it as it is.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::Simulation;
use super::frames::SavedFrame;
use super::plans::Needs;
use crate::gpu::{read_all, write_all};
use crate::step::trajectory::Trajectory;
use crate::step::{ContactWrench, RigidState};
use crate::{Error, Result};

/// The first bytes of a saved state, with the version of its format.
const MARK: [u8; 8] = *b"palpate9";

/// The state of a simulation: everything that moves.
#[derive(Serialize, Deserialize)]
struct State {
    /// Fingerprint of the bodies that the state belongs to.
    model: [u8; 32],
    step: u64,
    time: f64,
    has_weight: bool,
    tool: Option<RigidState>,
    trajectory: Trajectory,
    /// The trajectories of the tools after the first.
    further_trajectories: Vec<Trajectory>,
    frames: Vec<SavedFrame>,
    wrench: Option<ContactWrench>,
    iterations: u32,
    /// Contents of the GPU arrays that a step leaves for the next one, one array after the other.
    arrays: Vec<u8>,
}

impl Simulation {
    /// The state after the last step. [`Simulation::restore`] continues from it, in this simulation or in another one
    /// with the same bodies and tool on the same GPU; both simulations then give the same results to the last bit.
    pub fn save(&self) -> Result<Vec<u8>> {
        let state = State {
            model: self.fingerprint(),
            step: self.step,
            time: self.time,
            has_weight: self.has_weight,
            tool: self.tool.as_ref().map(|tool| tool.state()),
            trajectory: self.trajectory.clone(),
            further_trajectories: self.further_tools.iter().map(|tool| tool.trajectory.clone()).collect(),
            frames: self.frames.saved(),
            wrench: self.last_wrench,
            iterations: self.last_iterations,
            arrays: read_all(&self.context, &self.stages.state())?,
        };
        let mut bytes = MARK.to_vec();
        let body =
            postcard::to_stdvec(&state).map_err(|e| Error::Simulation(format!("the state cannot be saved: {e}")))?;
        bytes.extend(Sha256::digest(&body));
        bytes.extend(body);
        Ok(bytes)
    }

    /// Restores a saved state. It is an error if the bytes are not a saved state, are damaged, or belong to a
    /// simulation of other bodies; the simulation is then unchanged.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<()> {
        let wrong =
            |what: &str| Error::Usage(format!("the state {what}; give a state that a simulation of this scene saved"));
        let rest = bytes.strip_prefix(&MARK).ok_or_else(|| wrong("was not saved by this version"))?;
        let (sum, body) = rest.split_at_checked(32).ok_or_else(|| wrong("is cut short"))?;
        if Sha256::digest(body).as_slice() != sum {
            return Err(wrong("is damaged"));
        }
        let state: State = postcard::from_bytes(body).map_err(|_| wrong("is damaged"))?;
        if state.model != self.fingerprint() {
            return Err(wrong("belongs to other bodies"));
        }
        let frames = state.frames.len() == self.model.frames.len() && state.frames.iter().all(SavedFrame::is_whole);
        let further = &state.further_trajectories;
        let trajectories = state.trajectory.is_whole() && further.iter().all(Trajectory::is_whole);
        let tools = state.tool.is_some() == self.tool.is_some() && further.len() == self.further_tools.len();
        if !frames || !trajectories || !tools {
            return Err(wrong("is damaged"));
        }
        write_all(&self.context, &self.stages.state(), &state.arrays)?;
        (self.step, self.time, self.has_weight) = (state.step, state.time, state.has_weight);
        if let (Some(tool), Some(saved)) = (&mut self.tool, state.tool) {
            (tool.centre, tool.orientation) = (saved.position, saved.orientation);
            (tool.velocity, tool.angular_velocity) = (saved.velocity, saved.angular_velocity);
        }
        self.trajectory = state.trajectory;
        self.frames.restore(&state.frames);
        for (tool, trajectory) in self.further_tools.iter_mut().zip(state.further_trajectories) {
            tool.leave_loop();
            tool.trajectory = trajectory;
            tool.follow(&self.model, &self.frames);
        }
        self.tool_end = None;
        self.last_reactions.clear();
        (self.last_wrench, self.last_iterations) = (state.wrench, state.iterations);
        self.needs = Needs::default();
        self.needs.note(state.iterations + 1);
        (self.last_timed, self.is_solved) = (None, false);
        Ok(())
    }

    /// Hash of all that must be equal in the simulation that saved a state and in the one that restores it: topology
    /// and rest state of the bodies, and sizes of the arrays.
    fn fingerprint(&self) -> [u8; 32] {
        let model = &self.model;
        let mut hash = Sha256::new();
        hash.update(bytemuck::cast_slice(&model.tetrahedra));
        hash.update(bytemuck::cast_slice(&model.skin_nodes));
        hash.update(bytemuck::cast_slice(&model.skin_weights));
        let places = model.node_rest.iter().zip(&model.node_info);
        places.for_each(|([x, y, z, _], [.., frame, held])| {
            hash.update(bytemuck::bytes_of(&[x.to_bits(), y.to_bits(), z.to_bits(), *frame, *held]));
        });
        hash.update(bytemuck::cast_slice(&model.held.nodes));
        hash.update(bytemuck::cast_slice(&model.proxy_pairs));
        let tested: Vec<u32> = model.pairs.iter().flat_map(|pair| [pair.lone_side, pair.by_triangles]).collect();
        hash.update(bytemuck::cast_slice(&tested));
        let counts = [model.frames.len(), model.cores.len(), usize::from(self.tool.is_some())];
        let held = counts.into_iter().chain(model.tool_cores.iter().copied()).map(|n| n as u64);
        hash.update(bytemuck::cast_slice(&held.collect::<Vec<u64>>()));
        let sizes: Vec<u64> = self.stages.state().iter().map(|array| array.bytes()).collect();
        hash.update(bytemuck::cast_slice(&sizes));
        hash.finalize().into()
    }
}
