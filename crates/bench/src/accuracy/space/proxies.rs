//! The curve `proxies` of `palpate bench accuracy`: the force on a ball that is pressed into a head must not depend on
//! the number of collision proxies (convex hulls for the broad phase), since these only select which parts may touch.

use palpate::Result;

use super::press::{Body, Press};
use super::{at_rest, entrant, error_against, force};
use crate::accuracy::race::{Entrant, race};
use crate::accuracy::{Curve, Judged, Settings};

/// Largest numbers of convex hulls that a body may have, one for each setting.
const HULLS: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];
/// Largest number of hulls of the reference, which is none of [`HULLS`].
const REFERENCE: u32 = 40;
/// Number of vertices of the head's skin (surface mesh): in the whole benchmark and in its short form.
const VERTICES: [usize; 2] = [20_000, 8_000];
/// Radius of the ball, m.
const RADIUS: f64 = 0.02;
/// Largest allowed relative error of the force with any number of hulls; only rounding may differ.
const BOUND: f64 = 1e-3;
/// Stages of a time step whose times are summed.
const STAGES: &[&str] = &["cull"];

/// Measures the force on a head with different numbers of collision proxies.
pub fn by_proxies(settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Curve> {
    let vertices = VERTICES[usize::from(settings.is_quick)];
    let press = |hulls: u32| Press { radius: RADIUS, ..Press::new(Body::Head(vertices, Some(hulls))) };
    watch("reference");
    let reference = force(&press(REFERENCE).scene(), settings)?;
    let entrants: Vec<Entrant> =
        HULLS.iter().map(|&hulls| entrant(&press(hulls), "", "", format!("{hulls} at most"), hulls.into())).collect();
    let options = settings.options();
    let rules = settings.rules(STAGES, &options);
    let mut forces = Vec::new();
    let points = race(entrants, &rules, watch, &mut |_, run| {
        forces.push(at_rest(run).length());
        error_against(reference, run)
    })?;
    let (low, high) = forces.iter().fold((f64::INFINITY, 0.0f64), |(low, high), &f| (low.min(f), high.max(f)));
    Ok(Curve {
        name: "proxies".into(),
        title: "Number of proxies".into(),
        question: format!(
            "Does the force depend on the collision proxies, and how much time do they save? A ball of 2 cm radius \
             goes 3 mm into the cheek of a head of {vertices} skin vertices with ever more convex hulls; the \
             reference has at most {REFERENCE} hulls."
        ),
        knob: "convex hulls at most".into(),
        stage: STAGES.concat(),
        points,
        expected: None,
        span_reason: format!(
            "collision proxies only select which parts may touch: forces with 1 to {} hulls lie within {:.1e} of each \
             other (relative)",
            HULLS[HULLS.len() - 1],
            high / low - 1.0
        ),
        bound: BOUND,
        judged: Judged::Every,
        ..Curve::default()
    })
}
