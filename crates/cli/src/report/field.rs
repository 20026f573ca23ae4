//! The image of a query (search for the overlap of two undeformed bodies, a and b): both bodies from the side, and a
//! map of their penetration depth along the contact normal, with a legend.
//!
//! The map is computed from the surfaces themselves and not from the contacts, so that it shows independently where
//! contacts must be. Each pixel has a line parallel to the normal; the depth at the pixel is the length of the longest
//! part of this line that lies within both bodies.

use glam::DVec3;
use palpate::QueryContact;

use super::letters;
use super::picture::{Face, Picture, View, draw};

/// Side of each of the two images, pixels.
const SIDE: usize = 600;
/// Width of the legend, pixels.
const LEGEND: usize = 190;
/// Side of a dot of a letter, pixels.
const DOT: usize = 2;
/// Half side of the map, as a multiple of the half extent of the contacts.
const ROOM: f64 = 1.25;
/// Least half side of the map, as a multiple of the greatest depth; it matters where contacts are few.
const LEAST_ROOM: f64 = 2.0;
/// Greatest number of times that the map is doubled in size because the overlap reaches its rim.
const DOUBLINGS: usize = 5;
/// Contacts belong to the same contact patch (place with one contact normal) if the cosine between their normals is
/// greater than this value.
const SAME_NORMAL: f64 = 0.999;
const A: [f64; 3] = [0.80, 0.52, 0.36];
const B: [f64; 3] = [0.36, 0.55, 0.74];
const WHITE: [u8; 3] = [255; 3];
const INK: [u8; 3] = [30; 3];

/// A placed surface.
pub struct Solid {
    /// World positions of the vertices, m.
    pub vertices: Vec<DVec3>,
    /// Three vertices per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Solid {
    fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + Clone {
        self.triangles.iter().map(|t| t.map(|v| self.vertices[v as usize]))
    }
}

/// Image of bodies a and b from the side, with a on the left; beside this image the depth map of the contact patch with
/// the deepest contact, seen from the side to which the patch's normal points, so that a lies behind b. If there is no
/// contact, the image shows only the bodies.
pub fn picture(solids: [&Solid; 2], contacts: &[QueryContact]) -> Picture {
    let deepest = contacts.iter().max_by(|x, y| x.depth.total_cmp(&y.depth));
    let normal = deepest.map_or(DVec3::X, |contact| contact.normal);
    let side = square(bodies(solids, normal));
    let Some(deepest) = deepest else { return side };
    let region: Vec<&QueryContact> = contacts.iter().filter(|c| c.normal.dot(normal) > SAME_NORMAL).collect();
    let field = Field::around(solids, &region, deepest);
    Picture::beside(&[&side, &field.picture(solids, &region), &field.legend()])
}

fn bodies(solids: [&Solid; 2], right: DVec3) -> Picture {
    let towards = (DVec3::new(0.3, 0.35, 1.0) - right * DVec3::new(0.3, 0.35, 1.0).dot(right)).normalize_or(DVec3::Y);
    let points = solids[0].corners().chain(solids[1].corners()).flatten();
    let view = View::of(points, towards, towards.cross(right));
    let faces = |k: usize| solids[k].corners().map(move |corners| Face::flat(corners, [A, B][k], false));
    draw(&faces(0).chain(faces(1)).collect::<Vec<_>>(), &view, SIDE)
}

/// Puts an image in the middle of a white square.
fn square(picture: Picture) -> Picture {
    let (left, top) = (SIDE.saturating_sub(picture.width) / 2, SIDE.saturating_sub(picture.height) / 2);
    let mut canvas = blank(SIDE, SIDE);
    for (row, line) in picture.pixels.chunks(picture.width.max(1)).enumerate() {
        let at = (row + top) * SIDE + left;
        canvas.pixels[at..at + line.len()].copy_from_slice(line);
    }
    canvas
}

fn blank(width: usize, height: usize) -> Picture {
    Picture { width, height, pixels: vec![WHITE; width * height] }
}

/// Map of penetration depth along a normal.
struct Field {
    /// Unit vectors to the right, up, and towards the viewer; the last is the normal.
    axes: [DVec3; 3],
    middle: DVec3,
    /// Half side of the map, m.
    half: f64,
    /// Depth of each pixel, m, rows from the top; 0 without overlap.
    depth: Vec<f64>,
    /// For each pixel, whether body a covers it and whether body b covers it.
    covered: Vec<[bool; 2]>,
}

/// A point at which a pixel's line meets a surface.
struct RayHit {
    pixel: u32,
    body: u8,
    height: f64,
    enters: bool,
}

impl Field {
    /// A map around contacts, large enough to hold the whole overlap.
    fn around(solids: [&Solid; 2], contacts: &[&QueryContact], deepest: &QueryContact) -> Field {
        let normal = deepest.normal;
        let up = if normal.y.abs() < 0.9 { DVec3::Y } else { DVec3::Z };
        let right = up.cross(normal).normalize_or(DVec3::X);
        let axes = [right, normal.cross(right), normal];
        let place = |contact: &QueryContact| solids[contact.body].vertices[contact.vertex as usize];
        let points: Vec<DVec3> = contacts.iter().map(|contact| place(contact)).collect();
        let span = |axis: DVec3| {
            let along = points.iter().map(|p| p.dot(axis));
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        };
        let spans = axes.map(span);
        let middle: DVec3 = (0..3).map(|k| axes[k] * (0.5 * (spans[k].0 + spans[k].1))).sum();
        let reach = (0..2).map(|k| 0.5 * (spans[k].1 - spans[k].0)).fold(0.0, f64::max);
        let half = (ROOM * reach).max(LEAST_ROOM * deepest.depth);
        let mut field = Field { axes, middle, half, depth: Vec::new(), covered: Vec::new() };
        field.fill(solids);
        for _ in 0..DOUBLINGS {
            let rim = |at: usize| [0, SIDE - 1].contains(&(at % SIDE)) || [0, SIDE - 1].contains(&(at / SIDE));
            if !field.depth.iter().enumerate().any(|(at, depth)| *depth > 0.0 && rim(at)) {
                break;
            }
            field.half *= 2.0;
            field.fill(solids);
        }
        field
    }

    /// Projects a point: pixels from the left and from the top, and height along the normal, m.
    fn project(&self, x: DVec3) -> DVec3 {
        let from = x - self.middle;
        let scale = SIDE as f64 / (2.0 * self.half);
        let middle = 0.5 * SIDE as f64;
        // A small offset keeps the pixels' lines off the edges of boxes that are aligned with the axes.
        let (right, up) = (scale * from.dot(self.axes[0]) + 0.137, scale * from.dot(self.axes[1]) + 0.071);
        DVec3::new(middle + right, middle - up, from.dot(self.axes[2]))
    }

    fn fill(&mut self, solids: [&Solid; 2]) {
        let mut ray_hits = Vec::new();
        for (body, solid) in solids.into_iter().enumerate() {
            solid.corners().for_each(|corners| self.cross(body as u8, corners, &mut ray_hits));
        }
        ray_hits.sort_by(|x, y| x.pixel.cmp(&y.pixel).then(x.height.total_cmp(&y.height)));
        self.depth = vec![0.0; SIDE * SIDE];
        self.covered = vec![[false; 2]; SIDE * SIDE];
        for line in ray_hits.chunk_by(|x, y| x.pixel == y.pixel) {
            let at = line[0].pixel as usize;
            let (mut inside, mut since) = ([0_i32; 2], 0.0);
            for ray_hit in line {
                self.covered[at][ray_hit.body as usize] = true;
                let was_in_both = inside.iter().all(|n| *n > 0);
                inside[ray_hit.body as usize] += if ray_hit.enters { 1 } else { -1 };
                match (was_in_both, inside.iter().all(|n| *n > 0)) {
                    (false, true) => since = ray_hit.height,
                    (true, false) => self.depth[at] = self.depth[at].max(ray_hit.height - since),
                    _ => {}
                }
            }
        }
    }

    /// Adds the points at which the pixels' lines meet a triangle.
    fn cross(&self, body: u8, corners: [DVec3; 3], ray_hits: &mut Vec<RayHit>) {
        let p = corners.map(|x| self.project(x));
        let edge = |a: DVec3, b: DVec3, x: f64, y: f64| (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
        let area = edge(p[0], p[1], p[2].x, p[2].y);
        let low = p[0].min(p[1]).min(p[2]);
        let high = p[0].max(p[1]).max(p[2]);
        if area == 0.0 || high.x < 0.0 || high.y < 0.0 || low.x > SIDE as f64 || low.y > SIDE as f64 {
            return;
        }
        let range = |low: f64, high: f64| {
            (low - 0.5).ceil().max(0.0) as usize..((high - 0.5).floor().min(SIDE as f64 - 1.0) + 1.0).max(0.0) as usize
        };
        for row in range(low.y, high.y) {
            for column in range(low.x, high.x) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let w = [0, 1, 2].map(|k| edge(p[(k + 1) % 3], p[(k + 2) % 3], x, y) / area);
                if w.iter().all(|w| *w >= 0.0) {
                    let height = w[0] * p[0].z + w[1] * p[1].z + w[2] * p[2].z;
                    // Rows run down, so that a face towards the viewer has a negative area; through such a face the
                    // line, which runs towards the viewer, leaves the body.
                    ray_hits.push(RayHit { pixel: (row * SIDE + column) as u32, body, height, enters: area > 0.0 });
                }
            }
        }
    }

    fn greatest(&self) -> f64 {
        self.depth.iter().copied().fold(0.0, f64::max)
    }

    /// Image of the map: depths in colour, the bodies beyond their overlap in pale colours; colliding vertices of a as
    /// white dots, colliding vertices of b as black dots.
    fn picture(&self, solids: [&Solid; 2], contacts: &[&QueryContact]) -> Picture {
        let mut picture = blank(SIDE, SIDE);
        let greatest = self.greatest().max(f64::MIN_POSITIVE);
        for (pixel, (depth, covered)) in picture.pixels.iter_mut().zip(self.depth.iter().zip(&self.covered)) {
            *pixel = match (*depth > 0.0, covered) {
                (true, _) => viridis(depth / greatest),
                (false, [true, true]) => [200; 3],
                (false, [true, false]) => [235, 215, 203],
                (false, [false, true]) => [205, 219, 235],
                (false, [false, false]) => WHITE,
            };
        }
        for contact in contacts {
            let at = self.project(solids[contact.body].vertices[contact.vertex as usize]);
            dot(&mut picture, at.x, at.y, contact.body == 0);
        }
        picture
    }

    /// Image of the legend: colours with their depths, the two kinds of dots, and a scale bar.
    fn legend(&self) -> Picture {
        let mut picture = blank(LEGEND, SIDE);
        let (greatest, top, height) = (self.greatest(), 60, 360);
        let (unit, factor) = unit_of(greatest);
        write(&mut picture, 20, 24, &format!("depth {unit}"));
        for row in 0..height {
            let colour = viridis(1.0 - row as f64 / (height - 1) as f64);
            (20..50).for_each(|column| picture.pixels[(top + row) * LEGEND + column] = colour);
        }
        for tick in 0..=4 {
            let share = f64::from(tick) / 4.0;
            let row = top + ((1.0 - share) * (height - 1) as f64).round() as usize;
            (50..56).for_each(|column| picture.pixels[row * LEGEND + column] = INK);
            write(&mut picture, 62, row - letters::HEIGHT, &short(share * greatest * factor));
        }
        for (row, name, is_a) in [(460, "vertices of A", true), (490, "vertices of B", false)] {
            dot(&mut picture, 12.0, row as f64 + 7.0, is_a);
            write(&mut picture, 26, row, name);
        }
        // The scale bar shows a round length and is at most a hundred pixels long.
        let pixel = 2.0 * self.half / SIDE as f64;
        let decade = 10f64.powf((100.0 * pixel).log10().floor());
        let length = [5.0, 2.0, 1.0].map(|k| k * decade).into_iter().find(|l| *l <= 100.0 * pixel).unwrap_or(decade);
        let (unit, factor) = unit_of(length);
        (0..4 * LEGEND).filter(|k| ((k % LEGEND) as f64) < length / pixel).for_each(|k| {
            let (row, column) = (530 + k / LEGEND, 20 + k % LEGEND);
            picture.pixels[row * LEGEND + column.min(LEGEND - 1)] = INK;
        });
        write(&mut picture, 20, 544, &format!("{} {unit}", short(length * factor)));
        picture
    }
}

/// A unit in which a length is between one and a thousand, and the number of these units in a metre.
fn unit_of(length: f64) -> (&'static str, f64) {
    match length {
        l if l >= 1e3 => ("km", 1e-3),
        l if l >= 1.0 => ("m", 1.0),
        l if l >= 1e-3 => ("mm", 1e3),
        l if l >= 1e-6 => ("um", 1e6),
        _ => ("nm", 1e9),
    }
}

/// A number with three digits, as text.
fn short(number: f64) -> String {
    let decimals = match number {
        n if n == 0.0 || n >= 99.95 => 0,
        n if n >= 9.995 => 1,
        _ => 2,
    };
    format!("{number:.decimals$}")
}

fn write(picture: &mut Picture, left: usize, top: usize, text: &str) {
    for (column, row) in letters::dots(text) {
        for k in 0..DOT * DOT {
            let (x, y) = (left + DOT * column + k % DOT, top + DOT * row + k / DOT);
            if x < picture.width && y < picture.height {
                picture.pixels[y * picture.width + x] = INK;
            }
        }
    }
}

/// Draws a white dot with a dark rim, or a dark dot with a white rim.
fn dot(picture: &mut Picture, x: f64, y: f64, is_white: bool) {
    let (inner, rim) = if is_white { (WHITE, INK) } else { (INK, WHITE) };
    for (row, column) in (-3..=3).flat_map(|row| (-3..=3).map(move |column| (row, column))) {
        let distance2 = row * row + column * column;
        let (at_x, at_y) = (x.floor() as i64 + column, y.floor() as i64 + row);
        let is_inside = at_x >= 0 && at_y >= 0 && at_x < picture.width as i64 && at_y < picture.height as i64;
        if distance2 <= 8 && is_inside {
            picture.pixels[at_y as usize * picture.width + at_x as usize] = if distance2 <= 3 { inner } else { rim };
        }
    }
}

/// The colour map viridis (S. van der Walt and N. Smith 2015), perceptually uniform from dark to light, interpolated
/// between nine of its colours.
fn viridis(share: f64) -> [u8; 3] {
    const COLOURS: [[u8; 3]; 9] = [
        [68, 1, 84],
        [71, 44, 122],
        [59, 81, 139],
        [44, 113, 142],
        [33, 144, 141],
        [39, 173, 129],
        [92, 200, 99],
        [170, 220, 50],
        [253, 231, 37],
    ];
    let at = share.clamp(0.0, 1.0) * 8.0;
    let (k, t) = ((at as usize).min(7), at - (at as usize).min(7) as f64);
    std::array::from_fn(|c| (f64::from(COLOURS[k][c]) * (1.0 - t) + f64::from(COLOURS[k + 1][c]) * t).round() as u8)
}

#[cfg(test)]
mod tests {
    use palpate::internal::prepare::layer;

    use super::*;

    fn cube(low: DVec3, high: DVec3) -> Solid {
        let (vertices, triangles, _) = layer::boundary(&layer::kuhn_box(low, high, [1, 1, 1]));
        Solid { vertices, triangles }
    }

    #[test]
    fn the_field_of_two_boxes_is_their_overlap() {
        // The upper box is smaller, 0.6 m across, and overlaps the lower one by 0.1 m.
        let (a, b) = (cube(DVec3::ZERO, DVec3::ONE), cube(DVec3::new(0.2, 0.2, 0.9), DVec3::new(0.8, 0.8, 1.5)));
        let below = (0..b.vertices.len() as u32).filter(|v| b.vertices[*v as usize].z < 1.0);
        let contact = |vertex| QueryContact {
            body: 1,
            vertex,
            depth: 0.1,
            normal: DVec3::Z,
            triangle: 0,
            barycentric: [1.0, 0.0, 0.0],
            area: 0.1,
        };
        let contacts: Vec<QueryContact> = below.map(contact).collect();
        assert_eq!(contacts.len(), 4);
        let field = Field::around([&a, &b], &contacts.iter().collect::<Vec<_>>(), &contacts[0]);
        assert!((field.greatest() - 0.1).abs() < 1e-12);
        let pixel = 2.0 * field.half / SIDE as f64;
        let area = field.depth.iter().filter(|d| (**d - 0.1).abs() < 1e-9).count() as f64 * pixel * pixel;
        let any = field.depth.iter().filter(|d| **d > 0.0).count() as f64 * pixel * pixel;
        assert!(
            (area - 0.36).abs() < 0.01 && area == any,
            "area at full depth {area} m^2, area of any overlap {any} m^2; both must be 0.36"
        );
        let picture = picture([&a, &b], &contacts);
        assert_eq!((picture.width, picture.height), (2 * SIDE + LEGEND, SIDE));
        assert_eq!(super::picture([&a, &b], &[]).width, SIDE);
    }

    #[test]
    fn units_keep_numbers_short() {
        for (length, text) in [(2.5e-3, "2.50 mm"), (0.0999, "99.9 mm"), (120.0, "120 m"), (3e-7, "300 nm")] {
            let (unit, factor) = unit_of(length);
            assert_eq!(format!("{} {unit}", short(length * factor)), text);
        }
    }
}
