//! Tests of kernel wrench/reduce, which sums the force and torque of the contacts on the tool (the rigid body that the
//! haptic device leads), and the contact stiffness and damping that act on the tool. A pair has body a and body b.

use glam::DVec3;
use palpate::internal::gpu::Size;
use palpate::internal::shaders::{Contact, Counts, NONE, Pair, Report, StepParams, ToolWrench};
use palpate_oracle::step::Resolved;
use palpate_oracle::wrench;

use crate::harness::random::Random;
use crate::harness::{Tolerance, case, context, expect_close};
use crate::solver::system::{System, two_layers};

/// Relative error of sums over contacts, whose terms have both signs and are a dozen roundings of 6e-8 away from the
/// input. The error is relative to the sum of the terms' magnitudes; for entry (i, k) of a matrix this sum is at most
/// the geometric mean of the diagonal entries i and k.
const SUM: f64 = 2.0e-6;

/// Runs wrench/reduce, checks that every other word of the report stays as it was, and returns what it says of the tool.
fn reduce(system: &System, forces: &[[f32; 4]]) -> ToolWrench {
    let [held, loose] = [true, false].map(|wants_stiffness| reduce_as(system, forces, wants_stiffness));
    // If no haptic loop holds the tool, force and torque are the same, and stiffness and damping are not computed.
    let want = ToolWrench { stiffness: [0.0; 21], damping: [0.0; 21], ..held };
    assert_eq!(bytemuck::bytes_of(&loose), bytemuck::bytes_of(&want));
    held
}

fn reduce_as(system: &System, forces: &[[f32; 4]], wants_stiffness: bool) -> ToolWrench {
    let mut before: Report = bytemuck::Zeroable::zeroed();
    (before.verdict, before.iterations, before.tool_change) = (5, 6, [7.0; 6]);
    let outcome = case("wrench/reduce")
        .size(Size::Reduce)
        .constant("FRICTION", system.twin.friction.is_some())
        .input("params", &[StepParams { wants_stiffness: u32::from(wants_stiffness), ..system.params }])
        .input("counts", &[system.counts])
        .input("contacts", &system.contacts)
        .input("contact_forces", forces)
        .partial("report", &[before])
        .groups(1)
        .run();
    let after = outcome.get::<Report>("report")[0];
    let mut rest = after;
    rest.tools[0] = before.tools[0];
    assert_eq!(
        bytemuck::bytes_of(&rest),
        bytemuck::bytes_of(&before),
        "words of the report that wrench/reduce does not write"
    );
    after.tools[0]
}

#[test]
fn one_contact_by_hand() {
    // wrench/reduce with stiffness k = 100 N/m^3, at rest: the force is area * k * depth = 0.5 * 100 * 0.1 = 5 N,
    // against the normal where the tool is body a. The contact's arm goes from the tool's centre to the contact.
    let mut system = System::new(&[], 0.0, 1);
    system.contacts = vec![Contact {
        normal: [0.0, 0.0, 1.0],
        area: 0.5,
        arm: [0.0, 2.0, 0.0],
        tool_sign: 1.0,
        depth: 0.1,
        stiffness: 100.0,
        damping: 4.0,
        ..Contact::default()
    }];
    system.counts.contacts = 1;
    let report = reduce(&system, &[[0.0; 4]]);
    let rounding = Tolerance { abs: 0.0, rel: 1e-6 };
    expect_close("force", &report.force, &[0.0, 0.0, -5.0], rounding);
    expect_close("torque", &report.torque, &[-10.0, 0.0, 0.0], rounding);
    expect_close("pressing", &[report.pressing], &[5.0], rounding);
    // The upper triangle is in the order x, y, z, rx, ry, rz: its entries (z, z), (z, rx) and (rx, rx) are not zero.
    let (mut stiffness, mut damping) = ([0.0; 21], [0.0; 21]);
    for (at, value) in [(11, 50.0), (12, 100.0), (15, 200.0)] {
        (stiffness[at], damping[at]) = (value, value * 0.04);
    }
    expect_close("stiffness", &report.stiffness, &stiffness, rounding);
    expect_close("damping", &report.damping, &damping, rounding);
    // Now the tool is body b.
    system.contacts[0].tool_sign = -1.0;
    let report = reduce(&system, &[[0.0; 4]]);
    expect_close("force", &report.force, &[0.0, 0.0, 5.0], rounding);
    expect_close("torque", &report.torque, &[10.0, 0.0, 0.0], rounding);
    expect_close("stiffness", &report.stiffness, &stiffness, rounding);
    // The bodies part so fast that the damper would pull more than the spring pushes, so that there is no force.
    system.contacts[0].rate = -3.0;
    let report = reduce(&system, &[[0.0; 4]]);
    assert_eq!((report.force, report.torque, report.stiffness), ([0.0; 3], [0.0; 3], [0.0; 21]));
    assert_eq!(report.friction, [0.0; 3]);
}

/// The entries (i, k) of a matrix's upper triangle, row by row, each with its scale, the geometric mean of the diagonal
/// entries i and k.
fn triangle(matrix: &[[f64; 6]; 6]) -> Vec<(f64, f64)> {
    let entry = |i: usize, k: usize| (matrix[i][k], (matrix[i][i] * matrix[k][k]).sqrt());
    (0..6).flat_map(|i| (i..6).map(move |k| entry(i, k))).collect()
}

#[test]
fn friction_by_hand() {
    // wrench/reduce: the coefficient of friction is c = 2 N s/m. The slip is 3 m/s along x, and the step, of h = 1/128
    // s, raises it by 1 m/s, for which the solver has computed the impulse h c * 1 m/s = 2/128 N s. So friction drags
    // the tool by 2 * 4 = 8 N, at an arm of 0.5 m along z, and adds the damping c across the normal.
    let mut system = System::new(&[], 0.0, 1).with_friction();
    system.contacts = vec![Contact {
        normal: [0.0, 0.0, 1.0],
        area: 0.5,
        arm: [0.0, 0.0, 0.5],
        tool_sign: 1.0,
        depth: 0.1,
        stiffness: 100.0,
        friction: 2.0,
        slip: [3.0, 0.0, 0.0],
        ..Contact::default()
    }];
    system.counts.contacts = 1;
    let impulse = 2.0 / 128.0;
    let report = reduce(&system, &[[impulse, 0.0, 0.0, 0.0]]);
    let close = Tolerance { abs: 1e-6, rel: 1e-6 };
    expect_close("force", &report.force, &[-8.0, 0.0, -5.0], close);
    expect_close("friction", &report.friction, &[-8.0, 0.0, 0.0], close);
    expect_close("torque", &report.torque, &[0.0, -4.0, 0.0], close);
    let mut damping = [0.0; 21];
    // Entries (x, x), (x, ry), (y, y), (y, rx), (rx, rx) and (ry, ry) are not zero.
    for (at, value) in [(0, 2.0), (4, 1.0), (6, 2.0), (8, -1.0), (15, 0.5), (18, 0.5)] {
        damping[at] = value;
    }
    expect_close("damping", &report.damping, &damping, close);
    // Where the tool is body b, friction drags the tool along with body a.
    system.contacts[0].tool_sign = -1.0;
    let report = reduce(&system, &[[impulse, 0.0, 0.0, 0.0]]);
    expect_close("force", &report.force, &[8.0, 0.0, 5.0], close);
    expect_close("torque", &report.torque, &[0.0, 4.0, 0.0], close);
}

#[test]
fn each_of_several_tools_has_its_own_contacts() {
    // wrench/reduce with three tools, pairs of bodies (a: tool 0, b: no tool), (a: no tool, b: tool 2) and (a: tool 2, b:
    // tool 0). All contacts have a pressure of 10 N/m^2; arms lead from tool_centre, which is the centre of tool 0. Where
    // the two tools touch, they slide along x: friction is 2 * 3 = 6 N.
    let pair = |tools| Pair { tools, ..Pair::default() };
    let pairs = [pair([0, NONE]), pair([NONE, 2]), pair([2, 0])];
    let contact = |pair: u32, area: f32, tool_sign: f32, arm: [f32; 3]| Contact {
        normal: [0.0, 0.0, 1.0],
        area,
        arm,
        tool_sign,
        depth: 0.5,
        stiffness: 20.0,
        side: 2 * pair,
        ..Contact::default()
    };
    let contacts = [
        contact(0, 0.1, 1.0, [0.0, 2.0, 0.0]),
        contact(1, 0.2, -1.0, [3.0, 0.0, 0.0]),
        Contact { friction: 2.0, slip: [3.0, 0.0, 0.0], ..contact(2, 0.4, 1.0, [0.0, 1.0, 1.0]) },
    ];
    let mut params =
        StepParams { dt: 1.0 / 128.0, wants_stiffness: 1, tool_centre: [1.0, 0.0, 0.0], ..StepParams::default() };
    for (held, x) in params.held.iter_mut().zip([1.0, 8.0, 2.0]) {
        held.centre = [x, 0.0, 0.0];
    }
    let old = ToolWrench { force: [7.0; 3], torque: [7.0; 3], ..ToolWrench::default() };
    let before = Report { tools: [old; 4], ..Report::default() };
    let outcome = case("wrench/reduce")
        .size(Size::Reduce)
        .constant("FRICTION", true)
        .constant("TOOLS", 3u32)
        .input("params", &[params])
        .input("counts", &[Counts { contacts: 3, ..Counts::default() }])
        .input("contacts", &contacts)
        .input("pairs", &pairs)
        .input("contact_forces", &[[0.0f32; 4]; 3])
        .partial("report", &[before])
        .groups(3)
        .run();
    let tools = outcome.get::<Report>("report")[0].tools;
    let rounding = Tolerance { abs: 1e-6, rel: 1e-6 };
    // Tool 0 is pushed down by 1 N at arm (0, 2, 0), and up by 4 N and along x by 6 N at its own point, arm (0, 1, 1) less
    // the depth of 0.5 along z.
    expect_close("force on tool 0", &tools[0].force, &[6.0, 0.0, 3.0], rounding);
    expect_close("torque on tool 0", &tools[0].torque, &[-2.0 + 4.0, 6.0 * 0.5, -6.0], rounding);
    expect_close("pressing on tool 0", &[tools[0].pressing], &[5.0], rounding);
    // Tool 1 touches nothing. Tool 2, whose centre is 1 m further along x, is pushed up by 2 N at arm (2, 0, 0), and down
    // by 4 N and against x by 6 N at arm (-1, 1, 1).
    assert_eq!(tools[1], ToolWrench::default());
    expect_close("force on tool 2", &tools[2].force, &[-6.0, 0.0, -2.0], rounding);
    expect_close("torque on tool 2", &tools[2].torque, &[-4.0, -4.0 - 4.0 - 6.0, 6.0], rounding);
    expect_close("pressing on tool 2", &[tools[2].pressing], &[6.0], rounding);
    expect_close("friction on tool 2", &tools[2].friction, &[-6.0, 0.0, 0.0], rounding);
    // Stiffness along z, and damping across it, which here is friction's alone: sums over both contacts.
    let diagonal = |upper: &[f32; 21]| [0, 6, 11].map(|k| upper[k]);
    expect_close("stiffness of tool 2", &diagonal(&tools[2].stiffness), &[0.0, 0.0, 20.0 * 0.6], rounding);
    expect_close("damping of tool 2", &diagonal(&tools[2].damping), &[2.0, 2.0, 0.0], rounding);
    assert_eq!(tools[3], old);
}

#[test]
fn sums_agree_with_the_oracle_at_every_size() {
    let width = context().reduce_size() as usize;
    for count in [0, 1, width - 1, width, width + 1, 1234] {
        let system = System::new(&two_layers(), 0.004, 1).with_tool();
        agree(system.with_contacts(count, count as u64), count as u64 + 9);
        let system = System::new(&two_layers(), 0.004, 1).with_tool().with_friction();
        agree(system.with_contacts(count, count as u64), count as u64 + 9);
    }
}

fn agree(system: System, seed: u64) {
    let (mut random, h) = (Random(seed), system.twin.dt);
    let (places, start) = (system.twin.unknowns(), system.start());
    let (mut forces, mut resolved) = (vec![], vec![]);
    for (twin, contact) in system.twin_contacts.iter().zip(&system.contacts) {
        // The impulse that solve/contact_product writes for a contact and some solution x is h (h k + d) a (J x), with
        // time step h, stiffness k, damping d, area a, and normal speed J x of up to 0.3 m/s.
        let speed = f64::from(0.3 * random.next() as f32);
        let slope = h * twin.stiffness + twin.damping;
        let normal = (h * slope * twin.area * speed) as f32;
        forces.push([f32::NAN, f32::NAN, f32::NAN, normal]);
        let rate: f64 = system.twin.row(&places, twin).iter().map(|(i, w)| w * start[*i]).sum();
        let pressure = twin.stiffness * twin.depth + slope * (rate + speed);
        let active = pressure > 0.0;
        let force = if active { twin.area * pressure } else { 0.0 };
        let (mut friction, mut viscosity) = (DVec3::ZERO, 0.0);
        if system.twin.friction.is_some() {
            let across = 0.3 * random.vector().reject_from_normalized(twin.normal);
            let drag = system.twin.drag(&places, &start, &vec![0.0; places.count], twin);
            viscosity = drag.viscosity;
            friction = if active { -viscosity * (drag.slip() + across) } else { DVec3::ZERO };
            let both = f64::from(normal) * twin.normal + h * f64::from(contact.friction) * across;
            forces.pop();
            forces.push(both.as_vec3().extend(normal).to_array());
        }
        resolved.push(Resolved { contact: twin.clone(), force, friction, viscosity, active });
    }
    let report = reduce(&system, &forces);
    let centre = system.twin.tool.as_ref().unwrap().centre;
    let want = wrench::on_tool(&resolved, centre);
    let size: f64 = resolved.iter().map(|r| r.force + r.friction.length()).sum();
    let (pushing, count) = (resolved.iter().filter(|r| r.active).count(), resolved.len());
    assert!(count < 100 || (pushing > count / 4 && pushing < count), "{pushing} of {count} contacts push");
    // Arms of contacts are up to 0.2 m long.
    let within = |scale: f64| Tolerance { abs: SUM * scale, rel: 0.0 };
    expect_close("force", &report.force, &want.force.to_array(), within(size));
    expect_close("torque", &report.torque, &want.torque.to_array(), within(0.2 * size));
    expect_close("pressing", &[report.pressing], &[want.pressing], within(size));
    expect_close("friction", &report.friction, &want.friction.to_array(), within(size));
    for (got, matrix) in [(report.stiffness, want.stiffness), (report.damping, want.damping)] {
        for (got, (want, scale)) in got.iter().zip(triangle(&matrix)) {
            expect_close("entry of stiffness or damping", &[*got], &[want], within(scale));
        }
    }
}

#[test]
fn stiffness_is_positive_and_reaction_is_opposite() {
    // wrench/reduce: x.Kx > 0 for the stiffness K of these contacts and a random twist x. With the sides of every
    // contact exchanged, the wrench changes its sign and K stays.
    let mut system = System::new(&two_layers(), 0.004, 1).with_tool().with_contacts(60, 3);
    let forces = vec![[0.0; 4]; 60];
    let report = reduce(&system, &forces);
    let at = |i: usize, k: usize| -> f64 {
        let (i, k) = (i.min(k), i.max(k));
        f64::from(report.stiffness[(0..i).map(|row| 6 - row).sum::<usize>() + k - i])
    };
    let mut random = Random(5);
    for _ in 0..50 {
        let x: [f64; 6] = std::array::from_fn(|_| random.next());
        let energy: f64 = (0..36).map(|k| x[k / 6] * at(k / 6, k % 6) * x[k % 6]).sum();
        assert!(energy > 0.0, "x.Kx = {energy} is not positive");
    }
    for contact in &mut system.contacts {
        contact.tool_sign = -contact.tool_sign;
    }
    let other = reduce(&system, &forces);
    assert_eq!(other.force, report.force.map(|x| -x));
    assert_eq!(other.torque, report.torque.map(|x| -x));
    assert_eq!((other.stiffness, other.damping), (report.stiffness, report.damping));
    assert!(report.force.iter().any(|x| *x != 0.0));
}
