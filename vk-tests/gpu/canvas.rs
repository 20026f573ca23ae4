//! Tests of the drawing part of the Vulkan module (`palpate::internal::gpu`), whose render target (a colour image, a
//! depth image or both) is called a canvas:
//! which pixels a triangle covers, the depth test, blending, face culling, drawing onto a part of the canvas, index
//! buffers and instances, multisampling, kept and cleared contents, and refused drawings.

use bytemuck::{Pod, Zeroable};
use glam::DVec2;
use palpate::internal::gpu::{
    Before, Buffer, Canvas, Drawn, Image, Memory, Named, Onto, RasterPipeline, Recorder, Side, Texels, shader_names,
};
use palpate::internal::shaders::test::DrawFlat;

use crate::harness::random::Random;
use crate::harness::{assert_clean, context, turn};

/// Width and height of the images, pixels; not a square, so that exchanged rows and columns would show.
const SIZE: [u32; 2] = [40, 24];
/// Distance from an edge, pixels, within which a pixel's centre may count as either inside or outside: the rasterizer
/// rounds corners to 1/16 of a pixel at worst.
const NEAR_EDGE: f64 = 0.15;
/// Tolerance of a colour channel (0 to 1) that is drawn once: the image stores the channel in a byte.
const BYTE: f64 = 1.01 / 255.0;
/// Tolerance of a depth (0 to 1) in the depth image, which is an f32 interpolated over the triangle.
const DEPTH: f64 = 1e-6;
const WHITE: [f32; 4] = [1.0; 4];
const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];
const BLUE: [f32; 4] = [0.0, 0.0, 1.0, 1.0];
const GREY: [f32; 4] = [0.2, 0.4, 0.6, 0.8];
/// Drawing without depth test, blending and face culling: a later triangle replaces an earlier one.
pub const PLAIN: Onto =
    Onto { has_colour: true, has_depth: false, hides: false, blends: false, culls: None, samples: 1 };
/// Drawing with depth test and depth writes: nearer triangles hide farther ones.
const HIDING: Onto = Onto { has_depth: true, hides: true, ..PLAIN };

#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Corner {
    place: [f32; 4],
    colour: [f32; 4],
}

/// A canvas to draw onto, and the host-readable arrays that its pixels are copied to.
pub struct Sheet {
    pub canvas: Canvas,
    colour: Buffer,
    depth: Buffer,
}

impl Sheet {
    pub fn new(size: [u32; 2], samples: u32) -> Sheet {
        let image = |name, texels, samples| Some(Image::new(context(), name, texels, size, samples).unwrap());
        let mean = if samples > 1 { image("mean", Texels::Colour, 1) } else { None };
        let canvas = Canvas {
            colour: image("colour", Texels::Colour, samples),
            depth: image("depth", Texels::Depth, samples),
            mean,
        };
        let bytes = 4 * u64::from(size[0]) * u64::from(size[1]);
        let array = |name| Buffer::new(context(), name, bytes, Memory::Readback).unwrap();
        Sheet { canvas, colour: array("colours"), depth: array("depths") }
    }

    /// Draws all of `all` onto the canvas, and returns the colour (channels 0 to 1) and the depth of each pixel. The
    /// depth of a multisampled canvas is not copied back.
    pub fn draw(&self, before: Before, all: &[Drawn]) -> (Vec<[f64; 4]>, Vec<f32>) {
        let seen = self.canvas.mean.as_ref().or(self.canvas.colour.as_ref()).unwrap();
        let mut recorder = Recorder::untimed(context()).unwrap();
        recorder.stage("drawing");
        recorder.paint(&self.canvas, before, all);
        recorder.copy_out(seen, &self.colour);
        if let (None, Some(depth)) = (&self.canvas.mean, &self.canvas.depth) {
            recorder.copy_out(depth, &self.depth);
        }
        recorder.finish().unwrap().submit_and_wait().unwrap();
        assert_clean(context(), "drawing");
        let colours = self.colour.read::<[u8; 4]>().unwrap();
        (colours.iter().map(|c| c.map(|byte| f64::from(byte) / 255.0)).collect(), self.depth.read().unwrap())
    }
}

/// The clip-space coordinates of a position given in pixels.
fn clip(pixel: DVec2) -> [f32; 2] {
    [(2.0 * pixel.x / f64::from(SIZE[0]) - 1.0) as f32, (2.0 * pixel.y / f64::from(SIZE[1]) - 1.0) as f32]
}

/// A triangle of one colour at one depth; corners in pixels.
fn triangle(corners: [DVec2; 3], depth: f32, colour: [f32; 4]) -> Vec<Corner> {
    corners.map(|x| Corner { place: [clip(x)[0], clip(x)[1], depth, 1.0], colour }).to_vec()
}

/// A rectangle of two triangles that face the viewer, given by its left, top, right and bottom edges in pixels.
fn rectangle([left, top, right, bottom]: [f64; 4], depth: f32, colour: [f32; 4]) -> Vec<Corner> {
    let [a, b, c, d] = [[left, top], [left, bottom], [right, bottom], [right, top]].map(DVec2::from);
    [triangle([a, b, c], depth, colour), triangle([a, c, d], depth, colour)].concat()
}

fn array(corners: &[Corner]) -> Buffer {
    Buffer::from_slice(context(), "corners", corners, Memory::Device).unwrap()
}

fn flat(onto: &Onto) -> RasterPipeline {
    RasterPipeline::onto(context(), "test/flat", &[], onto).unwrap()
}

fn flat_of(corners: &Buffer) -> DrawFlat<'_> {
    DrawFlat { aside: 0.0, corners }
}

/// A draw of one instance of the triangles that the first `count` corners of the array form.
fn drawn<'a>(pipeline: &'a RasterPipeline, arguments: &'a DrawFlat<'a>, count: u32) -> Drawn<'a> {
    Drawn { pipeline, arguments, indices: None, range: (0, count), instances: 1, part: None }
}

/// Draws the triangles with these corners on a canvas with one sample per pixel that is cleared to the colour `ground`;
/// returns the colours and depths of the pixels.
fn painted(onto: &Onto, ground: [f32; 4], corners: &[Corner]) -> (Vec<[f64; 4]>, Vec<f32>) {
    let (pipeline, corners_there) = (flat(onto), array(corners));
    let mut sheet = Sheet::new(SIZE, 1);
    sheet.canvas.depth = sheet.canvas.depth.filter(|_| onto.has_depth);
    sheet.draw(Before::Cleared(ground), &[drawn(&pipeline, &flat_of(&corners_there), corners.len() as u32)])
}

/// Centres of the pixels of an image with this width and height, row by row, in pixels.
pub fn centres(size: [u32; 2]) -> impl Iterator<Item = DVec2> {
    (0..size[1]).flat_map(move |y| (0..size[0]).map(move |x| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)))
}

/// Signed distances of the point `x` from the three edges of a triangle, pixels; all three have the same sign where `x`
/// is inside.
fn edges([a, b, c]: [DVec2; 3], x: DVec2) -> [f64; 3] {
    [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).perp_dot(x - from) / from.distance(to))
}

/// True if `x` is inside the triangle; `None` if it lies within `near` pixels of an edge.
fn inside(corners: [DVec2; 3], x: DVec2, near: f64) -> Option<bool> {
    let d = edges(corners, x);
    let turned = if (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]) < 0.0 { -1.0 } else { 1.0 };
    let least = d.iter().map(|d| turned * d).fold(f64::INFINITY, f64::min);
    (least.abs() > near).then_some(least > 0.0)
}

pub fn expect_colour(what: &str, got: [f64; 4], want: [f64; 4], tolerance: f64) {
    let error = (0..4).map(|k| (got[k] - want[k]).abs()).fold(0.0, f64::max);
    assert!(error <= tolerance, "{what}: colour {got:?}, expected {want:?}");
}

fn wide(colour: [f32; 4]) -> [f64; 4] {
    colour.map(f64::from)
}

fn at(x: u32, y: u32) -> usize {
    (y * SIZE[0] + x) as usize
}

#[test]
fn a_triangle_covers_the_pixels_whose_centres_are_inside() {
    turn();
    let mut random = Random(11);
    let mut said = 0;
    for case in 0..40 {
        // Some triangles reach beyond the image.
        let corner = |random: &mut Random| {
            let mut side = |k: usize| (0.8 * random.next() + 0.5) * f64::from(SIZE[k]);
            DVec2::new(side(0), side(1))
        };
        let corners = [corner(&mut random), corner(&mut random), corner(&mut random)];
        let depth = (0.5 + 0.4 * random.next()) as f32;
        let (colours, depths) = painted(&HIDING, GREY, &triangle(corners, depth, RED));
        for (pixel, x) in centres(SIZE).enumerate() {
            let Some(is_inside) = inside(corners, x, NEAR_EDGE) else { continue };
            let (want, far) = if is_inside { (RED, f64::from(depth)) } else { (GREY, 1.0) };
            expect_colour(&format!("case {case} at {x}"), colours[pixel], wide(want), BYTE);
            assert!((f64::from(depths[pixel]) - far).abs() < DEPTH, "case {case} at {x}: depth {}", depths[pixel]);
            said += 1;
        }
    }
    assert!(said > 35 * 40 * 24, "only {said} pixels were far enough from edges; more than 33600 are expected");
}

#[test]
fn colours_and_depths_are_interpolated() {
    turn();
    let corners = [[-20.0, -20.0], [100.0, -10.0], [10.0, 70.0]].map(DVec2::from);
    let values = [[0.1, 0.9, 0.2, 0.4], [0.9, 0.1, 0.5, 0.8], [0.3, 0.5, 1.0, 0.6]];
    let depths = [0.2, 0.5, 0.8];
    let mut list = triangle(corners, 0.0, WHITE);
    for (k, corner) in list.iter_mut().enumerate() {
        (corner.colour, corner.place[2]) = (values[k], depths[k]);
    }
    let (got, far) = painted(&HIDING, GREY, &list);
    let area = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
    for (pixel, x) in centres(SIZE).enumerate() {
        let share =
            [0, 1, 2].map(|k| (corners[(k + 2) % 3] - corners[(k + 1) % 3]).perp_dot(x - corners[(k + 1) % 3]) / area);
        let mix = |of: &dyn Fn(usize) -> f32| (0..3).map(|k| share[k] * f64::from(of(k))).sum::<f64>();
        let want = [0, 1, 2, 3].map(|c| mix(&|k| values[k][c]));
        expect_colour(&format!("at {x}"), got[pixel], want, BYTE);
        assert!((f64::from(far[pixel]) - mix(&|k| depths[k])).abs() < 1e-4, "at {x}: wrong depth {}", far[pixel]);
    }
}

#[test]
fn nearer_hides_farther_whatever_the_order() {
    turn();
    let (near, far) = (rectangle([5., 5., 20., 20.], 0.3, RED), rectangle([10., 2., 35., 15.], 0.6, BLUE));
    let forth = painted(&HIDING, GREY, &[near.clone(), far.clone()].concat());
    assert_eq!(forth, painted(&HIDING, GREY, &[far.clone(), near.clone()].concat()));
    let (colours, depths) = forth;
    for (x, y, colour, depth) in [(12, 10, RED, 0.3), (30, 10, BLUE, 0.6), (6, 18, RED, 0.3), (38, 20, GREY, 1.0)] {
        expect_colour(&format!("pixel {x}, {y}"), colours[at(x, y)], wide(colour), BYTE);
        assert_eq!(depths[at(x, y)], depth);
    }
    // The rectangle drawn last is seen where the canvas has no depth image, and where drawing does not write to the
    // depth image (`hides: false`).
    let both = [near.clone(), far.clone()].concat();
    expect_colour("no depth image", painted(&PLAIN, GREY, &both).0[at(12, 10)], wide(BLUE), BYTE);
    let seen = painted(&Onto { hides: false, ..HIDING }, GREY, &both);
    expect_colour("hides: false", seen.0[at(12, 10)], wide(BLUE), BYTE);
    assert!(seen.1.iter().all(|depth| *depth == 1.0), "drawing with hides: false must not write depth");
    // Of two rectangles at the same depth, the one drawn later is seen.
    let level = [near, rectangle([5., 5., 20., 20.], 0.3, BLUE)].concat();
    expect_colour("equal depths", painted(&HIDING, GREY, &level).0[at(12, 10)], wide(BLUE), BYTE);
}

#[test]
fn colours_are_mixed_by_their_alpha() {
    turn();
    let blending = Onto { blends: true, ..PLAIN };
    let over = |below: [f64; 4], above: [f32; 4]| {
        [0, 1, 2, 3].map(|c| f64::from(above[c]) + (1.0 - f64::from(above[3])) * below[c])
    };
    let (a, b) = ([0.3, 0.1, 0.0, 0.4], [0.0, 0.2, 0.25, 0.25]);
    let both = [rectangle([0., 0., 30., 24.], 0.5, a), rectangle([10., 0., 40., 24.], 0.5, b)].concat();
    let (colours, _) = painted(&blending, GREY, &both);
    let ground = wide(GREY);
    for (x, want) in [(5, over(ground, a)), (20, over(over(ground, a), b)), (35, over(ground, b))] {
        // The colour is rounded to bytes once for each rectangle blended.
        expect_colour(&format!("column {x}"), colours[at(x, 12)], want, 2.0 * BYTE);
    }
    let (colours, _) = painted(&PLAIN, GREY, &both);
    expect_colour("no blending", colours[at(20, 12)], wide(b), BYTE);
}

#[test]
fn either_side_can_be_left_out() {
    turn();
    // The corners of this triangle go counter-clockwise in the image, so it faces the viewer.
    let facing = [[5.0, 2.0], [5.0, 20.0], [18.0, 20.0]].map(DVec2::from);
    assert!(
        (facing[1] - facing[0]).perp_dot(facing[2] - facing[0]) < 0.0,
        "y points down in the image, so the triangle's signed area must be negative"
    );
    let turned = [[25.0, 2.0], [38.0, 20.0], [25.0, 20.0]].map(DVec2::from);
    let both = [triangle(facing, 0.5, RED), triangle(turned, 0.5, BLUE)].concat();
    for (culls, want) in [(None, [RED, BLUE]), (Some(Side::Back), [RED, GREY]), (Some(Side::Front), [GREY, BLUE])] {
        let (colours, _) = painted(&Onto { culls, ..PLAIN }, GREY, &both);
        expect_colour(&format!("culls {culls:?}, front of a triangle"), colours[at(7, 17)], wide(want[0]), BYTE);
        expect_colour(&format!("culls {culls:?}, back of a triangle"), colours[at(27, 17)], wide(want[1]), BYTE);
    }
}

#[test]
fn a_part_of_the_canvas_is_drawn_onto() {
    turn();
    let corners = array(&rectangle([0., 0., 40., 24.], 0.5, RED));
    let (sheet, pipeline) = (Sheet::new(SIZE, 1), flat(&HIDING));
    let buffers = flat_of(&corners);
    for part in [[0, 0, 40, 24], [7, 3, 11, 9], [30, 20, 100, 100], [3, 3, 0, 5], [40, 24, 1, 1], [90, 0, 5, 5]] {
        let one = Drawn { part: Some(part), ..drawn(&pipeline, &buffers, 6) };
        let (colours, depths) = sheet.draw(Before::Cleared(GREY), &[one]);
        let [left, top, width, height] = part;
        for (pixel, x) in centres(SIZE).enumerate() {
            let (x, y) = (x.x as u32, x.y as u32);
            let is_in = (left..left + width).contains(&x) && (top..top + height).contains(&y);
            expect_colour(&format!("{part:?} at {x}, {y}"), colours[pixel], wide(if is_in { RED } else { GREY }), BYTE);
            assert_eq!(depths[pixel], if is_in { 0.5 } else { 1.0 });
        }
    }
}

#[test]
fn indices_vertices_and_instances_are_those_asked_for() {
    turn();
    let columns = [RED, BLUE, WHITE].iter().enumerate();
    let of =
        |(k, colour): (usize, &[f32; 4])| rectangle([10.0 * k as f64, 0., 10.0 * k as f64 + 10.0, 24.], 0.5, *colour);
    let corners = array(&columns.flat_map(of).collect::<Vec<_>>());
    let (sheet, pipeline) = (Sheet::new(SIZE, 1), flat(&HIDING));
    let buffers = flat_of(&corners);
    let expect = |what: &str, one: Drawn, want: [[f32; 4]; 4]| {
        let (colours, _) = sheet.draw(Before::Cleared(GREY), &[one]);
        (0..4).for_each(|k| {
            expect_colour(&format!("{what}: column {k}"), colours[at(10 * k + 5, 12)], wide(want[k as usize]), BYTE)
        });
    };
    expect("first six corners", drawn(&pipeline, &buffers, 6), [RED, GREY, GREY, GREY]);
    expect("corners from 6 on", Drawn { range: (6, 12), ..drawn(&pipeline, &buffers, 0) }, [GREY, BLUE, WHITE, GREY]);
    expect("no corners", drawn(&pipeline, &buffers, 0), [GREY; 4]);
    // The index buffer names the corners of the third column, then of the first one.
    let list: Vec<u32> = (12..18).chain(0..6).collect();
    let indices = Buffer::from_slice(context(), "indices", &list, Memory::Device).unwrap();
    let indexed = |range| Drawn { indices: Some(&indices), range, ..drawn(&pipeline, &buffers, 0) };
    expect("all indices", indexed((0, 12)), [RED, GREY, WHITE, GREY]);
    expect("six indices from 6 on", indexed((6, 6)), [RED, GREY, GREY, GREY]);
    expect("first six indices", indexed((0, 6)), [GREY, GREY, WHITE, GREY]);
    // Each instance lies one column (10 pixels) further to the right.
    let aside = DrawFlat { aside: 20.0 / SIZE[0] as f32, ..buffers };
    let repeated = Drawn { instances: 3, ..drawn(&pipeline, &aside, 6) };
    expect("three instances", repeated, [RED, RED, RED, GREY]);
}

#[test]
fn samples_are_resolved_to_their_mean() {
    turn();
    let mut random = Random(3);
    let (sheet, pipeline) = (Sheet::new(SIZE, 4), flat(&Onto { samples: 4, ..HIDING }));
    let mut between = 0;
    for case in 0..10 {
        let mut corner = || 0.5 * (1.0 + random.vector().truncate()) * DVec2::new(SIZE[0].into(), SIZE[1].into());
        let corners = [corner(), corner(), corner()];
        let there = array(&triangle(corners, 0.5, WHITE));
        let (colours, _) = sheet.draw(Before::Cleared([0.0; 4]), &[drawn(&pipeline, &flat_of(&there), 3)]);
        for (pixel, x) in centres(SIZE).enumerate() {
            let [got, ..] = colours[pixel];
            let quarters = 4.0 * got;
            assert!(
                (quarters - quarters.round()).abs() < 4.0 * BYTE,
                "case {case} at {x}: the mean of four samples is {got}, which is no multiple of 1/4"
            );
            // Where no edge comes nearer to the pixel's centre than half the pixel's diagonal, the four samples agree.
            match inside(corners, x, 0.5f64.sqrt() + NEAR_EDGE) {
                Some(is_inside) => {
                    assert!((got - f64::from(u8::from(is_inside))).abs() < BYTE, "case {case} at {x}: colour {got}")
                }
                None => between += u32::from((0.2..0.8).contains(&got)),
            }
        }
    }
    assert!(between > 100, "only {between} pixels at edges have a red channel of 0.2 to 0.8; more than 100 must");
}

#[test]
fn what_was_there_is_kept_or_cleared() {
    turn();
    let (left, right) =
        (array(&rectangle([0., 0., 20., 24.], 0.3, RED)), array(&rectangle([10., 0., 40., 24.], 0.6, BLUE)));
    for samples in [1, 4] {
        let (sheet, pipeline) = (Sheet::new(SIZE, samples), flat(&Onto { samples, ..HIDING }));
        let expect = |what: &str, before: Before, all: &[Drawn], want: [[f32; 4]; 3]| {
            let (colours, _) = sheet.draw(before, all);
            for (x, want) in [5, 15, 30].into_iter().zip(want) {
                expect_colour(&format!("{what}, {samples} samples, column {x}"), colours[at(x, 12)], wide(want), BYTE);
            }
        };
        let [left, right] = [&left, &right].map(flat_of);
        expect("cleared", Before::Cleared(GREY), &[drawn(&pipeline, &left, 6)], [RED, RED, GREY]);
        // The depth image is kept as well: the red rectangle is nearer and still hides the blue one.
        expect("drawn onto kept contents", Before::Kept, &[drawn(&pipeline, &right, 6)], [RED, RED, BLUE]);
        expect("nothing drawn onto kept contents", Before::Kept, &[], [RED, RED, BLUE]);
        expect("cleared, then drawn", Before::Cleared(WHITE), &[drawn(&pipeline, &right, 6)], [WHITE, BLUE, BLUE]);
    }
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    turn();
    let context = context();
    for size in [[0, 5], [5, 0], [1 << 30, 5], [5, u32::MAX]] {
        let error = Image::new(context, "image", Texels::Colour, size, 1).err().unwrap().to_string();
        assert!(error.contains(&format!("{} x {} pixels", size[0], size[1])), "wrong error: {error}");
    }
    let error = RasterPipeline::onto(context, "test/raster_cells", &[], &PLAIN).err().unwrap().to_string();
    assert!(error.contains("may not write raster_cells"), "wrong error: {error}");
    assert!(shader_names().any(|name| name == "test/flat.frag"));
    let corners = array(&rectangle([0., 0., 40., 24.], 0.5, RED));
    let indices = Buffer::from_slice(context, "indices", &[0u32; 6], Memory::Device).unwrap();
    let pipeline = flat(&HIDING);
    let buffers = flat_of(&corners);
    let sheet = Sheet::new(SIZE, 1);
    let fails = |act: &dyn Fn(&mut Recorder)| {
        let mut recorder = Recorder::untimed(context).unwrap();
        recorder.stage("wrong");
        act(&mut recorder);
        recorder.finish().map(|_| ()).unwrap_err().to_string()
    };
    let paint =
        |canvas: &Canvas, one: Drawn| fails(&|r| r.paint(canvas, Before::Cleared(GREY), std::slice::from_ref(&one)));
    let good = || drawn(&pipeline, &buffers, 6);
    for range in [(1, 6), (0, 7), (u32::MAX, u32::MAX)] {
        let error = paint(&sheet.canvas, Drawn { indices: Some(&indices), range, ..good() });
        assert!(error.contains("but array indices has 24 bytes"), "wrong error: {error}");
    }
    let depth = Some(Image::new(context, "small", Texels::Depth, [40, 23], 1).unwrap());
    let error = paint(&Canvas { depth, ..sheet.canvas.clone() }, good());
    assert!(error.contains("differ in size"), "wrong error: {error}");
    assert!(paint(&Canvas::default(), good()).contains("images of a canvas differ in size, or there are none"));
    let other = Named { shader: "test/flat", buffers: &[("corners", &corners)], push: &[] };
    assert!(paint(&sheet.canvas, Drawn { arguments: &other, ..good() }).contains("push constants"));
    let none = Named { shader: "test/flat", buffers: &[], push: &[0; 4] };
    assert!(paint(&sheet.canvas, Drawn { arguments: &none, ..good() }).contains("corners, which was left out"));
    let error = fails(&|r| r.copy_out(sheet.canvas.colour.as_ref().unwrap(), &corners));
    assert!(error.contains("image colour of 3840 bytes cannot be copied to array corners"), "wrong error: {error}");
    let several = Sheet::new(SIZE, 4);
    let error = fails(&|r| r.copy_out(several.canvas.colour.as_ref().unwrap(), &several.colour));
    assert!(error.contains("cannot be copied"), "wrong error: {error}");
    assert_clean(context, "refused drawings");
}
