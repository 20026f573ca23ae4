//! The legend, which is drawn onto a rendered image and says what the image's colours and arrows stand for.

use std::sync::Arc;

use egui::{Align2, Color32, FontId, Pos2, Rect, Vec2};
use palpate::internal::gpu::{Image, Recording};
use palpate::internal::step::Field;
use palpate::{Context, Result};

use super::look::map;
use super::moment::Moment;
use super::overlay::Overlay;
use super::painter::{Atlas, Painter};
use super::renderer::Legend;
use super::scale::with_unit;
use super::tessellated;

/// Height of an image, pixels, up to which a point (unit of length of egui, the user interface library) is one pixel;
/// on higher images the legend is scaled up.
const PLAIN: f32 = 720.0;
/// Sizes in points: margin between the legend and the image's edge, width and height of the colour bar, height of the
/// letters.
const EDGE: f32 = 18.0;
const BAR: Vec2 = Vec2::new(230.0, 12.0);
const LETTERS: f32 = 15.0;
/// Colour of the legend's background, which keeps the letters legible over any image, and colour of the letters.
const PAPER: Color32 = Color32::from_rgba_premultiplied(190, 191, 193, 200);
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

    /// The recording of GPU commands that draw the legend onto an image with one sample per pixel; `None` if the image
    /// needs no legend. The GPU must have finished the recording that the call before this one returned.
    pub fn paint(&mut self, moment: &Moment, legend: &Legend, image: &Image) -> Result<Option<Recording>> {
        let lines = lines(moment, legend);
        if lines.is_empty() && legend.field.is_none() {
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
                write(&painter, screen, &lines, legend);
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

/// The legend's lines about the force and the torque on the tool, with the colours of the lines.
fn lines(moment: &Moment, legend: &Legend) -> Vec<(Color32, String)> {
    if !moment.shown.has(Overlay::Arrows) || moment.tool.is_none() {
        return Vec::new();
    }
    let line = |name: &str, x: f64, high: f64, unit: &str| {
        let longest = if high > 0.0 { format!(" (longest arrow {})", with_unit(high, unit)) } else { String::new() };
        format!("{name} {}{longest}", with_unit(x, unit))
    };
    vec![
        (Color32::from_rgb(200, 50, 40), line("force", moment.force.length(), legend.force, "N")),
        (Color32::from_rgb(70, 80, 190), line("torque", moment.torque.length(), legend.torque, "N m")),
    ]
}

fn write(painter: &egui::Painter, screen: Rect, lines: &[(Color32, String)], legend: &Legend) {
    let font = FontId::proportional(LETTERS);
    let mut at = Pos2::new(EDGE, screen.bottom() - EDGE);
    let scale = if legend.field.is_some() { 2.7 * LETTERS + BAR.y + 4.0 } else { 0.0 };
    let height = 1.35 * LETTERS * lines.len() as f32 + scale;
    let width = lines.iter().map(|(_, line)| painter.layout_no_wrap(line.clone(), font.clone(), INK).size().x);
    let width = width.fold(if legend.field.is_some() { BAR.x } else { 0.0 }, f32::max);
    let behind = Rect::from_min_max(at - Vec2::new(0.0, height), at + Vec2::new(width, 0.0)).expand(8.0);
    painter.rect_filled(behind, 4.0, PAPER);
    for (colour, line) in lines.iter().rev() {
        painter.text(at, Align2::LEFT_BOTTOM, line, font.clone(), *colour);
        at.y -= 1.35 * LETTERS;
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
    at.y -= 1.35 * LETTERS + BAR.y;
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
