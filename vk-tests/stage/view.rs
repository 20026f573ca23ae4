//! Tests of the view, which draws a simulation: its shaders for light, values and shadows against f64, and images of a
//! simulation. An image must not depend on the slices (parts of the draw work, which are submitted one after another)
//! in which it is drawn. An overlay is something that is drawn on or over the bodies, such as contact pressure.

use bytemuck::Zeroable;
use glam::{DMat4, DVec2, DVec3, DVec4};
use palpate::Simulation;
use palpate::internal::gpu::{Before, Buffer, Drawn, Image, Memory, Onto, RasterPipeline, Recorder, Texels};
use palpate::internal::shaders;
use palpate::internal::step::Field;
use palpate_view::look::{self, Look, Material, SCALE_COLOURS, View, across, columns, flags, light};
use palpate_view::{Moment, Overlay, Overlays, Renderer, Settings};

use crate::gpu::canvas::{PLAIN, Sheet, centres, expect_colour};
use crate::harness::random::Random;
use crate::harness::{assert_clean, context, turn};
use crate::scene::touch::{Place, press};
use crate::scene::whole_step::{open, run, scene};

/// Width and height of the images in these tests, pixels.
const SIZE: [u32; 2] = [24, 16];
/// Error of a colour channel: the shader's sRGB is off by 0.1 %, and the result is rounded to a byte.
const SHADE: f64 = 2.0 / 255.0;
/// Error of a depth in a shadow map (0 to 1): directions are rounded to f32, and corners on a slope are rounded to
/// 1/256 of a texel.
const DEPTH: f64 = 2e-5;
/// Texels along a side of the shadow maps in these tests.
const SIDE: u32 = 32;

#[test]
fn the_sun_sees_a_ball_from_zero_to_one() {
    let mut random = Random(7);
    for _ in 0..20 {
        let (sun, middle, reach) = (random.vector().normalize(), 5.0 * random.vector(), 1.1 + random.next());
        let seen = light(sun, middle, reach);
        let [right, up] = across(sun);
        assert!(right.cross(up).distance(sun) < 1e-12, "right, up and towards the sun are right-handed");
        for (at, want) in [
            (middle, DVec3::splat(0.5)),
            (middle + reach * sun, DVec3::new(0.5, 0.5, 0.0)),
            (middle - reach * sun, DVec3::new(0.5, 0.5, 1.0)),
            (middle + reach * right, DVec3::new(1.0, 0.5, 0.5)),
            (middle - reach * up, DVec3::new(0.5, 0.0, 0.5)),
        ] {
            let got = seen.transform_point3(at);
            assert!(got.distance(want) < 1e-12, "position seen from the sun {got}, expected {want}");
        }
    }
}

fn wide(x: [f32; 3]) -> DVec3 {
    DVec3::from(x.map(f64::from))
}

/// Converts a linear colour to sRGB (IEC 61966-2-1).
fn shown(linear: DVec3) -> DVec3 {
    let one = |x: f64| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    DVec3::from(linear.clamp(DVec3::ZERO, DVec3::ONE).to_array().map(one))
}

fn smooth(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The calculation of shared/surface.glsl in f64: the displayed colour, multiplied by its alpha.
fn surface(
    view: &View,
    material: &Material,
    colours: &[[f32; 4]],
    x: DVec3,
    n: DVec3,
    value: f64,
    sun_share: f64,
) -> [f64; 4] {
    let has = |flag: u32| material.flags & flag != 0;
    let [r, g, b, own_alpha] = material.colour.map(f64::from);
    let (mut own, mut evenness) = (DVec3::new(r, g, b), 0.0);
    let colour = |k: usize| wide(colours[k][..3].try_into().unwrap());
    if has(flags::VALUED) {
        let (low, high) = (f64::from(material.low), f64::from(material.high));
        let share = ((value - low) / (high - low)).clamp(0.0, 1.0);
        evenness = if has(flags::EVEN) { 1.0 } else { smooth(0.0, 0.02, share) };
        own = own.lerp(colour((share * 255.0 + 0.5) as usize), evenness);
    }
    if has(flags::NUMBERED) {
        own = colour(256 + value.round() as usize % 256);
    }
    if has(flags::UNLIT) {
        return (own_alpha * shown(own)).extend(own_alpha).to_array();
    }
    let (to_sun, to_eye) = (wide(view.sun), (wide(view.eye) - x).normalize());
    let sun = n.dot(to_sun).max(0.0) * if has(flags::BARE) { 1.0 } else { sun_share };
    let sky = 0.5 * (1.0 + n.y);
    let coloured =
        DVec3::new(0.16, 0.16, 0.18) + sky * DVec3::new(0.26, 0.28, 0.31) + sun * DVec3::new(0.86, 0.82, 0.74);
    let light = coloured.lerp(DVec3::splat(0.62 + 0.18 * sky + 0.3 * sun), evenness);
    let glint = n.dot((to_eye + to_sun).normalize()).max(0.0).powi(32) * (8.0 * sun).min(1.0);
    let mut bright = own * light + 0.1 * glint * (1.0 - evenness);
    let mut alpha = own_alpha;
    if has(flags::GLASS) {
        let rim = (1.0 - n.dot(to_eye).max(0.0)).powi(3);
        alpha = own_alpha + (0.95 - own_alpha) * rim;
        bright += 0.5 * glint;
    }
    (alpha * shown(bright)).extend(alpha).to_array()
}

/// The calculation of shared/shade.glsl in f64: the share of the sun that reaches a point.
fn lit(view: &View, depths: &[f32], x: DVec3, n: DVec3) -> f64 {
    let matrix = DMat4::from_cols_array_2d(&view.light.map(|column| column.map(f64::from)));
    let place = matrix.transform_point3(x + 2.0 * f64::from(view.texel) * n);
    let side = view.shadow_side as usize;
    let texel = side as f64 * place.truncate() - 0.5;
    let (corner, share) = (texel.floor(), texel - texel.floor());
    if corner.min_element() < 1.0 || corner.max_element() >= side as f64 - 4.0 {
        return 1.0;
    }
    let depth = place.z.min(1.0) - f64::from(view.bias);
    let weights = |share: f64| [1.0 - share, 1.0, 1.0, share];
    let (along, down) = (weights(share.x), weights(share.y));
    let texels = (0..4).flat_map(|j| (0..4).map(move |i| (i, j)));
    let one = |(i, j): (usize, usize)| {
        let (column, row) = (corner.x as usize + i - 1, corner.y as usize + j - 1);
        let is_lit = f64::from(depths[row * side + column]) >= depth;
        along[i] * down[j] * f64::from(u8::from(is_lit))
    };
    texels.map(one).sum::<f64>() / 9.0
}

/// A triangle that covers the image and is nearly parallel to the image: positions are pixels from the image's middle.
struct Face {
    positions: [DVec3; 3],
    normals: [DVec3; 3],
    values: [f64; 3],
}

impl Face {
    fn new(random: &mut Random, values: [f64; 3]) -> Face {
        let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let positions = [
            corner(-20.0, -30.0, random.next()),
            corner(60.0, 10.0, random.next()),
            corner(-20.0, 30.0, random.next()),
        ];
        // Normals point more or less towards the viewer.
        let mut normal = || (DVec3::new(0.0, 0.0, 1.3) + random.vector()).normalize();
        Face { positions, normals: [normal(), normal(), normal()], values }
    }

    /// Barycentric weights of the corners at a pixel.
    fn shares(&self, pixel: DVec2) -> [f64; 3] {
        let at = pixel - 0.5 * DVec2::new(SIZE[0].into(), SIZE[1].into());
        let corner = |k: usize| self.positions[k % 3].truncate();
        let area = (corner(1) - corner(0)).perp_dot(corner(2) - corner(0));
        [0, 1, 2].map(|k| (corner(k + 2) - corner(k + 1)).perp_dot(at - corner(k + 1)) / area)
    }
}

/// A view from above in which a pixel is a metre, and in which the world's y points down.
fn view(random: &mut Random) -> View {
    let [width, height] = SIZE.map(f64::from);
    let mut sun = random.vector();
    sun.z = 0.6 + sun.z.abs();
    let sun = sun.normalize();
    let reach = 20.0;
    // Only x and y decide where a point is drawn; all depths are the same, since clip space ends at depths 0 and 1.
    let clip = DMat4::from_cols(
        DVec4::new(2.0 / width, 0.0, 0.0, 0.0),
        DVec4::new(0.0, 2.0 / height, 0.0, 0.0),
        DVec4::ZERO,
        DVec4::new(0.0, 0.0, 0.5, 1.0),
    );
    View {
        clip: columns(clip),
        light: columns(light(sun, DVec3::ZERO, reach)),
        eye: [3.0, -2.0, 25.0],
        sun: sun.as_vec3().to_array(),
        across: across(sun).map(|axis| axis.as_vec3().to_array()),
        middle: [0.0; 3],
        reach: reach as f32,
        bias: 0.006,
        texel: (2.0 * reach / f64::from(SIDE)) as f32,
        shadow_side: SIDE,
        ..View::zeroed()
    }
}

fn words<T: bytemuck::Pod>(name: &str, data: &[T]) -> Buffer {
    Buffer::from_slice(context(), name, data, Memory::Device).unwrap()
}

/// A buffer with a shadow map (the depths that the sun sees), padded for reads of four depths at once.
fn shadow_array(depths: &[f32]) -> Buffer {
    words("shadow", &[depths, &[0.0; 4]].concat())
}

/// The colours that view/mesh draws of a face, with shading at vertices or at pixels.
fn drawn_face(
    at_vertices: bool,
    view: &View,
    material: &Material,
    colours: &[[f32; 4]],
    depths: &[f32],
    face: &Face,
) -> Vec<[f64; 4]> {
    let constants = [("AT_VERTICES", at_vertices.into())];
    let pipeline = RasterPipeline::onto(context(), "view/mesh", &constants, &PLAIN).unwrap();
    // Three other vertices come first, since values are read four at a time.
    let narrow = |all: [DVec3; 3], w: f32| [[[9.0f32; 4]; 3], all.map(|x| x.as_vec3().extend(w).to_array())].concat();
    let [a, b, c] = face.values.map(|value| value as f32);
    let values = [[9.0, 9.0, 9.0, a], [b, c, 9.0, 9.0]];
    let other = Material { colour: [1.0, 0.0, 1.0, 1.0], flags: flags::UNLIT, low: 0.0, high: 1.0 };
    let arguments = shaders::view::DrawMesh {
        material_index: 1,
        view: &words("view", &[*view]),
        positions: &words("positions", &narrow(face.positions, 1.0)),
        normals: &words("normals", &narrow(face.normals, 0.0)),
        values: &words("values", &values),
        shadow: &shadow_array(depths),
        colours: &words("colours", colours),
        materials: &words("materials", &[other, *material, other]),
    };
    let mut sheet = Sheet::new(SIZE, 1);
    sheet.canvas.depth = None;
    let one =
        Drawn { pipeline: &pipeline, arguments: &arguments, indices: None, range: (3, 3), instances: 1, part: None };
    sheet.draw(Before::Cleared([0.0; 4]), &[one]).0
}

/// Draws a face with shading at pixels and at vertices, and compares every pixel.
fn expect_shaded(what: &str, view: &View, material: &Material, depths: &[f32], face: &Face) {
    let colours = look::colours(Some(Field::Pressure));
    let mix = |share: [f64; 3], all: [DVec3; 3]| (0..3).map(|k| share[k] * all[k]).sum::<DVec3>();
    let is_flat = material.flags & flags::FLAT != 0;
    let [a, b, c] = face.positions;
    let plane = (b - a).cross(c - a).normalize();
    for at_vertices in [false, true] {
        let got = drawn_face(at_vertices, view, material, &colours, depths, face);
        let shade =
            |x: DVec3, n: DVec3, value: f64| surface(view, material, &colours, x, n, value, lit(view, depths, x, n));
        let corners = [0, 1, 2].map(|k| shade(face.positions[k], face.normals[k], face.values[k]));
        for (pixel, at) in centres(SIZE).enumerate() {
            let share = face.shares(at);
            let x = mix(share, face.positions);
            let value: f64 = (0..3).map(|k| share[k] * face.values[k]).sum();
            // Pixels at which rounding decides between two colours of the colour scale are not compared.
            let step = 255.0 * (value - f64::from(material.low)) / f64::from(material.high - material.low) + 0.5;
            if !at_vertices && face.values[0] != face.values[1] && (step - step.round()).abs() < 0.01 {
                continue;
            }
            let want = if at_vertices {
                [0, 1, 2, 3].map(|c| (0..3).map(|k| share[k] * corners[k][c]).sum())
            } else {
                let towards = if plane.dot(wide(view.eye) - x) < 0.0 { -plane } else { plane };
                let n = if is_flat { towards } else { mix(share, face.normals).normalize() };
                shade(x, n, value)
            };
            expect_colour(&format!("{what}, shading at vertices: {at_vertices}, pixel {at}"), got[pixel], want, SHADE);
        }
    }
}

/// A shadow map in which the sun reaches everything.
const OPEN: [f32; (SIDE * SIDE) as usize] = [1.0; (SIDE * SIDE) as usize];
/// A shadow map in which the sun reaches nothing.
const DARK: [f32; (SIDE * SIDE) as usize] = [0.0; (SIDE * SIDE) as usize];

#[test]
fn surfaces_are_shaded_as_in_f64() {
    turn();
    let mut random = Random(23);
    for case in 0..6 {
        let plain = Material { low: 2.0, high: 12.0, ..Material::body(case) };
        // The values lie below the colour scale, low, midway and high on the scale, and above the scale; no value is
        // half-way between two colours.
        for (what, value) in [("below", 1.0), ("low", 2.1), ("midway", 5.3), ("high", 10.7), ("above", 20.0)] {
            for more in [0, flags::EVEN] {
                let face = Face::new(&mut random, [value; 3]);
                let valued = plain.with(flags::VALUED | more);
                expect_shaded(
                    &format!("place on the colour scale: {what}; flags {more}"),
                    &view(&mut random),
                    &valued,
                    &OPEN,
                    &face,
                );
            }
        }
        let slope = Face::new(&mut random, [2.1, 6.3, 10.7]);
        expect_shaded("a slope of values", &view(&mut random), &plain.with(flags::VALUED), &OPEN, &slope);
        let face = Face::new(&mut random, [7.0; 3]);
        for number in [0.0, 3.0, 255.0, 258.0] {
            let face = Face { values: [number; 3], ..Face::new(&mut random, [0.0; 3]) };
            expect_shaded("coloured by a whole number", &view(&mut random), &plain.with(flags::NUMBERED), &OPEN, &face);
        }
        for (what, material) in [
            ("plain", plain),
            ("flat", plain.with(flags::FLAT)),
            ("glass", plain.glass(0.4)),
            ("unlit", plain.with(flags::UNLIT)),
            ("unlit glass", plain.glass(0.3).with(flags::UNLIT)),
            ("bare", plain.with(flags::BARE)),
        ] {
            for (light, depths) in [("in the sun", &OPEN), ("in the dark", &DARK)] {
                expect_shaded(&format!("{what} {light}"), &view(&mut random), &material, depths, &face);
            }
        }
    }
}

#[test]
fn shadows_are_smooth_between_texels() {
    turn();
    let mut random = Random(31);
    for _ in 0..8 {
        // No depth is near the depth of the face itself, where rounding would decide.
        let depths: Vec<f32> = (0..SIDE * SIDE).map(|_| if random.next() < 0.0 { 0.05 } else { 0.97 }).collect();
        let face = Face::new(&mut random, [0.0; 3]);
        let face = Face { normals: [DVec3::Z; 3], ..face };
        let view = view(&mut random);
        let shares: Vec<f64> = centres(SIZE)
            .map(|at| lit(&view, &depths, (at - 0.5 * DVec2::new(24.0, 16.0)).extend(0.0), DVec3::Z))
            .collect();
        assert!(
            shares.iter().filter(|share| (0.1..0.9).contains(*share)).count() > shares.len() / 2,
            "most pixels must be between light and dark"
        );
        expect_shaded("a coarse shadow", &view, &Material::plain([200, 180, 160]), &depths, &face);
    }
}

/// Draws the ground under a square that hangs above it. Returns the colour of each pixel, and the shadow map.
fn shaded_ground(view: &View, square: [DVec3; 4], side: u32) -> (Vec<[f64; 4]>, Buffer) {
    let caster = Onto { has_depth: true, hides: true, samples: 1, ..Onto::default() };
    let caster = RasterPipeline::onto(context(), "view/shadow", &[], &caster).unwrap();
    let ground = RasterPipeline::onto(context(), "view/ground", &[], &PLAIN).unwrap();
    let view_there = words("view", &[*view]);
    let positions = words("positions", &square.map(|x| x.as_vec3().extend(1.0).to_array()));
    let indices = words("triangles", &[0u32, 1, 2, 0, 2, 3]);
    let seen = Image::new(context(), "what the sun sees", Texels::Depth, [side; 2], 1).unwrap();
    let depths = Buffer::new(context(), "shadow", seen.bytes() + 16, Memory::Device).unwrap();
    let canvas = palpate::internal::gpu::Canvas { depth: Some(seen.clone()), ..Default::default() };
    let mut recorder = Recorder::untimed(context()).unwrap();
    recorder.stage("shadow");
    let casters = Drawn {
        pipeline: &caster,
        arguments: &shaders::view::DrawShadow { view: &view_there, positions: &positions },
        indices: Some(&indices),
        range: (0, 6),
        instances: 1,
        part: None,
    };
    recorder.paint(&canvas, Before::Cleared([0.0; 4]), &[casters]);
    recorder.copy_out(&seen, &depths);
    recorder.finish().unwrap().submit_and_wait().unwrap();
    assert_clean(context(), "a shadow");
    let mut sheet = Sheet::new([64, 48], 1);
    sheet.canvas.depth = None;
    let arguments = shaders::view::DrawGround { view: &view_there, shadow: &depths };
    let one =
        Drawn { pipeline: &ground, arguments: &arguments, indices: None, range: (0, 6), instances: 1, part: None };
    (sheet.draw(Before::Cleared([0.0; 4]), &[one]).0, depths)
}

/// Checks that the shadow map has the square's depth wherever the sun sees the square.
fn expect_depths(depths: &[f32], view: &View, (on, plane): (DVec3, DVec3), side: u32) {
    let (sun, [right, up], middle, reach) =
        (wide(view.sun), view.across.map(wide), wide(view.middle), f64::from(view.reach));
    let mut seen = 0;
    for (texel, at) in centres([side; 2]).enumerate().filter(|(texel, _)| depths[*texel] < 1.0) {
        let place = (2.0 * at / f64::from(side) - 1.0) * reach;
        let from = middle + place.x * right + place.y * up;
        let along = (on - from).dot(plane) / sun.dot(plane);
        let want = 0.5 - 0.5 * along / reach;
        assert!(
            (f64::from(depths[texel]) - want).abs() < DEPTH,
            "depth at texel {at}: {}, expected {want}",
            depths[texel]
        );
        seen += 1;
    }
    assert!(seen > 1000, "the square has only {seen} texels of the shadow map");
}

#[test]
fn a_square_throws_its_shadow_where_the_suns_rays_pass() {
    turn();
    let (size, side) = ([64u32, 48], 512u32);
    let mut random = Random(41);
    for case in 0..6 {
        let mut towards = random.vector();
        // The sun is high in some cases and low in the others: a shadow fades where it goes far.
        towards.y = if case % 2 == 0 { 1.0 + towards.y.abs() } else { 0.4 * towards.x.hypot(towards.z) };
        let (sun, reach) = (towards.normalize(), 2.0);
        let (normal, offset) = (DVec3::Y, -0.8);
        let middle = 0.2 * random.vector();
        // The square is nearly level, turned about the vertical, and above the ground.
        let (u, v) = (DVec3::new(0.5, 0.0, 0.3), DVec3::new(-0.2, 0.03, 0.4));
        let centre = middle + DVec3::new(0.0, 0.3, 0.0);
        let square = [centre - u - v, centre - u + v, centre + u + v, centre + u - v];
        let mut camera = palpate_view::Camera::around(middle - 1.0, middle + 1.0);
        (camera.yaw, camera.pitch) = (3.0 * random.next(), 0.9);
        camera.target = centre - (centre.y - offset) / sun.y * sun;
        let texel = 2.0 * reach / f64::from(side);
        let view = View {
            clip: columns(camera.matrix(size[0], size[1])),
            light: columns(light(sun, middle, reach)),
            eye: camera.eye().as_vec3().to_array(),
            sun: sun.as_vec3().to_array(),
            across: across(sun).map(|axis| axis.as_vec3().to_array()),
            ground: normal.extend(offset).as_vec4().to_array(),
            middle: middle.as_vec3().to_array(),
            reach: reach as f32,
            bias: 0.006,
            texel: texel as f32,
            shadow_side: side,
        };
        let (got, depths) = shaded_ground(&view, square, side);
        let plane = u.cross(v);
        expect_depths(&depths.read().unwrap(), &view, (centre, plane), side);
        let (mut dark, mut bright) = (0, 0);
        for (pixel, at) in centres(size).enumerate() {
            let ray = camera.ray(at.x, at.y, size[0], size[1]);
            let along = (offset - ray.origin.dot(normal)) / ray.direction.dot(normal);
            let x = ray.origin + along * ray.direction;
            // No ground is drawn beyond the square region that the shadow map covers.
            let from_middle = x - middle;
            let seen = across(sun).map(|axis| axis.dot(from_middle).abs()).into_iter().fold(0.0, f64::max);
            if along < 0.0 || seen > 0.95 * reach {
                continue;
            }
            // The point at which the ray towards the sun meets the square's plane, in half edges of the square. The ray
            // begins a little above the ground, as in the shader: slopes must not shade themselves.
            let from = x + 2.0 * texel * normal;
            let met = from + (centre - from).dot(plane) / sun.dot(plane) * sun - centre;
            let halves = [met.cross(v).dot(plane) / plane.dot(plane), u.cross(met).dot(plane) / plane.dot(plane)];
            let least = halves.map(|h| 1.0 - h.abs()).into_iter().fold(f64::INFINITY, f64::min);
            // The width on the square, in half edges, of the texels over which the shadow's edge is smoothed.
            let near = 4.0 * texel / (u.length().min(v.length()) * sun.dot(plane.normalize()).abs());
            if least.abs() < near {
                continue;
            }
            let flat = (from_middle - from_middle.dot(normal) * normal).length() / reach;
            let share = if least > 0.0 { 0.36 * (1.0 - smooth(0.8, 2.6, flat)) } else { 0.0 };
            if least > 0.0 {
                dark += 1
            } else {
                bright += 1
            };
            expect_colour(&format!("case {case}, pixel {at}, point {x}"), got[pixel], [0.0, 0.0, 0.0, share], SHADE);
        }
        assert!(dark > 50 && bright > 500, "case {case}: {dark} pixels in the shadow, {bright} in the sun");
    }
}

/// A simulation in which every overlay has something to show.
fn pressed() -> Simulation {
    let mut simulation = open(&scene(&press(2e4, 1e-3, Place::default(), "")), None);
    run(&mut simulation, 10);
    simulation
}

const SETTINGS: Settings = Settings { size: [160, 90], samples: 4 };
const SHOWN: [&[Overlay]; 4] = [
    &[],
    &[Overlay::Pressure, Overlay::Arrows, Overlay::ContactPatches],
    &[Overlay::Proxies, Overlay::Arrows],
    &[Overlay::Layer, Overlay::Cores, Overlay::Displacement],
];

#[test]
fn the_same_moment_gives_the_same_picture() {
    let mut simulation = pressed();
    let mut renderer = Renderer::new(&mut simulation, SETTINGS).unwrap();
    let camera = renderer.camera();
    let mut first = Vec::new();
    for round in 0..2 {
        for (k, shown) in SHOWN.iter().enumerate() {
            let moment = Moment::of(&mut simulation, renderer.origin(), Overlays::of(shown)).unwrap();
            renderer.look(&moment, &camera).unwrap();
            let picture = renderer.picture().unwrap();
            match round {
                0 => first.push(picture),
                _ => assert!(picture == first[k], "overlays {shown:?}: the same moment gives another picture"),
            }
        }
    }
    for (k, picture) in first.iter().enumerate() {
        assert!(
            first[..k].iter().all(|other| other != picture),
            "overlays {:?} give the same picture as earlier overlays",
            SHOWN[k]
        );
        let behind = look::BACKGROUND.map(|x| (255.0 * x).round() as u8);
        let drawn = picture.pixels.iter().filter(|pixel| **pixel != behind).count();
        assert!(drawn > picture.pixels.len() / 20, "overlays {:?}: only {drawn} pixels are drawn", SHOWN[k]);
    }
    run(&mut simulation, 0);
}

#[test]
fn a_picture_does_not_depend_on_its_slices() {
    let mut simulation = pressed();
    for samples in [1, 4] {
        let mut renderer = Renderer::new(&mut simulation, Settings { samples, ..SETTINGS }).unwrap();
        let camera = renderer.camera();
        for shown in SHOWN {
            let moment = Moment::of(&mut simulation, renderer.origin(), Overlays::of(shown)).unwrap();
            let mut counts = Vec::new();
            let mut pictures = [u32::MAX, 50, 17].map(|triangles| {
                renderer.set_slice(triangles);
                renderer.look(&moment, &camera).unwrap();
                counts.push(renderer.slices().len());
                for slice in renderer.slices() {
                    slice.submit_and_wait().unwrap();
                }
                renderer.read().unwrap()
            });
            assert!(
                counts[0] == 1 && counts[1] > 1 && counts[2] > counts[1],
                "overlays {shown:?}: numbers of slices {counts:?}"
            );
            let [whole, ..] = &pictures;
            assert!(
                pictures.iter().all(|picture| picture == whole),
                "overlays {shown:?}: another picture if drawn in slices"
            );
            // This shows that the comparison above can fail: one changed bit of a pixel is a difference.
            pictures[1].pixels[0][0] ^= 1;
            assert!(pictures[1] != pictures[0]);
        }
    }
    run(&mut simulation, 0);
}

#[test]
fn a_picture_shows_the_sun_from_where_it_is() {
    let mut simulation = pressed();
    let mut renderer = Renderer::new(&mut simulation, SETTINGS).unwrap();
    let camera = renderer.camera();
    let mut taken = |sun: DVec3| {
        renderer.set_sun(sun);
        let moment = Moment::of(&mut simulation, renderer.origin(), Overlays::default()).unwrap();
        renderer.look(&moment, &camera).unwrap();
        renderer.picture().unwrap()
    };
    let brightness = |picture: &palpate_view::picture::Picture| {
        picture.pixels.iter().map(|p| u64::from(p[0]) + u64::from(p[1]) + u64::from(p[2])).sum::<u64>()
    };
    let above = taken(DVec3::Y);
    let below = taken(-DVec3::Y);
    assert!(brightness(&above) > brightness(&below), "the picture must be brighter with the sun above");
    assert_eq!(SCALE_COLOURS, 256);
    assert!(taken(DVec3::ZERO) == below, "a direction of zero must be ignored");
}
