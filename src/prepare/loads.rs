//! Loads on a body: finds the nodes of the layer (tetrahedral simulation mesh), the triangles of the skin (surface mesh)
//! or the core (rigid part) on which each load of the scene acts.

use super::cores::{self, Numbered};
use super::{Embedding, Layer};
use crate::Result;
use crate::scene::triangles::TriangleMesh;
use crate::scene::{self, Bind, Body, LoadKind};

/// Least magnitude of an embedding weight (by which a skin vertex follows a node) that counts.
const LEAST_WEIGHT: f64 = 1e-6;

/// A load and what it acts on.
#[derive(Debug, Clone)]
pub struct Load {
    /// The load as the scene gives it.
    pub source: scene::Load,
    /// What it acts on.
    pub part: Part,
}

/// What a load acts on.
#[derive(Debug, Clone, PartialEq)]
pub enum Part {
    /// Nodes of the layer.
    Nodes(Vec<u32>),
    /// Triangles of the skin.
    Triangles(Vec<u32>),
    /// The core with this index.
    Core(usize),
}

/// The loads of a body and what they act on. `soft`: the layer and its embedding of a soft body, in file coordinates,
/// with how its file numbers the nodes; `prescribed`: whether each node is attached to a fixed or driven core; `skin` is
/// in file coordinates. `error` makes an error of a key, a problem and a remedy.
///
/// It is an error if a load acts on nothing, or on nothing that forces move and without a reaction that shows it.
pub fn loads(
    body: &Body,
    soft: Option<(&Layer, &[Embedding], &Numbered)>,
    prescribed: &[bool],
    skin: &TriangleMesh,
    error: impl Fn(&str, &str, &str) -> crate::Error,
) -> Result<Vec<Load>> {
    let mut all = Vec::new();
    for load in &body.loads {
        let key = format!("load.{}.bind", load.name);
        let wrong = |(problem, remedy): (String, String)| error(&key, &problem, &remedy);
        let empty =
            |what: &str| wrong((format!("{what} the region: the load acts on nothing"), "enlarge the region".into()));
        let part = match (&load.kind, soft) {
            (LoadKind::Core { core, .. }, _) => {
                Part::Core(body.cores.iter().position(|own| own.name == *core).unwrap_or_default())
            }
            (LoadKind::Force { on, .. }, Some((layer, _, mesh))) => {
                let named = cores::selected(on, layer, mesh, skin).map_err(wrong)?;
                Part::Nodes((0..layer.nodes.len()).filter(|n| named[*n]).map(|n| n as u32).collect())
            }
            (LoadKind::Traction { on, .. } | LoadKind::Pressure { on, .. }, Some((layer, embedding, mesh))) => {
                let is_in = vertices(on, layer, embedding, mesh, skin).map_err(wrong)?;
                let triangles = skin.triangles.iter().zip(0..);
                let own = triangles.filter(|(corners, _)| corners.iter().all(|v| is_in[*v as usize]));
                Part::Triangles(own.map(|(_, index)| index).collect())
            }
            (_, None) => {
                let problem = "belongs to a soft body, and this one is rigid";
                return Err(error(&key, problem, "give a load on the body's core"));
            }
        };
        let loaded: Vec<u32> = match (&part, soft) {
            (Part::Nodes(nodes), _) => nodes.clone(),
            (Part::Triangles(triangles), Some((layer, embedding, _))) => {
                let vertices = triangles.iter().flat_map(|t| skin.triangles[*t as usize]);
                vertices.flat_map(|v| followed(layer, &embedding[v as usize])).collect()
            }
            _ => Vec::new(),
        };
        let is_prescribed = |n: &u32| prescribed.get(*n as usize).is_some_and(|is| *is);
        if !loaded.is_empty() && loaded.iter().all(is_prescribed) && !body.reports_reactions() {
            let problem = "acts only on nodes of cores that do not move by forces: it changes nothing";
            return Err(error(
                &key,
                problem,
                "enlarge the region, or give the body reactions = true to see it in them",
            ));
        }
        match &part {
            Part::Nodes(nodes) if nodes.is_empty() => return Err(empty("no node lies in")),
            Part::Triangles(triangles) if triangles.is_empty() => {
                return Err(empty("no triangle of the skin lies with all corners in"));
            }
            _ => {}
        }
        all.push(Load { source: load.clone(), part });
    }
    Ok(all)
}

/// The nodes that a skin vertex follows.
fn followed(layer: &Layer, embedding: &Embedding) -> impl Iterator<Item = u32> {
    let nodes = layer.tetrahedra[embedding.tetrahedron as usize].into_iter().zip(embedding.weights);
    nodes.filter(|(_, weight)| weight.abs() > LEAST_WEIGHT).map(|(node, _)| node)
}

/// Whether each vertex of the skin lies in a region. Where the region lists nodes, a vertex lies in it if it follows those
/// nodes alone.
fn vertices(
    on: &Bind,
    layer: &Layer,
    embedding: &[Embedding],
    mesh: &Numbered,
    skin: &TriangleMesh,
) -> std::result::Result<Vec<bool>, (String, String)> {
    Ok(match on {
        Bind::Box { low, high } => skin.vertices.iter().map(|x| x.cmpge(*low).all() && x.cmple(*high).all()).collect(),
        Bind::Sphere { centre, radius } => skin.vertices.iter().map(|x| x.distance(*centre) <= *radius).collect(),
        Bind::All => vec![true; skin.vertices.len()],
        _ => {
            let named = cores::selected(on, layer, mesh, skin)?;
            let follows = |e: &Embedding| followed(layer, e).all(|node| named[node as usize]);
            embedding.iter().map(follows).collect()
        }
    })
}
