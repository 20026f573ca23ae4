//! Contact as the loop follows it from one wrench to the next: the model of the newest wrench is blended in over one interval,
//! and more slowly while that would add more energy than the hand has paid for or may be lent.

use glam::DVec3;

use super::local_model::{Evaluation, LocalModel, Tangent, along};
use super::passivity::Passivity;
use crate::step::{ContactWrench, RigidState, Wrench};

/// What a body that moves as it is told may give the hand, W.
const DRIVEN_POWER: f64 = 0.1;

/// Wrenches with contact in a row that may be too shallow to tell how stiff it is.
const SHALLOW: u32 = 3;

/// How models are made and blended.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// Whether contact is followed between wrenches; else the force of the newest is kept as it is.
    pub local_model: bool,
    /// At which rotations of the tool count as displacements, m.
    pub arm: f64,
    /// How far from its pose a model is trusted, m.
    pub trust: f64,
    /// The longest interval to blend over, s.
    pub longest: f64,
}

/// The contact that is followed.
#[derive(Debug, Clone)]
pub struct Followed {
    rules: Rules,
    /// What was felt when the newest wrench was taken.
    from: LocalModel,
    /// The model of the newest wrench.
    to: LocalModel,
    /// Of the newest model in what is felt, from 0 to 1.
    share: f64,
    /// To blend over, s.
    interval: f64,
    newest: ContactWrench,
    /// Wrenches with contact in a row.
    touches: u32,
    /// How stiff the wall was that the last known gap ended at, N/m; 0: none was known.
    wall: f64,
    /// Where the tool was in the last wrench without contact, m.
    entered: DVec3,
    /// The greatest force times the way from there so far, J: more is never lent.
    most_lent: f64,
    /// When the newest wrench was taken, s.
    taken: f64,
    /// What may still be lent, J: the force that the newest wrench would have shown on the way that the tool went since the one
    /// before, where less was felt.
    credit: f64,
}

impl Followed {
    /// No contact; the tool is there.
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
            touches: 0,
            wall: 0.0,
            entered: tool.position,
            most_lent: 0.0,
            taken: 0.0,
            credit: 0.0,
        }
    }

    /// The newest wrench.
    pub fn newest(&self) -> &ContactWrench {
        &self.newest
    }

    /// What is felt in this state of the tool.
    pub fn evaluate(&self, tool: &RigidState) -> Evaluation {
        let to = self.to.evaluate(tool);
        if self.share >= 1.0 { to } else { self.from.evaluate(tool).blend(&to, self.share) }
    }

    /// A wrench that is new and finite, taken at `time` (s) with the tool in this state. `lent`: what is lent already, J.
    pub fn take(&mut self, wrench: &ContactWrench, time: f64, tool: &RigidState, lent: f64) {
        let Rules { local_model, arm, trust, longest } = self.rules;
        if wrench.wrench == Wrench::ZERO {
            (self.touches, self.wall) = (0, wrench.gap.map_or(0.0, |gap| gap.stiffness));
        } else {
            self.touches += 1;
        }
        let model = match local_model {
            false => LocalModel::raw(wrench),
            // The wall of the gap stays until contact tells how stiff it is deeper in.
            true if (1..=SHALLOW).contains(&self.touches) => {
                LocalModel::new(wrench, arm, trust).no_softer_inward(self.wall, trust)
            }
            true => LocalModel::new(wrench, arm, trust),
        };
        self.from = match self.share >= 1.0 {
            true => self.to,
            false => match self.evaluate(tool) {
                // Between two contacts: the later one says where contact begins again.
                now if now.tangent == Tangent::zero() => self.to,
                now => LocalModel::of(tool, &now, arm, trust),
            },
        };
        // Where a wrench knows of no contact, and the last one that did says the same of that place, that one says where contact
        // begins again: a tool that bounces meets it between two wrenches.
        let is_remembered =
            !model.has_contact() && self.to.has_contact() && self.to.evaluate(&wrench.tool).tangent == Tangent::zero();
        if !is_remembered {
            self.to = model;
        }
        // What came before the first wrench is no interval to blend over.
        let interval = if self.newest.step > 0 { (time - self.taken).min(longest).max(0.0) } else { 0.0 };
        self.interval = if local_model { interval } else { 0.0 };
        self.share = 0.0;
        self.most_lent = self.most_lent.max(self.opposed(tool));
        // A wall that was known opposed the way.
        let unopposed = if self.wall > 0.0 { 0.0 } else { self.unopposed(tool) };
        self.credit = self.credit.max(unopposed).min((self.most_lent - lent).max(0.0));
        (self.newest, self.taken) = (*wrench, time);
        if wrench.wrench == Wrench::ZERO {
            (self.entered, self.most_lent) = (wrench.tool.position, 0.0);
        }
    }

    /// The force that the new model shows beyond what was felt, times the way that the tool went against it since the last
    /// wrench, J.
    fn unopposed(&self, tool: &RigidState) -> f64 {
        let Some(normal) = self.to.normal() else { return 0.0 };
        let way = -normal.dot(tool.position - self.newest.tool.position);
        let [from, to] = [&self.from, &self.to].map(|model| along(&normal, &model.evaluate(tool).tangent.force));
        way.max(0.0) * (to - from).max(0.0)
    }

    /// The force of the new model times the way since contact was entered, J.
    fn opposed(&self, tool: &RigidState) -> f64 {
        let Some(normal) = self.to.normal() else { return 0.0 };
        let way = -normal.dot(tool.position - self.entered);
        way.max(0.0) * along(&normal, &self.to.evaluate(tool).tangent.force).max(0.0)
    }

    /// Blends on for `period` s. `stored` (J): what coupling and tool hold beside contact. Energy that the newer model adds where the
    /// tool is must be paid, or lent against the way that was unopposed; what is not is kept back, and told so. `gain`: share of
    /// the force that is played, which energies are counted by.
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
        // The reading may be a quantum off.
        let uncertain = passivity.quantum_worth(gain * to.tangent.force.fixed_rows::<3>(0).norm());
        let missing = asked - passivity.surplus(gain * (stored + now)) - uncertain;
        if !passivity.is_on() || asked <= 0.0 || missing <= 0.0 {
            self.share += wanted;
            return false;
        }
        let driven = if self.newest.is_driven { DRIVEN_POWER * period } else { 0.0 };
        let loan = passivity.lend(missing.min(self.credit + driven));
        self.credit -= loan.min(self.credit);
        self.share += wanted * (1.0 - ((missing - loan) / asked).min(1.0));
        missing > loan
    }

    /// Contact has ended: nothing is left to lend for.
    pub fn end(&mut self) {
        self.credit = 0.0;
    }
}
