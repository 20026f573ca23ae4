//! The proximity query by itself: for two rigid skins (triangle surfaces) a and b, each in a pose, it finds the
//! vertices of either that lie within the other. It records the step's stages pose, cull, skin, depth and contact, and
//! nothing after them.

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

/// Share of the smaller body's extent up to which [`QuerySettings::of`] allows depths without a flag.
const DEPTH_SHARE: f64 = 0.1;

/// Number of runs per query where no direction is given. The first run finds where the skins touch, with a contact
/// normal that the collision proxies (convex hulls) suggest; the others refine the normal by the contacts found.
const ROUNDS: u32 = 4;

/// How a run is timed; on some drivers timestamps themselves take time.
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
    /// World direction from a to b along which depth is measured, of any length but zero; `None`: the broad phase finds
    /// it.
    pub direction: Option<DVec3>,
    /// How runs are timed.
    pub timing: Timing,
    /// Path by which the depth stage finds where triangles meet the rays of opposing vertices; `None`: compute, or the
    /// graphics path where [`Options::measure`] is set and finds it faster.
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

/// Two rigid skins, and the kernels that find where they overlap.
pub struct Query {
    context: Arc<Context>,
    common: Common,
    touch: TouchStages,
    /// One recording of the stages per [`Timing`]: untimed, each stage timed, all stages timed as one.
    records: [Recording; 3],
    timing: Timing,
    /// Clears the results of the last run.
    fresh: Recording,
    /// Copies the results to `contacts`, `counts` and `contact_patches`, which the host can read.
    fetch: Recording,
    contacts: Buffer,
    counts: Buffer,
    contact_patches: Buffer,
    /// Kept alive because the recordings read its arrays.
    _elastic: Elastic,
    pair: Pair,
    bodies: [Side; 2],
    path: Path,
}

/// What the host keeps of a body.
struct Side {
    centroid: DVec3,
    vertices: u32,
    triangles: u32,
    proxies: Vec<Proxy>,
}

/// Result of a query.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Colliding vertices in the order of their indices, those of a before those of b.
    pub contacts: Vec<QueryContact>,
    /// Contact patches, that is areas with one normal where the bodies may touch; positions are relative to
    /// [`Answer::origin`].
    #[doc(hidden)]
    pub contact_patches: Vec<ContactPatch>,
    /// World position that the contact patches are relative to, m.
    pub origin: DVec3,
    /// Warnings about the answer, for instance a contact beyond the depth limit.
    pub flags: Flags,
    /// Counters of the stages: active chunks (groups of skin vertices), work items, ray hits, contacts.
    #[doc(hidden)]
    pub counts: Counts,
    /// Times, microseconds, by stage or of all stages as one; empty where runs are not timed.
    pub stage_times: Vec<(String, f64)>,
}

/// A colliding vertex: a skin vertex that lies within the other body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QueryContact {
    /// The body that the vertex belongs to: 0 for a, 1 for b.
    pub body: usize,
    /// Index of the vertex in that body's skin.
    pub vertex: u32,
    /// Depth along the normal, m; positive.
    pub depth: f64,
    /// Unit contact normal in world axes, from a to b.
    pub normal: DVec3,
    /// Triangle of the other body's skin that the ray through the vertex along the normal hits.
    pub triangle: u32,
    /// Barycentric coordinates of that hit in the triangle.
    pub barycentric: [f64; 3],
    /// Area of the skin around the vertex, projected along the normal, m^2; halved, since vertices of both bodies
    /// become contacts.
    pub area: f64,
}

impl Query {
    /// Prepares two rigid bodies of a scene, by name, and opens a Vulkan device for them. Depths beyond a tenth of the
    /// smaller body's extent raise a flag ([`Query::set_depth_limit`]); the broad phase finds the contact normal
    /// ([`Query::set_direction`]).
    ///
    /// # Errors
    /// There is no body of that name, it is not rigid, or its files are faulty; [`Error::NoDevice`], [`Error::Memory`],
    /// [`Error::Vulkan`].
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

    /// As [`Query::of_bodies`], on a device that is already open.
    #[doc(hidden)]
    pub fn on_device(context: &Arc<Context>, a: &Body, b: &Body, settings: &QuerySettings) -> Result<Query> {
        let bodies = [side(a)?, side(b)?];
        let model = Model::of_query(a, b);
        ArrayChoice::new(context)?;
        let path = Choice::new(context, settings.depth)?.path;
        let (common, elastic) = (Common::new(context, &model)?, Elastic::new(context, &model)?);
        let touch = TouchStages::new(context, &model, Some(path), false)?;
        let mut warm_up = Recorder::warm_up(context)?;
        touch.record(&mut warm_up, &common, &elastic);
        warm_up.finish()?.submit_and_wait()?;
        let record = |mut recorder: Recorder| {
            touch.record(&mut recorder, &common, &elastic);
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

    /// Sets the depth (m, above zero) beyond which a contact raises a flag, for later runs.
    ///
    /// # Errors
    /// [`Error::Vulkan`]: the device's memory could not be written.
    pub fn set_depth_limit(&mut self, limit: f64) -> Result<()> {
        self.common.params.mapped_mut::<StepParams>()?[0].depth_limit = limit as f32;
        Ok(())
    }

    /// Sets the world direction from a to b, of any length but zero, along which later runs measure depth; `None`: the
    /// broad phase finds it.
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
        // Results of the last query, whose poses may be unrelated, must not influence this one.
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

    /// The path that the depth stage takes, compute or graphics.
    pub fn depth_path(&self) -> Path {
        self.path
    }

    /// Numbers of passes of each stage.
    #[doc(hidden)]
    pub fn passes(&self) -> Vec<StagePasses> {
        self.record().passes()
    }

    fn record(&self) -> &Recording {
        &self.records[self.timing as usize]
    }

    fn contact(&self, contact: &Contact) -> QueryContact {
        // In the model's arrays, the vertices and triangles of a come before those of b.
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

    /// The world position that f32 positions on the GPU are relative to: the middle of the overlap of the bodies'
    /// bounding boxes, or of the gap between them, since single precision is finest near its origin.
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

/// What the host keeps of a rigid body; an error for any other body.
fn side(body: &Body) -> Result<Side> {
    let (skin, proxies, centroid) = rigid(body)?;
    Ok(Side {
        centroid,
        vertices: skin.vertices.len() as u32,
        triangles: skin.triangles.len() as u32,
        proxies: proxies.to_vec(),
    })
}
