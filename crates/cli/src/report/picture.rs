//! Images without a GPU: a z-buffered orthographic rasteriser, smoothed by supersampling, and PNG files of its images.
//!
//! The rasteriser is made for reports, not for speed. The same faces give the same bytes on every machine, because the
//! rasteriser uses only correctly rounded operations in a fixed order.

use std::io::Write;

use glam::DVec3;

/// Number of samples along a side of each pixel.
const SAMPLES: usize = 3;
/// Width of a drawn edge, samples.
const EDGE: f64 = 1.3;
/// Brightness of a drawn edge, as a share of the face's brightness.
const EDGE_SHADE: f64 = 0.35;
/// Distance from a sample to the neighbours with whose depth its own depth is compared, samples.
const RELIEF_REACH: i64 = 5;
/// Strength with which a jump in depth darkens the farther surface; a jump is measured as a share of the image's longer
/// side.
const RELIEF: f64 = 9.0;
/// Width of the free border on each side of what is drawn, as a share of the larger extent of what is drawn.
const BORDER: f64 = 0.04;

/// Red, green and blue, linear, 0 to 1.
pub type Colour = [f64; 3];

/// A triangle to draw.
#[derive(Debug, Clone)]
pub struct Face {
    /// Corners, m.
    pub corners: [DVec3; 3],
    /// Unit normals at the corners.
    pub normals: [DVec3; 3],
    /// Colour in full light.
    pub colour: Colour,
    /// Whether the triangle's edges are drawn.
    pub has_edges: bool,
}

impl Face {
    /// A flat triangle, counter-clockwise seen from outside.
    pub fn flat(corners: [DVec3; 3], colour: Colour, has_edges: bool) -> Self {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        Face { corners, normals: [normal; 3], colour, has_edges }
    }
}

/// The orthographic camera of an image.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Unit vectors to the right of the image, up, and towards the viewer.
    axes: [DVec3; 3],
    /// Centre of what is shown, m.
    centre: DVec3,
    /// Half width and half height shown, m.
    half: [f64; 2],
}

impl View {
    /// A view of the box around points, seen by a viewer in the direction `towards`; `up` points upwards in the image
    /// as nearly as possible. The view shows all points and a border around them.
    pub fn of(points: impl Iterator<Item = DVec3> + Clone, towards: DVec3, up: DVec3) -> View {
        let towards = towards.normalize_or(DVec3::Z);
        let right = up.cross(towards).try_normalize().unwrap_or_else(|| towards.any_orthonormal_vector());
        let axes = [right, towards.cross(right), towards];
        let reach = |axis: DVec3| {
            let along = points.clone().map(|p| p.dot(axis));
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        };
        let spans = axes.map(reach);
        let centre = (0..3).map(|k| axes[k] * (0.5 * (spans[k].0 + spans[k].1))).sum();
        let half = [0, 1].map(|k| 0.5 * (spans[k].1 - spans[k].0));
        let border = 2.0 * BORDER * half[0].max(half[1]);
        // If there is no point or only one, the view is a square of 2 m.
        let half = if border > 0.0 { half.map(|h| h + border) } else { [1.0; 2] };
        View { axes, centre, half }
    }

    /// Unit vectors to the right of the image, up, and towards the viewer.
    pub fn axes(&self) -> [DVec3; 3] {
        self.axes
    }
}

/// A finished image: rows from the top, sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Red, green, blue of each pixel.
    pub pixels: Vec<[u8; 3]>,
}

/// Draws faces on white; the longer side of the image has `longest` pixels.
pub fn draw(faces: &[Face], view: &View, longest: usize) -> Picture {
    let mut canvas = Canvas::new(view, longest);
    faces.iter().for_each(|face| canvas.add(face));
    canvas.relief();
    canvas.finish()
}

struct Canvas<'a> {
    view: &'a View,
    /// Number of samples per row, and number of rows of samples.
    size: [usize; 2],
    /// Samples per metre.
    scale: f64,
    /// Height towards the viewer of the nearest face at each sample, m.
    depth: Vec<f32>,
    colour: Vec<[f32; 3]>,
}

impl<'a> Canvas<'a> {
    fn new(view: &'a View, longest: usize) -> Self {
        let scale = longest as f64 / (2.0 * view.half[0].max(view.half[1]));
        let size = view.half.map(|half| SAMPLES * ((2.0 * half * scale).round() as usize).max(1));
        let count = size[0] * size[1];
        let depth = vec![f32::NEG_INFINITY; count];
        Canvas { view, size, scale: SAMPLES as f64 * scale, depth, colour: vec![[1.0; 3]; count] }
    }

    /// Projects a point: samples from the left and from the top, and height towards the viewer, m.
    fn project(&self, point: DVec3) -> DVec3 {
        let [right, up, towards] = self.view.axes;
        let from = point - self.view.centre;
        let middle = self.size.map(|samples| samples as f64 / 2.0);
        let (x, y) = (self.scale * from.dot(right), self.scale * from.dot(up));
        DVec3::new(middle[0] + x, middle[1] - y, from.dot(towards))
    }

    fn add(&mut self, face: &Face) {
        let p = face.corners.map(|corner| self.project(corner));
        // Twice the signed area; y runs down, so that faces towards the viewer have a negative area.
        let cross = |a: DVec3, b: DVec3, x: f64, y: f64| (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
        let area = cross(p[0], p[1], p[2].x, p[2].y);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let lengths = [0, 1, 2].map(|k| (p[(k + 2) % 3] - p[(k + 1) % 3]).truncate().length());
        let span = |axis: usize| {
            let last = self.size[axis] as f64 - 1.0;
            let (low, high) = p.iter().fold((last, 0.0), |(l, h): (f64, f64), q| (l.min(q[axis]), h.max(q[axis])));
            (low.floor().max(0.0) as usize, high.ceil().min(last) as usize)
        };
        let ((x0, x1), (y0, y1)) = (span(0), span(1));
        for row in y0..=y1 {
            for column in x0..=x1 {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let w = [0, 1, 2].map(|k| cross(p[(k + 1) % 3], p[(k + 2) % 3], x, y) / area);
                if w.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let height = (w[0] * p[0].z + w[1] * p[1].z + w[2] * p[2].z) as f32;
                let at = row * self.size[0] + column;
                if height > self.depth[at] {
                    let inward = [0, 1, 2].map(|k| w[k] * area.abs() / lengths[k]);
                    let is_edge = face.has_edges && inward.iter().any(|&d| d < EDGE);
                    self.depth[at] = height;
                    self.colour[at] = self.shade(face, w, is_edge);
                }
            }
        }
    }

    /// Colour of a face at barycentric weights `w`, lit from the upper left, weakly from the right, and by the sky;
    /// both sides of a face look alike.
    fn shade(&self, face: &Face, w: [f64; 3], is_edge: bool) -> [f32; 3] {
        let [right, up, towards] = self.view.axes;
        let normal = (0..3).map(|k| face.normals[k] * w[k]).sum::<DVec3>().normalize_or_zero();
        let normal = if normal.dot(towards) < 0.0 { -normal } else { normal };
        let key = (towards * 0.75 + up * 0.55 - right * 0.5).normalize_or_zero();
        let fill = (towards * 0.5 + right).normalize_or_zero();
        let sky = 0.5 + 0.5 * normal.dot(up);
        let light = 0.12 + 0.10 * sky + 0.72 * normal.dot(key).max(0.0) + 0.16 * normal.dot(fill).max(0.0);
        let half = (key + towards).normalize_or_zero();
        let shine = 0.06 * normal.dot(half).max(0.0).powi(24);
        let edge = if is_edge { EDGE_SHADE } else { 1.0 };
        face.colour.map(|c| (edge * (c * light + shine)) as f32)
    }

    /// Darkens samples that lie behind their neighbours, so that folds and outlines show (after C. Boucheny 2009,
    /// eye-dome lighting).
    fn relief(&mut self) {
        let [columns, rows] = self.size.map(|samples| samples as i64);
        let width = 2.0 * self.view.half[0].max(self.view.half[1]);
        for row in 0..rows {
            for column in 0..columns {
                let at = (row * columns + column) as usize;
                if self.depth[at] == f32::NEG_INFINITY {
                    continue;
                }
                let mut step = 0.0;
                for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)] {
                    let (x, y) = (column + RELIEF_REACH * dx, row + RELIEF_REACH * dy);
                    if (0..columns).contains(&x) && (0..rows).contains(&y) {
                        let other = self.depth[(y * columns + x) as usize];
                        step += f64::from((other - self.depth[at]).max(0.0)).min(0.05 * width);
                    }
                }
                let shade = 1.0 / (1.0 + RELIEF * step / width);
                self.colour[at] = self.colour[at].map(|c| c * shade as f32);
            }
        }
    }

    /// The mean of each pixel's samples, as sRGB.
    fn finish(self) -> Picture {
        let [width, height] = self.size.map(|samples| samples / SAMPLES);
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                let mut sum = [0.0; 3];
                for sample in 0..SAMPLES * SAMPLES {
                    let (x, y) = (column * SAMPLES + sample % SAMPLES, row * SAMPLES + sample / SAMPLES);
                    let colour = self.colour[y * self.size[0] + x];
                    (0..3).for_each(|k| sum[k] += f64::from(colour[k]));
                }
                pixels.push(sum.map(|total| srgb(total / (SAMPLES * SAMPLES) as f64)));
            }
        }
        Picture { width, height, pixels }
    }
}

/// Encodes a linear value by its square root (gamma 2). The square root is close to the curve of sRGB and, unlike that
/// curve, is rounded alike on every machine.
fn srgb(linear: f64) -> u8 {
    (255.0 * linear.clamp(0.0, 1.0).sqrt()).round() as u8
}

impl Picture {
    /// Joins images side by side, from the left.
    pub fn beside(pictures: &[&Picture]) -> Picture {
        let height = pictures.iter().map(|p| p.height).max().unwrap_or(0);
        let width = pictures.iter().map(|p| p.width).sum();
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            for picture in pictures {
                let line = picture.pixels.chunks(picture.width.max(1)).nth(row);
                match line {
                    Some(line) => pixels.extend_from_slice(line),
                    None => pixels.extend(std::iter::repeat_n([255; 3], picture.width)),
                }
            }
        }
        Picture { width, height, pixels }
    }

    /// Writes the image as a PNG file.
    pub fn write_png(&self, w: &mut impl Write) -> std::io::Result<()> {
        let mut encoder = png::Encoder::new(w, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish().map_err(Into::into)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE: [u8; 3] = [255; 3];

    fn square(z: f64, half: f64, colour: Colour) -> [Face; 2] {
        let corner = |x: f64, y: f64| DVec3::new(x * half, y * half, z);
        let (a, b, c, d) = (corner(-1., -1.), corner(1., -1.), corner(1., 1.), corner(-1., 1.));
        [Face::flat([a, b, c], colour, false), Face::flat([a, c, d], colour, false)]
    }

    fn front(faces: &[Face], side: usize) -> Picture {
        let view = View::of(faces.iter().flat_map(|f| f.corners), DVec3::Z, DVec3::Y);
        draw(faces, &view, side)
    }

    #[test]
    fn the_nearer_face_is_seen_whatever_the_order() {
        let (near, far) = (square(1.0, 0.5, [1.0, 0.0, 0.0]), square(0.0, 1.0, [0.0, 0.0, 1.0]));
        let forth = front(&[near.clone(), far.clone()].concat(), 40);
        let back = front(&[far, near].concat(), 40);
        assert_eq!(forth, back);
        let at = |x: usize, y: usize| forth.pixels[y * 40 + x];
        assert!(at(20, 20)[0] > 2 * at(20, 20)[2] && at(5, 20)[2] > 2 * at(5, 20)[0]);
        assert_eq!((at(0, 0), at(39, 39)), (WHITE, WHITE));
    }

    #[test]
    fn up_is_up_and_right_is_right() {
        let mut faces = square(0.0, 1.0, [0.0, 0.0, 1.0]).to_vec();
        let mark = |x: f64, y: f64| DVec3::new(x, y, 0.5);
        faces.push(Face::flat([mark(0.2, 0.9), mark(0.9, 0.2), mark(0.9, 0.9)], [1.0, 0.0, 0.0], false));
        let picture = front(&faces, 50);
        let red = |x: usize, y: usize| picture.pixels[y * 50 + x][0] > picture.pixels[y * 50 + x][2];
        assert!(red(40, 9) && !red(9, 9) && !red(40, 40) && !red(9, 40));
    }

    #[test]
    fn a_slanted_outline_is_smooth() {
        let corners = [DVec3::ZERO, DVec3::new(1.0, 0.3, 0.0), DVec3::new(0.2, 1.0, 0.0)];
        let picture = front(&[Face::flat(corners, [0.0; 3], false)], 30);
        let levels: std::collections::BTreeSet<u8> = picture.pixels.iter().map(|p| p[0]).collect();
        assert!(levels.len() >= 8, "at least 8 grey levels are expected: {levels:?}");
    }

    #[test]
    fn a_png_comes_back() {
        let picture = front(&square(0.0, 1.0, [0.2, 0.6, 0.4]), 20);
        let both = Picture::beside(&[&picture, &picture]);
        assert_eq!((both.width, both.height, both.pixels[25]), (40, 20, picture.pixels[5]));
        let mut bytes = Vec::new();
        both.write_png(&mut bytes).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, both.pixels.as_flattened());
    }

    #[test]
    fn nothing_and_flat_things_are_drawn_without_harm() {
        assert!(front(&[], 5).pixels.iter().all(|&p| p == WHITE));
        let line = Face::flat([DVec3::ZERO, DVec3::X, DVec3::X], [0.0; 3], true);
        let picture = front(&[line], 50);
        assert_eq!((picture.width, picture.pixels.len()), (50, 50 * picture.height));
        assert!(picture.height < 10 && picture.pixels.iter().all(|&p| p == WHITE));
    }
}
