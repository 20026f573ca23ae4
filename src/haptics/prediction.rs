//! How well the local contact model foretells the next contact wrench of the simulation.

use super::compliance::Compliance;
use super::local_model::LocalModel;
use crate::step::ContactWrench;

/// Forces below this are too small to compare a predicted change with the observed one, N.
const FELT: f64 = 0.02;

/// Follows the wrenches of a run of the haptic loop, and predicts each from the one before it.
#[derive(Debug, Clone)]
pub struct Prediction {
    arm: f64,
    body: Compliance,
    last: Option<ContactWrench>,
}

impl Prediction {
    /// Begins before the first wrench; `arm` is the tool's lever arm, m.
    pub fn new(arm: f64) -> Prediction {
        Prediction { arm, body: Compliance::default(), last: None }
    }

    /// Takes the next wrench. Returns the predicted and the observed change of force since the last one, N, along that
    /// one's force; `None` where one of the two forces is too small to compare.
    pub fn take(&mut self, wrench: &ContactWrench) -> Option<[f64; 2]> {
        let last = self.last.replace(*wrench)?;
        let model = LocalModel::new(&last, &self.body, self.arm, f64::INFINITY);
        self.body.learn(&last, wrench, self.arm);
        if last.wrench.force.length() <= FELT || wrench.wrench.force.length() <= FELT {
            return None;
        }
        let (along, predicted) = model.foretell(&wrench.tool, self.body.twist())?;
        Some([predicted, along.dot(wrench.wrench.force - last.wrench.force)])
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::step::RigidState;

    /// A contact of 1200 N/m on a body with which it is felt as 300 N/m, pressed deeper by 0.1 mm each time.
    #[test]
    fn the_first_change_is_predicted_without_the_body_and_the_later_ones_with_it() {
        let mut prediction = Prediction::new(0.01);
        let changes: Vec<Option<[f64; 2]>> = (0..30)
            .map(|k| {
                let depth = 1e-4 * f64::from(k);
                let tool = RigidState::at_rest(DVec3::Y * -depth, DQuat::IDENTITY);
                let mut wrench = ContactWrench::none(tool);
                wrench.wrench.force = DVec3::Y * 300.0 * depth;
                wrench.stiffness[1][1] = 1200.0;
                prediction.take(&wrench)
            })
            .collect();
        // There is no last wrench at first, and then no force.
        assert_eq!(changes[..2], [None; 2]);
        let [predicted, observed] = changes[2].unwrap();
        assert!((observed - 0.03).abs() < 1e-12 && (predicted - 0.12).abs() < 0.03);
        let [predicted, observed] = changes[29].unwrap();
        assert!((predicted - observed).abs() < 1e-3 * observed, "predicted {predicted} N, observed {observed} N");
    }
}
