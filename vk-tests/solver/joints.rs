//! Rigid cores (rigid bodies inside a soft one, to which nodes are attached) with joints between them, in the solver of
//! A x = b: their rows of the operator A and of the right-hand side b, the inverse that preconditions these rows, and
//! the whole solve, against f64 matrices made of the numbers that the kernels read. The oracle is the f64 reference
//! implementation on the CPU.

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};
use glam::{DMat3, DQuat, DVec3};
use palpate::internal::prepare::layer::kuhn_box;
use palpate::internal::prepare::{Body, Frame, FrameMotion, Shape};
use palpate::internal::shaders::{self, NONE, Rigid};
use palpate::scene::{Hinge, Joint, Preconditioner, Resistance};
use palpate_oracle::linear::{Entries, Solver};

use super::passes::{Change, Passes};
use super::whole::SOLUTION;
use crate::harness::random::Random;
use crate::solver::system::{System, layered, material};
use crate::stage::elastic::expect_of_largest;

/// Number of cores along a bar.
const CORES: usize = 7;
/// Pairs of cores with a joint between them: the dynamic cores form a tree, one pair has two joints, and core 5 has
/// none.
const JOINED: [[usize; 2]; 7] = [[3, 1], [1, 0], [1, 2], [3, 4], [4, 3], [6, 4], [2, 6]];
/// The core on a hinge.
const HINGED: usize = 2;
/// The core that does not move.
const FIXED: usize = 6;
/// Greatest allowed error of an entry of the inverse, relative to the geometric mean of the diagonal entries of its row
/// and column: blocks are inverted in f32.
const INVERSE: f64 = 1.0e-5;

/// A bar with a core every 8 cm; the nodes in a slab around each core's place are attached to that core.
fn bar() -> Body {
    let mut layer = kuhn_box(DVec3::new(-0.26, -0.02, -0.02), DVec3::new(0.26, 0.02, 0.02), [26, 2, 2]);
    let core_of = |x: &DVec3| {
        let at = (x.x + 0.24) / 0.08;
        ((at - at.round()).abs() < 0.26).then_some(at.round() as usize)
    };
    layer.attached = layer.nodes.iter().map(|x| core_of(x).is_some()).collect();
    let node_frames: Vec<u32> =
        layer.nodes.iter().map(|x| (((x.x + 0.24) / 0.08).round() as u32).min(CORES as u32 - 1)).collect();
    let masses = palpate_oracle::elastic::Elements::new(&layer, material(1e5), DMat3::IDENTITY).masses;
    let frame = |core: usize| {
        let own = (0..masses.len()).filter(|n| core_of(&layer.nodes[*n]) == Some(core));
        let (sum, mass) = own.fold((DVec3::ZERO, 0.0), |(s, m), n| (s + masses[n] * layer.nodes[n], m + masses[n]));
        let point = sum / mass + DVec3::new(0.004, -0.003, 0.002);
        let hinge = (core == HINGED).then_some(Hinge { point, axis: DVec3::new(0.48, 0.6, 0.64) });
        let motion = if core == FIXED { FrameMotion::Fixed } else { FrameMotion::Dynamic { mass: None, hinge } };
        Frame { centre: hinge.map_or(sum / mass, |hinge| hinge.point), motion }
    };
    let all: Vec<Frame> = (0..CORES).map(frame).collect();
    let joint = |(index, cores): (usize, &[usize; 2])| Joint {
        cores: *cores,
        point: 0.5 * (all[cores[0]].centre + all[cores[1]].centre) + DVec3::new(0.0, 0.01, 0.002 * index as f64),
        resistance: Resistance { stiffness: 0.3 * index as f64, damping: 0.01, ..Resistance::default() },
    };
    let made: Vec<Joint> = JOINED.iter().enumerate().map(joint).collect();
    let mut body = layered(layer, material(1e5), DQuat::from_xyzw(0.1, 0.2, 0.3, 0.9273618495495703));
    if let Shape::Soft { frames, node_frames: places, joints, .. } = &mut body.shape {
        (*frames, *places, *joints) = (all, node_frames, made);
    }
    body
}

/// Passes of the solver on the bar. The data of its joints (stiffness, impulse and so on), which the host otherwise
/// writes in each step, are random.
fn passes(with: Preconditioner) -> Passes {
    let mut passes = Passes::new(System::preconditioned(&[bar()], 0.004, 3, with));
    let model = &passes.system.model;
    let mut random = Random(31);
    let orientation = model.frames[0].orientation;
    let h = passes.system.twin.dt;
    let joint = |joint: &palpate::internal::stages::joints::Joint| {
        let mut some = |scale: f64| (scale * random.vector()).as_vec3().to_array();
        let arms = joint.arms.map(|arm| (orientation * arm).as_vec3().to_array());
        let square = some(1.0).map(f64::from);
        let size = h * h * joint.limit_stiffness[0];
        let entry = |i: usize, j: usize| (size * (square[i] * square[j] + f64::from(u8::from(i == j)))) as f32;
        shaders::Joint {
            rigid: joint.cores.map(|core| core.map_or(NONE, |core| core as u32)),
            arm: arms,
            linear: (h * h * joint.stiffness) as f32,
            angular: [entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)],
            impulse: some(1e-3),
            twist: some(1e-5),
        }
    };
    passes.joints = model.joints.iter().map(joint).collect();
    passes
}

/// A row of a joint's Jacobian J for one of the joint's two cores, that with index `side` (0 or 1): six factors of the
/// core's twist. J gives the motion, at the joint, of core 0 relative to core 1 along `axis`, or the relative rotation
/// about `axis` if `about`. A core on a hinge only turns about its axis `hinge`.
fn row(joint: &shaders::Joint, side: usize, axis: DVec3, about: bool, hinge: DVec3) -> [f64; 6] {
    let arm = DVec3::from(joint.arm[side].map(f64::from));
    let (mut linear, mut angular) = if about { (DVec3::ZERO, axis) } else { (axis, arm.cross(axis)) };
    if hinge != DVec3::ZERO {
        (linear, angular) = (DVec3::ZERO, hinge.dot(angular) * hinge);
    }
    let sign = if side == 0 { 1.0 } else { -1.0 };
    let all = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
    all.map(|x| sign * x)
}

/// Adds the joints' J^T G J to a matrix, entry by entry through `add`, and their J^T f to b, with G the square of the
/// time step times the joint's stiffness and f the joint's impulse. `first` gives the first unknown of a core.
fn add_joints(passes: &Passes, first: impl Fn(usize) -> usize, mut add: impl FnMut(usize, usize, f64), b: &mut [f64]) {
    for joint in &passes.joints {
        for about in [false, true] {
            let w = joint.angular.map(f64::from);
            let g = match about {
                false => DMat3::from_diagonal(DVec3::splat(f64::from(joint.linear))),
                true => DMat3::from_cols_array(&[w[0], w[3], w[4], w[3], w[1], w[5], w[4], w[5], w[2]]),
            };
            let f = DVec3::from(if about { joint.twist } else { joint.impulse }.map(f64::from));
            let rows: Vec<Vec<(usize, f64)>> = (0..3)
                .map(|k| {
                    let of = |side: usize| {
                        let core = joint.rigid[side];
                        let hinge = passes.rigids.get(core as usize).map_or([0.0; 3], |rigid| rigid.hinge);
                        let six = row(joint, side, DVec3::AXES[k], about, DVec3::from(hinge.map(f64::from)));
                        let at = if core == NONE { 0 } else { first(core as usize) };
                        six.into_iter().enumerate().map(move |(i, x)| (at + i, x)).filter(move |_| core != NONE)
                    };
                    of(0).chain(of(1)).collect()
                })
                .collect();
            for (k, left) in rows.iter().enumerate() {
                left.iter().for_each(|(i, x)| b[*i] += x * f[k]);
                for (l, right) in rows.iter().enumerate() {
                    for (i, x) in left {
                        right.iter().for_each(|(j, y)| add(*i, *j, x * g.col(l)[k] * y));
                    }
                }
            }
        }
    }
}

/// The oracle's A and b, with the rows of the joints added.
fn with_joints(passes: &Passes) -> (Entries, Vec<f64>) {
    let s = &passes.system;
    let (mut a, mut b) = s.twin.assemble(s.device.as_ref(), &s.twin_contacts);
    let cores = s.twin.unknowns().cores;
    add_joints(passes, |core| cores[core], |i, j, x| a.add(i, j, x), &mut b);
    (a, b)
}

#[test]
fn rows_of_joints_are_in_a_and_b() {
    let mut passes = passes(Preconditioner::Jacobi);
    let mut random = Random(32);
    passes.assemble();
    let (a, b) = with_joints(&passes);
    let unknowns = passes.system.twin.unknowns();
    // A core on a hinge spins about the hinge and does not move otherwise.
    let mut twists = vec![];
    for rigid in &passes.rigids {
        let mut six: [f64; 6] = std::array::from_fn(|_| random.next());
        if rigid.hinge != [0.0; 3] {
            let axis = DVec3::from(rigid.hinge.map(f64::from));
            six = [[0.0; 3], (random.next() * axis).to_array()].concat().try_into().unwrap();
        }
        twists.push(six.map(|x| x as f32));
    }
    passes.solution = passes.system.random_field(&mut random);
    let mut x = passes.system.unknowns(&passes.solution, &[0.0; 6]);
    for (k, six) in twists.iter().enumerate() {
        passes.rigid(k).x = *six;
        (0..6).for_each(|i| x[unknowns.cores[k] + i] = f64::from(six[i]));
    }
    // Nodes attached to a core move with it.
    let carried = passes.system.rows(&x).0.concat();
    for node in passes.system.model.cores.iter().flat_map(|core| core.nodes.clone()).map(|node| node as usize) {
        (0..3).for_each(|k| passes.solution[node][k] = carried[3 * node + k] as f32);
    }
    passes.apply(Change::Start);
    passes.gather(0);
    let y = a.multiply(&x);
    passes.cores();
    for (index, first) in unknowns.cores.iter().enumerate() {
        let rows = rows_of(&passes, &passes.rigids[index]);
        for part in [0..3, 3..6] {
            let (name, of) = (format!("core {index}, rows {part:?}"), first + part.start..first + part.end);
            expect_of_largest(&format!("{name}: A x"), &rows[part.clone()], &y[of.clone()], 1e-5);
            let got = passes.rigids[index].b.map(f64::from);
            let got: Vec<f32> = got[part].iter().map(|x| *x as f32).collect();
            expect_of_largest(&format!("{name}: b"), &got, &b[of], 1e-5);
        }
    }
}

/// A core's rows of A x, summed over its blocks (attached nodes, split by workgroup).
fn rows_of(passes: &Passes, rigid: &Rigid) -> [f32; 6] {
    let turn = DQuat::from_array(passes.block_turns[rigid.block_first as usize].map(f64::from));
    let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
    for coarse_index in rigid.first_coarse_index..rigid.first_coarse_index + rigid.block_count {
        let modes = &passes.restricted_product[3 * coarse_index as usize..][..2].concat();
        force += DVec3::from_slice(&[0, 1, 2].map(|k| f64::from(modes[k])));
        torque += DVec3::from_slice(&[3, 4, 5].map(|k| f64::from(modes[k])));
    }
    let all = [(turn * force).to_array(), (turn * torque).to_array()].concat();
    std::array::from_fn(|k| all[k] as f32)
}

#[test]
fn cores_that_are_joined_are_inverted_as_one() {
    let mut passes = passes(Preconditioner::Jacobi);
    passes.assemble();
    passes.cores();
    let count = passes.rigids.len();
    // `dense` holds, for each core, the sum of P^T D P over its attached nodes. D is a node's diagonal block, which
    // `inverse` holds for attached nodes, and P maps the core's twist to the node's velocity. Ones stand in for motions
    // that a hinge prevents.
    let mut dense = Mat::<f64>::zeros(6 * count, 6 * count);
    for (index, rigid) in passes.rigids.iter().enumerate() {
        let turn = DQuat::from_array(passes.system.frames[rigid.frame as usize].rotation.map(f64::from));
        let hinge = DVec3::from(rigid.hinge.map(f64::from));
        for node in &passes.system.model.cores[index].nodes {
            let rest = passes.system.model.node_rest[*node as usize].map(f64::from);
            let arm = turn * DVec3::from_slice(&rest[..3]);
            for column in 0..6 {
                let mut six = [0.0; 6];
                six[column] = 1.0;
                let (mut u, mut w) = (DVec3::from_slice(&six[..3]), DVec3::from_slice(&six[3..]));
                if hinge != DVec3::ZERO {
                    (u, w) = (DVec3::ZERO, hinge.dot(w) * hinge);
                }
                let moved = DVec3::from(passes.precondition(*node as usize, (u + w.cross(arm)).to_array()));
                let (mut force, mut torque) = (moved, arm.cross(moved));
                if hinge != DVec3::ZERO {
                    (force, torque) = (DVec3::ZERO, hinge.dot(torque) * hinge);
                }
                let rows = [force.to_array(), torque.to_array()].concat();
                (0..6).for_each(|row| dense[(6 * index + row, 6 * index + column)] += rows[row]);
            }
        }
        if hinge != DVec3::ZERO {
            for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
                let along = if i > 2 && j > 2 { hinge[i - 3] * hinge[j - 3] } else { 0.0 };
                dense[(6 * index + i, 6 * index + j)] += f64::from(u8::from(i == j)) - along;
            }
        }
    }
    let mut unused = vec![0.0; 6 * count];
    add_joints(&passes, |core| 6 * core, |i, j, x| dense[(i, j)] += x, &mut unused);
    let inverse = dense.llt(Side::Lower).unwrap().inverse();
    let groups: Vec<u32> = passes.rigids.iter().map(|rigid| rigid.group_count).collect();
    println!("for each core, the number of cores joined with it, itself included: {groups:?}");
    assert!(groups.contains(&1) && groups.contains(&5));
    let mut worst = 0.0f64;
    for (index, rigid) in passes.rigids.iter().enumerate() {
        let (first, width) = (rigid.group_first as usize, 6 * rigid.group_count as usize);
        for (i, j) in (0..6).flat_map(|i| (0..width).map(move |j| (i, j))) {
            let (row, column) = (6 * (index - first) + i, j);
            let got = f64::from(passes.rigid_inverses[rigid.inverse_first as usize + row * width + column]);
            let (a, b) = (6 * index + i, 6 * first + j);
            // For motions that a hinge prevents, `dense` has ones on its diagonal, but the kernel's inverse is zero
            // there: the ones are subtracted.
            let held = |k: usize| passes.rigids[k / 6].hinge != [0.0; 3];
            let want = if a / 6 == b / 6 && held(a) {
                let hinge = DVec3::from(passes.rigids[a / 6].hinge.map(f64::from));
                let ones = f64::from(u8::from(a == b));
                let along = if a % 6 > 2 && b % 6 > 2 { hinge[a % 6 - 3] * hinge[b % 6 - 3] } else { 0.0 };
                inverse[(a, b)] - (ones - along)
            } else {
                inverse[(a, b)]
            };
            let size = (inverse[(a, a)] * inverse[(b, b)]).sqrt();
            worst = worst.max((got - want).abs() / size);
            let other = f64::from(passes.rigid_inverses[rigid.inverse_first as usize + column * width + row]);
            assert_eq!(got, other, "the inverse must be symmetric to the last bit");
        }
    }
    println!("inverse of joined cores: largest relative error {worst:.1e}");
    assert!(worst < INVERSE, "relative error of the inverse {worst:e}");
}

#[test]
#[ignore = "long: 8 s"]
fn cores_that_are_joined_are_solved_as_one() {
    for with in [Preconditioner::Jacobi, Preconditioner::Coarse] {
        let mut passes = passes(with);
        passes.system.stop_at(1e-6);
        passes.record_start();
        passes.iterate(400);
        let (a, b) = with_joints(&passes);
        let want = Solver::default().solve(&a, &b).unwrap();
        println!("{with:?} preconditioner: {} iterations with joints", passes.iterations_done());
        assert_eq!(passes.state.status, 1);
        let (nodes, _) = passes.system.rows(&want);
        let got: Vec<f32> = passes.solution.iter().flat_map(|x| [x[0], x[1], x[2]]).collect();
        expect_of_largest("nodes", &got, &nodes.concat(), SOLUTION);
        passes.record_end();
        assert!(passes.report.residual < 1e-5, "residual {:e}", passes.report.residual);
        let firsts = passes.system.twin.unknowns().cores;
        for part in [0..3, 3..6] {
            let own = |first: usize| first + part.start..first + part.end;
            let got: Vec<f32> = (0..firsts.len()).flat_map(|k| passes.core_changes[own(6 * k)].to_vec()).collect();
            let want: Vec<f64> = firsts.iter().flat_map(|first| want[own(*first)].to_vec()).collect();
            expect_of_largest(&format!("cores, rows {part:?}"), &got, &want, SOLUTION);
        }
    }
}
