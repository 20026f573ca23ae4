//! Tests of rendered images of a simulation, which must look like the golden images (stored references), and of the
//! films (image sequences) and snapshots (single images) that the built program `palpate` writes. A *contact patch* is
//! a place where a pair of bodies may touch; an image can show it as a rectangle.
//!
//! `PALPATE_WRITE_GOLDEN=1 cargo test --release --test pictures` overwrites the golden images with newly rendered ones.
//! Look at the new images before you keep them.
#![cfg(feature = "view")]

use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use glam::DVec3;
use image_compare::prelude::{ImageBuffer, Rgb, RgbImage};
use palpate::{Options, Scene, Simulation, Threads};
use palpate_view::picture::Picture;
use palpate_view::{Overlay, Overlays, Settings, Studio};
use tempfile::TempDir;

#[path = "harness/likeness.rs"]
mod likeness;
#[path = "../../../vk-tests/harness/spoil.rs"]
mod spoil;

use likeness::{ALIKE, likeness, read};

/// Width and height of the images, pixels.
const SIZE: [u32; 2] = [480, 270];
/// A golden image: the scene and the camera that it is made with.
struct Golden {
    name: &'static str,
    scene: &'static str,
    steps: usize,
    shown: &'static [Overlay],
    /// The camera's angle to the right of the scene's front, its angle above the horizon (both in degrees), and its
    /// zoom factor (1 shows everything).
    from: [f64; 3],
    /// Vector from the middle of all bodies to the point that the camera looks at, m.
    aside: [f64; 3],
}

const GOLDEN: [Golden; 9] = [
    Golden { name: "head", scene: "touch", steps: 60, shown: &[], from: [25.0, 12.0, 1.0], aside: [0.0; 3] },
    Golden {
        name: "pressure",
        scene: "touch",
        steps: 60,
        shown: &[Overlay::Pressure, Overlay::Arrows],
        from: [45.0, 8.0, 3.0],
        aside: [0.0, -0.05, 0.07],
    },
    Golden {
        name: "proxies",
        scene: "touch",
        steps: 60,
        shown: &[Overlay::Proxies, Overlay::ContactPatches],
        from: [25.0, 12.0, 1.0],
        aside: [0.0; 3],
    },
    Golden {
        name: "layer",
        scene: "touch",
        steps: 60,
        shown: &[Overlay::Layer, Overlay::Cores, Overlay::Displacement],
        from: [40.0, 12.0, 1.2],
        aside: [-0.07, -0.03, 0.06],
    },
    Golden { name: "fine", scene: "fine", steps: 40, shown: &[], from: [-10.0, 12.0, 1.0], aside: [0.0; 3] },
    Golden {
        name: "displacement",
        scene: "fine",
        steps: 40,
        shown: &[Overlay::Displacement],
        from: [40.0, 8.0, 2.0],
        aside: [-0.03, -0.05, 0.06],
    },
    Golden {
        name: "energy",
        scene: "pair",
        steps: 50,
        shown: &[Overlay::Energy],
        from: [20.0, 10.0, 2.0],
        aside: [-0.06, -0.04, 0.0],
    },
    Golden {
        name: "regions",
        scene: "pair",
        steps: 50,
        shown: &[Overlay::ContactPatches, Overlay::Cores],
        from: [20.0, 10.0, 1.0],
        aside: [0.0; 3],
    },
    Golden {
        name: "materials",
        scene: "parts",
        steps: 10,
        shown: &[Overlay::Materials],
        from: [25.0, 20.0, 1.0],
        aside: [0.0; 3],
    },
];

fn golden_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

fn device() -> Option<String> {
    std::env::var("PALPATE_TEST_DEVICE").ok()
}

/// Loads the scene of this name from the golden folder and steps it; returns the simulation and a studio, which renders
/// images of it. Each shader named in `replaced` is replaced by the SPIR-V that is given with its name.
fn studio(scene: &str, steps: usize, replaced: Vec<(String, Vec<u8>)>) -> (Simulation, Studio) {
    let scene = Scene::load(&golden_folder().join(format!("{scene}.toml"))).unwrap();
    let options = Options { device: device(), threads: Some(Threads::Auto), replaced, ..Options::of_program() };
    let mut simulation = Simulation::open(&scene, &options).unwrap();
    let studio = Studio::new(&mut simulation, Settings { size: SIZE, samples: 4 }).unwrap();
    for _ in 0..steps {
        simulation.step().unwrap();
    }
    (simulation, studio)
}

impl Golden {
    fn aim(&self, studio: &mut Studio) {
        let plain = studio.renderer().camera();
        let [yaw, pitch, nearer] = self.from;
        (studio.camera.yaw, studio.camera.pitch) = (yaw.to_radians(), pitch.to_radians());
        studio.camera.distance = plain.distance / nearer;
        studio.camera.target = plain.target + DVec3::from(self.aside);
        studio.shown = Overlays::of(self.shown);
    }
}

fn image(picture: &Picture) -> RgbImage {
    ImageBuffer::from_raw(picture.width, picture.height, picture.rgb()).unwrap()
}

#[test]
fn pictures_look_like_the_golden_ones() {
    let is_written = std::env::var_os("PALPATE_WRITE_GOLDEN").is_some();
    for scene in ["touch", "fine", "pair", "parts"] {
        let all: Vec<&Golden> = GOLDEN.iter().filter(|golden| golden.scene == scene).collect();
        let steps = all[0].steps;
        assert!(all.iter().all(|golden| golden.steps == steps));
        let (mut simulation, mut studio) = studio(scene, steps, vec![]);
        for golden in all {
            golden.aim(&mut studio);
            let picture = studio.picture(&mut simulation).unwrap();
            let file = golden_folder().join(format!("{}.png", golden.name));
            if is_written {
                picture.write_png(fs::File::create(&file).unwrap()).unwrap();
            }
            let alike = likeness(&image(&picture), &read(&file));
            println!("image {}: the similarity to its golden image is {alike:.4}", golden.name);
            if alike < ALIKE {
                let seen = std::env::temp_dir().join(format!("palpate-{}.png", golden.name));
                picture.write_png(fs::File::create(&seen).unwrap()).unwrap();
                panic!(
                    "the rendered image {} has a similarity of only {alike:.3} to {}; the rendered image is now in {}",
                    golden.name,
                    file.display(),
                    seen.display()
                );
            }
        }
    }
}

/// The image with its legend painted over, because the legend's letters differ between pressure and depth.
fn unlabelled(mut image: RgbImage) -> RgbImage {
    for (x, y, pixel) in image.enumerate_pixels_mut() {
        if x < 300 && y > 150 {
            *pixel = Rgb([255; 3]);
        }
    }
    image
}

#[test]
fn the_comparison_sees_what_eyes_see() {
    let (mut simulation, mut studio) = studio("touch", 60, vec![]);
    let mut sun_at = |studio: &mut Studio, golden: &Golden, sun: DVec3| {
        golden.aim(studio);
        studio.renderer().set_sun(sun);
        image(&studio.picture(&mut simulation).unwrap())
    };
    let sun = DVec3::new(-0.25, 0.85, 0.8);
    let [plain, pressed, ..] = &GOLDEN;
    let head = sun_at(&mut studio, plain, sun);
    // Noise of one intensity level must not count as a difference.
    let mut noise = head.clone();
    let mut state = 1u32;
    for byte in noise.iter_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *byte = byte.saturating_add_signed((state >> 16) as i8 % 2);
    }
    let alike = likeness(&head, &noise);
    println!("the similarity of the image with noise to the image without noise is {alike:.3}");
    assert!(head != noise && alike > ALIKE, "the similarity {alike} of the image with noise is too low");
    let expect_seen = |what: &str, a: &RgbImage, b: &RgbImage| {
        let alike = likeness(a, b);
        println!("{what}: the similarity to the image without this change is {alike:.3}");
        assert!(alike < ALIKE, "{what}: the similarity {alike} to the image without this change is too high");
    };
    // The comparison must notice light from another direction; light from below casts no shadow on the ground.
    expect_seen("light from the right", &head, &sun_at(&mut studio, plain, DVec3::new(0.8, 0.85, 0.3)));
    expect_seen("light 13 degrees lower", &head, &sun_at(&mut studio, plain, DVec3::new(-0.25, 0.62, 0.95)));
    expect_seen("light from below", &head, &sun_at(&mut studio, plain, -sun));
    for golden in [plain, pressed] {
        let before = sun_at(&mut studio, golden, sun);
        for [right, up] in [[2.0, 0.0], [0.0, 2.0]] {
            let [yaw, pitch, nearer] = golden.from;
            let moved = Golden { from: [yaw + right, pitch + up, nearer], ..*golden };
            expect_seen(
                &format!("image {}, camera turned by {right} degrees to the right and {up} degrees up", golden.name),
                &before,
                &sun_at(&mut studio, &moved, sun),
            );
        }
    }
    // The comparison must notice another colour map: the image of pressure is compared with the image of depth, a field
    // with a similar distribution on the surface and another colour map.
    let [pressure, depth] = [Overlay::Pressure, Overlay::Depth].map(|field| {
        pressed.aim(&mut studio);
        studio.renderer().set_sun(sun);
        studio.shown = Overlays::of(&[field]);
        unlabelled(image(&studio.picture(&mut simulation).unwrap()))
    });
    let alike = likeness(&pressure, &depth);
    println!("the similarity of the image of pressure to the image of depth is {alike:.3}");
    assert!(alike < ALIKE, "the similarity {alike} of the images of pressure and depth is too high");
}

#[test]
fn the_comparison_sees_that_a_shadow_is_missing() {
    for (name, shader, from, to) in [
        ("head", "view/ground.frag", "(1.0 - lit(x, n))", "(1e-9 * lit(x, n))"),
        ("head", "view/mesh.frag", "lit(x, n))", "1.0 + 1e-9 * lit(x, n))"),
        ("fine", "view/mesh.vert", "lit(x, normal))", "1.0 + 1e-9 * lit(x, normal))"),
    ] {
        let golden = GOLDEN.iter().find(|golden| golden.name == name).unwrap();
        let file = read(&golden_folder().join(format!("{name}.png")));
        let replaced = vec![(shader.to_string(), spoil::spoiled(shader, from, to))];
        let (mut simulation, mut studio) = studio(golden.scene, golden.steps, replaced);
        golden.aim(&mut studio);
        let alike = likeness(&file, &image(&studio.picture(&mut simulation).unwrap()));
        println!("{shader} without a shadow: the similarity to the golden image is {alike:.3}");
        assert!(alike < ALIKE, "{shader} without a shadow: the similarity {alike} to the golden image is too high");
    }
}

/// A scene in which the tool (the rigid body that the haptic device leads), a ball of 50 g, is close above a soft
/// block.
const SCENE: &str = "[step]\ngravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [4, 3, 4] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [[body.core]]\nname = \"bottom\"\nbind = { box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }\n\
    [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.051, 0.0]\n\
    [coupling]\nstiffness = 500.0\ndamping = 5.0\nangular_stiffness = 0.5\nangular_damping = 0.005\n\
    [drive]\nkeys = [[0.0, 0.0, 0.051, 0.0], [0.05, 0.0, 0.043, 0.0]]\n";

/// A temporary folder that holds [`SCENE`] as `scene.toml`.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    folder
}

/// Runs the program `palpate` in a folder, with these arguments.
fn palpate(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.args(arguments).current_dir(folder);
    // No command that these tests run opens a window, so none needs a display.
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    if let Some(device) = device().filter(|_| arguments[0] != "devices") {
        command.args(["--device", &device]);
    }
    command.output().unwrap()
}

fn succeed(folder: &Path, arguments: &[&str]) {
    let output = palpate(folder, arguments);
    assert!(output.status.success(), "palpate {arguments:?} failed: {}", String::from_utf8_lossy(&output.stderr));
}

/// Names of the files and folders in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let all = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut all: Vec<_> = all.collect();
    all.sort();
    all
}

/// The images of an animated PNG, each with the time for which it is shown, s.
fn frames(file: &Path) -> Vec<(RgbImage, f64)> {
    let mut reader = png::Decoder::new(BufReader::new(fs::File::open(file).unwrap())).read_info().unwrap();
    let control = *reader.info().animation_control().expect("the PNG must be animated");
    assert_eq!(control.num_plays, 0, "the animation must play for ever");
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let mut all = Vec::new();
    for _ in 0..control.num_frames {
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!(info.color_type, png::ColorType::Rgb);
        let frame = *reader.info().frame_control().unwrap();
        let delay = f64::from(frame.delay_num) / f64::from(frame.delay_den);
        all.push((ImageBuffer::from_raw(info.width, info.height, bytes.clone()).unwrap(), delay));
    }
    assert!(reader.next_frame(&mut bytes).is_err(), "the file has more images than it declares");
    all
}

#[test]
fn films_are_the_same_every_time() {
    let folder = folder();
    let film = |out: &str| {
        let look = ["--size", "96x54", "--fps", "100", "--seconds", "0.04", "--show", "pressure,force"];
        succeed(folder.path(), &[&["film", "scene.toml", "--out", out][..], &look].concat());
    };
    film("one.apng");
    film("two.png");
    film("frames");
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("one.apng") == bytes("two.png"), "two runs made different films");
    let animated = frames(&folder.path().join("one.apng"));
    assert_eq!(animated.len(), 5, "the film must have an image at each of 0, 10, 20, 30 and 40 ms");
    assert!(animated.iter().all(|(frame, delay)| frame.dimensions() == (96, 54) && (delay - 0.01).abs() < 1e-12));
    assert!(animated[0].0 != animated[4].0, "the first and the last image must differ");
    let expected: Vec<String> = (0..5).map(|k| format!("frame-{k:05}.png")).collect();
    assert_eq!(names(&folder.path().join("frames")), expected);
    for (name, (frame, _)) in expected.iter().zip(&animated) {
        assert!(read(&folder.path().join("frames").join(name)) == *frame, "{name} differs from the image in the film");
    }
    // At half the speed the images are 5 ms of simulated time apart, so every other one shows a moment of the first
    // film.
    let slow = ["--size", "96x54", "--fps", "100", "--speed", "0.5", "--seconds", "0.04", "--show", "pressure,force"];
    succeed(folder.path(), &[&["film", "scene.toml", "--out", "slow.apng"][..], &slow].concat());
    let slow = frames(&folder.path().join("slow.apng"));
    assert_eq!(slow.len(), 9);
    // Only the first images are compared: the colour scale of pressure may be set at a moment that only the slow film
    // shows.
    assert!(slow[0].0 == animated[0].0);
    assert_eq!(names(folder.path()), ["frames", "one.apng", "scene.toml", "slow.apng", "two.png"]);
}

#[test]
fn films_tell_the_time_in_a_corner() {
    let folder = folder();
    let film = |out: &str, more: &[&str]| {
        let look = ["--size", "480x270", "--fps", "100", "--seconds", "0.01", "--camera", "25,12,0.5"];
        succeed(folder.path(), &[&["film", "scene.toml", "--out", out][..], &look, more].concat());
        // The name of a folder may have a dot, if what follows the dot is not the ending of a video file.
        [0, 1].map(|k| read(&folder.path().join(format!("{out}/frame-{k:05}.png"))))
    };
    let (with, without) = (film("with.time", &[]), film("without", &["--no-time"]));
    let is_in_corner = |x: u32, y: u32| x < 100 && y < 35;
    for (with, without) in with.iter().zip(&without) {
        let changed = with.enumerate_pixels().filter(|(x, y, pixel)| *pixel != without.get_pixel(*x, *y));
        let changed: Vec<(u32, u32)> = changed.map(|(x, y, _)| (x, y)).collect();
        assert!(changed.len() > 200, "only {} pixels tell the time", changed.len());
        assert!(changed.iter().all(|(x, y)| is_in_corner(*x, *y)), "the time is outside of its corner");
    }
    let differ = |[a, b]: &[RgbImage; 2]| {
        a.enumerate_pixels().any(|(x, y, pixel)| is_in_corner(x, y) && pixel != b.get_pixel(x, y))
    };
    assert!(differ(&with) && !differ(&without), "in the corner the time must change, and nothing else");
}

/// The rows of a trace, one for each step, without the columns of the times that the steps took to compute.
fn untimed(file: &Path) -> Vec<Vec<String>> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let timed: Vec<bool> = reader.headers().unwrap().iter().map(|name| name.ends_with("_us")).collect();
    let cells = |row: csv::StringRecord| {
        row.iter().enumerate().filter(|(k, _)| !timed[*k]).map(|(_, cell)| cell.to_string()).collect()
    };
    reader.records().map(|row| cells(row.unwrap())).collect()
}

#[test]
fn snapshots_leave_the_trace_as_it_is() {
    let folder = folder();
    let run = ["run", "scene.toml", "--steps", "30", "--out"];
    succeed(folder.path(), &[&run[..], &["without"]].concat());
    let look = ["--snapshot", "10", "--size", "96x54", "--show", "materials,force,layer,cores,regions,proxies"];
    succeed(folder.path(), &[&run[..], &["with"], &look].concat());
    let [without, with] = ["without", "with"].map(|name| folder.path().join(name));
    let trace = untimed(&without.join("trace.csv"));
    assert_eq!(trace.len(), 30);
    assert!(trace == untimed(&with.join("trace.csv")), "snapshots must not change the simulation");
    let new: Vec<String> = names(&with).into_iter().filter(|name| !names(&without).contains(name)).collect();
    assert_eq!(new, [10, 20, 30].map(|step| format!("snapshot-{step:06}.png")));
    assert_eq!(read(&with.join("snapshot-000010.png")).dimensions(), (96, 54));
    assert!(read(&with.join("snapshot-000010.png")) != read(&with.join("snapshot-000030.png")));
    for name in ["block.obj", "block.vtk"] {
        assert!(
            fs::read(with.join(name)).unwrap() == fs::read(without.join(name)).unwrap(),
            "{name} differs between the run with snapshots and the run without"
        );
    }
}

#[test]
fn a_snapshot_is_what_the_studio_takes() {
    let (mut simulation, mut studio) = studio("touch", 20, vec![]);
    let [_, golden, ..] = &GOLDEN;
    golden.aim(&mut studio);
    let at = studio.camera.target.to_array().map(|x| format!("{x:?}")).join(",");
    studio.shows_time = true;
    let taken = image(&studio.picture(&mut simulation).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let scene = golden_folder().join("touch.toml");
    let [yaw, pitch, nearer] = golden.from;
    let camera = format!("{yaw},{pitch},{nearer}");
    let run = ["run", scene.to_str().unwrap(), "--steps", "20", "--out", "out", "--snapshot", "20"];
    let look = ["--size", "480x270", "--camera", &camera, "--at", &at, "--show", "force,pressure"];
    succeed(folder.path(), &[&run[..], &look].concat());
    assert!(read(&folder.path().join("out/snapshot-000020.png")) == taken);
}

/// Checks that the program refuses the arguments with a message of one line and makes no file; returns the message.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let before = names(folder);
    let output = palpate(folder, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "wrong exit status of palpate {arguments:?}; it printed: {message}");
    assert_eq!(message.lines().count(), 1, "palpate {arguments:?} must print one line; it printed: {message}");
    assert!(message.starts_with("error: ") && !message.contains("panicked"), "wrong error: {message}");
    assert!(output.stdout.is_empty(), "standard output must be empty");
    assert_eq!(names(folder), before, "palpate {arguments:?} must make no file");
    message
}

#[test]
fn what_cannot_be_pictured_is_refused_in_one_line() {
    let folder = folder();
    let folder = folder.path();
    fs::write(folder.join("file"), "mine").unwrap();
    fs::create_dir(folder.join("taken.apng")).unwrap();
    fs::write(folder.join("taken.apng/mine"), "mine").unwrap();
    for (more, words) in [
        (&["--size", "0x5"][..], "give width and height from 1 to 16384"),
        (&["--size", "99999x10"], "give width and height from 1 to 16384"),
        (&["--size", "64"], "give width and height"),
        (&["--fps", "0"], "0 is not in 1..=1000"),
        (&["--fps", "1001"], "1001 is not in 1..=1000"),
        (&["--speed", "0"], "give a number greater than zero"),
        (&["--speed", "nan"], "give a number greater than zero"),
        (&["--seconds", "-1"], "give a number greater than zero"),
        (&["--show", "nonsense"], "give some of pressure, depth, force"),
        (&["--show", ""], "give some of pressure, depth, force"),
        (&["--show", "depth,pressure"], "show only one of pressure, depth"),
        (&["--show", "materials,depth"], "show only one of pressure, depth"),
        (&["--camera", "x"], "give two angles in degrees"),
        (&["--camera", "1,2,0"], "give two angles in degrees"),
        (&["--camera", "1,2,3,4"], "give two angles in degrees"),
        (&["--camera", "inf,2"], "give two angles in degrees"),
        (&["--at", "1,2"], "give three numbers"),
        (&["--seconds", "1e9"], "100000 at most"),
        (&["--seconds", "1e300", "--speed", "1e-300"], "100000 at most"),
    ] {
        let message = refusal(folder, &[&["film", "scene.toml", "--out", "out.apng"][..], more].concat());
        assert!(message.contains(words), "options {more:?}: wrong error: {message}");
    }
    for (out, words) in [
        ("file/film.apng", "file"),
        ("file", "file"),
        ("file/under/frames", "file/under/frames"),
        ("taken.apng", "taken.apng"),
        ("/proc/none/film.apng", "/proc/none"),
        ("", "out"),
    ] {
        let short = ["--size", "8x8", "--seconds", "0.002", "--fps", "1000"];
        let message = refusal(folder, &[&["film", "scene.toml", "--out", out][..], &short].concat());
        assert!(message.contains(words), "--out {out}: wrong error: {message}");
    }
    assert_eq!(names(&folder.join("taken.apng")), ["mine"]);
    let message = refusal(folder, &["film", "missing.toml", "--out", "out.apng"]);
    assert!(message.contains("missing.toml: cannot be read"), "wrong error: {message}");
    let message = refusal(folder, &["film", "scene.toml"]);
    assert!(message.contains("--out"), "wrong error: {message}");
    for (more, words) in [
        (&["--snapshot", "5"][..], "--out"),
        (&["--snapshot", "0", "--out", "out"], "give a whole number from 1"),
        (&["--snapshot", "x", "--out", "out"], "give a whole number from 1"),
        (&["--snapshot", "5", "--out", "out", "--show", "energy,depth"], "show only one of pressure, depth"),
        (&["--snapshot", "1", "--steps", "2", "--out", "file"], "file"),
    ] {
        let message = refusal(folder, &[&["run", "scene.toml"][..], more].concat());
        assert!(message.contains(words), "options {more:?}: wrong error: {message}");
    }
    let message = refusal(folder, &["figures", "--out", "out", "--only", "3"]);
    assert!(message.contains("give some of 1, 2, 4, 5, 6, 7, lump, forearm"), "wrong error: {message}");
    let message = refusal(folder, &["figures", "--out", "out", "--only", "lump", "--gallery"]);
    assert!(message.contains("--gallery"), "wrong error: {message}");
    for name in ["x.mp4", "x.gif", "x.WebM", "x.avi", "x.mov", "x.mkv", "sub/x.mp4"] {
        let message = refusal(folder, &["film", "scene.toml", "--out", name, "--fps", "30"]);
        assert!(message.contains(name) && message.contains("give FILE.apng"), "--out {name}: wrong error: {message}");
        let command = "ffmpeg -framerate 30 -i DIRECTORY/frame-%05d.png";
        assert!(
            message.contains(command) && message.trim_end().ends_with(name),
            "--out {name}: wrong error: {message}"
        );
    }
    let message = refusal(folder, &["run", "scene.toml", "--steps", "1", "--no-time"]);
    assert!(message.contains("give --snapshot N"), "wrong error: {message}");
    let message = refusal(folder, &["figures", "--out", "out", "--only", "1", "--scenes", "nowhere"]);
    assert!(message.contains("touch-head.toml"), "wrong error: {message}");
    assert_eq!(fs::read_to_string(folder.join("file")).unwrap(), "mine");
}
