//! Supports of a soft body: finds, for each node of the layer (tetrahedral simulation mesh), the directions in which its
//! supports let it move, and, where reactions are reported, which share of the force that holds a node belongs to which
//! support or core (rigid part of the body).

use faer::{Mat, Side};
use glam::{DMat3, DVec3};

use super::Layer;
use super::cores::{self, Numbered};
use crate::Result;
use crate::scene::triangles::TriangleMesh;
use crate::scene::{Body, Constraint, Motion};

/// Supports count as holding a node along the same direction where the angle between their directions, rad, is below this.
const SAME: f64 = 1e-3;
/// Entries of projections of order one below this are rounding errors, and become zero.
const NOTHING: f64 = 1e-12;

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
    /// What the user should know, one sentence each.
    pub notes: Vec<String>,
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
/// It is an error if no node of a support is left to it by the cores, if it holds a node of a dynamic core, if nothing of
/// the body is left free to move, or if reactions are asked for and nothing has any.
pub fn supports(
    body: &Body,
    layer: &Layer,
    holders: &[u32],
    mesh: &Numbered,
    skin: &TriangleMesh,
    error: impl Fn(&str, &str, &str) -> crate::Error,
) -> Result<Supports> {
    let reports = body.reports_reactions();
    if !reports && body.supports.is_empty() {
        return Ok(Supports::default());
    }
    // The supports that hold each node.
    let mut held: Vec<Vec<usize>> = vec![Vec::new(); layer.nodes.len()];
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
        nodes().filter(|n| !layer.attached[*n]).for_each(|n| held[n].push(index));
    }
    let constraints = |n: usize| held[n].iter().map(|index| body.supports[*index].constraint).collect::<Vec<_>>();
    let of_nodes: Vec<(Freedom, Vec<DMat3>)> = (0..held.len()).map(|n| combined(&constraints(n))).collect();
    let is_free = |n: usize| !layer.attached[n] && of_nodes[n].0 != Freedom::Held;
    let has_dynamic = body.cores.iter().any(|core| matches!(core.motion, Motion::Dynamic));
    if !has_dynamic && !body.supports.is_empty() && !(0..held.len()).any(is_free) {
        let problem = "cores and supports hold all nodes: nothing is left free to move";
        return Err(error("support", problem, "make a region smaller, or leave a support out"));
    }
    // A joint's force acts on its cores and is in no node's equation.
    let is_joined = |index: usize| body.joints.iter().any(|joint| joint.cores.contains(&index));
    let is_prescribed = |index: &usize| !matches!(body.cores[*index].motion, Motion::Dynamic);
    let prescribed = || (0..body.cores.len()).filter(is_prescribed);
    let reported: Vec<usize> = prescribed().filter(|index| reports && !is_joined(*index)).collect();
    let mut made = Supports::default();
    if reports {
        let joined: Vec<&str> =
            prescribed().filter(|i| is_joined(*i)).map(|index| body.cores[index].name.as_str()).collect();
        if !joined.is_empty() {
            let names = joined.join(", ");
            made.notes.push(format!("no reactions of cores with joints, whose forces act on no node: {names}"));
        }
        if body.supports.is_empty() && reported.is_empty() {
            let problem = "nothing that holds the body has a reaction: it has neither supports, nor fixed or driven cores \
                           without joints";
            return Err(error("reactions", problem, "remove it, or add a support"));
        }
    }
    for index in &reported {
        let own = (0..held.len()).filter(|n| layer.attached[*n] && holders[*n] as usize == *index);
        let nodes = own.map(|n| (n as u32, DMat3::IDENTITY)).collect();
        made.holders.push(Holder { name: body.cores[*index].name.clone(), nodes });
    }
    for (index, support) in body.supports.iter().enumerate().filter(|_| reports) {
        let share = |n: usize| {
            let place = held[n].iter().position(|own| *own == index)?;
            Some((n as u32, of_nodes[n].1[place]))
        };
        made.holders.push(Holder { name: support.name.clone(), nodes: (0..held.len()).filter_map(share).collect() });
    }
    let is_reported = |n: usize| layer.attached[n] && reported.contains(&(holders[n] as usize));
    let freedom = |(n, (left, _)): (usize, &(Freedom, Vec<DMat3>))| if is_reported(n) { Freedom::Held } else { *left };
    made.freedom = of_nodes.iter().enumerate().map(freedom).collect();
    Ok(made)
}

/// What several supports together leave to a node, and for each support the matrix that maps the force that holds the node
/// to this support's share. With the projections P_s onto the directions along which the supports hold the node, the share
/// of support s is P_s (sum P)^+, with the pseudo-inverse: where the directions are independent each support has the
/// component of the force along its own, and where several hold the node along one direction they share equally. This is
/// the split with the least sum of squares, and does not depend on the order of the supports.
fn combined(constraints: &[Constraint]) -> (Freedom, Vec<DMat3>) {
    let alone = |constraint: &Constraint| match *constraint {
        Constraint::Plane(normal) => Freedom::Plane(normal),
        Constraint::Axis(direction) => Freedom::Axis(direction),
        Constraint::Point => Freedom::Held,
    };
    let taken: Vec<DMat3> = constraints.iter().map(|own| DMat3::IDENTITY - alone(own).projection()).collect();
    match constraints {
        [] => return (Freedom::Free, taken),
        [only] => return (alone(only), taken),
        _ => {}
    }
    let sum = taken.iter().fold(DMat3::ZERO, |sum, own| sum + *own);
    let matrix = Mat::from_fn(3, 3, |i, j| sum.col(j)[i]);
    // The matrix is symmetric and finite, so that its eigenvalues are always found.
    let Ok(eigen) = matrix.self_adjoint_eigen(Side::Lower) else { return (Freedom::Held, taken) };
    let vector = |k: usize| clean(DVec3::new(eigen.U()[(0, k)], eigen.U()[(1, k)], eigen.U()[(2, k)])).normalize();
    // Two planes at the small angle x have the eigenvalue x^2 / 2.
    let is_held = |k: &usize| eigen.S()[*k] > 0.5 * SAME * SAME;
    let (along, free): (Vec<usize>, Vec<usize>) = (0..3).partition(is_held);
    let left = match (&along[..], &free[..]) {
        ([one], _) => Freedom::Plane(vector(*one)),
        (_, [one]) => Freedom::Axis(vector(*one)),
        _ => Freedom::Held,
    };
    let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
    let inverse = along.iter().fold(DMat3::ZERO, |sum, k| sum + outer(vector(*k)) * (1.0 / eigen.S()[*k]));
    let share = |own: &DMat3| {
        let share = *own * inverse;
        DMat3::from_cols(clean(share.x_axis), clean(share.y_axis), clean(share.z_axis))
    };
    (left, taken.iter().map(share).collect())
}

/// The vector with zeros in place of rounding errors.
fn clean(v: DVec3) -> DVec3 {
    DVec3::from(v.to_array().map(|x| if x.abs() < NOTHING { 0.0 } else { x }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(normal: [f64; 3]) -> Constraint {
        Constraint::Plane(DVec3::from(normal).normalize())
    }

    /// The shares of a force that holds a node.
    fn shares(constraints: &[Constraint], force: [f64; 3]) -> Vec<DVec3> {
        combined(constraints).1.iter().map(|share| *share * DVec3::from(force)).collect()
    }

    fn expect(constraints: &[Constraint], force: [f64; 3], want: &[[f64; 3]]) {
        let got = shares(constraints, force);
        assert_eq!(got.len(), want.len());
        for (got, want) in got.iter().zip(want) {
            assert!(got.distance(DVec3::from(*want)) < 1e-9, "{constraints:?}: shares {got}, expected {want:?}");
        }
        let mut turned = constraints.to_vec();
        turned.reverse();
        let mut back = shares(&turned, force);
        back.reverse();
        let differ = got.iter().zip(&back).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(differ < 1e-9, "{constraints:?}: the shares depend on the order, {got:?} and {back:?}");
    }

    #[test]
    fn what_supports_leave_is_left_by_all_of_them() {
        let left = |constraints: &[Constraint]| combined(constraints).0;
        assert_eq!(left(&[]), Freedom::Free);
        assert_eq!(left(&[Constraint::Axis(DVec3::Y)]), Freedom::Axis(DVec3::Y));
        assert_eq!(left(&[plane([1.0, 0.0, 0.0]); 2]), Freedom::Plane(DVec3::X));
        let Freedom::Axis(along) = left(&[plane([1.0, 0.0, 0.0]), plane([3.0, 4.0, 0.0])]) else { panic!() };
        assert_eq!(along.abs(), DVec3::Z);
        let Freedom::Axis(along) = left(&[plane([1.0, 1.0, 0.0]), plane([0.0, 1.0, 1.0])]) else { panic!() };
        assert!(along.cross(DVec3::new(1.0, -1.0, 1.0)).length() < 1e-12, "the line of two oblique planes is {along}");
        let corner = [plane([1.0, 0.0, 0.0]), plane([1.0, 1.0, 0.0]), plane([0.0, 0.0, 1.0])];
        assert_eq!(left(&corner), Freedom::Held);
        assert_eq!(left(&[plane([1.0, 0.0, 0.0]), Constraint::Axis(DVec3::X)]), Freedom::Held);
        assert_eq!(left(&[Constraint::Axis(DVec3::X), Constraint::Axis(DVec3::Y)]), Freedom::Held);
        // Directions that differ by less than a thousandth count as one.
        let Freedom::Plane(_) = left(&[plane([1.0, 0.0, 0.0]), plane([1.0, 5e-4, 0.0])]) else { panic!() };
        let Freedom::Axis(_) = left(&[plane([1.0, 0.0, 0.0]), plane([1.0, 2e-3, 0.0])]) else { panic!() };
    }

    #[test]
    fn a_force_is_split_along_the_directions_of_each_support() {
        // Orthogonal planes: components. Oblique planes: (1, 2, 0) = a (1, 0, 0) + b (3, 4, 0) / 5 with b = 5/2 and
        // a = 1 - 3/2.
        expect(
            &[plane([1.0, 0.0, 0.0]), plane([0.0, 1.0, 0.0])],
            [3.0, -2.0, 0.0],
            &[[3.0, 0.0, 0.0], [0.0, -2.0, 0.0]],
        );
        expect(
            &[plane([1.0, 0.0, 0.0]), plane([3.0, 4.0, 0.0])],
            [1.0, 2.0, 0.0],
            &[[-0.5, 0.0, 0.0], [1.5, 2.0, 0.0]],
        );
        // Three oblique planes: f = a (1, 0, 0) + b (1, 1, 0) + c (1, 1, 1) with c = 3, b = 2 - 3, a = 1 - 2.
        let three = [plane([1.0, 0.0, 0.0]), plane([1.0, 1.0, 0.0]), plane([1.0, 1.0, 1.0])];
        expect(&three, [1.0, 2.0, 3.0], &[[-1.0, 0.0, 0.0], [-1.0, -1.0, 0.0], [3.0, 3.0, 3.0]]);
        // What two supports hold along one direction they share equally, and each has the rest of its own.
        expect(&[plane([0.0, 1.0, 0.0]), Constraint::Point], [1.0, 2.0, 3.0], &[[0.0, 1.0, 0.0], [1.0, 1.0, 3.0]]);
        expect(&[Constraint::Axis(DVec3::X); 2], [0.0, 2.0, 4.0], &[[0.0, 1.0, 2.0]; 2]);
        expect(&[Constraint::Point], [1.0, 2.0, 3.0], &[[1.0, 2.0, 3.0]]);
        // Nothing grows without bound where directions nearly agree: the pin takes the small difference.
        let nearly = shares(&[plane([1.0, 0.002, 0.0]), Constraint::Point], [0.0, 1.0, 0.0]);
        assert!(nearly.iter().all(|share| share.length() < 1.0 + 1e-9), "shares {nearly:?}");
    }
}
