//! Part `peers` of `palpate bench proximity`: compares palpate's query, which finds the contacts between a pumpkin and
//! a head in one pose, with a method of closest points. This method finds, for each vertex of the pumpkin, the nearest
//! point of the head's surface and whether the vertex is inside, by a bounding volume hierarchy (parry3d, f64) on one
//! CPU core. Both bodies are rigid; a head that deforms would need its hierarchy refitted in each step, and the time of
//! a refit is measured too.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use glam::{DQuat, DVec3};
use palpate::internal::query::QuerySettings;
use palpate::scene::Model;
use palpate::{Context, Error, Query, Result};
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{TriMesh, TriMeshFlags};
use serde::{Deserialize, Serialize};

use super::patches::{Place, measure_one};
use super::{Settings, rigid};
use crate::median;

/// Factor by which the pumpkin is scaled, so that its vertices are about as far apart as those of the head.
const SCALE: f64 = 0.5;
/// Position of the pumpkin's centre, m, before the pumpkin is moved along -z. The distance of this move is found by a
/// search for the pose with the wanted number of vertices inside the head.
const BEHIND: DVec3 = DVec3::new(0.0, 0.03, 0.0);
/// Least and greatest distance that the search for the pose considers, m.
const DISTANCES: [f64; 2] = [0.11, 0.5];
/// Bisection steps of the search for the pose.
const HALVINGS: usize = 24;
/// One refit is measured for this many runs of closest points, since refits take longer and their times vary less.
const REFIT_EVERY: usize = 10;

/// Sizes and times of both methods.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Peers {
    /// Numbers of vertices of the pumpkin and of the head.
    pub vertices: [usize; 2],
    /// Number of the pumpkin's vertices that lie inside the head, as found by closest points.
    pub inside: usize,
    /// Number of the pumpkin's vertices in the intersection of the two bodies' bounding boxes.
    pub boxed: usize,
    /// Numbers of the vertices of the pumpkin and of the head that lie within the other body, as found by palpate's
    /// query.
    pub colliding: [usize; 2],
    /// Results of palpate's query.
    #[serde(flatten)]
    pub place: Place,
    /// Greatest distance up to which closest points are searched, m: the depth beyond which palpate's query warns.
    pub reach: f64,
    /// Time of the closest points for the pumpkin's vertices in the intersection of the bounding boxes, us; one entry
    /// for each run. These vertices are selected anew in each run.
    pub boxed_us: Vec<f64>,
    /// Time of the closest points for all vertices of the pumpkin, us; one entry for each run.
    pub all_us: Vec<f64>,
    /// Time to refit the head's hierarchy after its vertices moved, us; one entry for each refit.
    pub refit_us: Vec<f64>,
}

impl Peers {
    /// Median time of the closest points for the vertices in the intersection of the bounding boxes, ms.
    pub fn boxed_ms(&self) -> f64 {
        1e-3 * median(&self.boxed_us)
    }

    /// Median time of the closest points for all vertices of the pumpkin, ms.
    pub fn all_ms(&self) -> f64 {
        1e-3 * median(&self.all_us)
    }

    /// Median time to refit the head's hierarchy, ms.
    pub fn refit_ms(&self) -> f64 {
        1e-3 * median(&self.refit_us)
    }
}

/// Finds a pose in which about the wanted number of the pumpkin's vertices lie inside the head, and measures both
/// methods in this pose.
pub fn peers(context: &Arc<Context>, settings: &Settings, watch: &mut dyn FnMut(&str)) -> Result<Peers> {
    let [pumpkin_count, head_count] = settings.peer_vertices;
    watch(&format!("peers: a pumpkin of {pumpkin_count} vertices and a head of {head_count}"));
    let (points, pumpkin_triangles) = palpate::internal::prepare::model::surface(Model::Pumpkin, pumpkin_count);
    let points: Vec<DVec3> = points.into_iter().map(|x| SCALE * x).collect();
    let (head_points, head_triangles) = palpate::internal::prepare::model::surface(Model::Head, head_count);
    let mut tree = tree(&head_points, &head_triangles)?;
    let head_box = bounds(&head_points);
    let head = rigid("head", head_points, head_triangles)?;
    let pumpkin = rigid("pumpkin", points.clone(), pumpkin_triangles)?;

    let placed = |distance: f64| -> Vec<Vector> {
        let at = BEHIND - DVec3::Z * distance;
        points.iter().map(|x| *x + at).map(|x| Vector::new(x.x, x.y, x.z)).collect()
    };
    // All of the pumpkin's vertices lie in the pumpkin's bounding box. Its vertices in the head's bounding box are
    // therefore those in the intersection of both boxes.
    let in_box = |x: &&Vector| (0..3).all(|k| (head_box[0][k]..=head_box[1][k]).contains(&x[k]));
    let inside = |points: &[Vector]| closest(&tree, points.iter().filter(in_box), f64::MAX).0;
    let [mut near, mut far] = DISTANCES;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (near + far);
        if inside(&placed(middle)) > settings.peer_colliding {
            near = middle;
        } else {
            far = middle;
        }
    }
    let all = placed(far);

    let query_settings = QuerySettings::of(&head, &pumpkin);
    let mut query = Query::on_device(context, &head, &pumpkin, &query_settings)?;
    let pose = (BEHIND - DVec3::Z * far, DQuat::IDENTITY);
    watch(&format!("peers: {} runs of each", settings.runs));
    let place = measure_one(&mut query, pose, settings)?;
    let answer = query.run((DVec3::ZERO, DQuat::IDENTITY), pose)?;
    let of = |body: usize| answer.contacts.iter().filter(|contact| contact.body == body).count();
    let mut peers = Peers {
        vertices: [points.len(), settings.peer_vertices[1]],
        inside: inside(&all),
        boxed: all.iter().filter(in_box).count(),
        colliding: [of(1), of(0)],
        place,
        reach: query_settings.depth_limit,
        ..Peers::default()
    };
    for _ in 0..settings.runs {
        peers.boxed_us.push(time(|| closest(&tree, black_box(&all).iter().filter(in_box), peers.reach)));
        peers.all_us.push(time(|| closest(&tree, black_box(&all).iter(), peers.reach)));
    }
    let moved: Vec<Vector> = tree.vertices().to_vec();
    for _ in 0..settings.runs.div_ceil(REFIT_EVERY) {
        peers.refit_us.push(time(|| tree.set_vertices(black_box(&moved))));
    }
    Ok(peers)
}

/// A triangle mesh of parry3d, with its bounding volume hierarchy, that can distinguish inside from outside.
fn tree(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<TriMesh> {
    let points = vertices.iter().map(|x| Vector::new(x.x, x.y, x.z)).collect();
    TriMesh::with_flags(points, triangles.to_vec(), TriMeshFlags::ORIENTED)
        .map_err(|problem| Error::Simulation(format!("parry3d refuses the head: {problem}")))
}

/// Number of points that are inside the mesh, and the sum of their depths (m). Points farther than `reach` (m) from the
/// surface do not count.
fn closest<'a>(tree: &TriMesh, points: impl Iterator<Item = &'a Vector>, reach: f64) -> (usize, f64) {
    let nearest =
        points.filter_map(|&point| Some((point, tree.project_local_point_with_max_dist(point, false, reach)?)));
    nearest
        .filter(|(_, nearest)| nearest.is_inside)
        .fold((0, 0.0), |(count, depth), (point, nearest)| (count + 1, depth + (nearest.point - point).length()))
}

/// Time that `work` takes, us.
fn time<T>(work: impl FnOnce() -> T) -> f64 {
    let begun = Instant::now();
    black_box(work());
    begun.elapsed().as_secs_f64() * 1e6
}

fn bounds(points: &[DVec3]) -> [DVec3; 2] {
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    [low, points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max)]
}
