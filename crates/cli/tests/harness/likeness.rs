//! Comparison of images, as an eye compares them: by the structural similarity of their least similar tile.

use std::fs;
use std::io::BufReader;
use std::path::Path;

use image_compare::Algorithm;
use image_compare::prelude::{ImageBuffer, Rgb, RgbImage};

/// Side of the squares whose mean colours are compared, pixels; the mean removes noise of single pixels, which no
/// viewer sees.
const BLUR: u32 = 3;
/// Width and height of a tile, in squares of [`BLUR`] pixels. Images are compared tile by tile and the least similar
/// tile counts, because what a contact changes is a small part of an image.
const TILE: [u32; 2] = [16, 15];
/// Least structural similarity (Wang et al. 2004) of a tile, in its worst colour channel, for images to count as alike.
/// Noise of one intensity level leaves a similarity of 0.94 (the crate image_compare sums variances over a window where
/// Wang et al. take their mean, and so is stricter); a turn of the camera by two degrees leaves 0.8.
pub const ALIKE: f64 = 0.87;

/// Reads a PNG file.
pub fn read(file: &Path) -> RgbImage {
    let decoder =
        png::Decoder::new(BufReader::new(fs::File::open(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()))));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    ImageBuffer::from_raw(info.width, info.height, bytes).unwrap()
}

/// The mean colours of squares of [`BLUR`] pixels a side; pixels left over at the right and at the bottom are
/// not compared.
fn blurred(image: &RgbImage) -> RgbImage {
    RgbImage::from_fn(image.width() / BLUR, image.height() / BLUR, |x, y| {
        let pixels = (0..BLUR * BLUR).map(|k| image.get_pixel(BLUR * x + k % BLUR, BLUR * y + k / BLUR));
        let mut sums = [0; 3];
        pixels.for_each(|pixel| (0..3).for_each(|c| sums[c] += u32::from(pixel[c])));
        Rgb(sums.map(|sum| ((sum + BLUR * BLUR / 2) / (BLUR * BLUR)) as u8))
    })
}

/// Structural similarity of two images of equal size in their least similar tile, 0 to 1.
pub fn likeness(a: &RgbImage, b: &RgbImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions(), "images to compare must have the same size");
    let (a, b) = (blurred(a), blurred(b));
    let part = |of: &RgbImage, left: u32, top: u32| {
        RgbImage::from_fn(TILE[0], TILE[1], |x, y| *of.get_pixel(left + x, top + y))
    };
    let mut least = 1.0f64;
    for top in (0..a.height()).step_by(TILE[1] as usize) {
        for left in (0..a.width()).step_by(TILE[0] as usize) {
            // The last tile of a row or column is moved so that it ends where the image does.
            let (left, top) = (left.min(a.width() - TILE[0]), top.min(a.height() - TILE[1]));
            let [a, b] = [part(&a, left, top), part(&b, left, top)];
            let alike = image_compare::rgb_similarity_structure(&Algorithm::MSSIMSimple, &a, &b).unwrap();
            least = least.min(alike.score);
        }
    }
    least
}
