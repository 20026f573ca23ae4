//! The pictures of the gallery that `palpate figures` renders: one picture of each scene in assets/gallery.

use palpate_view::Overlay;

use super::{Figure, Shot};
use crate::film::View;

/// Width and height of a picture, pixels.
const SIZE: [u32; 2] = [640, 480];
/// Folder of the gallery's scenes.
const SCENES: &str = "assets/gallery";

const fn one(
    scene: &'static str,
    time: f64,
    shown: &'static [Overlay],
    [yaw, pitch, nearer]: [f64; 3],
    aside: [f64; 3],
) -> Shot {
    Shot { scene, time, shown, from: View { yaw, pitch, nearer }, aside, size: SIZE, shows_time: true }
}

const fn figure(name: &'static str, file: &'static str, shots: &'static [Shot]) -> Figure {
    Figure { name, file, scenes: SCENES, shots }
}

pub const GALLERY: [Figure; 9] = [
    figure(
        "lump",
        "gallery-lump",
        &[one("lump", 0.45, &[Overlay::Materials, Overlay::Arrows], [20.0, 18.0, 1.15], [0.0, -0.01, 0.0])],
    ),
    figure(
        "forearm",
        "gallery-forearm",
        &[one("forearm", 0.4, &[Overlay::Materials, Overlay::Cores, Overlay::Arrows], [25.0, 18.0, 1.2], [0.0; 3])],
    ),
    figure(
        "two-bodies",
        "gallery-two-bodies",
        &[one("two-bodies", 0.5, &[Overlay::Materials], [20.0, 12.0, 1.2], [0.0; 3])],
    ),
    figure("gears", "gallery-gears", &[one("gears", 0.5, &[Overlay::Energy], [15.0, 20.0, 1.15], [0.0; 3])]),
    figure(
        "pad-in-hand",
        "gallery-pad-in-hand",
        &[one("pad-in-hand", 0.4, &[Overlay::Arrows], [65.0, 18.0, 1.6], [0.0, 0.0, 0.07])],
    ),
    figure(
        "finger",
        "gallery-finger",
        &[one("finger", 0.5, &[Overlay::Cores, Overlay::Arrows], [20.0, 15.0, 0.95], [0.0, -0.012, 0.0])],
    ),
    figure(
        "drag",
        "gallery-drag",
        &[one("drag", 0.5, &[Overlay::Displacement, Overlay::Arrows], [25.0, 30.0, 1.6], [0.0; 3])],
    ),
    figure(
        "cushion",
        "gallery-cushion",
        &[one("cushion", 0.4, &[Overlay::Layer, Overlay::Displacement, Overlay::Arrows], [25.0, 18.0, 1.3], [0.0; 3])],
    ),
    figure(
        "needle",
        "gallery-needle",
        &[one("needle", 0.4, &[Overlay::Displacement, Overlay::Arrows], [25.0, 20.0, 0.8], [0.0, 0.008, 0.0])],
    ),
];
