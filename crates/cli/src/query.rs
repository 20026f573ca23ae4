//! `palpate query`: finds where two undeformed surfaces overlap; reports which vertices of each surface lie within the
//! other, draws an image of their depths, and measures the times of the query's stages on the GPU.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::builder::NonEmptyStringValueParser;
use glam::{DQuat, DVec3};
use palpate::internal::prepare::repair::{self, Origin};
use palpate::internal::prepare::{self, Body, Shape};
use palpate::internal::query::QuerySettings;
use palpate::internal::query::{Answer, Timing};
use palpate::internal::stages::POSE_TO_CONTACT;
use palpate::scene::{self, Surface, triangles};
use palpate::{Error, Options, Query, QueryContact, Result, Scene};

use crate::prepare::surface_of;
use crate::report::query::{Subject, write_contacts};
use crate::report::{Output, QueryReport, StageSamples, field};
use crate::{print, tell};

/// Greatest coordinate and length that is accepted, m; beyond it single precision is too coarse.
const LARGEST: f64 = 1e9;
const CONTACTS: &str = "contacts.csv";
const PICTURE: &str = "depth.png";
const REPORT: &str = "query.json";

/// Options of `palpate query`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The first surface: a file (OBJ, STL, PLY, glTF, VTP, VTU, VTK), or a built-in model (head, pumpkin, gear, human,
    /// sphere), as head or head:44000 (number of vertices)
    a: String,
    /// The second surface
    b: String,
    /// Pose of surface b: position (m) and quaternion of the coordinate frame of b's file; surface a stays as in its
    /// file
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = pose, allow_hyphen_values = true)]
    pose_b: Option<Pose>,
    /// Direction from a to b along which depth is measured, of any length [default: the surfaces' normal where they
    /// touch]
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    direction: Option<DVec3>,
    /// Depth, m, beyond which a flag is raised [default: a tenth of the smaller surface's extent]
    #[arg(long, value_name = "L", value_parser = length, allow_negative_numbers = true)]
    depth_limit: Option<f64>,
    /// Number of times that the query is run and timed
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    runs: u32,
    /// Vulkan device: its name, or its index in the list of `palpate devices`
    #[arg(long, value_name = "NAME-OR-INDEX", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,
    /// Directory to write contacts, image and report into; without it nothing is written
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Position, m, and orientation.
type Pose = (DVec3, DQuat);

/// Parses `N` finite numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> std::result::Result<[f64; N], String> {
    let parsed: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let parsed = parsed.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    parsed.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| format!("give {N} numbers separated by commas"))
}

fn pose(text: &str) -> std::result::Result<Pose, String> {
    let [x, y, z, q @ ..]: [f64; 7] = numbers(text)?;
    if [x, y, z].iter().any(|x| x.abs() > LARGEST) {
        return Err(format!("give a position within {LARGEST:e} of the origin"));
    }
    let turn = scene::unit_quaternion(q).map_err(|problem| format!("{}; {}", problem.problem, problem.remedy))?;
    Ok((DVec3::new(x, y, z), turn))
}

fn direction(text: &str) -> std::result::Result<DVec3, String> {
    let direction = DVec3::from_array(numbers(text)?);
    // By its greatest component first: the square of a very long or short one is no number.
    let scaled = direction / direction.abs().max_element();
    scaled.try_normalize().ok_or_else(|| "the direction has no length; give one that is not zero".into())
}

fn length(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0 && number <= LARGEST);
    number.ok_or_else(|| format!("give a number greater than zero, {LARGEST:e} at most"))
}

/// Runs the query, and repeats it to measure times. Input is read and prepared before the Vulkan device is opened; the
/// output directory is made afterwards.
pub fn query(arguments: &Arguments) -> Result<()> {
    let (a, b) = (Part::read(&arguments.a)?, Part::read(&arguments.b)?);
    let mut settings = QuerySettings::of(&a.body, &b.body);
    settings.direction = arguments.direction;
    settings.depth_limit = arguments.depth_limit.unwrap_or(settings.depth_limit);
    let options = Options { device: arguments.device.clone(), ..Options::of_program() };
    let mut query = Query::of_bodies(&a.body, &b.body, &settings, &options)?;
    for note in a.notes().iter().chain(b.notes()) {
        tell(note);
    }
    let mut output = arguments.out.as_deref().map(Output::create).transpose()?;
    let pose_b = arguments.pose_b.unwrap_or((DVec3::ZERO, DQuat::IDENTITY));
    let (answer, stages, wall_us) = run(&mut query, pose_b, arguments.runs)?;

    let mut report = QueryReport {
        device: query.context().device_name().into(),
        driver: query.context().driver().into(),
        depth_path: query.depth_path().name().into(),
        a: a.subject(),
        b: b.subject(),
        depth_limit_m: settings.depth_limit,
        ..QueryReport::default()
    };
    report.pose_b[..3].copy_from_slice(&pose_b.0.to_array());
    report.pose_b[3..].copy_from_slice(&pose_b.1.to_array());
    report.add_answer(&answer);
    report.add_times(&stages, &wall_us);
    if let Some(output) = &mut output {
        let in_file = |contact: &QueryContact| if contact.body == 0 { b.in_file(contact) } else { a.in_file(contact) };
        let contacts: Vec<QueryContact> = answer.contacts.iter().map(in_file).collect();
        output.write(CONTACTS, |w| write_contacts(w, &contacts))?;
        let picture = field::picture([&a.placed((DVec3::ZERO, DQuat::IDENTITY)), &b.placed(pose_b)], &answer.contacts);
        output.write(PICTURE, |w| picture.write_png(w))?;
        output.write(REPORT, |w| serde_json::to_writer_pretty(w, &report).map_err(Into::into))?;
    }
    output.map_or(Ok(()), Output::commit)?;
    print(&report.to_string())
}

/// Runs the query `runs` times; returns the answer, the times of each stage, and the wall time of each run,
/// microseconds. Runs in which each stage is timed alternate with runs in which all stages are timed as one.
fn run(query: &mut Query, pose_b: Pose, runs: u32) -> Result<(Answer, Vec<StageSamples>, Vec<f64>)> {
    let passes = |stage: &palpate::internal::gpu::StagePasses| StageSamples {
        stage: stage.stage.clone(),
        passes: stage.dispatches,
        us: Vec::new(),
    };
    let mut stages: Vec<StageSamples> = query.passes().iter().map(passes).collect();
    let all = query.passes().iter().map(|stage| stage.dispatches).sum();
    stages.push(StageSamples { stage: POSE_TO_CONTACT.into(), passes: all, us: Vec::new() });
    let mut wall_us = Vec::with_capacity(runs as usize);
    let mut ask = |timing| -> Result<Answer> {
        query.set_timing(timing);
        let begun = Instant::now();
        let answer = query.run((DVec3::ZERO, DQuat::IDENTITY), pose_b)?;
        wall_us.push(begun.elapsed().as_secs_f64() * 1e6);
        for (stage, us) in &answer.stage_times {
            stages.iter_mut().filter(|samples| samples.stage == *stage).for_each(|samples| samples.us.push(*us));
        }
        Ok(answer)
    };
    let mut answer = ask(Timing::Stages)?;
    for run in 1..runs {
        answer = ask(if run % 2 == 0 { Timing::Stages } else { Timing::AsOne })?;
    }
    Ok((answer, stages, wall_us))
}

/// One of the two surfaces.
struct Part {
    surface: String,
    body: Body,
    /// For each triangle of the prepared body, the file's triangle that it was made from; empty if the surface is not
    /// from a file.
    origins: Vec<Origin>,
}

impl Part {
    fn read(text: &str) -> Result<Part> {
        let surface = surface_of(text)?;
        let body = scene::Body {
            name: "body".into(),
            shape: scene::Shape::Rigid { surface: surface.clone() },
            hulls: None,
            units: None,
            scale: 1.0,
            position: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            material: None,
            dilatation: Default::default(),
            regions: Vec::new(),
            collides: None,
            cores: Vec::new(),
            repair: true,
            joints: Vec::new(),
            supports: Vec::new(),
            loads: Vec::new(),
            reactions: None,
            skeleton: None,
        };
        let scene = Scene::of_body(text, body);
        let body = prepare::body(&scene.bodies[0], &scene).map_err(|error| of_file(error, text))?;
        let origins = match &surface {
            Surface::File(path) => {
                repair::origins(&triangles::read(path)?.mesh).map_err(|refusal| refusal.error(path))?
            }
            Surface::Model { .. } | Surface::Mesh(_) => Vec::new(),
        };
        Ok(Part { surface: text.into(), body, origins })
    }

    fn notes(&self) -> &[String] {
        &self.body.report.notes
    }

    fn skin(&self) -> (&[DVec3], &[[u32; 3]]) {
        match &self.body.shape {
            Shape::Rigid { skin, .. } => (&skin.vertices, &skin.triangles),
            _ => (&[], &[]),
        }
    }

    fn subject(&self) -> Subject {
        let (vertices, triangles) = self.skin();
        Subject {
            surface: self.surface.clone(),
            vertices: vertices.len(),
            triangles: triangles.len(),
            contacts: 0,
            notes: self.notes().to_vec(),
        }
    }

    fn placed(&self, (position, orientation): Pose) -> field::Solid {
        let (vertices, triangles) = self.skin();
        let vertices = vertices.iter().map(|x| position + orientation * *x).collect();
        field::Solid { vertices, triangles: triangles.to_vec() }
    }

    /// A contact whose triangle belongs to this surface, with the triangle's number and the order of its corners
    /// changed to those of the surface's file.
    fn in_file(&self, contact: &QueryContact) -> QueryContact {
        let Some(origin) = self.origins.get(contact.triangle as usize) else { return *contact };
        let [u, v, w] = contact.barycentric;
        let barycentric = if origin.is_turned { [u, w, v] } else { [u, v, w] };
        QueryContact { triangle: origin.triangle, barycentric, ..*contact }
    }
}

/// Translates an error about a key of the scene that `Part::read` made into an error about the surface's file.
fn of_file(error: Error, surface: &str) -> Error {
    match error {
        Error::Key { problem, remedy, .. } => Error::input(Path::new(surface), None, problem, remedy),
        other => other,
    }
}
