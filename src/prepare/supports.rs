//! Supports of a soft body: finds, for each node of the layer (tetrahedral simulation mesh), the directions in which its
//! supports let it move, and, where reactions are reported, which share of the force that holds a node belongs to which
//! support or core (rigid part of the body).

use glam::{DMat3, DVec3};

use super::Layer;
use super::cores::{self, Numbered};
use crate::Result;
use crate::scene::obj::TriangleMesh;
use crate::scene::{Body, Constraint, Motion};

/// A support adds nothing where the sine of the angle between its direction and those in which other supports hold the
/// node already is below this.
const SAME: f64 = 1e-3;

/// Where supports, and a core whose reaction is reported, let a node move. Directions are those of the body's file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Freedom {
    /// Everywhere, or as its core prescribes.
    #[default]
    Free,
    /// In the plane with this unit normal.
    Plane(DVec3),
    /// Along this unit direction.
    Axis(DVec3),
    /// Nowhere, other than with a core of prescribed motion.
    Held,
}

impl Freedom {
    /// The projection onto the velocities that the node may have.
    pub fn projection(&self) -> DMat3 {
        let outer = |n: DVec3| DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        match self {
            Freedom::Free => DMat3::IDENTITY,
            Freedom::Plane(normal) => DMat3::IDENTITY - outer(*normal),
            Freedom::Axis(direction) => outer(*direction),
            Freedom::Held => DMat3::ZERO,
        }
    }
}

/// What holds a soft body.
#[derive(Debug, Clone, Default)]
pub struct Supports {
    /// For each node of the layer, what is left to it; empty where supports hold no node and no reaction is reported.
    pub freedom: Vec<Freedom>,
    /// The supports, and the cores of prescribed motion, whose reactions are reported.
    pub holders: Vec<Holder>,
}

/// A support or a core, whose reaction is reported.
#[derive(Debug, Clone)]
pub struct Holder {
    /// Name of the support or core.
    pub name: String,
    /// The nodes that it holds, each with the matrix that maps the force that holds the node to this holder's share: the
    /// whole force, where no other support holds the node.
    pub nodes: Vec<(u32, DMat3)>,
}

/// Finds what is left to each node. `layer` is in file coordinates, with its attached nodes marked; `holders` has the
/// index of the core of each attached node. `error` is that of [`cores::bind`].
///
/// It is an error if no node of a support is left to it by the cores, if it holds a node of a dynamic core, or if
/// nothing of the body is left free to move.
pub fn supports(
    body: &Body,
    layer: &Layer,
    holders: &[u32],
    mesh: &Numbered,
    skin: &TriangleMesh,
    error: impl Fn(&str, &str, &str) -> crate::Error,
) -> Result<Supports> {
    if !body.reactions.unwrap_or(!body.supports.is_empty()) && body.supports.is_empty() {
        return Ok(Supports::default());
    }
    // Unit vectors along which supports hold each node, linearly independent, each with the index of its support.
    let mut held: Vec<Vec<(DVec3, usize)>> = vec![Vec::new(); layer.nodes.len()];
    for (index, support) in body.supports.iter().enumerate() {
        let key = format!("support.{}.bind", support.name);
        let named = cores::selected(&support.bind, layer, mesh, skin)
            .map_err(|(problem, remedy)| error(&key, &problem, &remedy))?;
        let nodes = || (0..layer.nodes.len()).filter(|n| named[*n]);
        if nodes().next().is_none() {
            return Err(error(&key, "no node lies in the region: the support holds nothing", "enlarge the region"));
        }
        let core = |node: usize| &body.cores[holders[node] as usize];
        let moving = |n: &usize| layer.attached[*n] && matches!(core(*n).motion, Motion::Dynamic);
        if let Some(node) = nodes().find(moving) {
            let problem = format!(
                "node {} is attached to the dynamic core \"{}\", which no support can hold",
                mesh.numbers[node],
                core(node).name
            );
            return Err(error(&key, &problem, "keep the region away from the core, or give the core a `hinge`"));
        }
        if nodes().all(|n| layer.attached[n]) {
            let problem = "all nodes in the region are attached to cores: none is left for the support";
            return Err(error(&key, problem, "enlarge the region, or leave the support out"));
        }
        for node in nodes().filter(|n| !layer.attached[*n]) {
            for direction in directions(support.constraint) {
                if left_by(&held[node]).projection().mul_vec3(direction).length() > SAME {
                    held[node].push((direction, index));
                }
            }
        }
    }
    let is_free = |n: usize| !layer.attached[n] && held[n].len() < 3;
    let has_dynamic = body.cores.iter().any(|core| matches!(core.motion, Motion::Dynamic));
    if !has_dynamic && !(0..layer.nodes.len()).any(is_free) {
        let problem = "cores and supports hold all nodes: nothing is left free to move";
        return Err(error("support", problem, "make a region smaller, or leave a support out"));
    }
    Ok(of_held(body, layer, holders, &held))
}

/// Unit vectors, orthogonal to each other, along which a support holds its nodes.
fn directions(constraint: Constraint) -> Vec<DVec3> {
    match constraint {
        Constraint::Plane(normal) => vec![normal],
        Constraint::Axis(direction) => {
            let (a, b) = direction.any_orthonormal_pair();
            vec![a, b]
        }
        Constraint::Point => DVec3::AXES.to_vec(),
    }
}

/// What is left to a node that is held along linearly independent directions.
fn left_by(held: &[(DVec3, usize)]) -> Freedom {
    match *held {
        [] => Freedom::Free,
        [(normal, _)] => Freedom::Plane(normal),
        [(a, _), (b, _)] => Freedom::Axis(a.cross(b).normalize()),
        _ => Freedom::Held,
    }
}

/// The matrix that maps the force that holds a node to the share of one support: a support pushes only along its own
/// directions, so that the force is split into components along all the directions `held`, which need not be orthogonal.
fn share(held: &[(DVec3, usize)], support: usize) -> DMat3 {
    let basis = match *held {
        [(a, _)] => {
            let (b, c) = a.any_orthonormal_pair();
            DMat3::from_cols(a, b, c)
        }
        [(a, _), (b, _)] => DMat3::from_cols(a, b, a.cross(b)),
        [(a, _), (b, _), (c, _)] => DMat3::from_cols(a, b, c),
        _ => return DMat3::ZERO,
    };
    let own = |k: usize| if held.get(k).is_some_and(|(_, of)| *of == support) { basis.col(k) } else { DVec3::ZERO };
    DMat3::from_cols(own(0), own(1), own(2)) * basis.inverse()
}

/// The supports of a body whose nodes are held along the directions `held`, each with the index of its support.
fn of_held(body: &Body, layer: &Layer, holders: &[u32], held: &[Vec<(DVec3, usize)>]) -> Supports {
    let reports = body.reactions.unwrap_or(!body.supports.is_empty());
    // A joint's force acts on its cores and is in no node's equation.
    let is_joined = |index: usize| body.joints.iter().any(|joint| joint.cores.contains(&index));
    let reports_core =
        |index: usize| reports && !matches!(body.cores[index].motion, Motion::Dynamic) && !is_joined(index);
    let freedom = |n: usize| match layer.attached[n] && reports_core(holders[n] as usize) {
        true => Freedom::Held,
        false => left_by(&held[n]),
    };
    let mut all = Vec::new();
    for index in (0..body.cores.len()).filter(|index| reports_core(*index)) {
        let own = (0..layer.nodes.len()).filter(|n| layer.attached[*n] && holders[*n] as usize == index);
        let nodes = own.map(|n| (n as u32, DMat3::IDENTITY)).collect();
        all.push(Holder { name: body.cores[index].name.clone(), nodes });
    }
    for (index, support) in body.supports.iter().enumerate().filter(|_| reports) {
        let own = (0..layer.nodes.len()).filter(|n| held[*n].iter().any(|(_, of)| *of == index));
        all.push(Holder {
            name: support.name.clone(),
            nodes: own.map(|n| (n as u32, share(&held[n], index))).collect(),
        });
    }
    let freedom: Vec<Freedom> = (0..layer.nodes.len()).map(freedom).collect();
    match freedom.iter().all(|freedom| *freedom == Freedom::Free) {
        true => Supports::default(),
        false => Supports { freedom, holders: all },
    }
}
