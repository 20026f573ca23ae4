//! `palpate prepare`: makes a layered body of a surface: skin (the surface mesh), layer (a tetrahedral mesh around a
//! rigid core) and proxies (convex collision hulls). Writes the body with a report, images, and a scene in which a
//! sphere presses into the body.

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use palpate::internal::files;
use palpate::internal::prepare::report::peak_memory;
use palpate::internal::prepare::{self, Body, Cache, Layer, Report, Shape, Skin, Stage, bind};
use palpate::scene::triangles::EXTENSIONS;
use palpate::scene::units::UNITS;
use palpate::scene::{self, Material, MaterialLaw, Model, Surface, gmsh, obj};
use palpate::{Error, Result, Scene};
use sha2::{Digest, Sha256};

use crate::press::{self, Press};
use crate::report::picture::Picture;
use crate::report::{Output, figure};
use crate::{print, tell};

/// Number of steps of the progress bar after the body is made: one for the images, one for the files.
const AFTER: u64 = 2;

/// The scene that is written; where an edited one has that name, `scene-1.toml` and so on.
const SCENE: &str = "scene.toml";
/// Key of `report.json` with the digests (SHA-256) of the scenes that were written, by the names of their files.
const DIGESTS: &str = "scenes_sha256";

/// Default number of lattice cells (cubes that are filled with tetrahedra) along a surface's largest extent.
const CELLS: u32 = 40;

/// Options of `palpate prepare`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The surface: a file (OBJ, STL, PLY, glTF, VTP, VTU, VTK), or a built-in model (head, pumpkin, gear, human, sphere),
    /// as head or head:44000 (number of vertices)
    surface: String,
    /// Directory to write the body, its report and images into [default: the surface's name without its extension]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Edge of the lattice cells that are filled with tetrahedra, in the surface's units [default: a fortieth of the
    /// surface's largest extent]
    #[arg(long, value_name = "C", conflicts_with = "cells", value_parser = positive, allow_negative_numbers = true)]
    cell: Option<f64>,
    /// Number of lattice cells along the surface's largest extent
    #[arg(long, value_name = "N", default_value_t = CELLS, value_parser = clap::value_parser!(u32).range(1..=1000))]
    cells: u32,
    /// Edge of the largest cells deep inside, as a multiple of the edge of cells at the surface: 1, 2, 4 or 8
    #[arg(long, value_name = "G", default_value_t = 1, value_parser = grade)]
    grade: u32,
    /// Fill only a shell below the surface, of this thickness in the surface's units [default: fill everything]
    #[arg(long, value_name = "T", value_parser = positive, allow_negative_numbers = true)]
    thickness: Option<f64>,
    /// Greatest number of convex collision hulls
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(scene::MOST_HULLS)))]
    hulls: Option<u32>,
    /// Unit of the surface's lengths [default: m]
    #[arg(long, value_name = "U", value_parser = unit)]
    units: Option<f64>,
    /// Factor by which the surface's lengths are multiplied besides
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = positive, allow_negative_numbers = true)]
    scale: f64,
    /// Refuse a surface with defects, instead of repairing it
    #[arg(long)]
    no_repair: bool,
    /// Write no images
    #[arg(long)]
    no_pictures: bool,
    /// Neither read nor write the cache of prepared bodies
    #[arg(long)]
    no_cache: bool,
}

fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("give a number greater than zero".into()),
    }
}

fn unit(text: &str) -> std::result::Result<f64, String> {
    let unit = UNITS.iter().find(|(name, _)| *name == text);
    unit.map(|(_, metres)| *metres).ok_or_else(|| format!("give {}", UNITS.map(|(name, _)| name).join(", ")))
}

fn grade(text: &str) -> std::result::Result<u32, String> {
    let grade = text.parse().ok().filter(|grade| [1, 2, 4, 8].contains(grade));
    grade.ok_or_else(|| "give 1, 2, 4 or 8".into())
}

/// Prepares a surface with default options, and writes the body and its scene into a folder; `watch` is called with the
/// name of each stage of the preparation as it begins.
#[cfg(feature = "view")]
pub fn quietly(surface: &Path, out: &Path, watch: &mut dyn FnMut(&str)) -> Result<()> {
    let arguments = Arguments {
        surface: surface.to_string_lossy().into_owned(),
        out: Some(out.into()),
        cell: None,
        cells: CELLS,
        grade: 1,
        thickness: None,
        hulls: None,
        units: None,
        scale: 1.0,
        no_repair: false,
        no_pictures: true,
        no_cache: false,
    };
    let scene = scene_of(&arguments)?;
    let mut output = Output::create(out)?;
    let (body, _) = prepare::body_and_report(&scene.bodies[0], &scene, &Cache::of_user(), &mut |stage| {
        watch(stage.name());
        Ok(())
    })
    .map_err(|error| in_options(error, &arguments.surface))?;
    let Shape::Soft { layer, skin, .. } = &body.shape else {
        return Err(Error::Simulation("internal error: the surface was not prepared as a soft body".into()));
    };
    let depths = depths_of(&arguments, layer, skin)?;
    let (cores, _) = press::cores(layer, &depths);
    write_body(&mut output, layer, skin)?;
    output.write(SCENE, |w| Press::into(skin, layer, &depths).write(w, &body.name, &cores))?;
    output.commit()
}

/// Hexadecimal digest of a scene's text.
fn digest(text: &[u8]) -> String {
    Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The digests of the scenes that earlier runs wrote into a folder, by the names of their files.
fn digests(folder: &Path) -> serde_json::Value {
    let report = std::fs::read(folder.join("report.json")).unwrap_or_default();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap_or_default();
    if report[DIGESTS].is_object() { report[DIGESTS].clone() } else { serde_json::json!({}) }
}

/// Whether there is a scene that is neither `new` nor, by its digest, what an earlier run wrote.
fn is_edited(scene: &Path, written: &serde_json::Value, new: &[u8]) -> bool {
    std::fs::read(scene).is_ok_and(|there| there != new && *written != digest(&there).as_str())
}

fn depths_of(arguments: &Arguments, layer: &Layer, skin: &Skin) -> Result<Vec<f64>> {
    bind::depths(layer, (&skin.vertices, &skin.triangles))
        .map_err(|problem| Error::input(Path::new(&arguments.surface), None, problem, "give a closed surface"))
}

/// Prepares a surface and writes all files; if anything fails, no file is written.
pub fn prepare(arguments: &Arguments) -> Result<()> {
    let scene = scene_of(arguments)?;
    // A directory that cannot be written is an error before the work begins, not after it.
    let out = out_of(arguments);
    let mut output = Output::create(&out)?;
    if let scene::Shape::Soft { surface: Some(Surface::File(file)), .. } = &scene.bodies[0].shape {
        files::will_read(file);
    }
    output.reserve(&["skin.obj", "layer.msh"])?;
    let bar = progress();
    let cache = if arguments.no_cache { Cache::off() } else { Cache::of_user() };
    let (body, mut report) = prepare::body_and_report(&scene.bodies[0], &scene, &cache, &mut |stage| {
        show(&bar, stage);
        Ok(())
    })
    .map_err(|error| in_options(error, &arguments.surface))?;
    let (Shape::Soft { layer, skin, .. }, Some(report)) = (&body.shape, &mut report) else {
        return Err(Error::Simulation("internal error: the surface was not prepared as a soft body".into()));
    };
    let depths = depths_of(arguments, layer, skin)?;
    let (cores, held) = press::cores(layer, &depths);
    if !arguments.no_pictures {
        bar.set_message("images");
        let begun = Instant::now();
        let mut shown = layer.clone();
        shown.attached = held;
        write_pictures(&mut output, &body, &shown, skin)?;
        report.seconds.insert("pictures".into(), begun.elapsed().as_secs_f64().into());
        report.peak_memory_bytes = peak_memory();
    }
    bar.inc(1);
    bar.set_message("files");
    write_body(&mut output, layer, skin)?;
    let mut text = Vec::new();
    let written = Press::into(skin, layer, &depths).write(&mut text, &body.name, &cores);
    written.map_err(|source| Error::Output { file: out.join(SCENE), source })?;
    let mut digests = digests(&out);
    let names = std::iter::once(SCENE.into()).chain((1..).map(|k| format!("scene-{k}.toml")));
    let scene = names.into_iter().find(|name| !is_edited(&out.join(name), &digests[name.as_str()], &text));
    let scene = scene.unwrap_or_else(|| SCENE.into());
    output.write(&scene, |w| w.write_all(&text))?;
    digests[scene.as_str()] = digest(&text).into();
    let mut facts = serde_json::to_value(&*report).map_err(|error| Error::Simulation(error.to_string()))?;
    facts[DIGESTS] = digests;
    output.write("report.json", |w| serde_json::to_writer_pretty(w, &facts).map_err(Into::into))?;
    output.write("report.txt", |w| write_text(w, report))?;
    output.commit()?;
    bar.finish_and_clear();
    if scene != SCENE {
        tell(&format!("{}: seems to be edited, and is kept; the new scene is {scene}", out.join(SCENE).display()));
    }
    let scene = out.join(&scene);
    print(&format!("{report}{}: run it with: palpate run {}\n", out.display(), pasted(&scene)))
}

/// A path as it can be pasted into a shell.
fn pasted(path: &Path) -> String {
    let text = path.display().to_string();
    let text = if text.starts_with('-') { format!("./{text}") } else { text };
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:,@\\".contains(c);
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

fn write_text(w: &mut impl std::io::Write, report: &Report) -> std::io::Result<()> {
    write!(w, "{report}")
}

/// The directory that is written.
fn out_of(arguments: &Arguments) -> PathBuf {
    arguments.out.clone().unwrap_or_else(|| stem(&arguments.surface).into())
}

/// The name of a model without the number of its vertices, or a file's name without folder and extension.
fn stem(surface: &str) -> &OsStr {
    let model = surface.split_once(':').map(|(name, _)| name);
    let name = model.filter(|name| Model::ALL.iter().any(|model| model.name() == *name)).unwrap_or(surface);
    Path::new(name).file_stem().unwrap_or_default()
}

/// A scene of one soft body, made from the options.
fn scene_of(arguments: &Arguments) -> Result<Scene> {
    let surface = surface_of(&arguments.surface)?;
    let (cells, grade, thickness) = (arguments.cells, arguments.grade, arguments.thickness);
    let layer = match arguments.cell {
        Some(cell) => scene::Layer::Cell { cell, grade, thickness },
        None => scene::Layer::Across { cells, grade, thickness },
    };
    let name: String = stem(&arguments.surface).to_string_lossy().chars().filter(|c| is_plain(*c)).collect();
    let body = scene::Body {
        name: if name.is_empty() || name == "tool" { "body".into() } else { name },
        shape: scene::Shape::Soft { surface: Some(surface), layer },
        hulls: arguments.hulls,
        repair: !arguments.no_repair,
        units: arguments.units,
        scale: arguments.scale,
        position: DVec3::ZERO,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        material: Some(Material {
            law: MaterialLaw::Corotational,
            young: 2e4,
            poisson: 0.45,
            density: 1000.0,
            damping_mass: 0.0,
            damping_stiffness: 0.002,
        }),
        dilatation: Default::default(),
        regions: Vec::new(),
        collides: None,
        cores: Vec::new(),
        joints: Vec::new(),
        supports: Vec::new(),
        loads: Vec::new(),
        reactions: None,
        skeleton: None,
    };
    Ok(Scene::of_body(&arguments.surface, body))
}

/// Whether a character of the surface's name is kept in the body's name, which becomes part of file names and keys.
fn is_plain(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_' || c == '-'
}

/// Reads an argument as a surface: a file, or a built-in model's name with, optionally, a colon and a number of
/// vertices.
pub fn surface_of(text: &str) -> Result<Surface> {
    let (name, count) = text.split_once(':').map_or((text, None), |(name, count)| (name, Some(count)));
    let model = Model::ALL.into_iter().find(|model| model.name() == name);
    if let Some(model) = model.filter(|_| !Path::new(text).exists()) {
        let range = model.vertices();
        let vertices = count.map_or(Ok(model.default_vertices()), str::parse).ok().filter(|n| range.contains(n));
        let vertices = vertices.ok_or_else(|| {
            let problem = format!("`{}` is not a valid number of vertices for this model", count.unwrap_or_default());
            Error::input(Path::new(text), None, problem, format!("give {} to {}", range.start(), range.end()))
        })?;
        return Ok(Surface::Model { model, vertices });
    }
    let path = PathBuf::from(text);
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if !EXTENSIONS.contains(&extension.as_str()) {
        let (models, extensions) = (Model::ALL.map(Model::name).join(", "), EXTENSIONS.join(", ."));
        let remedy = match extension.as_str() {
            "msh" | "node" | "ele" => {
                "tetrahedra are a `layer` in the [[body]] of a scene, and need no preparation".into()
            }
            _ => format!("give .{extensions}, or a model: {models}, such as head or head:44000"),
        };
        return Err(Error::input(&path, None, "neither a file with a surface nor a model", remedy));
    }
    Ok(Surface::File(path))
}

/// Translates an error about a key of the scene that `scene_of` made into an error about the option behind that key.
fn in_options(error: Error, surface: &str) -> Error {
    let Error::Key { key, problem, remedy, .. } = error else { return error };
    let option = match key.rsplit('.').next().unwrap_or_default() {
        "cell" | "layer" => "--cell",
        "across" => "--cells",
        "hulls" => "--hulls",
        _ => "SURFACE",
    };
    Error::Key { file: surface.into(), key: option.into(), problem, remedy }
}

/// A progress bar on standard error, drawn only where standard error is a terminal.
fn progress() -> ProgressBar {
    let bar = ProgressBar::new(Stage::Ready as u64 + AFTER).with_finish(ProgressFinish::AndClear);
    bar.enable_steady_tick(Duration::from_millis(200));
    match ProgressStyle::with_template("{spinner} {wide_bar} {msg} ({elapsed})") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

fn show(bar: &ProgressBar, stage: Stage) {
    bar.set_message(stage.name());
    // Reading the cache comes first and writing the cache comes last, but both are the same stage; the bar must not
    // move back at the end.
    bar.set_position((stage as u64).max(bar.position()));
}

/// Writes an image of the collision proxies, one of the layer cut open, one of the skin, and one of all three side by
/// side.
fn write_pictures(output: &mut Output, body: &Body, layer: &Layer, skin: &Skin) -> Result<()> {
    let (Shape::Soft { proxies, .. } | Shape::Rigid { proxies, .. }) = &body.shape else { return Ok(()) };
    let view = figure::view(skin);
    let pictures = [figure::proxies(proxies, &view), figure::layer(layer, &view), figure::skin(skin, &view)];
    for (name, picture) in ["proxies.png", "layer.png", "skin.png"].into_iter().zip(&pictures) {
        output.write(name, |w| picture.write_png(w))?;
    }
    let all: Vec<&Picture> = pictures.iter().collect();
    output.write("figure.png", |w| Picture::beside(&all).write_png(w))
}

/// Writes the body's files, with lengths in metres.
fn write_body(output: &mut Output, layer: &Layer, skin: &Skin) -> Result<()> {
    output.write("skin.obj", |w| obj::write(w, &skin.vertices, &skin.triangles))?;
    output.write("layer.msh", |w| gmsh::write(w, &layer.nodes, &layer.tetrahedra))
}
