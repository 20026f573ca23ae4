//! Example: finds a lump by touch. A spherical tool (the rigid body that a haptic device leads) slides along a slab of
//! gel that contains a stiffer sphere, and the force on the tool is printed along the way. Run it by
//! `cargo run --release --example slide`.

use palpate::scene::{Bind, Body, Contact, Core, Coupling, Key, Material, Place, Region, Tool};
use palpate::{Options, SceneBuilder, Simulation};

fn main() -> palpate::Result<()> {
    let gel = Material::new(1.5e4, 0.45, 1000.0);
    let mut slab = Body::block("slab", [-0.06, -0.02, -0.02], [0.06, 0.0, 0.02], [24, 4, 8], gel);
    slab.cores
        .push(Core::fixed("table", Bind::Box { low: [-1.0, -1.0, -1.0].into(), high: [1.0, -0.019, 1.0].into() }));
    let lump = Place::Sphere { centre: [0.0, -0.008, 0.0].into(), radius: 0.008 };
    slab.regions.push(Region { place: lump, material: Material { young: 1.5e5, ..gel } });
    let way = [[-0.04, 0.012], [-0.04, 0.006], [0.04, 0.006]];
    let keys = [0.0, 0.1, 0.6].iter().zip(way).map(|(time, [x, y])| Key::at(*time, [x, y, 0.0])).collect();
    let scene = SceneBuilder::new("slide")
        .contact(Contact { friction: 0.1, ..Contact::default() })?
        .body(slab)?
        .tool(Tool::sphere(0.01, 0.05).at([-0.04, 0.012, 0.0]))?
        .coupling(Coupling { stiffness: 1000.0, damping: 10.0, ..Coupling::default() })?
        .trajectory(keys)?
        .build()?;
    let mut simulation = Simulation::open(&scene, &Options::default())?;
    for _ in 0..600 {
        let report = simulation.step()?;
        let Some(tool) = report.tool else { continue };
        if report.step % 25 == 0 {
            let along = 1e3 * tool.tool.position.x;
            println!(
                "tool at x = {along:6.1} mm: force {:.3} N upwards, {:+.3} N along the slab; flags {:?}",
                tool.force.y, tool.force.x, report.flags
            );
        }
    }
    Ok(())
}
