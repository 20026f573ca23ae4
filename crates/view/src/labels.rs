//! The legend of a rendered image: what its colours and arrows stand for, drawn onto it; and a text in its upper left
//! corner, such as the simulated time.

use std::sync::Arc;

use egui::{Align2, Color32, FontId, Pos2, Rect, Vec2};
use palpate::internal::gpu::{Image, Recording};
use palpate::internal::step::Field;
use palpate::{Context, Result};

use super::look::map;
use super::moment::{Moment, ShownTool};
use super::overlay::Overlay;
use super::painter::{Atlas, Painter};
use super::renderer::Legend;
use super::scale::with_unit;
use super::tessellated;

/// Height of an image, pixels, up to which a point (unit of length of egui, the user interface library) is one pixel;
/// on higher images the legend is scaled up.
const PLAIN: f32 = 720.0;
/// Margin between the legend and the image's edge, points.
const EDGE: f32 = 18.0;
/// Width and height of the colour bar, points.
const BAR: Vec2 = Vec2::new(230.0, 12.0);
/// Side of the square in a material's colour, points.
const SWATCH: f32 = 13.0;
/// Margin between the text in the upper left corner and the image's edges, points.
const CORNER: f32 = 10.0;
/// Size of the letters, points.
const LETTERS: f32 = 15.0;
/// Distance from one line of text to the next, points.
const LINE: f32 = 1.35 * LETTERS;
/// Greatest number of materials that the legend names; how many more there are is said in a line of its own.
const MATERIALS: usize = 16;
/// Colour of the legend's background, which keeps the letters legible over any image.
const PAPER: Color32 = Color32::from_rgba_premultiplied(190, 191, 193, 200);
/// Colour of the letters.
const INK: Color32 = Color32::from_rgb(40, 42, 48);

/// Draws legends.
pub struct Labels {
    egui: egui::Context,
    painter: Painter,
    atlas: Atlas,
}

impl Labels {
    /// Prepares to draw legends.
    pub fn new(context: &Arc<Context>) -> Result<Labels> {
        Ok(Labels { egui: egui::Context::default(), painter: Painter::new(context)?, atlas: Atlas::default() })
    }

    /// The recording (GPU commands) that draws the legend and the corner's text onto an image with one sample per
    /// pixel; `None` if there is nothing to draw. The GPU must have finished the recording that the previous call
    /// returned.
    pub fn paint(&mut self, moment: &Moment, legend: &Legend, image: &Image) -> Result<Option<Recording>> {
        let lines = lines(moment, legend);
        if lines.is_empty() && legend.field.is_none() && moment.corner.is_none() {
            return Ok(None);
        }
        let size = image.size();
        let scale = (size[1] as f32 / PLAIN).max(1.0);
        self.egui.set_pixels_per_point(scale);
        let screen = Rect::from_min_size(Pos2::ZERO, Vec2::new(size[0] as f32, size[1] as f32) / scale);
        let input = egui::RawInput { screen_rect: Some(screen), ..egui::RawInput::default() };
        // After a change of scale, egui uses the new scale only from the second run on, so two runs are made.
        let rounds = if self.egui.pixels_per_point() == scale { 1 } else { 2 };
        let mut written = Default::default();
        for _ in 0..rounds {
            let output = self.egui.run_ui(input.clone(), |ui| {
                let painter = ui.ctx().layer_painter(egui::LayerId::background());
                if !lines.is_empty() || legend.field.is_some() {
                    write(&painter, screen, &lines, legend);
                }
                moment.corner.iter().for_each(|text| write_corner(&painter, screen, text));
            });
            if tessellated::update(&mut self.atlas, &output.textures_delta) {
                self.painter.set_atlas(&self.atlas)?;
            }
            let primitives = self.egui.tessellate(output.shapes, output.pixels_per_point);
            written = tessellated::flat(&primitives, output.pixels_per_point, size);
        }
        self.painter.paint(&written, image).map(Some)
    }
}

/// A line of the legend.
struct Line {
    /// Colour of the square in front of the text; `None`: there is no square.
    swatch: Option<Color32>,
    /// Colour of the text.
    ink: Color32,
    text: String,
}

/// The legend's lines on materials, then those on force and torque.
fn lines(moment: &Moment, legend: &Legend) -> Vec<Line> {
    let mut lines = materials(moment);
    if moment.shown.has(Overlay::Arrows) {
        lines.extend(arrows(moment, legend));
    }
    lines
}

/// The legend's lines on materials, each with a square in the material's colour.
fn materials(moment: &Moment) -> Vec<Line> {
    let named = moment.materials.iter().take(MATERIALS).map(|material| {
        let [r, g, b] = material.colour;
        let text = format!("{}: {}", material.name, with_unit(material.young, "Pa"));
        Line { swatch: Some(Color32::from_rgb(r, g, b)), ink: INK, text }
    });
    let more = moment.materials.len().saturating_sub(MATERIALS);
    let rest = (more > 0).then(|| Line { swatch: None, ink: INK, text: format!("and {more} more materials") });
    named.chain(rest).collect()
}

/// The legend's lines on force and torque, in the colours of the arrows; two for each tool, of several with its name.
fn arrows(moment: &Moment, legend: &Legend) -> Vec<Line> {
    let line = |ink: Color32, name: String, x: f64, high: f64, unit: &str| {
        let longest = if high > 0.0 { format!(" (longest arrow {})", with_unit(high, unit)) } else { String::new() };
        Line { swatch: None, ink, text: format!("{name} {}{longest}", with_unit(x, unit)) }
    };
    let of_tool = |ShownTool { name, wrench, .. }: &ShownTool| {
        let of = if moment.tools.len() > 1 { format!("{name}: ") } else { String::new() };
        let (red, blue) = (Color32::from_rgb(200, 50, 40), Color32::from_rgb(70, 80, 190));
        [
            line(red, format!("{of}force"), wrench.force.length(), legend.force, "N"),
            line(blue, format!("{of}torque"), wrench.torque.length(), legend.torque, "N m"),
        ]
    };
    moment.tools.iter().flat_map(of_tool).collect()
}

/// Writes the text of the upper left corner.
fn write_corner(painter: &egui::Painter, screen: Rect, text: &str) {
    let text = painter.layout_no_wrap(text.into(), FontId::proportional(LETTERS), INK);
    let at = screen.left_top() + Vec2::splat(CORNER);
    painter.rect_filled(Rect::from_min_size(at, text.size()).expand(4.0), 3.0, PAPER);
    painter.galley(at, text, INK);
}

/// Writes the legend into the lower left corner.
fn write(painter: &egui::Painter, screen: Rect, lines: &[Line], legend: &Legend) {
    let font = FontId::proportional(LETTERS);
    let mut at = Pos2::new(EDGE, screen.bottom() - EDGE);
    let scale = if legend.field.is_some() { 2.7 * LETTERS + BAR.y + 4.0 } else { 0.0 };
    let height = LINE * lines.len() as f32 + scale;
    let indent = |line: &Line| if line.swatch.is_some() { LINE } else { 0.0 };
    let width =
        lines.iter().map(|line| indent(line) + painter.layout_no_wrap(line.text.clone(), font.clone(), INK).size().x);
    let width = width.fold(if legend.field.is_some() { BAR.x } else { 0.0 }, f32::max);
    let behind = Rect::from_min_max(at - Vec2::new(0.0, height), at + Vec2::new(width, 0.0)).expand(8.0);
    painter.rect_filled(behind, 4.0, PAPER);
    for line in lines.iter().rev() {
        if let Some(colour) = line.swatch {
            let square = Rect::from_min_size(at - Vec2::new(0.0, LETTERS), Vec2::splat(SWATCH));
            painter.rect_filled(square, 2.0, colour);
        }
        painter.text(at + Vec2::new(indent(line), 0.0), Align2::LEFT_BOTTOM, &line.text, font.clone(), line.ink);
        at.y -= LINE;
    }
    let Some((field, high)) = legend.field else { return };
    if high == 0.0 {
        painter.text(at, Align2::LEFT_BOTTOM, format!("{}: none yet", field.name()), font, INK);
        return;
    }
    let ends = [(0.0, Align2::LEFT_BOTTOM), (0.5, Align2::CENTER_BOTTOM), (1.0, Align2::RIGHT_BOTTOM)];
    for (share, align) in ends {
        let place = Pos2::new(at.x + share * BAR.x, at.y);
        painter.text(place, align, tick(field, f64::from(share) * high), font.clone(), INK);
    }
    at.y -= LINE + BAR.y;
    let steps = 64;
    for k in 0..steps {
        let colour = map(field).eval_rational(k, steps);
        let width = BAR.x / steps as f32;
        let left = Pos2::new(at.x + k as f32 * width, at.y);
        // Strips overlap a little, so that no gap shows between them.
        let rect = Rect::from_min_size(left, Vec2::new(width + 0.5, BAR.y));
        painter.rect_filled(rect, 0.0, Color32::from_rgb(colour.r, colour.g, colour.b));
    }
    at.y -= 4.0;
    painter.text(at, Align2::LEFT_BOTTOM, field.name(), font, INK);
}

/// A value on a field's colour scale, as text.
fn tick(field: Field, x: f64) -> String {
    match field.unit() {
        "J/m^3" => with_unit(x, "J/m\u{b3}"),
        unit => with_unit(x, unit),
    }
}
