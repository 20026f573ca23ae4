//! Tests of fields on the skins (surface meshes) for display: contact depth and pressure, strain energy density,
//! displacement, stress. Each kernel is compared with f64, and whole fields are compared with values that the host
//! computes. A run whose fields are read must give the same bits as a run whose fields are not read. A patch is a group
//! of tetrahedra that share one volumetric strain (F-bar); the oracle is the f64 reference implementation.

use glam::{DQuat, DVec3};
use palpate::internal::gpu::Size;
use palpate::internal::prepare::patch::patches;
use palpate::internal::prepare::{Layer, Shape};
use palpate::internal::shaders::{Contact, Counts, Frame, NONE, StepParams};
use palpate::internal::step::{Field, Overlay};
use palpate::scene::{MaterialLaw, Samples, Sides};
use palpate::{Simulation, StepReport};

use crate::harness::random::Random;
use crate::harness::{Tolerance, case, context, expect_close};
use crate::invariant::friction;
use crate::scene::joints;
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, run, scene, soft_twin};
use crate::solver::system::{System, layered, material, two_layers};
use crate::stage::elastic::expect_of_largest;
use crate::stage::sizes;
use crate::stage::stresses::{STRESS, elements, invariants};

/// Relative error where the expected values are computed by hand: a dozen roundings.
const BY_HAND: f64 = 1.0e-6;
/// Error of f32 sums of a few terms.
const SUM: Tolerance = Tolerance { abs: 1e-6, rel: 2e-6 };
/// Error of the force that a step's pressures give, relative to the summed magnitudes of the forces at the contacts,
/// which may cancel in the sum: f32 sums.
const PRESSURE: f64 = 1.0e-5;
/// Error of a whole field relative to its largest value: displacements are f32, and the strain is a small difference of
/// them.
const WHOLE: f64 = 2.0e-4;
/// Largest value of a field at rest, where only rounding in f64 is left; m or J/m^3.
const REST: f64 = 1.0e-12;
/// Largest stress at rest, Pa: rounding of displacements of bodies that have turned.
const STRESS_AT_REST: f64 = 1.0e-2;

/// One list of up to four random indices below `n` for each owner. Returns the running totals of the lists' lengths,
/// and the contents of all lists.
fn lists(owners: usize, n: usize, random: &mut Random) -> (Vec<u32>, Vec<u32>) {
    let (mut first, mut held) = (vec![0], Vec::new());
    for _ in 0..owners {
        held.extend((0..random.below(5)).map(|_| random.below(n) as u32));
        first.push(held.len() as u32);
    }
    (first, held)
}

/// The oracle's energy densities of a system's tetrahedra, at the oracle's own rotations.
pub fn energies(system: &System) -> Vec<f64> {
    let of_body = |body: &palpate_oracle::step::SoftBody| {
        let rotations = body.elements.rotations(&body.displacement);
        body.elements.densities(&body.displacement, &rotations)
    };
    system.twin.bodies.iter().flat_map(of_body).collect()
}

/// One component of each row.
pub fn column(rows: &[[f32; 4]], k: usize) -> Vec<f32> {
    rows.iter().map(|row| row[k]).collect()
}

#[test]
fn the_energy_of_a_tetrahedron_stretched_along_an_edge_by_hand() {
    // draw/elements on a tetrahedron at the corner of a cube with edges of 1 m, whose second node is displaced by (0.01,
    // 0, 0) m. With strain E = diag(0.01, 0, 0) and volume V = 1/6 m^3, the corotational density is (mu + lambda / 2)
    // 1e-4.
    for law in [MaterialLaw::Corotational, MaterialLaw::NeoHookean] {
        let nodes = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let layer = Layer { nodes, tetrahedra: vec![[0, 1, 2, 3]], attached: vec![false; 4], ..Layer::default() };
        let soft = palpate::scene::Material { law, ..material(2e4) };
        let mut system = System::new(&[layered(layer, soft, DQuat::IDENTITY)], 0.0, 1);
        system.displacement[1] = [0.01, 0.0, 0.0, 0.0];
        let (got, _) = elements(&system, false, &[], &[]);
        let (mu, lambda) = (2e4 / 2.9, 2e4 * 0.45 / (1.45 * 0.1));
        let (m, l) = (4.0 / 3.0 * mu, lambda + 5.0 / 6.0 * mu);
        // The invariants of the neo-Hookean law are I = 2 + 1.01^2 and J = 1.01.
        let (grown, j, a) = (1.01f64.powi(2) - 1.0, 1.01f64, 1.0 + 0.75 * m / l);
        let bent = m * (grown - (1.0 + grown / 4.0).ln()) + l * ((j - a).powi(2) - (1.0 - a).powi(2));
        let want = if law == MaterialLaw::Corotational { (mu + 0.5 * lambda) * 1e-4 } else { 0.5 * bent };
        expect_close("density", &[got[0][0]], &[want], Tolerance { abs: 0.0, rel: 10.0 * BY_HAND });
        expect_close("volume", &[got[0][1]], &[1.0 / 6.0], Tolerance { abs: 0.0, rel: BY_HAND });
    }
}

#[test]
fn energies_of_patches_agree_with_the_oracle() {
    let mut bodies = two_layers();
    for body in &mut bodies {
        let Shape::Soft { layer, .. } = &mut body.shape else { panic!("the body is not soft") };
        layer.patches = patches(layer, |_| 0);
    }
    let system = System::new(&bodies, 0.002, 5);
    let of = &system.model.patches.of;
    let (densities, _) = elements(&system, false, of, &[]);
    let count = system.model.patches.count();
    let members = |p: usize| (0..of.len() as u32).filter(move |t| of[*t as usize] == p as u32);
    let mut first = vec![0u32];
    (0..count).for_each(|p| first.push(first[p] + members(p).count() as u32));
    let outcome = case("draw/share")
        .constant("PATCHES", count as u32)
        .input("patch_first", &first)
        .input("patch_members", &(0..count).flat_map(members).collect::<Vec<u32>>())
        .inout("densities", &densities)
        .elements(count)
        .run();
    let got: Vec<[f32; 4]> = outcome.get("densities");
    let want = energies(&system);
    expect_of_largest("densities of patches", &column(&got, 0), &want, STRESS);
    let alone = column(&densities, 0).iter().zip(&want).filter(|(got, want)| f64::from(**got) < 0.9 * **want).count();
    assert!(count > 1 && alone > 0, "patches must change the densities of some tetrahedra");
}

#[test]
fn sums_over_patches_of_any_number() {
    let mut random = Random(31);
    for n in sizes() {
        // Each patch has two tetrahedra, and no tetrahedron is in two patches.
        let (first, members) =
            ((0..=n as u32).map(|p| 2 * p).collect::<Vec<_>>(), (0..2 * n as u32).rev().collect::<Vec<_>>());
        let rows: Vec<[f32; 4]> = (0..2 * n)
            .map(|_| [1.0 + random.next(), 1.1 + random.next(), random.next(), 2.0].map(|x| x as f32))
            .collect();
        let outcome = case("draw/share")
            .constant("PATCHES", n as u32)
            .input("patch_first", &first)
            .input("patch_members", &members)
            .inout("densities", &rows)
            .elements(n)
            .run();
        let (mut want, mut stresses) = (vec![0.0; 2 * n], vec![0.0; 2 * n]);
        for pair in members.chunks(2) {
            let [a, b] = [pair[0], pair[1]].map(|t| rows[t as usize].map(f64::from));
            let theta = (a[1] * a[2] + b[1] * b[2]) / (a[1] + b[1]);
            for (t, own) in pair.iter().zip([a, b]) {
                want[*t as usize] = own[0] + 0.5 * own[3] * theta * theta;
                stresses[*t as usize] = own[3] * theta;
            }
        }
        let got: Vec<[f32; 4]> = outcome.get("densities");
        expect_close("densities", &column(&got, 0), &want, SUM);
        assert!((0..2 * n).all(|t| got[t][1..3] == rows[t][1..3]));
        expect_close("stresses of patches", &column(&got, 3), &stresses, SUM);
    }
}

#[test]
fn nodes_have_the_mean_of_their_tetrahedra_and_vertices_that_of_their_nodes() {
    let mut random = Random(32);
    for n in sizes() {
        let densities: Vec<[f32; 4]> =
            (0..50).map(|_| [1.0 + random.next(), 1.1 + random.next(), 5.0, 5.0].map(|x| x as f32)).collect();
        let pairs: Vec<[f32; 4]> = (0..100).map(|_| [0; 4].map(|_| 1.0 + random.next() as f32)).collect();
        let (first, around) = lists(n, 50, &mut random);
        // The number is in one of one or two texels of each tetrahedron.
        for (numbers, texels, texel, component) in [(&densities, 1, 0, 0), (&pairs, 2, 0, 3), (&pairs, 2, 1, 2)] {
            let outcome = case("draw/mean")
                .constant("NODES", n as u32)
                .constant("TEXELS", texels as u32)
                .constant("TEXEL", texel as u32)
                .constant("COMPONENT", component as u32)
                .input("node_first", &first)
                .input("node_tetrahedra", if around.is_empty() { &[0] } else { &around })
                .input("numbers", numbers)
                .input("densities", &densities)
                .output::<f32>("node_values", n)
                .elements(n)
                .run();
            let mean = |i: usize| {
                let own = around[first[i] as usize..first[i + 1] as usize].iter().map(|t| {
                    let t = *t as usize;
                    (f64::from(numbers[texels * t + texel][component]), f64::from(densities[t][1]))
                });
                let (sum, all) =
                    own.fold((0.0, 0.0), |(sum, all), (number, volume)| (sum + number * volume, all + volume));
                if all > 0.0 { sum / all } else { 0.0 }
            };
            let want: Vec<f64> = (0..n).map(mean).collect();
            let got: Vec<f32> = outcome.get("node_values");
            expect_close("means at nodes", &got, &want, SUM);
        }

        let (nodes, weights) = vertices(n, 50, &mut random);
        let values: Vec<f32> = (0..50).map(|_| random.next() as f32 + 1.0).collect();
        let outcome = case("draw/spread")
            .input("skin_nodes", &nodes)
            .input("skin_weights", &weights)
            .input("node_values", &values)
            .output::<f32>("values", n)
            .push(&(n as u32))
            .elements(n)
            .run();
        let spread = |(nodes, weights): (&[u32; 4], &[f32; 4])| match nodes[0] {
            NONE => 0.0,
            _ => nodes
                .iter()
                .zip(weights)
                .map(|(n, w)| f64::from(*w) * f64::from(values[*n as usize]))
                .sum::<f64>()
                .max(0.0),
        };
        let want: Vec<f64> = nodes.iter().zip(&weights).take(n).map(spread).collect();
        expect_close("values at vertices", &outcome.get::<f32>("values"), &want, SUM);
    }
}

/// Nodes and weights of `n` skin vertices, at least one, of which some belong to rigid bodies.
fn vertices(n: usize, nodes: usize, random: &mut Random) -> (Vec<[u32; 4]>, Vec<[f32; 4]>) {
    let four = |k: usize, random: &mut Random| match k % 7 {
        6 => [NONE, 0, 0, 0],
        _ => [0; 4].map(|_| random.below(nodes) as u32),
    };
    let all = (0..n.max(1)).map(|k| (four(k, random), [0; 4].map(|_| random.next() as f32)));
    all.unzip()
}

#[test]
fn what_deformation_moved_is_turned_by_its_frames() {
    let mut random = Random(33);
    let frames: Vec<Frame> = (0..3)
        .map(|_| Frame { rotation: random.turn(3.0).as_quat().to_array(), centre: [5.0; 3], ..Frame::default() })
        .collect();
    let displacement: Vec<[f32; 4]> = (0..50).map(|_| random.vector().as_vec3().extend(9.0).to_array()).collect();
    let info: Vec<[u32; 4]> = (0..50).map(|_| [7, 7, random.below(3) as u32, 7]).collect();
    for n in sizes() {
        let (nodes, weights) = vertices(n, 50, &mut random);
        let outcome = case("draw/moved")
            .input("frames", &frames)
            .input("skin_nodes", &nodes)
            .input("skin_weights", &weights)
            .input("displacement", &displacement)
            .input("node_info", &info)
            .output::<f32>("values", n)
            .push(&(n as u32))
            .elements(n)
            .run();
        let turned = |node: &u32| {
            let at = *node as usize;
            let rotation = DQuat::from_array(frames[info[at][2] as usize].rotation.map(f64::from));
            let [x, y, z, _] = displacement[at].map(f64::from);
            rotation * DVec3::new(x, y, z)
        };
        let moved = |(nodes, weights): (&[u32; 4], &[f32; 4])| match nodes[0] {
            NONE => 0.0,
            _ => nodes.iter().zip(weights).map(|(n, w)| f64::from(*w) * turned(n)).sum::<DVec3>().length(),
        };
        let want: Vec<f64> = nodes.iter().zip(&weights).take(n).map(moved).collect();
        expect_close("distances moved", &outcome.get::<f32>("values"), &want, SUM);
    }
}

#[test]
fn the_greatest_of_ranges_of_any_size() {
    let width = context().reduce_size() as usize;
    let mut random = Random(34);
    let sizes = [0, 1, width - 1, width, width + 1, 1234];
    let mut ranges = vec![];
    for n in sizes {
        let first = ranges.last().map_or(3, |range: &[u32; 2]| range[1]);
        ranges.push([first, first + n as u32]);
    }
    let values: Vec<f32> = (0..ranges[5][1] + 5).map(|_| 1.0 + random.next() as f32).collect();
    for n in 0..=sizes.len() {
        let outcome = case("draw/most")
            .size(Size::Reduce)
            .input("ranges", if n == 0 { &[[0; 2]] } else { &ranges[..n] })
            .input("values", &values)
            .output::<f32>("most", n)
            .groups(n)
            .run();
        let most = |range: &[u32; 2]| values[range[0] as usize..range[1] as usize].iter().copied().fold(0.0, f32::max);
        assert_eq!(outcome.get::<f32>("most"), ranges[..n].iter().map(most).collect::<Vec<_>>());
    }
}

#[test]
fn contacts_show_at_both_skins_and_the_greatest_of_a_vertex_stays() {
    let mut random = Random(35);
    let skin = 60;
    let triangles: Vec<[u32; 4]> =
        (0..40).map(|_| [random.below(skin), random.below(skin), random.below(skin), 0].map(|v| v as u32)).collect();
    for n in sizes() {
        for is_solved in [1u32, 0] {
            let contact = |c: usize, random: &mut Random| Contact {
                area: 0.6 + 0.5 * random.next() as f32,
                depth: 0.5 + 0.4 * random.next() as f32,
                rate: 0.3 * random.next() as f32,
                stiffness: if c % 5 == 4 { 0.0 } else { 2.0 + random.next() as f32 },
                damping: if c % 5 == 4 { 0.0 } else { 1.0 },
                vertex: random.below(skin) as u32,
                triangle: if c % 3 == 2 { NONE } else { random.below(40) as u32 },
                ..Contact::default()
            };
            let mut contacts: Vec<Contact> = (0..n.max(1)).map(|c| contact(c, &mut random)).collect();
            let mut forces: Vec<[f32; 4]> =
                contacts.iter().map(|_| [0.0, 0.0, 0.0, 0.2 * random.next() as f32]).collect();
            // One force is NaN, which the solver would never write, and one contact is under tension.
            if n > 20 {
                forces[3][3] = f32::NAN;
                contacts[6].rate = -100.0;
            }
            let params = StepParams { dt: 0.25, ..bytemuck::Zeroable::zeroed() };
            let outcome = case("draw/touched")
                .constant("CAPACITY", contacts.len() as u32)
                .input("params", &[params])
                .input("counts", &[Counts { contacts: n as u32, ..Counts::default() }])
                .input("contacts", &contacts)
                .input("contact_forces", &forces)
                .input("triangles", &triangles)
                .input("is_solved", &[is_solved])
                .inout("depths", &vec![0.0f32; skin])
                .inout("pressures", &vec![0.0f32; skin])
                .elements(contacts.len())
                .run();
            let (mut depths, mut pressures) = (vec![0.0f64; skin], vec![0.0f64; skin]);
            for (c, force) in contacts.iter().zip(&forces).take(n).filter(|(c, _)| c.stiffness > 0.0) {
                let [k, d, depth, rate, area] = [c.stiffness, c.damping, c.depth, c.rate, c.area].map(f64::from);
                let slope = 0.25 * k + d;
                let pressure = match is_solved {
                    1 => k * depth + slope * (rate + f64::from(force[3]) / (0.25 * slope * area)),
                    _ => k * depth + d * rate,
                };
                let met = triangles.get(c.triangle as usize).map_or(vec![], |t| t[..3].to_vec());
                for v in met.into_iter().chain([c.vertex]) {
                    depths[v as usize] = depths[v as usize].max(depth);
                    pressures[v as usize] = pressures[v as usize].max(pressure);
                }
            }
            expect_close("depths", &outcome.get::<f32>("depths"), &depths, Tolerance { abs: 0.0, rel: 0.0 });
            expect_close("pressures", &outcome.get::<f32>("pressures"), &pressures, SUM);
            assert!(n < 1000 || pressures.iter().all(|p| *p > 0.0));
        }
    }
}

/// A field as the GPU stores it, without padding. Also checks that the greatest value that is reported for each body is
/// the greatest at its vertices.
fn shown(simulation: &mut Simulation, field: Field) -> Vec<f32> {
    let ranges = simulation.skin_ranges();
    let found = simulation.field(field).unwrap();
    let mut values = found.values.read::<f32>().unwrap();
    assert!(values.len() - ranges.last().unwrap().end < 4);
    values.truncate(ranges.last().unwrap().end);
    assert!(values.iter().all(|x| *x >= 0.0 && x.is_finite()));
    let most: Vec<f32> = ranges.iter().map(|range| values[range.clone()].iter().copied().fold(0.0, f32::max)).collect();
    assert_eq!(found.greatest, most);
    let messages = simulation.context().validation_messages();
    assert!(messages.is_empty(), "{messages:#?}");
    values
}

/// The fields that the tetrahedra or the nodes have, at all skin vertices, computed on the host: strain energy density,
/// displacement, von Mises's stress and hydrostatic pressure.
fn of_host(simulation: &Simulation) -> [Vec<f64>; 4] {
    let ranges = simulation.skin_ranges();
    let total = ranges.last().unwrap().end;
    let mut all = [0; 4].map(|_| vec![0.0; total]);
    for (index, body) in simulation.bodies().iter().enumerate() {
        let Shape::Soft { layer, embedding, frames, node_frames, .. } = &body.shape else { continue };
        let elements = soft_twin(simulation, index).elements;
        let (moved, _) = simulation.nodes(index).unwrap().unwrap();
        let rotations = elements.rotations(&moved);
        let (densities, stresses) = (elements.densities(&moved, &rotations), elements.stresses(&moved, &rotations));
        let (mut sums, mut volumes) = (vec![DVec3::ZERO; moved.len()], vec![0.0; moved.len()]);
        for (t, nodes) in layer.tetrahedra.iter().enumerate() {
            for n in nodes {
                let [von_mises, pressure] = invariants(stresses[t]);
                sums[*n as usize] += elements.volumes[t] * DVec3::new(densities[t], von_mises, pressure.max(0.0));
                volumes[*n as usize] += elements.volumes[t];
            }
        }
        let (places, now) = (simulation.frames(index), simulation.node_positions(index).unwrap());
        let strayed = |n: usize| {
            let (place, frame) = (places[node_frames[n] as usize], &frames[node_frames[n] as usize]);
            now[n] - (place.centre + place.rotation * (layer.nodes[n] - frame.centre))
        };
        for (v, e) in embedding.iter().enumerate() {
            let nodes = layer.tetrahedra[e.tetrahedron as usize].map(|n| n as usize);
            let at = ranges[index].start + v;
            let means: DVec3 = nodes.iter().zip(e.weights).map(|(n, w)| w * sums[*n] / volumes[*n]).sum();
            let moved: DVec3 = nodes.iter().zip(e.weights).map(|(n, w)| w * strayed(*n)).sum();
            for (values, value) in
                all.iter_mut().zip([means.x.max(0.0), moved.length(), means.y.max(0.0), means.z.max(0.0)])
            {
                values[at] = value;
            }
        }
    }
    all
}

/// Depth and pressure at all skin vertices at the start of the last step, from the contacts of that step.
fn of_contacts(simulation: &Simulation) -> (Vec<f64>, Vec<f64>) {
    let total = simulation.skin_ranges().last().unwrap().end;
    let (mut depths, mut pressures) = (vec![0.0f64; total], vec![0.0f64; total]);
    let ranges = simulation.skin_ranges();
    let triangles: Vec<[usize; 3]> = ranges
        .iter()
        .enumerate()
        .flat_map(|(body, range)| simulation.skin_triangles(body).iter().map(|t| t.map(|v| range.start + v as usize)))
        .collect();
    for c in simulation.touch().unwrap().1.iter().filter(|c| c.stiffness > 0.0) {
        let [k, d, depth, rate] = [c.stiffness, c.damping, c.depth, c.rate].map(f64::from);
        let met = triangles.get(c.triangle as usize).map_or(vec![], |t| t.to_vec());
        for v in met.into_iter().chain([c.vertex as usize]) {
            depths[v] = depths[v].max(depth);
            pressures[v] = pressures[v].max(k * depth + d * rate);
        }
    }
    (depths, pressures)
}

#[test]
fn fields_are_what_the_host_knows() {
    let place = Place { shift: DVec3::new(0.3, -0.2, 0.1), turn: DQuat::from_rotation_z(0.5), slide: DVec3::ZERO };
    let keys = "motion = \"driven\"\nkeys = [[0.0, 0.4, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703], \
                [0.2, 0.42, 0.1, -0.2, 0.1, 0.2, 0.3, 0.9273618495495703]]";
    let pressed = press(2e4, 1e-3, place, "");
    let neo = pressed.replace("density = 1000.0", "density = 1000.0, law = \"neo-hookean\"");
    assert_ne!(neo, pressed);
    let patched = pressed.replace("name = \"block\"", "name = \"block\"\ndilatation = \"patch\"");
    let chain = joints::chain(2e4, keys, ["", "stiffness = 0.5"], "gravity = [5.0, -25.0, 8.0]");
    let all = [
        ("pressed", &pressed),
        ("neo-Hookean", &neo),
        ("patched", &patched),
        ("two falling bodies", &friction::collision(0.3)),
        ("a chain", &chain),
    ];
    for (name, text) in all {
        let mut simulation = open(&scene(text), None);
        // Bodies that collide have parted again at one of these times.
        let mut has_pressure = name == "a chain";
        for steps in [0, 25, 20] {
            run(&mut simulation, steps);
            let of_host = of_host(&simulation);
            let (depths, _) = of_contacts(&simulation);
            let got = Field::ALL.map(|field| shown(&mut simulation, field));
            expect_close(&format!("{name}: depth"), &got[0], &depths, Tolerance { abs: 0.0, rel: 0.0 });
            assert!(
                got[0].iter().zip(&got[1]).all(|(depth, pressure)| *pressure == 0.0 || *depth > 0.0),
                "{name}: a vertex has pressure but no depth"
            );
            for (field, wanted) in [Field::StrainEnergy, Field::Displacement, Field::VonMises, Field::Hydrostatic]
                .into_iter()
                .zip(&of_host)
            {
                let largest = wanted.iter().copied().fold(0.0, f64::max);
                let rest = if field.unit() == "Pa" { STRESS_AT_REST } else { REST };
                let tolerance = Tolerance { abs: WHOLE * largest + rest, rel: 0.0 };
                expect_close(&format!("{name}: {}", field.name()), &got[field as usize], wanted, tolerance);
            }
            assert!(
                steps == 0 || got[2..].iter().all(|values| values.iter().any(|x| *x > 0.0)),
                "{name}: strain energy, displacement or stress is zero everywhere"
            );
            has_pressure |= got[1].iter().any(|p| *p > 0.0);
        }
        assert!(has_pressure, "{name}: pressure is zero everywhere and at all times");
    }
}

#[test]
fn pressures_are_what_the_tool_feels() {
    let mut text = scene(&press(2e4, 1e-3, Place::default(), "tolerance = 1e-6\nmax_iterations = 1000"));
    (text.contact.sides, text.contact.samples) = (Sides::One, Samples::Vertices);
    let mut simulation = open(&text, None);
    let mut touched = 0;
    for row in run_looking(&mut simulation, 50) {
        let felt = row.0.tool.unwrap().force;
        assert!(
            row.1.distance(felt) <= PRESSURE * row.2,
            "step {}: pressures sum to {} N, the tool feels {felt} N",
            row.0.step,
            row.1
        );
        touched += usize::from(felt.length() > 0.01);
    }
    assert!(touched > 10);
    // Both skins have pressure. After a state is restored, the field is the pressure at the start of the last step.
    let values = shown(&mut simulation, Field::Pressure);
    let ranges = simulation.skin_ranges();
    assert!(ranges.iter().all(|range| values[range.clone()].iter().any(|p| *p > 0.0)));
    let state = simulation.save().unwrap();
    simulation.restore(&state).unwrap();
    let (_, began) = of_contacts(&simulation);
    let values = shown(&mut simulation, Field::Pressure);
    expect_of_largest("pressures at the start of the last step", &values, &began, PRESSURE);
}

/// For each step: its report, the force that the pressures of the tool's own contacts give, N, and the sum of the
/// magnitudes of these forces, N.
fn run_looking(simulation: &mut Simulation, steps: usize) -> Vec<(StepReport, DVec3, f64)> {
    let mut all = Vec::new();
    for _ in 0..steps {
        let row = run(simulation, 1).remove(0);
        let values = shown(simulation, Field::Pressure);
        let (mut force, mut size) = (DVec3::ZERO, 0.0);
        for c in simulation.touch().unwrap().1 {
            assert_eq!(c.side % 2, 1, "a contact must be of a vertex of the tool, body b (1) of its pair");
            let push = f64::from(c.area) * f64::from(values[c.vertex as usize]);
            force += push * DVec3::from(c.normal.map(f64::from));
            size += push;
        }
        all.push((row, force, size));
    }
    all
}

#[test]
fn a_run_that_is_looked_at_is_the_same_bits() {
    for text in [press(2e4, 1e-3, Place::default(), ""), friction::collision(0.3)] {
        let scene = scene(&text);
        let [mut plain, mut seen] = [open(&scene, None), open(&scene, None)];
        for step in 0..50 {
            let rows = [run(&mut plain, 1).remove(0), run(&mut seen, 1).remove(0)];
            let bits = rows.map(|row| {
                let tool =
                    row.tool.map(|t| [t.tool.position, t.force, t.torque].map(|x| x.to_array().map(f64::to_bits)));
                (tool, row.contacts, row.iterations, row.residual.to_bits(), row.flags)
            });
            assert_eq!(bits[0], bits[1], "results of step {step} of both runs");
            if step % 3 == 0 {
                seen.skins(DVec3::Y).unwrap();
                Field::ALL.iter().for_each(|field| drop(seen.field(*field).unwrap()));
                for overlay in [Overlay::Proxies, Overlay::Layers(Field::StrainEnergy), Overlay::Cores, Overlay::Bones]
                {
                    seen.overlay(overlay, DVec3::X).unwrap();
                }
                seen.contact_patch_rectangles().unwrap();
            }
        }
        let end = [&plain, &seen].map(|simulation| simulation.save().unwrap());
        assert!(end[0] == end[1], "the states of the two runs differ at the end");
    }
}
