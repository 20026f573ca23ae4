//! From a simulation's arrays to a picture, in slices: the simulation steps between any two of them. Nothing of a mesh is read
//! back.

use std::sync::Arc;

use glam::{DMat4, DVec3};

use super::look::{BACKGROUND, Material, View, columns, light};
use super::moment::Moment;
use super::parts::Parts;
use super::picture::Picture;
use super::Camera;
use crate::gpu::{
    Before, Buffer, Canvas, Context, DeviceKind, Drawn, Image, Memory, Onto, RasterPipeline, Recorder, Recording, Side,
    Texels,
};
use crate::step::Simulation;
use crate::{Error, Result};

/// Texels along the shadow's edge.
const SHADOW_SIDE: u32 = 512;
/// Materials that the shaders know.
const MATERIALS: usize = 32;
/// How far a shadow's caster must lie in front, of what the sun sees.
const BIAS: f64 = 0.006;
/// Towards the sun.
const SUN: DVec3 = DVec3::new(-0.45, 0.85, 0.55);
/// Triangles of a slice on a device that draws on the processor, and on any other.
const CPU_SLICE: u32 = 24_000;
const GPU_SLICE: u32 = 1 << 20;

/// How pictures are made.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Samples a pixel: 1 or 4.
    pub samples: u32,
}

/// Draws a simulation.
pub struct Renderer {
    context: Arc<Context>,
    settings: Settings,
    /// Where positions are measured from, m.
    origin: DVec3,
    parts: Parts,
    positions: Buffer,
    normals: Buffer,
    values: Buffer,
    view: Buffer,
    materials: Buffer,
    colours: Buffer,
    shadow: Canvas,
    shadow_depths: Buffer,
    canvas: Canvas,
    solid: RasterPipeline,
    glass: RasterPipeline,
    ground: RasterPipeline,
    caster: RasterPipeline,
    slices: Vec<Recording>,
}

impl Renderer {
    /// For a simulation as it is now: where its bodies are decides where positions are measured from.
    pub fn new(simulation: &mut Simulation, settings: Settings) -> Result<Renderer> {
        let context = simulation.context().clone();
        let parts = Parts::new(&context, simulation)?;
        let (middle, _) = around(parts.skins.iter().map(|part| part.ball));
        let skins = simulation.skin_arrays()?;
        let (positions, normals) = (skins.positions.clone(), skins.normals.clone());
        let vertices = positions.bytes() / 16;
        let onto = Onto { has_colour: true, has_depth: true, hides: true, samples: settings.samples, ..Onto::default() };
        let shade = Onto { has_depth: true, hides: true, samples: 1, ..Onto::default() };
        let blend = Onto { hides: false, blends: true, ..onto };
        let pipeline = |name: &str, onto: &Onto| RasterPipeline::onto(&context, name, &[], onto);
        let shadow_image = Image::new(&context, "what the sun sees", Texels::Depth, [SHADOW_SIDE; 2], 1)?;
        let host = |name: &str, bytes: usize| Buffer::new(&context, name, bytes as u64, Memory::Upload);
        let mut renderer = Renderer {
            canvas: canvas(&context, &settings)?,
            shadow_depths: Buffer::new(&context, "shadow", shadow_image.bytes(), Memory::Device)?,
            shadow: Canvas { depth: Some(shadow_image), ..Canvas::default() },
            values: Buffer::from_slice(&context, "no values", &vec![0f32; vertices.next_multiple_of(4) as usize], Memory::Device)?,
            view: host("view", size_of::<View>())?,
            materials: host("looks", MATERIALS * size_of::<Material>())?,
            colours: host("colours of values", 256 * 16)?,
            solid: pipeline("view/mesh", &Onto { culls: Some(Side::Back), ..onto })?,
            glass: pipeline("view/mesh", &Onto { culls: Some(Side::Back), ..blend })?,
            ground: pipeline("view/ground", &blend)?,
            caster: pipeline("view/shadow", &shade)?,
            slices: Vec::new(),
            origin: middle,
            context,
            settings,
            parts,
            positions,
            normals,
        };
        renderer.record()?;
        Ok(renderer)
    }

    /// Where positions are measured from, m: what [`Moment::of`] is given.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Makes pictures of another size from now on.
    pub fn resize(&mut self, size: [u32; 2]) -> Result<()> {
        let settings = Settings { size, ..self.settings };
        self.canvas = canvas(&self.context, &settings)?;
        self.settings = settings;
        self.record()
    }

    /// Sets out what the next picture shows; the slices draw it.
    pub fn look(&mut self, moment: &Moment, camera: &Camera) -> Result<()> {
        let [width, height] = self.settings.size;
        let balls = self.parts.skins.iter().map(|part| {
            let now = moment.frames.get(part.body).copied().flatten();
            let moved = part.frame.zip(now).map_or(DVec3::ZERO, |(then, now)| now - then);
            (part.ball.0 + moved, part.ball.1)
        });
        let (middle, reach) = around(balls);
        let sun = SUN.normalize();
        let shift = DMat4::from_translation(self.origin);
        let (normal, offset) = self.parts.ground;
        let relative = |x: DVec3| (x - self.origin).as_vec3().to_array();
        self.view.mapped_mut::<View>()?[0] = View {
            clip: columns(camera.matrix(width, height) * shift),
            light: columns(light(sun, middle, 1.05 * reach) * shift),
            eye: relative(camera.eye()),
            sun: sun.as_vec3().to_array(),
            background: BACKGROUND,
            ground: normal.extend(offset - normal.dot(self.origin)).as_vec4().to_array(),
            middle: relative(middle),
            reach: reach as f32,
            bias: BIAS as f32,
            texel: (2.1 * reach / f64::from(SHADOW_SIDE)) as f32,
            shadow_side: SHADOW_SIDE,
        };
        let mut materials = self.materials.mapped_mut::<Material>()?;
        for (slot, part) in materials.iter_mut().zip(&self.parts.skins) {
            *slot = part.material;
        }
        Ok(())
    }

    /// What draws a picture, in order: each is submitted by itself.
    pub fn slices(&self) -> &[Recording] {
        &self.slices
    }

    /// Draws all slices at once and reads the picture.
    pub fn picture(&self) -> Result<Picture> {
        Recording::submit_all(&self.slices.iter().collect::<Vec<_>>())?;
        self.read()
    }

    /// The picture that was drawn last.
    pub fn read(&self) -> Result<Picture> {
        let image = self.image()?;
        let array = Buffer::new(&self.context, "picture", image.bytes(), Memory::Readback)?;
        let mut recorder = Recorder::untimed(&self.context)?;
        recorder.stage("picture");
        recorder.copy_out(image, &array);
        recorder.finish()?.submit_and_wait()?;
        let [width, height] = image.size();
        Ok(Picture { width, height, pixels: array.read()? })
    }

    /// What the slices draw onto.
    pub fn image(&self) -> Result<&Image> {
        let seen = self.canvas.mean.as_ref().or(self.canvas.colour.as_ref());
        seen.ok_or_else(|| Error::Simulation("a canvas has no colour".into()))
    }

    fn record(&mut self) -> Result<()> {
        self.slices = Vec::new();
        self.slices.push(self.record_shadow()?);
        let most = if self.context.kind() == DeviceKind::Cpu { CPU_SLICE } else { GPU_SLICE };
        let mut before = Before::Cleared([BACKGROUND[0], BACKGROUND[1], BACKGROUND[2], 1.0]);
        let mut work: Vec<Vec<(usize, u32, u32)>> = vec![Vec::new()];
        let mut room = 3 * most;
        for (k, part) in self.parts.skins.iter().enumerate().filter(|(_, part)| !part.is_glass) {
            let mut first = 0;
            while first < part.index_count {
                if room == 0 {
                    work.push(Vec::new());
                    room = 3 * most;
                }
                let count = room.min(part.index_count - first);
                work.last_mut().into_iter().for_each(|slice| slice.push((k, first, count)));
                (first, room) = (first + count, room - count);
            }
        }
        let unresolved = Canvas { mean: None, ..self.canvas.clone() };
        for slice in work {
            let slice = self.record_skins(&unresolved, before, &self.solid, &slice)?;
            self.slices.push(slice);
            before = Before::Kept;
        }
        let last = self.record_last(before)?;
        self.slices.push(last);
        Ok(())
    }

    fn record_shadow(&self) -> Result<Recording> {
        let mut recorder = Recorder::untimed(&self.context)?;
        recorder.stage("shadow");
        let casters = Drawn {
            pipeline: &self.caster,
            buffers: &[&self.view, &self.positions],
            push: &[],
            indices: Some(&self.parts.casters),
            range: (0, self.parts.caster_count),
            instances: 1,
            part: None,
        };
        recorder.paint(&self.shadow, Before::Cleared([0.0; 4]), &[casters]);
        self.shadow.depth.iter().for_each(|depth| recorder.copy_out(depth, &self.shadow_depths));
        recorder.finish()
    }

    fn record_skins(
        &self,
        canvas: &Canvas,
        before: Before,
        pipeline: &RasterPipeline,
        work: &[(usize, u32, u32)],
    ) -> Result<Recording> {
        let mut recorder = Recorder::untimed(&self.context)?;
        recorder.stage("skins");
        let buffers = self.mesh_buffers();
        let slots: Vec<u32> = (0..MATERIALS as u32).collect();
        let drawn = work.iter().map(|&(k, first, count)| self.skin(pipeline, &buffers, &slots[k..=k], k, (first, count)));
        recorder.paint(canvas, before, &drawn.collect::<Vec<_>>());
        recorder.finish()
    }

    fn skin<'a>(
        &'a self,
        pipeline: &'a RasterPipeline,
        buffers: &'a [&'a Buffer],
        slot: &'a [u32],
        part: usize,
        range: (u32, u32),
    ) -> Drawn<'a> {
        let indices = Some(&self.parts.skins[part].indices);
        Drawn { pipeline, buffers, push: bytemuck::cast_slice(slot), indices, range, instances: 1, part: None }
    }

    fn mesh_buffers(&self) -> [&Buffer; 7] {
        [
            &self.view,
            &self.positions,
            &self.normals,
            &self.values,
            &self.shadow_depths,
            &self.colours,
            &self.materials,
        ]
    }

    /// What is seen through comes last.
    fn record_last(&self, before: Before) -> Result<Recording> {
        let mut recorder = Recorder::untimed(&self.context)?;
        recorder.stage("ground and glass");
        let buffers = self.mesh_buffers();
        let slots: Vec<u32> = (0..MATERIALS as u32).collect();
        let ground = [&self.view, &self.shadow_depths];
        let mut all = vec![Drawn {
            pipeline: &self.ground,
            buffers: &ground,
            push: &[],
            indices: None,
            range: (0, 6),
            instances: 1,
            part: None,
        }];
        for (k, part) in self.parts.skins.iter().enumerate().filter(|(_, part)| part.is_glass) {
            all.push(self.skin(&self.glass, &buffers, &slots[k..=k], k, (0, part.index_count)));
        }
        recorder.paint(&self.canvas, before, &all);
        recorder.finish()
    }
}

fn canvas(context: &Arc<Context>, settings: &Settings) -> Result<Canvas> {
    let image = |name, texels, samples| Image::new(context, name, texels, settings.size, samples);
    Ok(Canvas {
        colour: Some(image("picture", Texels::Colour, settings.samples)?),
        depth: Some(image("depths", Texels::Depth, settings.samples)?),
        mean: (settings.samples > 1).then(|| image("smoothed picture", Texels::Colour, 1)).transpose()?,
    })
}

/// A ball around balls.
fn around(balls: impl Iterator<Item = (DVec3, f64)> + Clone) -> (DVec3, f64) {
    let corners = balls.clone().flat_map(|(x, r)| [x - r, x + r]);
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = corners.fold(none, |(low, high), x| (low.min(x), high.max(x)));
    if !low.is_finite() {
        return (DVec3::ZERO, 1.0);
    }
    let middle = 0.5 * (low + high);
    let reach = balls.map(|(x, r)| x.distance(middle) + r).fold(0.0, f64::max);
    (middle, reach)
}
