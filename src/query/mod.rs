//! The proximity query by itself: two rigid skins, each in a pose, and which vertices of either lie within the other. It
//! records the stages from pose to contact as the step does, and nothing after them.

pub mod arrays;
pub mod choice;

use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::gpu::{Buffer, Context, Memory, Options, Recorder, Recording, StagePasses};
use crate::prepare::{Body, Cache, Proxy, Shape, Skin, body_and_report};
use crate::query::arrays::ArrayChoice;
use crate::query::choice::Choice;
use crate::scene::Scene;
use crate::shaders::{Contact, Counts, Frame, Link, Pair, Region, StepParams};
use crate::stages::depth::Path;
use crate::stages::elastic::Elastic;
use crate::stages::model::{Model, texel};
use crate::stages::touch::TouchStages;
use crate::stages::{Common, Flags, query_as_one};
use crate::{Error, Result};

/// Share of the smaller body's extent that [`QuerySettings::of`] allows as depth.
const DEPTH_SHARE: f64 = 0.1;

/// How often a pose is looked at where the direction is not given: the first finds where the skins touch, by the proxies'
/// directions; the others improve the direction by the skins'.
const ROUNDS: u32 = 4;

/// How a run is timed; timestamps take time themselves on some drivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// Not at all.
    Off,
    /// Stage by stage.
    Stages,
    /// From the first stage's beginning to the last one's end.
    AsOne,
}

/// What to look for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuerySettings {
    /// Depths beyond it raise a flag, m.
    pub depth_limit: f64,
    /// World direction from a to b along which depth is measured, of any length but zero; `None`: culling finds it.
    pub direction: Option<DVec3>,
    /// How runs are timed.
    pub timing: Timing,
    /// How triangles find the vertices that they lie over; `None`: the only way, or the faster one ([`Options::measure`]).
    pub depth: Option<Path>,
}

impl QuerySettings {
    /// The usual ones: depths to a tenth of the smaller body's extent, directions as culling finds them, stages timed.
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

/// Longest side of the box of a skin's triangles, m.
fn extent(skin: &Skin) -> f64 {
    let corners = || skin.triangles.iter().flatten().map(|&v| skin.vertices[v as usize]);
    (corners().fold(DVec3::NEG_INFINITY, DVec3::max) - corners().fold(DVec3::INFINITY, DVec3::min)).max_element()
}

/// Two rigid skins, and the kernels that find where they overlap.
pub struct Query {
    context: Arc<Context>,
    common: Common,
    touch: TouchStages,
    /// Untimed, timed by stage, timed as one.
    records: [Recording; 3],
    timing: Timing,
    fresh: Recording,
    fetch: Recording,
    contacts: Buffer,
    counts: Buffer,
    regions: Buffer,
    /// Held by nothing else, and read by the recording.
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

/// What a query found.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Colliding vertices in their own order, those of a first.
    pub contacts: Vec<QueryContact>,
    /// Where the bodies may touch; positions are relative to [`Answer::origin`].
    #[doc(hidden)]
    pub regions: Vec<Region>,
    /// World position that regions are relative to, m.
    pub origin: DVec3,
    /// What is wrong with the answer.
    pub flags: Flags,
    /// What passed through the stages.
    #[doc(hidden)]
    pub counts: Counts,
    /// Microseconds, by stage or of all as one; empty where runs are not timed.
    pub stage_times: Vec<(String, f64)>,
}

/// A skin vertex within the other body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QueryContact {
    /// The vertex's body: 0 a, 1 b.
    pub body: usize,
    /// Of that body's skin.
    pub vertex: u32,
    /// Along the normal, m, positive.
    pub depth: f64,
    /// Unit, world, from a to b.
    pub normal: DVec3,
    /// Of the other body's skin, where the vertex's line along the normal meets it.
    pub triangle: u32,
    /// Of that point in the triangle.
    pub barycentric: [f64; 3],
    /// Projected on the normal, half of it since both bodies' vertices are looked at, m^2.
    pub area: f64,
}

impl Query {
    /// Prepares two rigid bodies of a scene, by name, and opens a device for them. Depths beyond a tenth of the smaller one's
    /// extent raise a flag ([`Query::set_depth_limit`]); culling finds the direction ([`Query::set_direction`]).
    ///
    /// # Errors
    /// There is no such body, or it is not rigid; what is wrong with its files; [`Error::NoDevice`], [`Error::Memory`],
    /// [`Error::Vulkan`].
    pub fn open(scene: &Scene, bodies: [&str; 2], options: &Options) -> Result<Query> {
        let cache = options.cache.as_deref().map_or_else(Cache::off, Cache::at);
        let prepared = |name: &str| {
            let body = scene.bodies.iter().find(|body| body.name == name).ok_or_else(|| {
                Error::key(&scene.file, "body", format!("there is none called \"{name}\""), "name one of the scene")
            })?;
            Ok(body_and_report(body, scene, &cache, &mut |_| Ok(()))?.0)
        };
        let (a, b) = (prepared(bodies[0])?, prepared(bodies[1])?);
        Query::of_bodies(&a, &b, &QuerySettings::of(&a, &b), options)
    }

    /// Opens a device for two bodies of [`Shape::Rigid`].
    #[doc(hidden)]
    pub fn of_bodies(a: &Body, b: &Body, settings: &QuerySettings, options: &Options) -> Result<Query> {
        rigid(a).and(rigid(b))?;
        Query::on_device(&Context::open(options)?, a, b, settings)
    }

    /// As [`Query::of_bodies`] on a device that is open.
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
        fresh.fill(&touch.cull.regions, 0);
        let mut fetch = Recorder::untimed(context)?;
        fetch.stage("read");
        let mut copy = |from: &Buffer| -> Result<Buffer> {
            let to = Buffer::new(context, &format!("{} (read)", from.name()), from.bytes(), Memory::Readback)?;
            fetch.copy(from, &to);
            Ok(to)
        };
        let contacts = copy(&touch.contact.touch.contacts)?;
        let (counts, regions) = (copy(&common.counts)?, copy(&touch.cull.regions)?);

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
            regions,
            _elastic: elastic,
            pair: model.pairs[0],
            bodies,
            path,
        };
        query.set_direction(settings.direction);
        Ok(query)
    }

    /// Depths beyond `limit` (m, above zero) raise a flag in the runs that follow.
    ///
    /// # Errors
    /// [`Error::Vulkan`]: the device's memory could not be written.
    pub fn set_depth_limit(&mut self, limit: f64) -> Result<()> {
        self.common.params.mapped_mut::<StepParams>()?[0].depth_limit = limit as f32;
        Ok(())
    }

    /// World direction from a to b, of any length but zero, along which depth is measured in the runs that follow; `None`:
    /// culling finds it.
    pub fn set_direction(&mut self, direction: Option<DVec3>) {
        self.pair.direction = direction.map_or([0.0; 4], |direction| texel(direction.normalize(), 1.0));
    }

    /// How the runs that follow are timed.
    #[doc(hidden)]
    pub fn set_timing(&mut self, timing: Timing) {
        self.timing = timing;
    }

    /// Where the bodies overlap. A pose is the world position (m) and orientation of a body's rest frame, in which its
    /// vertices are given.
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
        // What the last pose found says nothing of this one.
        self.fresh.submit_and_wait()?;
        let rounds = if self.pair.direction[3] == 0.0 { ROUNDS } else { 1 };
        for _ in 0..rounds {
            self.record().submit_and_wait()?;
        }
        self.fetch.submit_and_wait()?;
        let counts = self.counts.mapped::<Counts>()?[0];
        let contacts = self.contacts.mapped::<Contact>()?;
        let regions = self.regions.mapped::<Region>()?;
        let mut contacts: Vec<QueryContact> =
            contacts[..counts.contacts as usize].iter().map(|contact| self.contact(contact)).collect();
        contacts.sort_by_key(|contact| (contact.body, contact.vertex));
        Ok(Answer {
            contacts,
            regions: regions.iter().filter(|region| region.weight > 0.0).copied().collect(),
            origin,
            flags: Flags(counts.flags),
            counts,
            stage_times: self.record().stage_times(),
        })
    }

    /// The device that answers.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// How triangles find the vertices that they cross.
    pub fn depth_path(&self) -> Path {
        self.path
    }

    /// Passes of each stage.
    #[doc(hidden)]
    pub fn passes(&self) -> Vec<StagePasses> {
        self.record().passes()
    }

    fn record(&self) -> &Recording {
        &self.records[self.timing as usize]
    }

    fn contact(&self, contact: &Contact) -> QueryContact {
        // Vertices and triangles of a come first in the model.
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

    /// The middle of what the bodies' boxes have in common, or of the gap between them: f32 has most digits there.
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

/// Skin, proxies and centroid of a rigid body.
fn rigid(body: &Body) -> Result<(&Skin, &[Proxy], DVec3)> {
    match &body.shape {
        Shape::Rigid { skin, proxies, centroid, .. } => Ok((skin, proxies, *centroid)),
        _ => Err(Error::Simulation(format!("a query is between rigid skins, and `{}` is none", body.name))),
    }
}

fn side(body: &Body) -> Result<Side> {
    let (skin, proxies, centroid) = rigid(body)?;
    Ok(Side {
        centroid,
        vertices: skin.vertices.len() as u32,
        triangles: skin.triangles.len() as u32,
        proxies: proxies.to_vec(),
    })
}
