//! Bodies for the contact tests, in the form in which the engine prepares the bodies of a scene: spheres, flat sheets,
//! half-spaces, and skins (surface meshes) embedded in a layer (tetrahedral mesh).

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::{self, Body, FrameMotion, Proxy, Shape, Skin, hull, layer, skin};
use palpate::scene::Material;

/// A triangle mesh: vertices, m, and the vertex indices of each triangle.
pub type Mesh = (Vec<DVec3>, Vec<[u32; 3]>);

/// A sphere whose triangles face outwards. It is made of an octahedron: `halvings` times, all edges are halved, so that
/// four triangles take the place of each. All vertices lie at the distance `radius` (m) from the origin.
pub fn sphere(radius: f64, halvings: u32) -> Mesh {
    let mut points: Vec<DVec3> = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z].into();
    let mut triangles: Vec<[u32; 3]> =
        vec![[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
    for _ in 0..halvings {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let mut finer = Vec::new();
        for &[a, b, c] in &triangles {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (points.into_iter().map(|p| p * radius).collect(), triangles)
}

/// A body of revolution about the y axis: `profile` gives radius and height (m) of each ring of vertices, from the lowest
/// up; the lowest and the highest ring are closed by flat ends.
pub fn lathe(profile: &[(f64, f64)], sides: u32) -> Mesh {
    let at = |(radius, y): (f64, f64), k: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(sides)).sin_cos();
        DVec3::new(radius * cos, y, radius * sin)
    };
    let mut points: Vec<DVec3> = profile.iter().flat_map(|ring| (0..sides).map(|k| at(*ring, k))).collect();
    let (rings, ends) = (profile.len() as u32, points.len() as u32);
    points.extend([profile[0], profile[profile.len() - 1]].map(|(_, y)| DVec3::new(0.0, y, 0.0)));
    let mut triangles = Vec::new();
    for k in 0..sides {
        let next = (k + 1) % sides;
        for ring in 0..rings - 1 {
            let [a, b, c, d] = [k, next, k + sides, next + sides].map(|v| v + ring * sides);
            triangles.extend([[a, c, b], [b, c, d]]);
        }
        let top = (rings - 1) * sides;
        triangles.extend([[ends, k, next], [ends + 1, top + next, top + k]]);
    }
    (points, triangles)
}

/// A square sheet in the plane y = 0 that faces up and reaches from -`half` to `half` (m) along x and z. It is divided
/// into `cells` x `cells` squares of two triangles each.
pub fn sheet(half: f64, cells: u32) -> Mesh {
    let at = |i: u32| (f64::from(i) / f64::from(cells) * 2.0 - 1.0) * half;
    let points = (0..=cells).flat_map(|z| (0..=cells).map(move |x| (x, z)));
    let points = points.map(|(x, z)| DVec3::new(at(x), 0.0, at(z))).collect();
    let index = |x: u32, z: u32| z * (cells + 1) + x;
    let squares = (0..cells).flat_map(|z| (0..cells).map(move |x| (x, z)));
    let halves = squares.flat_map(|(x, z)| {
        let [a, b, c, d] = [index(x, z), index(x + 1, z), index(x, z + 1), index(x + 1, z + 1)];
        [[a, c, b], [b, c, d]]
    });
    (points, halves.collect())
}

/// Collision proxies (convex hulls that cover the skin): one for each octant of space that contains the centroid of a
/// triangle. There are up to eight of them, so that several proxies take part even where the skin as a whole is convex.
pub fn octants(skin: &Skin) -> Vec<Proxy> {
    let mut proxies = vec![Proxy::default(); 8];
    let mut owned = vec![false; skin.vertices.len()];
    for (t, corners) in skin.triangles.iter().enumerate() {
        let c: DVec3 = corners.iter().map(|v| skin.vertices[*v as usize]).sum();
        let part = usize::from(c.x > 0.0) + 2 * usize::from(c.y > 0.0) + 4 * usize::from(c.z > 0.0);
        proxies[part].triangles.push(t as u32);
        for &v in corners {
            if !owned[v as usize] {
                owned[v as usize] = true;
                proxies[part].vertices.push(v);
            }
        }
    }
    proxies.retain(|p| !p.triangles.is_empty());
    for proxy in &mut proxies {
        let corners = proxy.triangles.iter().flat_map(|t| skin.triangles[*t as usize]);
        let points: Vec<DVec3> = corners.map(|v| skin.vertices[v as usize]).collect();
        let hull = hull::reduced(&points).unwrap();
        proxy.margin = points.iter().map(|x| hull.height(*x)).fold(0.0, f64::max);
        (proxy.hull, proxy.faces) = (hull.vertices, hull.faces);
    }
    proxies
}

/// A body at rest on which nothing acts.
fn placed(name: &str, shape: Shape, position: DVec3, orientation: DQuat) -> Body {
    Body {
        name: name.into(),
        shape,
        position,
        orientation,
        velocity: DVec3::ZERO,
        loads: vec![],
        report: Default::default(),
    }
}

/// A rigid body with this mesh as its skin; the function `cut` makes the collision proxies of the skin.
pub fn rigid(name: &str, mesh: Mesh, cut: fn(&Skin) -> Vec<Proxy>, position: DVec3, orientation: DQuat) -> Body {
    let skin = skin::build(mesh.0, mesh.1);
    let proxies = cut(&skin);
    let (volume, centroid, inertia, motion) = (1.0, DVec3::ZERO, DMat3::IDENTITY, FrameMotion::Fixed);
    let shape = Shape::Rigid { skin, proxies, volume, centroid, inertia, motion };
    placed(name, shape, position, orientation)
}

/// The collision proxies that the engine itself makes for a skin: one hull, or as many as the skin's shape needs.
pub fn whole(skin: &Skin) -> Vec<Proxy> {
    prepare::proxies(skin).unwrap()
}

/// A soft body with this mesh as its skin. The skin is embedded in a somewhat larger box of Kuhn cells (cuboids of six
/// tetrahedra each), and no node is attached to a rigid body.
pub fn soft(name: &str, mesh: Mesh, cut: fn(&Skin) -> Vec<Proxy>, position: DVec3, orientation: DQuat) -> Body {
    let reach = mesh.0.iter().fold(DVec3::ZERO, |reach, x| reach.max(x.abs()));
    let layer = layer::kuhn_box(-1.05 * reach, 1.05 * reach, [4, 4, 4]);
    let embedding = prepare::embed(&mesh.0, &layer).unwrap();
    let material = Material { damping_mass: 0.0, damping_stiffness: 0.0, ..crate::solver::system::material(2e4) };
    let materials = material.into();
    let skin = skin::build(mesh.0, mesh.1);
    let proxies = cut(&skin);
    let (frames, node_frames) = (vec![crate::solver::system::middle(&layer)], vec![0; layer.nodes.len()]);
    let supports = Default::default();
    let shape =
        Shape::Soft { layer, frames, node_frames, supports, joints: vec![], materials, embedding, skin, proxies };
    placed(name, shape, position, orientation)
}

/// The fixed half-space of all points x with `normal` . x < `offset` (m).
pub fn half_space(normal: DVec3, offset: f64) -> Body {
    let (position, orientation) = (DVec3::ZERO, DQuat::IDENTITY);
    let shape = Shape::Plane { normal, offset };
    placed("floor", shape, position, orientation)
}
