//! Test of isosurface stuffing, which fills a solid with tetrahedra by means of a lattice, with random *cuts* (points
//! where lattice edges leave the solid) and *warps* (lattice nodes moved onto a cut): the angles must be bounded and
//! the faces must match for any cuts, since both depend on the lattice alone and not on the surface.

use glam::DVec3;

use super::super::*;
use super::{ANGLE, Numbers, check, cuboid};

/// Random cuts of a lattice: its nodes are inside, on the surface or outside at random, and edges are cut (the surface
/// crosses them once) or disconnected (both ends are inside, but the edge leaves the solid between them) at random. A
/// node is warped by at most the share of an edge that stuffing allows (`LONG` or `SHORT`), often by exactly that share.
fn random_cuts(lattice: &Lattice, numbers: &mut Numbers) -> cut::Cuts {
    use cut::{Cuts, LONG, SHORT, Side};
    let count = lattice.node_count() as u32;
    let shares = [numbers.next(), numbers.next()];
    let mut cuts = Cuts {
        side: Vec::new(),
        taken: Default::default(),
        warped: Default::default(),
        leave: Default::default(),
        apart: Default::default(),
        welded: Vec::new(),
        lost: Vec::new(),
    };
    for node in 0..count {
        let number = numbers.next();
        let side = match number {
            _ if lattice.neighbours(node).count() < 14 => Side::Outside,
            x if x < 0.7 * shares[0] => Side::On,
            x if x < 0.7 * shares[0] + 0.3 + 0.4 * shares[1] => Side::Inside,
            _ => Side::Outside,
        };
        cuts.side.push(side);
    }
    for node in 0..count {
        let neighbours: Vec<u32> = lattice.neighbours(node).collect();
        let threshold = |m: u32| if Lattice::is_long(node, m) { LONG } else { SHORT };
        if cuts.side[node as usize] == Side::On {
            let to = neighbours[(numbers.next() * neighbours.len() as f64) as usize];
            let share = threshold(to) * (3.0 * numbers.next()).min(1.0);
            cuts.warped.insert(node, lattice.position(node).lerp(lattice.position(to), share));
        }
        for m in neighbours {
            // Any share of the edge is used, because `Cuts::share` clamps it to the range that stuffing allows.
            cuts.leave.insert((node, m), numbers.next());
            if node < m && numbers.next() < 0.3 {
                cuts.apart.insert((node, m));
            }
        }
    }
    cuts.join(lattice);
    cuts
}

#[test]
fn any_cuts_fill_a_lattice_with_good_angles_and_faces_that_meet() {
    let lattice = Lattice::around(DVec3::ZERO, DVec3::splat(9.0), 1.0);
    let far = cuboid(DVec3::splat(100.0), DVec3::ONE);
    let solid = Solid::new(&far.0, &far.1).unwrap();
    let field = sample::field(&solid, &lattice, (DVec3::ZERO, DVec3::ZERO), 1.0);
    let octants = grade::Octants::new(&solid, &lattice, &field, 1);
    let mut numbers = Numbers(7);
    let mut worst = f64::INFINITY;
    for _ in 0..60 {
        let cuts = random_cuts(&lattice, &mut numbers);
        let mut filling = fill::fill(&lattice, &octants, &cuts);
        parts::split(&solid, &cuts, &mut filling);
        let within: Vec<bool> = filling.corners.iter().map(|&c| is_within(&cuts, c)).collect();
        let layer = layer_of(filling);
        // If two tetrahedra disagreed about a face that they share, the layer would have a crack, and nodes inside the
        // solid would lie on the layer's boundary.
        let faces = layer::boundary_faces(&layer.tetrahedra);
        assert!(faces.iter().flat_map(|f| f.0).all(|n| !within[n as usize]));
        let parts = layer::parts(&layer).1;
        let filled = Filled {
            shift: 0.0,
            volume: total(&layer.nodes, &layer.tetrahedra),
            parts,
            dropped: Vec::new(),
            doubled: 0,
            separated: cuts.apart.len(),
            welded: Vec::new(),
            lost: Vec::new(),
            layer,
        };
        let report = filled.report(1.0, true, &lattice, &[], 0.0).unwrap();
        worst = worst.min(report.worst_dihedral);
        check(&filled.layer, &report);
    }
    println!("smallest dihedral angle of random cuts: {worst:.2} degrees");
    // The smallest angle must come near the bound `ANGLE`; otherwise the random cuts would not test the bound.
    assert!(worst < ANGLE + 1.5);
}

/// Whether a corner of the filling is a lattice node inside the solid.
fn is_within(cuts: &cut::Cuts, corner: Corner) -> bool {
    matches!(corner, Corner::Node(n) if cuts.side[n as usize] == cut::Side::Inside)
}

fn layer_of(filling: fill::Filling) -> Layer {
    let bound = vec![false; filling.nodes.len()];
    Layer { nodes: filling.nodes, tetrahedra: filling.tetrahedra, attached: bound, ..Layer::default() }
}
