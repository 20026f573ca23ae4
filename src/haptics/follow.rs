//! Contact on the tool (the rigid body that the haptic device leads) between two contact wrenches of the simulation.
//! The haptic loop evaluates local models (`local_model.rs`), one for each wrench. The model of the newest wrench is
//! blended in over one interval between wrenches, and more slowly if that would add more energy than the passivity
//! budget (`passivity.rs`) covers: the energy that the hand has supplied, plus *loans*. A loan stands for energy that
//! the hand would have supplied if the contact had been known earlier. A wrench without contact may report *gaps* to
//! bodies; its model then has a wall at the end of each. The *coupling* is the spring and damper between haptic
//! device and tool.

use glam::DVec3;

use super::compliance::Compliance;
use super::local_model::{Evaluation, LocalModel, Tangent, along, linear};
use super::passivity::Passivity;
use crate::step::{ContactWrench, RigidState, Wrench};

/// Power that a kinematic body (one whose motion is prescribed) may supply to the hand, W.
const KINEMATIC_POWER: f64 = 0.1;

/// The energy of a local model counts as paid although the hand gave less by this share of it, and by this much more in
/// J: damping that the model does not know counts as elasticity, and what damping took the hand does not get back. If
/// it does get it, the passivity controller acts where the force is played.
const LOST_SHARE: f64 = 0.1;
const LOST: f64 = 4e-5;

/// Walls foresaw a force if theirs differs from it by less than this share of the greater one, and along theirs it is
/// at most this many times as great: the first force of a fast press is too small rather than too great.
const FORESEEN: f64 = 0.75;
const MOST_FORESEEN: f64 = 1.3;

/// How local models are made and blended.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// Whether the contact wrench follows the tool by the local model; otherwise the newest wrench is kept constant.
    pub local_model: bool,
    /// Lever arm, m: a rotation of the tool counts as a displacement of its angle (rad) times this length.
    pub arm: f64,
    /// A model is trusted while the tool is within this distance, m, of its pose in the wrench that the model was made
    /// from.
    pub trust: f64,
    /// The longest time over which a model is blended in, s.
    pub longest: f64,
}

/// The contact that the tool feels at present, blended from two models.
#[derive(Debug, Clone)]
pub struct Followed {
    rules: Rules,
    /// Model of the wrench that the tool felt when the newest wrench arrived.
    from: LocalModel,
    /// Model that is being blended in: the model of the newest wrench, or, if that wrench has no contact, perhaps an
    /// earlier model.
    to: LocalModel,
    /// Weight of `to` in the wrench that the tool feels, from 0 to 1.
    share: f64,
    /// Time over which `to` is blended in, s.
    interval: f64,
    newest: ContactWrench,
    /// The newest wrench whose model was taken: where that was foreseen by walls, the one before it.
    modelled: ContactWrench,
    /// Compliance of the touched body.
    compliance: Compliance,
    /// The last wrench without contact: the tool's way into the contact starts there, or at the end of the gap which that
    /// reported.
    entered: ContactWrench,
    /// Bound on all loans of this contact, J: the greatest product so far of the contact force and the tool's way from
    /// `entered` against that force.
    most_lent: f64,
    /// Time at which the newest wrench was taken, s.
    taken: f64,
    /// Energy that may still be lent, J: the way in the body that the tool went since the previous wrench, times the
    /// force by which the newest model exceeds the force felt on that way.
    credit: f64,
}

impl Followed {
    /// Begins without contact, with the tool in the given state.
    pub fn new(rules: Rules, tool: RigidState) -> Followed {
        let newest = ContactWrench::none(tool);
        let none = LocalModel::raw(&newest);
        Followed {
            rules,
            from: none,
            to: none,
            share: 1.0,
            interval: 0.0,
            newest,
            modelled: newest,
            compliance: Compliance::default(),
            entered: newest,
            most_lent: 0.0,
            taken: 0.0,
            credit: 0.0,
        }
    }

    /// The newest wrench.
    pub fn newest(&self) -> &ContactWrench {
        &self.newest
    }

    /// Contact wrench, its slopes (stiffness and damping), and the model's energy in this state of the tool.
    pub fn evaluate(&self, tool: &RigidState) -> Evaluation {
        let to = self.to.evaluate(tool);
        if self.share >= 1.0 { to } else { self.from.evaluate(tool).blend(&to, self.share) }
    }

    /// Takes a new, finite wrench at `time` (s), when the tool is in this state. `lent` is the energy on loan, J.
    pub fn take(&mut self, wrench: &ContactWrench, time: f64, tool: &RigidState, lent: f64) {
        let Rules { local_model, arm, trust, longest } = self.rules;
        self.compliance.learn(&self.newest, wrench, arm);
        let model = match local_model {
            false => LocalModel::raw(wrench),
            true => LocalModel::new(wrench, &self.compliance, arm, trust),
        };
        self.from = match self.share >= 1.0 {
            true => self.to,
            false => match self.evaluate(tool) {
                // At the tool's pose neither of the two blended models has contact: the newer model is kept, because it
                // determines where contact begins again.
                now if now.tangent == Tangent::zero() => self.to,
                now => LocalModel::of(tool, &now, &self.to, arm, trust),
            },
        };
        // If neither the wrench nor the present model has contact at the wrench's pose, the present model is kept,
        // because it determines where contact begins again: a bouncing tool may touch again before the next wrench.
        let is_remembered =
            !model.has_contact() && self.to.has_contact() && self.to.evaluate(&wrench.tool).tangent == Tangent::zero();
        let felt = if is_remembered { self.to } else { model };
        let is_foreseen = self.is_foreseen(wrench);
        if !is_foreseen {
            self.to = felt;
        }
        // The time before the first wrench is no interval to blend over.
        let interval = if self.newest.step > 0 { (time - self.taken).min(longest).max(0.0) } else { 0.0 };
        self.interval = if local_model { interval } else { 0.0 };
        self.share = 0.0;
        self.most_lent = self.most_lent.max(self.opposed(&felt, tool));
        self.credit = self.credit.max(self.unopposed(&felt, tool)).min((self.most_lent - lent).max(0.0));
        (self.newest, self.taken) = (*wrench, time);
        if !is_foreseen {
            self.modelled = *wrench;
        }
        if wrench.wrench == Wrench::ZERO {
            (self.entered, self.most_lent) = (*wrench, 0.0);
        }
    }

    /// Whether a wrench is the first one of a contact that the present model's walls foresaw: at the wrench's pose they
    /// push with about its force, and it has little torque. Then the walls remain until the next wrench. The step that
    /// finds a first contact starts with the body at rest and the tool deep in it: its force tells less of where the
    /// body's surface is than the exact distances of the step before.
    fn is_foreseen(&self, wrench: &ContactWrench) -> bool {
        if self.newest.gap.is_none() || self.newest.wrench != Wrench::ZERO || wrench.has_kinematic_motion {
            return false;
        }
        let foreseen = linear(&self.to.evaluate(&wrench.tool).tangent.force);
        let Wrench { force, torque } = wrench.wrench;
        (foreseen - force).length() < FORESEEN * foreseen.length().max(force.length())
            && foreseen.dot(force) <= MOST_FORESEEN * foreseen.length_squared()
            && torque.length() <= FORESEEN * self.rules.arm * force.length()
    }

    /// The force by which the new model exceeds the force felt so far, times the way that the tool went against the
    /// contact's normal since the last wrench that was modelled, J; the way through the gap that this reported does not
    /// count.
    fn unopposed(&self, new: &LocalModel, tool: &RigidState) -> f64 {
        let Some(normal) = new.normal(tool) else { return 0.0 };
        let way = way_beyond(&self.modelled, &normal, tool);
        let [from, to] = [&self.from, new].map(|model| along(&normal, &model.evaluate(tool).tangent.force));
        way.max(0.0) * (to - from).max(0.0)
    }

    /// The force of the new model times the way that the tool went against the contact's normal since it entered the
    /// contact, J.
    fn opposed(&self, new: &LocalModel, tool: &RigidState) -> f64 {
        let Some(normal) = new.normal(tool) else { return 0.0 };
        let way = way_beyond(&self.entered, &normal, tool);
        way.max(0.0) * along(&normal, &new.evaluate(tool).tangent.force).max(0.0)
    }

    /// Advances the blend by `period` s, and returns whether the blend was held back. Energy that the newer model adds
    /// at the tool's pose must be covered by the passivity budget or by a loan for a way that no force opposed;
    /// otherwise the blend is held back. `stored` is the energy in coupling and tool, J, without contact. `gain` is the
    /// share of the force that is commanded to the device; all energies are scaled by this share.
    pub fn advance(
        &mut self,
        tool: &RigidState,
        period: f64,
        gain: f64,
        stored: f64,
        passivity: &mut Passivity,
    ) -> bool {
        if self.share >= 1.0 {
            return false;
        }
        let left = 1.0 - self.share;
        let wanted = if self.interval > 0.0 { (period / self.interval).min(left) } else { left };
        let [from, to] = [&self.from, &self.to].map(|model| model.evaluate(tool));
        let now = from.stored + self.share * (to.stored - from.stored);
        let asked = wanted * gain * (to.stored - from.stored);
        // The device's position may be wrong by one encoder step, so the hand may have supplied this much more energy.
        let uncertain = passivity.quantum_worth(gain * to.tangent.force.fixed_rows::<3>(0).norm());
        let missing = asked - passivity.surplus(gain * (stored + now)) - uncertain - gain * (LOST_SHARE * now + LOST);
        if !passivity.is_on() || asked <= 0.0 || missing <= 0.0 {
            self.share += wanted;
            return false;
        }
        let kinematic = if self.newest.has_kinematic_motion { KINEMATIC_POWER * period } else { 0.0 };
        let loan = passivity.lend(missing.min(self.credit + kinematic));
        self.credit -= loan.min(self.credit);
        self.share += wanted * (1.0 - ((missing - loan) / asked).min(1.0));
        missing > loan
    }

    /// Ends the contact: no more energy may be lent for it.
    pub fn end(&mut self) {
        self.credit = 0.0;
    }
}

/// The way that the tool went against a contact's normal since a wrench, m: beyond the gaps that the wrench reported, where
/// there are some.
fn way_beyond(wrench: &ContactWrench, normal: &DVec3, tool: &RigidState) -> f64 {
    let moved = tool.position - wrench.tool.position;
    let beyond = wrench
        .gaps()
        .map(|gap| (-gap.normal.dot(moved) - gap.distance.max(0.0)).max(0.0) * gap.normal.dot(*normal).max(0.0));
    if wrench.gap.is_some() { beyond.fold(0.0, f64::max) } else { -normal.dot(moved) }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::step::Gap;

    /// The tool moves 4 mm: through a gap of 3 mm, and 1 mm into a body that is stiffer than the wall at the gap's end.
    /// What may be lent is the missing force times the millimetre in the body.
    #[test]
    fn the_way_through_a_gap_lends_nothing() {
        let at = |y: f64| RigidState::at_rest(DVec3::Y * y, DQuat::IDENTITY);
        let rules = Rules { local_model: true, arm: 0.01, trust: 4e-3, longest: 0.02 };
        let mut followed = Followed::new(rules, at(3e-3));
        let gap = Gap::rigid(DVec3::Y, 3e-3, 100.0);
        followed.take(&ContactWrench { step: 1, gap: Some(gap), ..ContactWrench::none(at(3e-3)) }, 0.0, &at(3e-3), 0.0);
        let mut wrench = ContactWrench { step: 2, pressing: 1.1, ..ContactWrench::none(at(-1e-3)) };
        wrench.wrench.force = DVec3::Y * 1.1;
        wrench.stiffness[1][1] = 2000.0;
        followed.take(&wrench, 0.02, &at(-1e-3), 0.0);
        assert!((followed.credit - 1e-3 * (1.1 - 0.1)).abs() < 1e-12, "{} J may be lent", followed.credit);
        assert!((followed.most_lent - 1e-3 * 1.1).abs() < 1e-12, "{} J at most", followed.most_lent);
        // With gaps in two directions each has its own way.
        let aside = Gap { normal: DVec3::X, distance: 1e-3, ..gap };
        let before = ContactWrench {
            gap: Some(aside),
            farther: [Some(gap), None, None, None, None],
            ..ContactWrench::none(at(3e-3))
        };
        let there = RigidState::at_rest(DVec3::new(-1.5e-3, -1e-3, 0.0), DQuat::IDENTITY);
        assert!((way_beyond(&before, &DVec3::Y, &there) - 1e-3).abs() < 1e-12);
        assert!((way_beyond(&before, &DVec3::X, &there) - 5e-4).abs() < 1e-12);
    }

    /// A wall foresaw 1.1 N at the end of the step. A first wrench of about that force leaves the wall, whose force is
    /// felt until the next wrench; a first wrench of another direction, of far more or less force, with a torque, or of
    /// a body that moves by itself replaces it, and so does the second wrench.
    #[test]
    fn a_first_wrench_that_was_foreseen_leaves_the_wall() {
        let at = |y: f64| RigidState::at_rest(DVec3::Y * y, DQuat::IDENTITY);
        let rules = Rules { local_model: true, arm: 0.01, trust: 8e-3, longest: 0.02 };
        let gap = Gap::rigid(DVec3::Y, 1e-3, 1100.0);
        let near = ContactWrench { step: 1, gap: Some(gap), ..ContactWrench::none(at(1e-3)) };
        let touched = |force: DVec3| {
            let mut wrench = ContactWrench { step: 2, time: 0.02, pressing: 1.0, ..ContactWrench::none(at(-1e-3)) };
            wrench.wrench.force = force;
            wrench.stiffness[1][1] = 5000.0;
            wrench
        };
        let after = |wrenches: &[ContactWrench]| {
            let mut followed = Followed::new(rules, at(1e-3));
            followed.take(&near, 0.0, &at(1e-3), 0.0);
            wrenches.iter().for_each(|wrench| followed.take(wrench, wrench.time, &at(-1e-3), 0.0));
            followed.to.evaluate(&at(-1e-3)).tangent.force[1]
        };
        for (force, is_foreseen) in
            [(0.26, false), (0.29, true), (0.6, true), (1.42, true), (1.44, false), (9.0, false)]
        {
            let expected = if is_foreseen { 1.1 } else { force };
            assert!((after(&[touched(force * DVec3::Y)]) - expected).abs() < 1e-12, "a first wrench of {force} N");
        }
        assert!(after(&[touched(DVec3::new(1.0, 0.1, 0.0))]) < 0.2);
        let mut turned = touched(0.6 * DVec3::Y);
        turned.wrench.torque = DVec3::X * 0.005;
        assert!((after(&[turned]) - 0.6).abs() < 1e-12);
        let moved = ContactWrench { has_kinematic_motion: true, ..touched(0.6 * DVec3::Y) };
        assert!((after(&[moved]) - 0.6).abs() < 1e-12);
        let second = ContactWrench { step: 3, time: 0.04, ..touched(0.7 * DVec3::Y) };
        assert!((after(&[touched(0.6 * DVec3::Y), second]) - 0.7).abs() < 1e-12);
        // The second wrench asks for 2 N, where 1.1 N were felt on the millimetre since the gap's end.
        let mut followed = Followed::new(rules, at(1e-3));
        followed.take(&near, 0.0, &at(1e-3), 0.0);
        followed.take(&touched(0.6 * DVec3::Y), 0.02, &at(-1e-3), 0.0);
        let second = ContactWrench { step: 3, time: 0.04, ..touched(2.0 * DVec3::Y) };
        followed.take(&second, 0.04, &at(-1e-3), 0.0);
        assert!((followed.credit - 1e-3 * (2.0 - 1.1)).abs() < 1e-12, "{} J may be lent", followed.credit);
    }
}
