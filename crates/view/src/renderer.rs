//! Renders a simulation's arrays to an image in *slices*, parts that are submitted to the GPU one by one so that the
//! simulation can step between two slices. No mesh is read back to the CPU. A *skin* is a body's surface mesh; a
//! *piece* is a mesh, or part of one, with one material.

use std::sync::Arc;

use glam::{DMat4, DVec3};
use palpate::internal::gpu::{
    Arguments, Before, Buffer, Canvas, DeviceKind, Drawn, Image, Memory, Onto, RasterPipeline, Recorder, Recording,
    Side, Texels,
};
use palpate::internal::shaders;
use palpate::internal::step::{self, Field, FieldValues};
use palpate::{Context, Error, Result, Simulation, Wrench};

use super::Camera;
use super::look::{self, BACKGROUND, Material, SCALE_COLOURS, View, across, columns, light};
use super::moment::Moment;
use super::overlay::Overlay;
use super::parts::{Part, Parts};
use super::picture::Picture;
use super::pieces::{Piece, Pieces, Source, Style, is_of_bodies};
use super::scale::Scale;

/// Number of texels along a side of the shadow map. Shaders read the map from a texel buffer with four depths per
/// element; every Vulkan device permits 65,536 elements.
const SHADOW_SIDE: u32 = 508;
/// Shadow bias: by how much something must be nearer to the sun than a point to shade that point, as a share of the
/// shadow map's depth.
const BIAS: f64 = 0.006;
/// Direction towards the sun.
const SUN: DVec3 = DVec3::new(-0.25, 0.85, 0.8);
/// Extent of the shadow map, as a multiple of the diameter of the sphere around all bodies.
const ROOM: f64 = 1.05;
/// Half the edge of the box that the first camera shows, as a share of the radius of the sphere around all bodies.
/// Bodies seldom fill that sphere.
const SNUG: f64 = 0.5;
/// Meshes whose edges are shorter than this number of the shadow map's texels are shaded per vertex.
const FINE: f64 = 4.0;
/// Greatest number of materials in an image.
const MATERIALS: usize = 1024;
/// Greatest numbers of triangles in a slice: the first for a Vulkan device that draws on the CPU, the second for a GPU.
const CPU_SLICE: u32 = 30_000;
const GPU_SLICE: u32 = 1 << 22;

/// Settings of rendered images.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Samples per pixel: 1 or 4.
    pub samples: u32,
}

/// What the colours and arrows of an image stand for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Legend {
    /// The field that skins are coloured by, and the upper end of its scale, which begins at zero.
    pub field: Option<(Field, f64)>,
    /// Force that the longest arrow stands for, N; 0 if there was no force yet.
    pub force: f64,
    /// Torque that the longest arrow stands for, N m; 0 if there was no torque yet.
    pub torque: f64,
}

/// Draws a simulation.
pub struct Renderer {
    context: Arc<Context>,
    settings: Settings,
    /// World position to which the positions on the GPU are relative, m.
    origin: DVec3,
    /// Radius of the sphere around the bodies when rendering began, m; the sphere's centre is `origin`.
    reach: f64,
    parts: Parts,
    no_values: Buffer,
    view: Buffer,
    materials: Buffer,
    colours: Buffer,
    shadow: Canvas,
    shadow_depths: Buffer,
    canvas: Canvas,
    pipelines: Pipelines,
    legend: Legend,
    scales: [Scale; 6],
    slices: Vec<Recording>,
    /// Unit vector towards the sun.
    sun: DVec3,
    /// Greatest number of triangles in a slice.
    most: u32,
}

struct Pipelines {
    solid: RasterPipeline,
    fine: RasterPipeline,
    open: RasterPipeline,
    glass: RasterPipeline,
    ground: RasterPipeline,
    caster: RasterPipeline,
}

/// Indices of the scales of force and torque in `Renderer::scales`, which begins with the scales of the four fields.
const FORCE: usize = 4;
const TORQUE: usize = 5;

impl Renderer {
    /// A renderer for a simulation. The present places of the bodies determine [`Renderer::origin`].
    pub fn new(simulation: &mut Simulation, settings: Settings) -> Result<Renderer> {
        let context = simulation.context().clone();
        let mut parts = Parts::new(&context, simulation)?;
        let (middle, reach) = around(parts.skins.iter().map(|part| part.ball));
        let texel = 2.0 * ROOM * reach / f64::from(SHADOW_SIDE);
        parts.skins.iter_mut().for_each(|part| part.is_fine = part.edge < FINE * texel);
        let vertices = simulation.skin_ranges().last().map_or(0, |range| range.end);
        let no_values = vec![0f32; vertices.next_multiple_of(4)];
        let shadow = Image::new(&context, "shadow map", Texels::Depth, [SHADOW_SIDE; 2], 1)?;
        let host = |name: &str, bytes: usize| Buffer::new(&context, name, bytes as u64, Memory::Upload);
        Ok(Renderer {
            canvas: canvas(&context, &settings)?,
            shadow_depths: Buffer::new(&context, "shadow", shadow.bytes() + 16, Memory::Device)?,
            shadow: Canvas { depth: Some(shadow), ..Canvas::default() },
            no_values: Buffer::from_slice(&context, "values", &no_values, Memory::Device)?,
            view: host("view", size_of::<View>())?,
            materials: host("materials", MATERIALS * size_of::<Material>())?,
            colours: host("colours", 2 * SCALE_COLOURS * 16)?,
            pipelines: Pipelines::new(&context, settings.samples)?,
            legend: Legend::default(),
            scales: Default::default(),
            slices: Vec::new(),
            sun: SUN.normalize(),
            most: if context.kind() == DeviceKind::Cpu { CPU_SLICE } else { GPU_SLICE },
            origin: middle,
            reach,
            context,
            settings,
            parts,
        })
    }

    /// World position to which the positions on the GPU are relative, m; must be given to [`Moment::of`].
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// A camera that shows all bodies where they were when the renderer was made.
    pub fn camera(&self) -> Camera {
        Camera::around(self.origin - SNUG * self.reach, self.origin + SNUG * self.reach)
    }

    /// Changes the size of images, from the next [`Renderer::look`] on.
    pub fn resize(&mut self, size: [u32; 2]) -> Result<()> {
        let settings = Settings { size, ..self.settings };
        self.canvas = canvas(&self.context, &settings)?;
        self.settings = settings;
        Ok(())
    }

    /// Changes the direction towards the sun, from the next [`Renderer::look`] on; a zero vector changes nothing.
    pub fn set_sun(&mut self, towards: DVec3) {
        self.sun = towards.try_normalize().unwrap_or(self.sun);
    }

    /// Changes the greatest number of triangles in a slice, from the next [`Renderer::look`] on.
    pub fn set_slice(&mut self, triangles: u32) {
        self.most = triangles.clamp(1, GPU_SLICE);
    }

    /// What colours and arrows stand for in the image of the last [`Renderer::look`].
    pub fn legend(&self) -> &Legend {
        &self.legend
    }

    /// Prepares the next image, which is then drawn by submitting [`Renderer::slices`].
    pub fn look(&mut self, moment: &Moment, camera: &Camera) -> Result<()> {
        self.read_scales(moment);
        self.write_view(moment, camera)?;
        self.colours.write(&look::colours(moment.shown.field()))?;
        let source = Source {
            context: &self.context,
            moment,
            skins: &self.parts.skins,
            no_values: &self.no_values,
            origin: self.origin,
            height: 2.0 * camera.distance * (0.5 * camera.fovy).tan(),
            legend: &self.legend,
        };
        let Pieces { all, materials } = source.pieces()?;
        if materials.len() > MATERIALS {
            return Err(Error::Simulation(format!(
                "an image can show {MATERIALS} materials at most, not {}",
                materials.len()
            )));
        }
        self.materials.mapped_mut::<Material>()?[..materials.len()].copy_from_slice(&materials);
        self.slices = self.record(&all, &moment.positions)?;
        Ok(())
    }

    fn read_scales(&mut self, moment: &Moment) {
        let field = moment.field.as_ref().map(|values| {
            let scale = &mut self.scales[values.field as usize];
            scale.show(greatest_shown(moment, values, &self.parts.skins).into());
            (values.field, scale.high)
        });
        let field = field.filter(|(field, _)| shows(moment, *field, &self.parts.skins));
        let greatest = |part: fn(&Wrench) -> DVec3| {
            moment.tools.iter().map(|tool| part(&tool.wrench).length()).fold(0.0, f64::max)
        };
        self.scales[FORCE].show(greatest(|wrench| wrench.force));
        self.scales[TORQUE].show(greatest(|wrench| wrench.torque));
        self.legend = Legend { field, force: self.scales[FORCE].high, torque: self.scales[TORQUE].high };
    }

    fn write_view(&self, moment: &Moment, camera: &Camera) -> Result<()> {
        let [width, height] = self.settings.size;
        let balls = self.parts.skins.iter().map(|part| {
            let now = moment.frames.get(part.body).copied().flatten();
            let moved = part.frame.zip(now).map_or(DVec3::ZERO, |(then, now)| now - then);
            (part.ball.0 + moved, part.ball.1)
        });
        let (middle, reach) = around(balls);
        let (sun, reach) = (self.sun, ROOM * reach);
        let shift = DMat4::from_translation(self.origin);
        let (normal, offset) = self.parts.ground;
        let relative = |x: DVec3| (x - self.origin).as_vec3().to_array();
        self.view.mapped_mut::<View>()?[0] = View {
            clip: columns(camera.matrix(width, height) * shift),
            light: columns(light(sun, middle, reach) * shift),
            eye: relative(camera.eye()),
            sun: sun.as_vec3().to_array(),
            across: across(sun).map(|axis| axis.as_vec3().to_array()),
            ground: normal.extend(offset - normal.dot(self.origin)).as_vec4().to_array(),
            middle: relative(middle),
            reach: reach as f32,
            bias: BIAS as f32,
            texel: (2.0 * reach / f64::from(SHADOW_SIDE)) as f32,
            shadow_side: SHADOW_SIDE,
        };
        Ok(())
    }

    /// The slices that draw the image, in the order in which they must be submitted.
    pub fn slices(&self) -> &[Recording] {
        &self.slices
    }

    /// Submits all slices at once and reads the image.
    pub fn picture(&self) -> Result<Picture> {
        Recording::submit_all(&self.slices.iter().collect::<Vec<_>>())?;
        self.read()
    }

    /// Reads the image that was drawn last.
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

    /// The image that the slices draw, with one sample per pixel.
    pub fn image(&self) -> Result<&Image> {
        let seen = self.canvas.mean.as_ref().or(self.canvas.colour.as_ref());
        seen.ok_or_else(|| Error::Simulation("internal error: the canvas has no colour image".into()))
    }

    /// Records the slices: the first draws the shadow map, all of them draw opaque pieces, the last draws the ground
    /// and all transparent pieces.
    fn record(&self, pieces: &[Piece], positions: &Buffer) -> Result<Vec<Recording>> {
        let (glass, opaque): (Vec<&Piece>, Vec<&Piece>) = pieces.iter().partition(|piece| piece.style == Style::Glass);
        let glass = glass.into_iter().map(|piece| (piece, piece.range.clone()));
        let mut work = sliced(opaque.into_iter(), 3 * self.most);
        let last = work.len() - 1;
        work[last].extend(glass);
        let unresolved = Canvas { mean: None, ..self.canvas.clone() };
        let mut slices = Vec::with_capacity(work.len());
        for (k, slice) in work.iter().enumerate() {
            let mut recorder = Recorder::untimed(&self.context)?;
            if k == 0 {
                self.record_shadow(&mut recorder, positions);
            }
            recorder.stage("picture");
            let before = if k == 0 { Before::Cleared(BACKGROUND) } else { Before::Kept };
            self.record_pieces(
                &mut recorder,
                if k == last { &self.canvas } else { &unresolved },
                before,
                slice,
                k == last,
            );
            slices.push(recorder.finish()?);
        }
        Ok(slices)
    }

    fn record_shadow(&self, recorder: &mut Recorder, positions: &Buffer) {
        recorder.stage("shadow");
        let casters = Drawn {
            pipeline: &self.pipelines.caster,
            arguments: &shaders::view::DrawShadow { view: &self.view, positions },
            indices: Some(&self.parts.casters),
            range: (0, self.parts.caster_count),
            instances: 1,
            part: None,
        };
        recorder.paint(&self.shadow, Before::Cleared([0.0; 4]), &[casters]);
        self.shadow.depth.iter().for_each(|depth| recorder.copy_out(depth, &self.shadow_depths));
    }

    fn record_pieces(
        &self,
        recorder: &mut Recorder,
        canvas: &Canvas,
        before: Before,
        pieces: &[(&Piece, std::ops::Range<u32>)],
        with_ground: bool,
    ) {
        let meshes: Vec<_> = pieces
            .iter()
            .map(|(Piece { arrays, material, .. }, _)| shaders::view::DrawMesh {
                material_index: *material as u32,
                view: &self.view,
                positions: &arrays.positions,
                normals: &arrays.normals,
                values: &arrays.values,
                shadow: &self.shadow_depths,
                colours: &self.colours,
                materials: &self.materials,
            })
            .collect();
        let ground = shaders::view::DrawGround { view: &self.view, shadow: &self.shadow_depths };
        let mut all = Vec::with_capacity(pieces.len() + 1);
        // The ground is drawn after the opaque pieces, which hide it, and before the transparent ones, through which it
        // is seen.
        let under = pieces.iter().position(|(piece, _)| piece.style == Style::Glass).unwrap_or(pieces.len());
        for (k, ((piece, range), mesh)) in pieces.iter().zip(&meshes).enumerate() {
            if k == under && with_ground {
                all.push(whole(&self.pipelines.ground, &ground));
            }
            let pipeline = match piece.style {
                Style::Solid => &self.pipelines.solid,
                Style::Fine => &self.pipelines.fine,
                Style::Open => &self.pipelines.open,
                Style::Glass => &self.pipelines.glass,
            };
            let (indices, range) = (Some(&piece.arrays.indices), (range.start, range.end - range.start));
            all.push(Drawn { indices, range, ..whole(pipeline, mesh) });
        }
        if under == pieces.len() && with_ground {
            all.push(whole(&self.pipelines.ground, &ground));
        }
        recorder.paint(canvas, before, &all);
    }
}

/// A draw of six vertices without indices; the vertex shader computes their positions.
fn whole<'a>(pipeline: &'a RasterPipeline, arguments: &'a dyn Arguments) -> Drawn<'a> {
    Drawn { pipeline, arguments, indices: None, range: (0, 6), instances: 1, part: None }
}

impl Pipelines {
    fn new(context: &Arc<Context>, samples: u32) -> Result<Pipelines> {
        let onto = Onto { has_colour: true, has_depth: true, hides: true, samples, ..Onto::default() };
        let outside = Onto { culls: Some(Side::Back), ..onto };
        let blend = Onto { hides: false, blends: true, ..onto };
        let shade = Onto { has_depth: true, hides: true, samples: 1, ..Onto::default() };
        let mesh = |at_vertices: bool, onto| {
            RasterPipeline::onto(context, "view/mesh", &[("AT_VERTICES", at_vertices.into())], onto)
        };
        Ok(Pipelines {
            solid: mesh(false, &outside)?,
            fine: mesh(true, &outside)?,
            open: mesh(false, &onto)?,
            glass: mesh(false, &Onto { culls: Some(Side::Back), ..blend })?,
            ground: RasterPipeline::onto(context, "view/ground", &[], &blend)?,
            caster: RasterPipeline::onto(context, "view/shadow", &[], &shade)?,
        })
    }
}

/// Whether the image shows something that is coloured by the field: a soft body's skin, or its tetrahedral mesh if the
/// field has values at nodes.
fn shows(moment: &Moment, field: Field, skins: &[Part]) -> bool {
    let has_skins = !moment.shown.has(Overlay::Proxies) && !moment.shown.opens_layers();
    let has_layers = moment.shown.opens_layers() && is_of_bodies(field);
    (has_skins || has_layers) && skins.iter().any(|part| part.is_soft)
}

/// The greatest value of the field on the meshes that are coloured by it.
fn greatest_shown(moment: &Moment, values: &FieldValues, skins: &[Part]) -> f32 {
    let soft = skins.iter().filter(|part| part.is_soft && !moment.shown.opens_layers());
    let of_skins = soft.filter_map(|part| values.greatest.get(part.body));
    let layers = moment.meshes.iter().filter(|(overlay, _)| matches!(overlay, step::Overlay::Layers(_)));
    of_skins.copied().chain(layers.map(|(_, mesh)| mesh.greatest)).fold(0.0, f32::max)
}

/// Divides pieces into slices of at most `most` indices, three per triangle.
fn sliced<'a>(pieces: impl Iterator<Item = &'a Piece>, most: u32) -> Vec<Vec<(&'a Piece, std::ops::Range<u32>)>> {
    let (mut slices, mut room) = (vec![Vec::new()], most);
    for piece in pieces {
        let mut from = piece.range.start;
        while from < piece.range.end {
            if room == 0 {
                slices.push(Vec::new());
                room = most;
            }
            let to = piece.range.end.min(from + room);
            slices.last_mut().into_iter().for_each(|slice: &mut Vec<_>| slice.push((piece, from..to)));
            (room, from) = (room - (to - from), to);
        }
    }
    slices
}

fn canvas(context: &Arc<Context>, settings: &Settings) -> Result<Canvas> {
    let image = |name, texels, samples| Image::new(context, name, texels, settings.size, samples);
    Ok(Canvas {
        colour: Some(image("picture", Texels::Colour, settings.samples)?),
        depth: Some(image("depths", Texels::Depth, settings.samples)?),
        mean: (settings.samples > 1).then(|| image("antialiased image", Texels::Colour, 1)).transpose()?,
    })
}

/// A sphere that encloses these spheres: centre and radius, m.
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
