//! Example: steps a simulation with a haptic device of the program's own. Each step takes the device's pose and returns
//! force and torque on the tool, the rigid body that the device leads; the contacts report where the tool presses. Here
//! the device moves on a circle over the cheek of a head. Run it by `cargo run --release --example device`.

use std::path::Path;

use palpate::{Options, Pose, Scene, Simulation};

fn main() -> palpate::Result<()> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/scenes/touch-head.toml");
    let scene = Scene::load(&file)?;
    // At the first run the head is prepared, which takes seconds; later runs find it in the user's cache folder.
    let mut simulation = Simulation::open(&scene, &Options::of_program())?;
    for step in 0..300 {
        let angle = 0.02 * f64::from(step);
        let position = [0.03 + 0.004 * angle.cos(), -0.02 + 0.004 * angle.sin(), 0.083].into();
        let report = simulation.step_at(Pose { position, ..Pose::default() })?;
        let Some(tool) = report.tool else { continue };
        if report.step % 50 == 0 {
            let contacts = simulation.contacts()?;
            let most = contacts.iter().map(|contact| contact.pressure).fold(0.0, f64::max);
            println!(
                "force {:.3} N, torque {:.4} N m, {} contacts, pressure up to {:.1} kPa",
                tool.force.length(),
                tool.torque.length(),
                contacts.len(),
                1e-3 * most
            );
        }
    }
    Ok(())
}
