//! Compliance of the touched body, which the haptic loop learns from successive contact wrenches, and the damping of
//! that body.
//!
//! The stiffness that a wrench reports is that of the contact alone, with the body held still. The body yields as well,
//! so what is felt are two springs in series, 1 / K_felt = 1 / K + c, with the contact's stiffness K along the force
//! and the body's compliance c. From one wrench to the next the tool advances by d against the force, and the force
//! grows by df; hence c = d / df - 1 / K, a secant as in quasi-Newton methods (C. Broyden, "A class of methods for
//! solving nonlinear simultaneous equations", 1965).
//!
//! The body is a Kelvin-Voigt element: beside its spring 1 / c is a damper tau / c, with the retardation time tau of
//! its material. In steady motion the body takes the share c K_felt of the tool's velocity, so that a damping of
//! tau c K_felt^2 is felt. The damper's part of df is left out of the secant, which still contains inertia and a growing
//! area of contact.

use glam::DVec3;
use nalgebra::Vector6;

use super::local_model::{along, in_series, slope, vector};
use crate::step::trajectory::rotation_vector;
use crate::step::{ContactWrench, Gap, Wrench};

/// Weight of a new sample where the force changed much.
const MOST_WEIGHT: f64 = 0.8;
/// A change of the force by this share has half of that weight. Smaller changes tell less: they come from inertia and
/// from the solver's tolerance as much as from the body's elasticity.
const TELLING: f64 = 0.02;
/// If the tool advances by less than this share of its whole displacement, it slides, and the force changes because of
/// the body's shape rather than its compliance.
const ADVANCES: f64 = 0.2;
/// Least ratio of the stiffness that is felt to the contact's stiffness.
const SOFTEST: f64 = 0.02;
/// A sample counts as at most this many times the known compliance, or as the estimate or the compliance of the contact
/// where that is more, since a single sample may be far off.
const MOST_GROWTH: f64 = 1.5;
/// Where the tool's velocity changes from one step to the next by as much as this time goes into the way of a sample,
/// s, the sample has half of its weight: inertia, and waves in the body.
const UNSTEADY: f64 = 0.01;
/// The secant of a force that grows with the depth to this power, as between a sphere and a half-space (H. Hertz 1882),
/// is the tangent divided by this number.
const HERTZ: f64 = 1.5;

/// Motions longer than this between two wrenches are jumps, m.
const FARTHEST: f64 = 0.03;

/// What is known of the touched body.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Compliance {
    /// Compliance, m/N; 0 where the body does not yield or nothing is known yet.
    value: f64,
    /// Whether a motion in contact told of it; otherwise it is the estimate that came with the gap.
    is_learned: bool,
    /// The estimate that came with the last gap, m/N, and the pair of tool and body that the gap belongs to.
    estimate: f64,
    pair: Option<u32>,
    /// Retardation time of the body, s: its damping over its stiffness.
    retardation: f64,
    /// Mean twist of the tool in the newest step, as far as it was in contact: the motion that the body followed.
    /// `None` where that is not known.
    twist: Option<Vector6<f64>>,
}

impl Compliance {
    /// The body's compliance, m/N.
    pub fn value(&self) -> f64 {
        self.value
    }

    /// The body's own damping, N s/m, where it is felt with this stiffness (N/m). It goes with the square of the
    /// stiffness, also where that is a matrix.
    pub fn damping(&self, felt: f64) -> f64 {
        self.retardation * self.value * felt * felt
    }

    /// The motion that the body followed in the newest step: the tool's mean twist, less the way to the body. `None`
    /// where that is not known.
    pub fn twist(&self) -> Option<Vector6<f64>> {
        self.twist
    }

    /// Learns from two successive wrenches; a rotation counts as a displacement at the lever `arm` (m). Motions that
    /// tell nothing of the compliance leave it as it is. What was learned remains beyond the end of a contact, until
    /// another body is the nearest one.
    pub fn learn(&mut self, last: &ContactWrench, new: &ContactWrench, arm: f64) {
        if let (Some(gap), true) = (new.gap, new.wrench == Wrench::ZERO)
            && self.pair != Some(gap.pair)
        {
            *self = Compliance::estimate_of(&gap);
        }
        let before = self.twist.take();
        let Some(after) = new.contact_normal() else { return };
        let moved = new.tool.position - last.tool.position;
        let turned = rotation_vector(new.tool.orientation * last.tool.orientation.conjugate());
        let way = moved.length().hypot(arm * turned.length());
        if way > FARTHEST || new.has_kinematic_motion {
            return;
        }
        let twist = (new.h > 0.0).then(|| vector(moved, turned) / new.h);
        if last.wrench == Wrench::ZERO {
            self.learn_first(last, new, &after, &moved, twist);
        } else {
            self.twist = twist;
            self.learn_next(last, new, &moved, way, before);
        }
    }

    /// Learns from the first wrench of a contact: the tool has gone through the gap and then some way into the body.
    fn learn_first(
        &mut self,
        last: &ContactWrench,
        new: &ContactWrench,
        normal: &DVec3,
        moved: &DVec3,
        twist: Option<Vector6<f64>>,
    ) {
        let Some(gap) = last.gap_along(*normal) else { return };
        if self.pair != Some(gap.pair) {
            *self = Compliance::estimate_of(gap);
        }
        let gone = -gap.normal.dot(*moved);
        let depth = gone - gap.distance;
        if gone <= 0.0 || depth <= 0.0 {
            return;
        }
        self.twist = twist.map(|twist| (depth / gone).min(1.0) * twist);
        let stiffness = slope(normal, &new.stiffness_matrix());
        let force = normal.dot(new.wrench.force) - self.resisted(stiffness, normal, self.twist);
        if self.is_learned || force <= 0.0 {
            return;
        }
        self.take(unsteady(normal, self.twist, depth), stiffness, HERTZ * force / depth);
    }

    /// Learns from a wrench in contact that follows another one. `before`: the motion that the body followed then.
    fn learn_next(
        &mut self,
        last: &ContactWrench,
        new: &ContactWrench,
        moved: &DVec3,
        way: f64,
        before: Option<Vector6<f64>>,
    ) {
        let (Some(normal), Some(after)) = (last.contact_normal(), new.contact_normal()) else { return };
        let of = |normal: &DVec3, wrench: &ContactWrench| slope(normal, &wrench.stiffness_matrix());
        let stiffness = 0.5 * (of(&normal, last) + of(&after, new));
        let change = self.twist.zip(before).map(|(twist, before)| twist - before);
        let advanced = -normal.dot(*moved);
        let grown = normal.dot(new.wrench.force - last.wrench.force) - self.resisted(stiffness, &normal, change);
        if advanced * grown <= 0.0 || advanced.abs() < ADVANCES * way {
            return;
        }
        let share = TELLING * after.dot(new.wrench.force) / grown;
        let uncertain = share * share + unsteady(&normal, change, advanced);
        self.take(uncertain, stiffness, grown / advanced);
    }

    /// The force along the normal, N, by which the body's damper opposes a twist or a change of it.
    fn resisted(&self, stiffness: f64, normal: &DVec3, twist: Option<Vector6<f64>>) -> f64 {
        let speed = twist.map_or(0.0, |twist| -along(normal, &twist));
        self.damping(in_series(stiffness, self.value)) * speed
    }

    /// What is known of a body before it is touched.
    fn estimate_of(gap: &Gap) -> Compliance {
        let Gap { compliance, retardation, pair, .. } = *gap;
        Compliance {
            value: compliance,
            is_learned: false,
            estimate: compliance,
            pair: Some(pair),
            retardation,
            twist: None,
        }
    }

    /// Takes a sample of the stiffness that is felt, N/m, at a contact of the given stiffness. A sample that is
    /// uncertain by 1 has half of the weight of a certain one.
    fn take(&mut self, uncertain: f64, stiffness: f64, felt: f64) {
        let most = (MOST_GROWTH * self.value).max(self.estimate).max(1.0 / stiffness);
        let sample = (1.0 / felt.max(SOFTEST * stiffness) - 1.0 / stiffness).max(0.0).min(most);
        let value = self.value + MOST_WEIGHT / (1.0 + uncertain) * (sample - self.value);
        if stiffness > 0.0 && value.is_finite() {
            (self.value, self.is_learned) = (value, true);
        }
    }
}

/// How uncertain a sample is whose twist along the normal changed by this while the tool advanced by `way`, m.
fn unsteady(normal: &DVec3, change: Option<Vector6<f64>>, way: f64) -> f64 {
    let share = change.map_or(0.0, |change| UNSTEADY * along(normal, &change) / way);
    share * share
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::step::RigidState;

    /// Contact of 3000 N/m on a body of 300 N/m.
    const CONTACT: f64 = 3000.0;
    const BODY: f64 = 300.0;
    const ARM: f64 = 0.01;

    /// The wrench of a tool at this depth (m) below the body's surface, displaced sideways by `aside` (m).
    fn at(depth: f64, aside: f64, body: f64) -> ContactWrench {
        let tool = RigidState::at_rest(DVec3::new(aside, -depth, 0.0), DQuat::IDENTITY);
        let mut wrench = ContactWrench::none(tool);
        let felt = 1.0 / (1.0 / CONTACT + 1.0 / body);
        if depth > 0.0 {
            wrench.wrench.force = DVec3::Y * felt * depth;
            wrench.stiffness[1][1] = CONTACT;
        }
        wrench
    }

    fn above(distance: f64, compliance: f64) -> ContactWrench {
        let pair = u32::from(compliance == 0.0);
        let gap = Gap { compliance, pair, ..Gap::rigid(DVec3::Y, distance, CONTACT) };
        ContactWrench { gap: Some(gap), ..at(-distance, 0.0, BODY) }
    }

    fn pressed(body: f64) -> Compliance {
        let mut known = Compliance::default();
        for k in 0..20 {
            known.learn(
                &at(1e-3 + 1e-4 * f64::from(k), 0.0, body),
                &at(1e-3 + 1e-4 * f64::from(k + 1), 0.0, body),
                ARM,
            );
        }
        known
    }

    #[test]
    fn pressing_in_and_letting_go_tell_of_the_body_in_series() {
        let mut known = pressed(BODY);
        assert!((known.value() * BODY - 1.0).abs() < 0.01, "compliance {} m/N", known.value());
        for k in (0..20).rev() {
            known.learn(
                &at(1e-3 + 1e-4 * f64::from(k + 1), 0.0, 100.0),
                &at(1e-3 + 1e-4 * f64::from(k), 0.0, 100.0),
                ARM,
            );
        }
        assert!((known.value() * 100.0 - 1.0).abs() < 0.01, "compliance {} m/N", known.value());
        // A body that does not yield at all.
        assert!(pressed(1e12).value() < 1e-9);
    }

    /// A body with a damper beside its spring, pressed in quickly, at rest, and let go quickly: with the retardation
    /// time its compliance is learned to a few per cent, and the tool's mean velocity is known; without it a body that
    /// is stiffer by far is learned from the ends of the motions.
    #[test]
    fn a_damper_beside_the_spring_is_told_apart_from_it() {
        let (retardation, took) = (4e-3, 0.01);
        let felt = 1.0 / (1.0 / CONTACT + 1.0 / BODY);
        let damping = retardation / BODY * felt * felt;
        let depths = [1.0, 1.0, 2.2, 3.4, 4.6, 4.6, 4.61, 4.6, 4.6, 3.4];
        let wrenches: Vec<ContactWrench> = (1..depths.len())
            .map(|k| {
                let [last, depth] = [depths[k - 1], depths[k]].map(|depth: f64| 1e-3 * depth);
                let mut wrench = ContactWrench { h: took, ..at(depth, 0.0, BODY) };
                wrench.wrench.force += damping * (depth - last) / took * DVec3::Y;
                wrench
            })
            .collect();
        let learned = |retardation: f64| {
            let mut known = Compliance::default();
            let near = Gap { retardation, ..above(1e-3, 1.0 / BODY).gap.unwrap() };
            let before = ContactWrench { gap: Some(near), ..above(1e-3, 1.0 / BODY) };
            known.learn(&before, &before, ARM);
            known.learn(&wrenches[0], &wrenches[0], ARM);
            for pair in wrenches.windows(2) {
                known.learn(&pair[0], &pair[1], ARM);
                let mean = (pair[1].tool.position - pair[0].tool.position) / took;
                assert!((known.twist().unwrap() - vector(mean, DVec3::ZERO)).norm() < 1e-12);
                if retardation > 0.0 {
                    assert!((known.value() * BODY - 1.0).abs() < 0.05, "compliance {} m/N", known.value());
                }
            }
            known.value() * BODY
        };
        assert!((learned(retardation) - 1.0).abs() < 0.01 && (learned(0.0) - 1.0).abs() > 0.05);
    }

    #[test]
    fn rest_slides_and_relaxation_tell_nothing() {
        let known = pressed(BODY);
        let mut after = known;
        for _ in 0..1000 {
            after.learn(&at(2e-3, 0.0, BODY), &at(2e-3, 0.0, 1.0001 * BODY), ARM);
        }
        // The force changes although the tool rests; then it slides; then it falls while the tool sinks in.
        after.learn(&at(2e-3, 0.0, BODY), &at(2e-3, 0.0, 2.0 * BODY), ARM);
        after.learn(&at(2e-3, 0.0, BODY), &at(2.1e-3, 0.002, 2.0 * BODY), ARM);
        after.learn(&at(2e-3, 0.0, BODY), &at(2.1e-3, 0.0, 0.5 * BODY), ARM);
        assert_eq!(after.value().to_bits(), known.value().to_bits());
        // A force that changes by a thousandth while the tool moves little: noise of the solver.
        after.learn(&at(2e-3, 0.0, BODY), &at(2e-3 + 1e-9, 0.0, 1.001 * BODY), ARM);
        assert!((after.value() / known.value() - 1.0).abs() < 0.005);
    }

    /// A contact that goes on from a rigid body to a soft one, and turning, which moves the contact but not the centre.
    #[test]
    fn a_rigid_body_is_forgotten_and_a_turn_tells_nothing() {
        let mut known = pressed(1e12);
        for k in 0..9 {
            known.learn(
                &at(1e-3 + 1e-4 * f64::from(k), 0.0, BODY),
                &at(1e-3 + 1e-4 * f64::from(k + 1), 0.0, BODY),
                ARM,
            );
        }
        assert!((known.value() * BODY - 1.0).abs() < 0.1, "compliance {} m/N", known.value());
        let (before, mut turned) = (known, at(2e-3 + 1e-6, 0.0, 2.0 * BODY));
        turned.tool.orientation = DQuat::from_rotation_z(0.05);
        known.learn(&at(2e-3, 0.0, BODY), &turned, ARM);
        // Nor does a jump, or a body that moves by itself.
        known.learn(&at(2e-3, 0.0, BODY), &at(5e-2, 0.0, BODY), ARM);
        known.learn(&at(2e-3, 0.0, BODY), &ContactWrench { has_kinematic_motion: true, ..at(3e-3, 0.0, 900.0) }, ARM);
        assert_eq!(known, before);
        let mut huge = at(3e-3, 0.0, BODY);
        (huge.wrench.force.y, huge.stiffness[1][1]) = (1e200, 1e-310);
        known.learn(&at(2e-3, 0.0, BODY), &huge, ARM);
        assert!(known.value().is_finite());
        huge.stiffness[1][1] = 1e200;
        known.learn(&at(2e-3, 0.0, BODY), &huge, ARM);
        assert!(known.value().is_finite());
    }

    #[test]
    fn one_sample_far_off_does_not_last() {
        let mut known = pressed(BODY);
        known.learn(&at(1e-3, 0.0, BODY), &at(1.1e-3, 0.0, 0.92 * BODY), ARM);
        let ratio = known.value() * BODY;
        assert!((1.1..1.5).contains(&ratio), "{ratio} times the compliance");
        for k in 0..4 {
            known.learn(
                &at(1e-3 + 1e-4 * f64::from(k), 0.0, BODY),
                &at(1e-3 + 1e-4 * f64::from(k + 1), 0.0, BODY),
                ARM,
            );
        }
        assert!((known.value() * BODY - 1.0).abs() < 0.01);
    }

    #[test]
    fn before_contact_the_estimate_counts_until_the_first_touch_tells_more() {
        let mut known = Compliance::default();
        known.learn(&at(-3e-3, 0.0, BODY), &above(1e-3, 3e-3), ARM);
        assert_eq!(known.value(), 3e-3);
        // The first wrench is at a depth of 1 mm. Its secant is taken for that of Hertz's law, 2/3 of the tangent.
        known.learn(&above(1e-3, 3e-3), &at(1e-3, 0.0, BODY), ARM);
        let first = 1.0 / (1.5 / (1.0 / CONTACT + 1.0 / BODY)) - 1.0 / CONTACT;
        assert!((known.value() - (0.2 * 3e-3 + 0.8 * first)).abs() < 1e-12);
        // What was learned outlasts the contact, but not the way to another body.
        let learned = known;
        known.learn(&at(1e-3, 0.0, BODY), &above(1e-3, 3e-3), ARM);
        assert_eq!(known, learned);
        known.learn(&above(1e-3, 3e-3), &above(1e-3, 0.0), ARM);
        assert_eq!(known.value(), 0.0);
        // What is touched need not be what was nearest: the first touch tells of the body in that direction.
        let [soft, hard] = [3e-3, 0.0].map(|compliance| above(1e-3, compliance).gap.unwrap());
        let beside = ContactWrench {
            gap: Some(Gap { normal: DVec3::X, distance: 5e-4, ..hard }),
            farther: [Some(soft), None, None, None, None],
            ..above(1e-3, 0.0)
        };
        known.learn(&beside, &at(1e-3, 0.0, BODY), ARM);
        assert!((known.value() - (0.2 * 3e-3 + 0.8 * first)).abs() < 1e-12 && known.pair == Some(soft.pair));
    }
}
