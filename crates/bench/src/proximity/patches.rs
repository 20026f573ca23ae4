//! Skins that are alike where they touch: one patch on ever larger skins, and ever larger patches on one skin.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use palpate::internal::query::QuerySettings;
use palpate::internal::query::Timing;
use palpate::{Context, Query, Result};
use serde::{Deserialize, Serialize};

use super::graded::{Family, Graded};
use super::{Settings, counts, rigid};
use crate::Samples;

/// Bodies that share a patch.
const BODY: Family = Family { radius: 0.1, cap: 0.015, spacing: 0.0005, is_lobed: true };
/// What is pressed into it, as fine there.
const BALL: Family = Family { radius: 0.02, cap: 0.01, spacing: 0.0005, is_lobed: false };
const BALL_VERTICES: usize = 6_000;
/// m.
const BALL_DEPTH: f64 = 0.001;
/// Beside the pole and turned, so that no two vertices lie over each other.
const BESIDE: DVec3 = DVec3::new(0.0007, 0.0004, 0.0);
/// rad.
const TURN: f64 = 0.3;
/// Both bodies of the area's series.
const BROAD: Family = Family { radius: 0.1, cap: 0.06, spacing: 0.0008, is_lobed: true };
/// Between skins that do not touch, m: near enough that something has to be looked at.
const GAP: f64 = 0.0005;
/// Poses of the area's series are many and some take long: each has this part of the runs.
const AREA_RUNS: usize = 2;

/// What a query found, and what it took.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Place {
    /// Colliding vertices of both skins.
    pub contacts: usize,
    /// Chunks of both skins, at most 64 vertices each, that were looked at.
    pub chunks: u32,
    /// Projected on the normal, m^2.
    pub area: f64,
    /// m.
    pub max_depth: f64,
    /// Names of the flags that were raised.
    pub flags: Vec<String>,
    /// Microseconds, a run each.
    pub samples_us: Samples,
}

/// One patch on a skin of some size.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Sensitivity {
    /// Of the skin.
    pub vertices: usize,
    /// Of the skin.
    pub triangles: usize,
    /// Of the skin.
    pub proxies: usize,
    /// Preparing its proxies, s.
    pub prepare_seconds: f64,
    /// The query.
    #[serde(flatten)]
    pub place: Place,
}

/// One skin pressed into its like.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Area {
    /// Of each skin.
    pub vertices: usize,
    /// Of the circle where both meet, m^2; [`Place::area`] is what was found.
    pub circle: f64,
    /// The query.
    #[serde(flatten)]
    pub place: Place,
}

/// A pose of the second body of one of the queries.
pub struct Case {
    query: usize,
    pose: (DVec3, DQuat),
}

/// Queries in turn, so that a machine that grows faster or slower does so for all of them. Each is asked several times for
/// an answer and the last is timed: what it needs is in the caches, as it is from step to step. Runs are timed by stage and as
/// one in turn, as many of each.
pub fn measure(queries: &mut [Query], cases: &[Case], settings: &Settings) -> Result<Vec<Place>> {
    let mut places = vec![Place::default(); cases.len()];
    for run in 0..settings.warm_up + 2 * settings.runs {
        for (case, place) in cases.iter().zip(&mut places) {
            let query = &mut queries[case.query];
            query.set_timing(if run % 2 == 0 { Timing::Stages } else { Timing::AsOne });
            let answer = query.run((DVec3::ZERO, DQuat::IDENTITY), case.pose)?;
            if run < settings.warm_up {
                continue;
            }
            place.samples_us.add(&answer.stage_times);
            place.contacts = answer.contacts.len();
            place.chunks = answer.counts.chunks;
            place.area = answer.contacts.iter().fold(0.0, |area, contact| area + contact.area);
            place.max_depth = answer.contacts.iter().map(|contact| contact.depth).fold(0.0, f64::max);
            place.flags = answer.flags.names().map(Into::into).collect();
        }
    }
    Ok(places)
}

/// One pose of one query.
pub fn measure_one(query: &mut Query, pose: (DVec3, DQuat), settings: &Settings) -> Result<Place> {
    let places = measure(std::slice::from_mut(query), &[Case { query: 0, pose }], settings)?;
    Ok(places.into_iter().next().unwrap_or_default())
}

/// The same patch on skins of all sizes.
pub fn sensitivity(
    context: &Arc<Context>,
    settings: &Settings,
    watch: &mut dyn FnMut(&str),
) -> Result<Vec<Sensitivity>> {
    let Graded { vertices, triangles } = BALL.member(BALL_VERTICES);
    let ball = rigid("ball", vertices, triangles)?;
    let (mut queries, mut rows) = (Vec::new(), Vec::new());
    for &size in &settings.sizes {
        watch(&format!("sensitivity: a skin of {size} vertices"));
        let Graded { vertices, triangles } = BODY.member(size);
        let begun = std::time::Instant::now();
        let body = rigid("body", vertices, triangles)?;
        let prepare_seconds = begun.elapsed().as_secs_f64();
        let (vertices, triangles, proxies) = counts(&body);
        rows.push(Sensitivity { vertices, triangles, proxies, prepare_seconds, ..Sensitivity::default() });
        queries.push(Query::on_device(context, &body, &ball, &QuerySettings::of(&body, &ball))?);
    }
    watch(&format!("sensitivity: {} runs of each", settings.runs));
    let pose = against(BODY.radius + BALL.radius - BALL_DEPTH);
    let cases: Vec<Case> = (0..queries.len()).map(|query| Case { query, pose }).collect();
    let places = measure(&mut queries, &cases, settings)?;
    rows.iter_mut().zip(places).for_each(|(row, place)| row.place = place);
    Ok(rows)
}

/// Two like skins, deeper and deeper.
pub fn area(context: &Arc<Context>, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Vec<Area>> {
    let settings = &Settings { runs: settings.runs.div_ceil(AREA_RUNS), ..settings.clone() };
    watch(&format!("area: {} poses, {} runs of each", settings.areas_cm2.len(), settings.runs));
    let Graded { vertices, triangles } = BROAD.member(settings.area_vertices);
    let body = rigid("body", vertices, triangles)?;
    let mut queries = [Query::on_device(context, &body, &body, &QuerySettings::of(&body, &body))?];
    let circles: Vec<f64> = settings.areas_cm2.iter().map(|cm2| 1e-4 * cm2).collect();
    let pose = |&circle: &f64| match circle {
        0.0 => against(2.0 * BROAD.radius + GAP),
        _ => against(2.0 * (BROAD.radius.powi(2) - circle / std::f64::consts::PI).sqrt()),
    };
    let cases: Vec<Case> = circles.iter().map(|circle| Case { query: 0, pose: pose(circle) }).collect();
    let places = measure(&mut queries, &cases, settings)?;
    let vertices = counts(&body).0;
    Ok(circles.into_iter().zip(places).map(|(circle, place)| Area { vertices, circle, place }).collect())
}

/// The second body's pole against the first one's, its centre that high above the first one's.
fn against(height: f64) -> (DVec3, DQuat) {
    let turned = DQuat::from_rotation_x(std::f64::consts::PI) * DQuat::from_rotation_z(TURN);
    (BESIDE + DVec3::Z * height, turned)
}
