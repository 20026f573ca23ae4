//! The proximity query by itself: for two rigid bodies a and b, each with a *skin* (surface mesh) and in a pose, it
//! finds the skin vertices of either body that lie within the other. It runs the first stages of a step: pose (places
//! the bodies' coordinate frames), cull (broad phase, by *collision proxies*, which are convex hulls that cover a
//! skin), skin (computes vertex positions), depth and contact (narrow phase). It runs no later stage. To *record*
//! stages is to write their GPU commands once; a *run* of the query executes them. A *flag* is a warning about an
//! answer.

pub mod arrays;
pub mod choice;

use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::gpu::{Buffer, Context, Memory, Options, Recorder, Recording, StagePasses};
use crate::prepare::{Body, Cache, Proxy, Shape, Skin, body_and_report};
use crate::query::arrays::ArrayChoice;
use crate::query::choice::Choice;
use crate::scene::Scene;
use crate::shaders::{Contact, ContactPatch, Counts, Frame, Link, Pair, StepParams};
use crate::stages::depth::Path;
use crate::stages::elastic::Elastic;
use crate::stages::model::{Model, texel};
use crate::stages::touch::TouchStages;
use crate::stages::{Common, Flags, query_as_one};
use crate::{Error, Result};

/// Depth limit of [`QuerySettings::of`], as a share of the smaller body's extent. A deeper contact raises a flag.
const DEPTH_SHARE: f64 = 0.1;

/// A run without a given direction executes the recorded stages this many times. The first time finds where the skins
/// touch, with a contact normal that the collision proxies suggest; each further time refines the normal by the
/// contacts that were found before.
const ROUNDS: u32 = 4;

/// How a run is timed. Timestamps take time themselves on some drivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// No times are taken.
    Off,
    /// Each stage is timed.
    Stages,
    /// One time is taken, from the beginning of the first stage to the end of the last.
    AsOne,
}

/// Settings of a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuerySettings {
    /// A contact deeper than this raises a flag, m.
    pub depth_limit: f64,
    /// World direction from a to b along which depth is measured, of any length but zero; `None`: the query finds the
    /// direction.
    pub direction: Option<DVec3>,
    /// How runs are timed.
    pub timing: Timing,
    /// Path (compute or graphics) by which the depth stage finds where rays from the vertices of one skin hit triangles
    /// of the other; `None`: the compute path, or the graphics path if [`Options::measure`] is set and the measurement
    /// finds the graphics path faster.
    pub depth: Option<Path>,
}

impl QuerySettings {
    /// The default settings: a depth limit of a tenth of the smaller body's extent, no given direction, and timed
    /// stages.
    pub fn of(a: &Body, b: &Body) -> QuerySettings {
        let extent = [a, b].map(|body| rigid(body).map_or(f64::INFINITY, |(skin, ..)| extent(skin)));
        QuerySettings {
            depth_limit: DEPTH_SHARE * extent[0].min(extent[1]),
            direction: None,
            timing: Timing::Stages,
            depth: None,
        }
    }
}

/// Longest side of the bounding box of a skin's triangles, m.
fn extent(skin: &Skin) -> f64 {
    let corners = || skin.triangles.iter().flatten().map(|&v| skin.vertices[v as usize]);
    (corners().fold(DVec3::NEG_INFINITY, DVec3::max) - corners().fold(DVec3::INFINITY, DVec3::min)).max_element()
}

/// Two rigid bodies on the GPU, and the recorded kernels that find where their skins overlap.
pub struct Query {
    context: Arc<Context>,
    common: Common,
    touch: TouchStages,
    /// Three recordings of the stages, one for each [`Timing`]: untimed, each stage timed, all stages timed as one.
    records: [Recording; 3],
    timing: Timing,
    /// Recording that clears the results of the last run.
    fresh: Recording,
    /// Recording that copies the results to `contacts`, `counts` and `contact_patches`, which the host can read.
    fetch: Recording,
    contacts: Buffer,
    counts: Buffer,
    contact_patches: Buffer,
    /// The arrays of deformable bodies (there are none), kept alive because the recordings refer to these arrays.
    _elastic: Elastic,
    pair: Pair,
    bodies: [Side; 2],
    path: Path,
}

/// Data of a body that the host keeps.
struct Side {
    centroid: DVec3,
    vertices: u32,
    triangles: u32,
    proxies: Vec<Proxy>,
}

/// Result of a query.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Colliding vertices (skin vertices within the other body), first those of a, then those of b, in the order of
    /// their indices.
    pub contacts: Vec<QueryContact>,
    /// Contact patches: places where the bodies may touch, each with one contact normal. Their positions are relative
    /// to [`Answer::origin`].
    #[doc(hidden)]
    pub contact_patches: Vec<ContactPatch>,
    /// World position to which the positions of the contact patches are relative, m.
    pub origin: DVec3,
    /// Warnings about the answer, for instance a contact beyond the depth limit.
    pub flags: Flags,
    /// Counters of the stages: active chunks (a chunk is a group of skin vertices that is culled as a whole), work
    /// items (a work item is a chunk in a contact patch), ray hits, contacts.
    #[doc(hidden)]
    pub counts: Counts,
    /// Names and times (microseconds) of the stages, or of all stages as one; empty if runs are not timed.
    pub stage_times: Vec<(String, f64)>,
}

/// A colliding vertex: a skin vertex that lies within the other body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QueryContact {
    /// The body to which the vertex belongs: 0 for a, 1 for b.
    pub body: usize,
    /// Index of the vertex in that body's skin.
    pub vertex: u32,
    /// Depth along the normal, m; positive.
    pub depth: f64,
    /// Unit contact normal in world axes, from a to b.
    pub normal: DVec3,
    /// Triangle of the other body's skin that the ray through the vertex along the normal hits.
    pub triangle: u32,
    /// Barycentric coordinates, in this triangle, of the point where the ray hits it.
    pub barycentric: [f64; 3],
    /// Half the area of the skin around the vertex, projected along the normal, m^2. It is halved because vertices of
    /// both bodies become contacts.
    pub area: f64,
}

impl Query {
    /// Prepares two rigid bodies of a scene, by name, and opens a Vulkan device for them. A depth greater than a tenth
    /// of the smaller body's extent raises a flag ([`Query::set_depth_limit`] sets another limit); the query finds the
    /// contact normal ([`Query::set_direction`] sets one).
    ///
    /// # Errors
    /// A name belongs to no body, a body is not rigid, or a body's files are faulty; or the device cannot be used
    /// ([`Error::NoDevice`], [`Error::Memory`], [`Error::Vulkan`]).
    pub fn open(scene: &Scene, bodies: [&str; 2], options: &Options) -> Result<Query> {
        let cache = options.cache.as_deref().map_or_else(Cache::off, Cache::at);
        let prepared = |name: &str| {
            let body = scene.bodies.iter().find(|body| body.name == name).ok_or_else(|| {
                Error::key(&scene.file, "body", format!("there is no body \"{name}\""), "name a body of the scene")
            })?;
            Ok(body_and_report(body, scene, &cache, &mut |_| Ok(()))?.0)
        };
        let (a, b) = (prepared(bodies[0])?, prepared(bodies[1])?);
        Query::of_bodies(&a, &b, &QuerySettings::of(&a, &b), options)
    }

    /// Opens a Vulkan device for two bodies of [`Shape::Rigid`].
    #[doc(hidden)]
    pub fn of_bodies(a: &Body, b: &Body, settings: &QuerySettings, options: &Options) -> Result<Query> {
        rigid(a).and(rigid(b))?;
        Query::on_device(&Context::open(options)?, a, b, settings)
    }

    /// Does the same as [`Query::of_bodies`], but on a device that is already open.
    #[doc(hidden)]
    pub fn on_device(context: &Arc<Context>, a: &Body, b: &Body, settings: &QuerySettings) -> Result<Query> {
        let bodies = [side(a)?, side(b)?];
        let model = Model::of_query(a, b);
        ArrayChoice::new(context)?;
        let path = Choice::new(context, settings.depth)?.path;
        let (common, elastic) = (Common::new(context, &model)?, Elastic::new(context, &model)?);
        let touch = TouchStages::new(context, &model, Some(path), false)?;
        let mut warm_up = Recorder::warm_up(context)?;
        touch.record(&mut warm_up, &common, &elastic, None);
        warm_up.finish()?.submit_and_wait()?;
        let record = |mut recorder: Recorder| {
            common.record_inputs(&mut recorder);
            touch.record(&mut recorder, &common, &elastic, None);
            recorder.finish()
        };
        let records = [
            record(Recorder::untimed(context)?)?,
            record(Recorder::new(context)?)?,
            record(Recorder::timed_by(context, query_as_one)?)?,
        ];

        let mut fresh = Recorder::untimed(context)?;
        fresh.stage("forget");
        fresh.fill(&common.counts, 0);
        fresh.fill(&touch.cull.contact_patches, 0);
        let mut fetch = Recorder::untimed(context)?;
        fetch.stage("read");
        let mut copy = |from: &Buffer| -> Result<Buffer> {
            let to = Buffer::new(context, &format!("{} (read)", from.name()), from.bytes(), Memory::Readback)?;
            fetch.copy(from, &to);
            Ok(to)
        };
        let contacts = copy(&touch.contact.touch.contacts)?;
        let (counts, contact_patches) = (copy(&common.counts)?, copy(&touch.cull.contact_patches)?);

        let params = StepParams { dt: 1.0, depth_limit: settings.depth_limit as f32, ..bytemuck::Zeroable::zeroed() };
        common.params.mapped_mut::<StepParams>()?[0] = params;
        let link = Link { turn: [0.0, 0.0, 0.0, 1.0], ..Link::default() };
        common.links.mapped_mut::<Link>()?.fill(link);
        let mut query = Query {
            context: context.clone(),
            records,
            timing: settings.timing,
            fresh: fresh.finish()?,
            fetch: fetch.finish()?,
            common,
            touch,
            contacts,
            counts,
            contact_patches,
            _elastic: elastic,
            pair: model.pairs[0],
            bodies,
            path,
        };
        query.set_direction(settings.direction);
        Ok(query)
    }

    /// Sets, for later runs, the depth (m, above zero) beyond which a contact raises a flag.
    ///
    /// # Errors
    /// [`Error::Vulkan`]: the device's memory could not be written.
    pub fn set_depth_limit(&mut self, limit: f64) -> Result<()> {
        self.common.params.mapped_mut::<StepParams>()?[0].depth_limit = limit as f32;
        Ok(())
    }

    /// Sets the world direction from a to b, of any length but zero, along which later runs measure depth; `None`: the
    /// query finds the direction.
    pub fn set_direction(&mut self, direction: Option<DVec3>) {
        self.pair.direction = direction.map_or([0.0; 4], |direction| texel(direction.normalize(), 1.0));
    }

    /// Sets how later runs are timed.
    #[doc(hidden)]
    pub fn set_timing(&mut self, timing: Timing) {
        self.timing = timing;
    }

    /// Finds where the bodies overlap. A pose is the world position (m) and orientation of a body's rest frame, the
    /// coordinate frame in which its vertices are given.
    ///
    /// # Errors
    /// [`Error::Vulkan`]: a pass or a transfer failed.
    pub fn run(&mut self, pose_a: (DVec3, DQuat), pose_b: (DVec3, DQuat)) -> Result<Answer> {
        let poses = [pose_a, pose_b];
        let origin = self.origin(poses);
        self.touch.cull.pairs.mapped_mut::<Pair>()?[0] = self.pair;
        for (frame, (body, (position, orientation))) in
            self.common.frames.mapped_mut::<Frame>()?.iter_mut().zip(self.bodies.iter().zip(poses))
        {
            *frame = Frame {
                rotation: orientation.as_quat().to_array(),
                centre: (position + orientation * body.centroid - origin).as_vec3().to_array(),
                turn: [0.0, 0.0, 0.0, 1.0],
                core: crate::shaders::NONE,
                ..Frame::default()
            };
        }
        // The results of the last call, whose poses may be unrelated, must not influence this call.
        self.fresh.submit_and_wait()?;
        let rounds = if self.pair.direction[3] == 0.0 { ROUNDS } else { 1 };
        for _ in 0..rounds {
            self.record().submit_and_wait()?;
        }
        self.fetch.submit_and_wait()?;
        let counts = self.counts.mapped::<Counts>()?[0];
        let contacts = self.contacts.mapped::<Contact>()?;
        let contact_patches = self.contact_patches.mapped::<ContactPatch>()?;
        let mut contacts: Vec<QueryContact> =
            contacts[..counts.contacts as usize].iter().map(|contact| self.contact(contact)).collect();
        contacts.sort_by_key(|contact| (contact.body, contact.vertex));
        Ok(Answer {
            contacts,
            contact_patches: contact_patches
                .iter()
                .filter(|contact_patch| contact_patch.weight > 0.0)
                .copied()
                .collect(),
            origin,
            flags: Flags(counts.flags),
            counts,
            stage_times: self.record().stage_times(),
        })
    }

    /// The context of the Vulkan device that runs the query.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// The path by which the depth stage runs, compute or graphics.
    pub fn depth_path(&self) -> Path {
        self.path
    }

    /// For each stage, its number of passes.
    #[doc(hidden)]
    pub fn passes(&self) -> Vec<StagePasses> {
        self.record().passes()
    }

    fn record(&self) -> &Recording {
        &self.records[self.timing as usize]
    }

    fn contact(&self, contact: &Contact) -> QueryContact {
        // In the arrays on the GPU, the vertices and triangles of a come before those of b.
        let is_b = contact.side & 1 != 0;
        let [v, w] = contact.barycentric.map(f64::from);
        QueryContact {
            body: usize::from(is_b),
            vertex: if is_b { contact.vertex - self.bodies[0].vertices } else { contact.vertex },
            depth: contact.depth.into(),
            normal: DVec3::from(contact.normal.map(f64::from)).normalize(),
            triangle: if is_b { contact.triangle } else { contact.triangle - self.bodies[0].triangles },
            barycentric: [1.0 - v - w, v, w],
            area: contact.area.into(),
        }
    }

    /// The world position (m) to which positions on the GPU are relative: the middle of the overlap of the bodies'
    /// bounding boxes, or of the gap between the boxes. Positions on the GPU are f32, which is most precise near zero.
    fn origin(&self, poses: [(DVec3, DQuat); 2]) -> DVec3 {
        let boxes = [0, 1].map(|k| {
            let (position, orientation) = poses[k];
            let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            for x in self.bodies[k].proxies.iter().flat_map(|proxy| &proxy.hull) {
                let x = position + orientation * *x;
                (low, high) = (low.min(x), high.max(x));
            }
            (low, high)
        });
        let middle = 0.5 * (boxes[0].0.max(boxes[1].0) + boxes[0].1.min(boxes[1].1));
        if middle.is_finite() { middle } else { poses[0].0 }
    }
}

/// Skin, collision proxies and centroid of a rigid body.
fn rigid(body: &Body) -> Result<(&Skin, &[Proxy], DVec3)> {
    match &body.shape {
        Shape::Rigid { skin, proxies, centroid, .. } => Ok((skin, proxies, *centroid)),
        _ => Err(Error::Simulation(format!("a query needs two rigid bodies; `{}` is not rigid", body.name))),
    }
}

/// The data of a rigid body that the host keeps; an error for any other body.
fn side(body: &Body) -> Result<Side> {
    let (skin, proxies, centroid) = rigid(body)?;
    Ok(Side {
        centroid,
        vertices: skin.vertices.len() as u32,
        triangles: skin.triangles.len() as u32,
        proxies: proxies.to_vec(),
    })
}
