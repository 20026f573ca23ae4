//! Tests of shader view/panel, which draws tinted quads with texels of an atlas and blends them with the image, against
//! f64.

use palpate::internal::gpu::{Before, Buffer, Canvas, Image, Memory, Recorder, Texels};
use palpate_view::painter::{Atlas, Flat, Painter, Piece};

use crate::harness::{assert_clean, context, turn};

/// Width and height of the image, pixels; a point, the unit of the quad's coordinates, is two pixels.
const SIZE: [u32; 2] = [12, 8];
const BACKGROUND: [f32; 4] = [0.2, 0.4, 0.6, 1.0];
/// Error of a channel, in units of a byte: one unit by rounding in the product, and one unit by rounding in the blend.
const ROUNDING: f64 = 2.0;

#[test]
fn a_tinted_quad_of_the_atlas_is_mixed_with_the_picture_within_its_part() {
    turn();
    let context = context();
    let atlas = Atlas {
        size: [3, 2],
        texels: vec![[255; 4], [0, 0, 0, 0], [90, 60, 30, 120], [200, 10, 10, 255], [16, 32, 64, 64], [0, 255, 0, 255]],
    };
    let tint = [128u8, 192, 64, 192];
    let corner =
        |x: f32, y: f32, u: f32, v: f32| [x.to_bits(), y.to_bits(), u.to_bits(), v.to_bits(), u32::from_le_bytes(tint)];
    // The quad goes from pixel (2, 2) to (10, 6); its last two columns of pixels lie beyond the part of the image that
    // may be drawn on.
    let corners = [
        corner(1.0, 1.0, 0.0, 0.0),
        corner(5.0, 1.0, 1.0, 0.0),
        corner(5.0, 3.0, 1.0, 1.0),
        corner(1.0, 3.0, 0.0, 1.0),
    ];
    let flat = Flat {
        corners: corners.concat(),
        indices: vec![0, 1, 2, 0, 2, 3],
        pieces: vec![Piece { part: [0, 0, 8, 8], range: (0, 6) }],
        points: [6.0, 4.0],
    };
    let image = Image::new(context, "panel", Texels::Colour, SIZE, 1).unwrap();
    let mut recorder = Recorder::untimed(context).unwrap();
    recorder.paint(&Canvas { colour: Some(image.clone()), ..Canvas::default() }, Before::Cleared(BACKGROUND), &[]);
    recorder.finish().unwrap().submit_and_wait().unwrap();
    let mut painter = Painter::new(context).unwrap();
    painter.set_atlas(&atlas).unwrap();
    painter.paint(&flat, &image).unwrap().submit_and_wait().unwrap();
    let array = Buffer::new(context, "pixels", image.bytes(), Memory::Readback).unwrap();
    let mut recorder = Recorder::untimed(context).unwrap();
    recorder.copy_out(&image, &array);
    recorder.finish().unwrap().submit_and_wait().unwrap();
    let pixels: Vec<[u8; 4]> = array.read().unwrap();
    for (i, got) in pixels.iter().enumerate() {
        let (x, y) = (i % SIZE[0] as usize, i / SIZE[0] as usize);
        let is_inside = (2..8).contains(&x) && (2..6).contains(&y);
        let texel = |at: usize, first: usize, width: usize, count: usize| (2 * (at - first) + 1) * count / (2 * width);
        let over = if is_inside { atlas.texels[texel(y, 2, 4, 2) * 3 + texel(x, 2, 8, 3)] } else { [0; 4] };
        let tinted: [f64; 4] = std::array::from_fn(|k| f64::from(over[k]) * f64::from(tint[k]) / 255.0);
        for k in 0..4 {
            let want = tinted[k] + 255.0 * f64::from(BACKGROUND[k]) * (1.0 - tinted[3] / 255.0);
            assert!(
                (f64::from(got[k]) - want).abs() <= ROUNDING,
                "pixel ({x}, {y}), channel {k}: {}, expected {want}",
                got[k]
            );
        }
    }
    assert_clean(context, "panel");
}
