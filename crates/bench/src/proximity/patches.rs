//! The parts `sensitivity` and `area` of `palpate bench proximity`: they time the query (the stages of a step that find
//! contacts) for the same contact patch on ever larger skins (surface meshes), and for ever larger contact patches on
//! one skin. A contact patch is an area with one normal where two bodies may touch.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use palpate::internal::query::QuerySettings;
use palpate::internal::query::Timing;
use palpate::{Context, Query, Result};
use serde::{Deserialize, Serialize};

use super::graded::{Family, Graded};
use super::{Settings, counts, rigid};
use crate::Samples;

/// Bodies of the part `sensitivity`, which differ in their number of vertices but are identical within the contact
/// patch.
const BODY: Family = Family { radius: 0.1, cap: 0.015, spacing: 0.0005, is_lobed: true };
/// The ball that is pressed into the bodies of the part `sensitivity`; at the contact its triangles have the same size
/// as those of the bodies.
const BALL: Family = Family { radius: 0.02, cap: 0.01, spacing: 0.0005, is_lobed: false };
/// Approximate number of vertices of the ball.
const BALL_VERTICES: usize = 6_000;
/// Depth to which the ball is pressed into the bodies, m.
const BALL_DEPTH: f64 = 0.001;
/// Horizontal offset of the upper body from the lower body's pole (its highest point), m. With this offset and the
/// rotation by [`TURN`], no two vertices coincide in the contact plane.
const BESIDE: DVec3 = DVec3::new(0.0007, 0.0004, 0.0);
/// Rotation of the upper body about the axis through its poles, rad.
const TURN: f64 = 0.3;
/// Both bodies of the part `area`, which are equal.
const BROAD: Family = Family { radius: 0.1, cap: 0.06, spacing: 0.0008, is_lobed: true };
/// Distance between the two skins in the pose without contact, m; it is so short that the query still has to test some
/// vertices.
const GAP: f64 = 0.0005;
/// In the part `area` the number of runs of each pose is divided by this, since there are many poses and some take
/// long.
const AREA_RUNS: usize = 2;

/// What the query found in one pose of two bodies, and the times that it took.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Place {
    /// Number of contacts: vertices of both skins that lie within the other body.
    pub contacts: usize,
    /// Number of chunks of both skins (groups of at most 64 vertices that are culled together) that culling kept.
    pub chunks: u32,
    /// Total area of the contacts, projected along the contact normals, m^2.
    pub area: f64,
    /// Greatest depth of a contact, m.
    pub max_depth: f64,
    /// Names of the flags (warnings) that the query raised.
    pub flags: Vec<String>,
    /// Times of the stages, and of the query as a whole, us.
    pub samples_us: Samples,
}

/// Results for the contact patch on a skin of one size.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Sensitivity {
    /// Number of vertices of the skin.
    pub vertices: usize,
    /// Number of triangles of the skin.
    pub triangles: usize,
    /// Number of the body's collision proxies (convex hulls).
    pub proxies: usize,
    /// Time to prepare the body, most of it for the collision proxies, s.
    pub prepare_seconds: f64,
    /// Results of the query.
    #[serde(flatten)]
    pub place: Place,
}

/// Results for a body that is pressed into another one of the same shape.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Area {
    /// Number of vertices of each skin.
    pub vertices: usize,
    /// Area of the circle in which the bodies would intersect if they were spheres without the grooves between their
    /// lobes (`is_lobed`), m^2; [`Place::area`] is the area that the query found.
    pub circle: f64,
    /// Results of the query.
    #[serde(flatten)]
    pub place: Place,
}

/// One pose in which a query is run: the index of the query, and the pose of the second of its two bodies.
pub struct Case {
    query: usize,
    pose: (DVec3, DQuat),
}

/// Runs all cases in turn, so that a change of the machine's speed affects all of them, and returns a [`Place`] for
/// each case. The times of the first runs are not counted; after these runs, caches hold what the query needs, as in
/// the steps of a simulation. Runs are timed alternately stage by stage and as a whole.
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

/// Measures one query in one pose of its second body.
pub fn measure_one(query: &mut Query, pose: (DVec3, DQuat), settings: &Settings) -> Result<Place> {
    let places = measure(std::slice::from_mut(query), &[Case { query: 0, pose }], settings)?;
    Ok(places.into_iter().next().unwrap_or_default())
}

/// Measures the same contact patch on skins of all sizes.
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

/// Measures two bodies of the same shape that are pressed together ever deeper.
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

/// A pose of the second body in which its pole points at the first body's pole and its centre lies `height` (m) above
/// the first body's centre.
fn against(height: f64) -> (DVec3, DQuat) {
    let turned = DQuat::from_rotation_x(std::f64::consts::PI) * DQuat::from_rotation_z(TURN);
    (BESIDE + DVec3::Z * height, turned)
}
