//! Tests of the coarse space of the two-level additive Schwarz preconditioner: of its matrix, made on the host, and of
//! the passes that apply it. A block is the nodes that one workgroup of the solver owns; each block of free nodes
//! (nodes that are not attached to a rigid core, a rigid body inside the soft one) is an aggregate of the coarse space.
//! A block has twelve modes, affine motions of all its nodes, which are columns of the prolongation P; its coarse index
//! is the place of its modes in the kernels' arrays. The oracle is the f64 reference implementation on the CPU.

mod kernels;
mod law;
mod matrix;
mod symmetry;
mod turns;

use faer::Mat;
use glam::{DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::internal::prepare::{Body, Frame, FrameMotion, Layer, Shape};
use palpate::internal::shaders::NONE;
use palpate::internal::stages::model::Model;
use palpate::scene::Hinge;
use palpate_oracle::coarse::{BLOCK_UNKNOWNS, Block, prolongation};

use crate::solver::system::{
    System, layer, layered, material, two_layers, two_layers_one_on_a_core, two_layers_one_on_a_hinge,
};

/// The model's blocks in the order of their coarse indices, as the oracle represents them.
fn blocks_of(system: &System, turns: &[[f32; 4]]) -> Vec<Block> {
    let (model, blocks) = (&system.model, &system.model.blocks);
    let mut order: Vec<usize> = (0..blocks.blocks.len()).collect();
    order.sort_by_key(|b| blocks.coarse_indices[*b]);
    let block = |b: usize| {
        let [first, count, _, rigid] = blocks.blocks[b];
        let nodes = &blocks.nodes[first as usize..(first + count) as usize];
        let body = model.soft.iter().position(|soft| soft.nodes.contains(&(nodes[0][0] as usize))).unwrap();
        let node_first = model.soft[body].nodes.start as u32;
        Block {
            body,
            nodes: nodes.iter().map(|n| n[0] - node_first).collect(),
            core: (rigid != NONE).then_some(rigid as usize),
            turn: DQuat::from_array(turns[b].map(f64::from)),
        }
    };
    order.into_iter().map(block).collect()
}

/// Entries of P below this are set to zero. They are rounding errors, in f64, of a node's distance from the plane in
/// which its block lies, relative to the block's size.
const NOTHING: f64 = 1.0e-12;

/// The prolongation P, its modes in the order of the blocks' coarse indices.
fn coarse_vector_of(system: &System, turns: &[[f32; 4]]) -> Mat<f64> {
    let mut all = prolongation(&system.twin, &blocks_of(system, turns));
    all.col_iter_mut().flat_map(|column| column.iter_mut()).filter(|x| x.abs() < NOTHING).for_each(|x| *x = 0.0);
    all
}

/// The rotations of the blocks of bodies at rest, which are those of the rigid coordinate frames of their nodes.
fn rest_turns(system: &System) -> Vec<[f32; 4]> {
    system.model.blocks.blocks.iter().map(|block| system.frames[block[2] as usize].rotation).collect()
}

/// The inverses of the coarse matrices of all bodies, which the kernels read, as one matrix over the modes of all
/// blocks. If `scaled`, they are as stored: each inverse is scaled to ones on its diagonal.
fn host_inverse(model: &Model, scaled: bool) -> Mat<f64> {
    let (coarse, count) = (&model.coarse, BLOCK_UNKNOWNS * model.blocks.blocks.len());
    let mut inverse = Mat::zeros(count, count);
    let scale = |mode: usize| if scaled { 1.0 } else { f64::from(coarse.scales[mode / 4][mode % 4]) };
    for [first, first_coarse_index, texels, coarse_index] in coarse.blocks.iter().map(|block| block.map(|x| x as usize))
    {
        for row in 0..if texels > 0 { BLOCK_UNKNOWNS } else { 0 } {
            for column in 0..4 * texels {
                let word = coarse.inverse[first + row * (4 * texels).div_ceil(8) + column / 8][column % 8 / 2];
                let half = half::f16::from_bits((word >> (16 * (column % 2)) & 0xffff) as u16);
                let (i, j) = (BLOCK_UNKNOWNS * coarse_index + row, BLOCK_UNKNOWNS * first_coarse_index + column);
                inverse[(i, j)] = scale(i) * scale(j) * half.to_f64();
            }
        }
    }
    inverse
}

/// The layer (tetrahedral mesh) of a box of 20 mm cells; the nodes for which `held` is true are attached.
fn boxed(cells: [u32; 3], held: impl Fn(DVec3) -> bool) -> Layer {
    let half = 0.01 * DVec3::new(cells[0].into(), cells[1].into(), cells[2].into());
    let mut layer = kuhn_box(-half, half, cells);
    layer.attached = layer.nodes.iter().map(|x| held(*x)).collect();
    layer
}

/// The layer, turned by a fixed oblique rotation within its rest frame.
fn tilted(mut layer: Layer) -> Layer {
    let turn = DQuat::from_scaled_axis(DVec3::new(0.5, -0.8, 0.3));
    layer.nodes.iter_mut().for_each(|x| *x = turn * *x);
    layer
}

fn turned(layer: Layer) -> Body {
    turned_of(layer, 2e4)
}

/// A body that is turned, with a Young's modulus, Pa.
fn turned_of(layer: Layer, young: f64) -> Body {
    layered(layer, material(young), DQuat::from_scaled_axis(DVec3::new(0.4, 1.0, -0.3)))
}

/// A layer whose free nodes lie in a plane.
fn plane() -> Layer {
    boxed([6, 4, 1], |x| x.z < 0.0)
}

/// A layer whose free nodes lie in a row.
fn row() -> Layer {
    boxed([9, 1, 1], |x| x.y < 0.0 || x.z < 0.0)
}

/// A body whose nodes belong to two rigid coordinate frames at rest.
fn two_frames() -> Body {
    let mut body = turned(layer(100));
    if let Shape::Soft { layer, frames, node_frames, .. } = &mut body.shape {
        frames.push(Frame { centre: DVec3::new(0.03, 0.01, -0.02), motion: FrameMotion::Fixed });
        *node_frames = layer.nodes.iter().map(|x| u32::from(x.x > 0.0)).collect();
    }
    body
}

/// A body with a dynamic rigid core to which more nodes are attached than a block has.
pub fn large_core(hinged: bool) -> Body {
    let mut body = turned(boxed([6, 6, 8], |x| x.z < 0.03));
    if let Shape::Soft { layer, frames, materials, .. } = &mut body.shape {
        let masses = palpate_oracle::elastic::Elements::new(layer, &*materials, glam::DMat3::IDENTITY).masses;
        let bound = || (0..masses.len()).filter(|n| layer.attached[*n]);
        let mass: f64 = bound().map(|n| masses[n]).sum();
        let centre = bound().map(|n| masses[n] * layer.nodes[n]).sum::<DVec3>() / mass;
        let hinge = hinged.then_some(Hinge { point: centre, axis: DVec3::new(0.48, 0.6, 0.64) });
        frames[0] = Frame { centre, motion: FrameMotion::Dynamic { mass: None, hinge } };
    }
    body
}

/// Two bodies: the first is soft enough to go without a coarse space, and the second has one.
pub fn soft_and_stiff() -> Vec<Body> {
    let mut second = layer(60);
    second.attached[..9].fill(true);
    vec![layered(layer(100), material(2e3), DQuat::from_rotation_x(1.0)), turned_of(second, 2e6)]
}

/// Bodies of every kind for which the coarse space must work.
pub fn kinds() -> Vec<(&'static str, Vec<Body>)> {
    vec![
        ("one aggregate", vec![turned(layer(8))]),
        ("several", vec![turned(layer(100))]),
        ("two bodies", two_layers()),
        ("two frames", vec![two_frames()]),
        ("a core", two_layers_one_on_a_core()),
        ("a hinge", two_layers_one_on_a_hinge()),
        ("a core of several blocks", vec![large_core(false)]),
        ("a hinge of several blocks", vec![large_core(true)]),
        ("a plane", vec![turned(plane())]),
        ("a row", vec![turned(row())]),
        ("a tilted plane", vec![turned(tilted(plane()))]),
        ("a tilted row", vec![turned(tilted(row()))]),
        ("no free nodes in one of two", vec![turned(boxed([2, 2, 2], |_| true)), turned(layer(27))]),
    ]
}

fn product(matrix: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; matrix.nrows()];
    for (j, x) in x.iter().enumerate() {
        y.iter_mut().enumerate().for_each(|(i, y)| *y += matrix[(i, j)] * x);
    }
    y
}
