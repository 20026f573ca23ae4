//! All soft bodies of a scene as one, for the stability matrix (many stiff and extreme simulations, each judged by
//! invariants): energies and equations of several bodies in contact are those of a single body whose mesh falls into
//! parts.

use palpate::internal::prepare::supports::{Freedom, Supports};
use palpate::internal::prepare::{Body, Layer, Materials, Shape};
use palpate::{Error, Result};
use palpate_oracle::contact_law::auto_stiffness;

/// The soft bodies of a scene, joined.
pub struct Joined {
    /// Layers (tetrahedral meshes) one after the other, in the axes of the first body. The layers have no patches.
    pub layer: Layer,
    /// Materials of the tetrahedra.
    pub materials: Materials,
    /// What supports leave to the nodes.
    pub supports: Supports,
    /// For each body its number of nodes.
    pub nodes: Vec<usize>,
    /// For each skin vertex the nodes, with weights, by which it is embedded in the layer.
    pub vertices: Vec<Vec<(usize, f64)>>,
    /// Vertices of the skins' triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Contact stiffness that the engine chooses for a scene of these bodies, N/m^3.
    pub auto_stiffness: f64,
}

/// Joins the soft bodies at the beginning of `bodies`, which all have the orientation of the first. The engine numbers
/// the vertices and triangles of all skins in the order of the bodies, so that a contact's numbers are those of the
/// joined skin. Errors: the first body is not soft.
pub fn joined(bodies: &[Body]) -> Result<Joined> {
    let mut all = Joined {
        layer: Layer { nodes: Vec::new(), tetrahedra: Vec::new(), attached: Vec::new(), patches: Vec::new() },
        materials: Materials { all: Vec::new(), which: Vec::new() },
        supports: Supports::default(),
        nodes: Vec::new(),
        vertices: Vec::new(),
        triangles: Vec::new(),
        auto_stiffness: 0.0,
    };
    let mut own = Vec::new();
    for body in bodies {
        let Shape::Soft { layer, materials, supports, embedding, skin, .. } = &body.shape else { break };
        let (node, vertex) = (all.layer.nodes.len(), all.vertices.len() as u32);
        let material = all.materials.all.len() as u32;
        let away = body.position - bodies[0].position;
        all.layer.nodes.extend(layer.nodes.iter().map(|x| *x + away));
        all.layer.tetrahedra.extend(layer.tetrahedra.iter().map(|t| t.map(|i| node as u32 + i)));
        all.layer.attached.extend(&layer.attached);
        let of_node = |n: usize| supports.freedom.get(n).copied().unwrap_or(Freedom::Free);
        all.supports.freedom.extend((0..layer.nodes.len()).map(of_node));
        let which = (0..layer.tetrahedra.len()).map(|e| material + materials.index(e) as u32);
        all.materials.which.extend(which);
        all.materials.all.extend(&materials.all);
        all.nodes.push(layer.nodes.len());
        all.vertices.extend(embedding.iter().map(|embedded| {
            let corners = layer.tetrahedra[embedded.tetrahedron as usize];
            corners.iter().zip(embedded.weights).map(|(i, weight)| (node + *i as usize, weight)).collect()
        }));
        all.triangles.extend(skin.triangles.iter().map(|corners| corners.map(|i| vertex + i)));
        own.push((layer, &materials.all[0]));
    }
    let none = || Error::Simulation("the stability matrix needs a soft body first in the scene".into());
    all.auto_stiffness = auto_stiffness(&own).ok_or_else(none)?;
    Ok(all)
}
