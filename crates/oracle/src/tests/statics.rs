//! Tests of linear static equilibrium in f64 against solutions in closed form: a column under its weight, a cantilever.

use glam::{DMat3, DVec3};
use palpate::internal::prepare::layer::kuhn_box;

use super::material;
use crate::elastic::{Elements, lame};
use crate::testing::boundary;
use crate::{skin, statics};

/// A column between frictionless side walls bears its weight at `gravity` (m/s^2) and `pressure` (Pa) on its top.
/// Returns the greatest error of the mean height of a horizontal section, relative to the settlement of the top. The
/// stress in closed form is rho g (y - H) - p = (lambda + 2 mu) du/dy, with density rho, gravity g, column height H,
/// pressure p, vertical displacement u at height y, and Lame parameters lambda and mu.
fn column(cells: u32, gravity: f64, pressure: f64) -> f64 {
    let (height, side) = (0.4, 0.1);
    let layer = kuhn_box(DVec3::ZERO, DVec3::new(side, height, side), [cells / 4, cells, cells / 4]);
    let elements = Elements::new(&layer, material(1e5, 0.3), DMat3::IDENTITY);
    let fixed: Vec<_> = layer.nodes.iter().map(|x| [true, x.y == 0.0, true]).collect();
    let top: Vec<_> =
        boundary(&layer).into_iter().filter(|t| t.iter().all(|i| layer.nodes[*i as usize].y > height - 1e-9)).collect();
    let areas = skin::areas(&layer.nodes, &top);
    let load = |(m, a): (&f64, &f64)| DVec3::new(0.0, -m * gravity - a * pressure, 0.0);
    let loads: Vec<_> = elements.masses.iter().zip(&areas).map(load).collect();
    let u = statics::solve(&elements, &fixed, &loads).unwrap();
    let (mu, lambda) = lame(&elements.materials[0]);
    let modulus = lambda + 2.0 * mu;
    let exact = |y: f64| -(1000.0 * gravity * (height * y - 0.5 * y * y) + pressure * y) / modulus;
    let section = |level: u32| {
        let y = height * level as f64 / cells as f64;
        let nodes = layer.nodes.iter().zip(&u).filter(|(x, _)| (x.y - y).abs() < 1e-9);
        let heights: Vec<f64> = nodes.map(|(_, u)| u.y).collect();
        let mean = heights.iter().sum::<f64>() / heights.len() as f64;
        (mean - exact(y)).abs() / exact(height).abs()
    };
    (0..=cells).map(section).fold(0.0, f64::max)
}

#[test]
fn column_between_rollers_settles_as_in_the_closed_solution() {
    let pressed = column(8, 0.0, 500.0);
    let (coarse, fine) = (column(8, 9.81, 0.0), column(16, 9.81, 0.0));
    println!(
        "column, error relative to the settlement of its top: under pressure {pressed:.1e}, under its weight \
         {coarse:.1e}, under its weight with cells of half the size {fine:.1e}"
    );
    assert!(pressed < 1e-11, "uniform strain must be exact");
    // The corners of a Kuhn cell (a cube of six tetrahedra) carry unequal shares of its weight, so a section does not
    // stay quite flat; the error is of second order in the size of the cells.
    assert!(coarse < 5e-4 && coarse / fine > 3.5);
}

/// Tip deflection, weighted with the load, of a 1 x 0.2 x 0.2 m cantilever with Poisson's ratio 0 under a parabolic
/// shear load at its tip, with `n` cells across; relative to Timoshenko's P L^3 / (3 E I) + 6/5 P L / (G A), with load
/// P, length L, Young's modulus E, second moment of area I, shear modulus G and section area A.
fn cantilever(n: u32) -> f64 {
    let (length, side, young) = (1.0, 0.2, 1e6);
    let layer = kuhn_box(DVec3::ZERO, DVec3::new(length, side, side), [5 * n, n, n]);
    let elements = Elements::new(&layer, material(young, 0.0), DMat3::IDENTITY);
    let fixed: Vec<_> = layer.nodes.iter().map(|x| [x.x == 0.0; 3]).collect();
    let weight = |x: &DVec3| {
        let edge = |t: f64| if t < 1e-9 || t > side - 1e-9 { 0.5 } else { 1.0 };
        let tip = if x.x > length - 1e-9 { 1.0 } else { 0.0 };
        tip * parabola(x.y / side, 1.0 / n as f64) * edge(x.z)
    };
    let total: f64 = layer.nodes.iter().map(weight).sum();
    let loads: Vec<_> = layer.nodes.iter().map(|x| DVec3::new(0.0, -weight(x) / total, 0.0)).collect();
    let u = statics::solve(&elements, &fixed, &loads).unwrap();
    let deflection: f64 = u.iter().zip(&loads).map(|(u, p)| u.dot(*p)).sum();
    let (inertia, area) = (side.powi(4) / 12.0, side * side);
    let timoshenko = length.powi(3) / (3.0 * young * inertia) + 1.2 * length / (0.5 * young * area);
    deflection / timoshenko
}

/// Share of a parabolic load 6 x (1 - x), for heights x from 0 to 1, that falls on the node at height `t` of linear
/// elements of size `h`.
fn parabola(t: f64, h: f64) -> f64 {
    // Simpson's rule is exact here: the parabola times half of a node's linear hat function is a cubic.
    let half = |s: f64| {
        let at = |x: f64| if (-1e-9..=1.0 + 1e-9).contains(&x) { 6.0 * x * (1.0 - x) } else { 0.0 };
        if !(-1e-9..=1.0 + 1e-9).contains(&(t + s * h)) { 0.0 } else { h / 6.0 * (at(t) + 2.0 * at(t + 0.5 * s * h)) }
    };
    half(1.0) + half(-1.0)
}

#[test]
fn cantilever_converges_to_timoshenko() {
    let ratios: Vec<f64> = [2, 4, 8].into_iter().map(cantilever).collect();
    let errors: Vec<f64> = ratios.iter().map(|r| (1.0 - r).abs()).collect();
    let orders: Vec<f64> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
    println!("ratios of deflection to Timoshenko's {ratios:.4?}, observed orders of convergence {orders:.2?}");
    assert!(ratios.iter().all(|r| *r < 1.0), "linear elements must be too stiff, not too soft");
    assert!(orders[1] > 1.7 && orders[1] > orders[0], "orders of convergence {orders:?} must rise above 1.7");
}
