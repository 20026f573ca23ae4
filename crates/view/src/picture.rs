//! Images in the CPU's memory, which can be written as PNG files.

use std::io::Write;

/// An image in sRGB, stored row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels per row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Red, green, blue and alpha, a byte each.
    pub pixels: Vec<[u8; 4]>,
}

impl Picture {
    /// Writes the image as a PNG file.
    pub fn write_png(&self, out: impl Write) -> std::io::Result<()> {
        let mut encoder = png::Encoder::new(out, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb())?;
        Ok(writer.finish()?)
    }

    /// Joins images from left to right; images that are lower than the highest get white rows at the bottom.
    pub fn beside(pictures: &[Picture]) -> Picture {
        let width = pictures.iter().map(|picture| picture.width).sum();
        let height = pictures.iter().map(|picture| picture.height).max().unwrap_or(0);
        let row = |picture: &Picture, y: u32| {
            let [y, width] = [y as usize, picture.width as usize];
            picture.pixels.get(y * width..(y + 1) * width).map_or_else(|| vec![[255; 4]; width], <[_]>::to_vec)
        };
        let pixels = (0..height).flat_map(|y| pictures.iter().flat_map(move |picture| row(picture, y)));
        Picture { width, height, pixels: pixels.collect() }
    }

    /// Red, green and blue of all pixels, without alpha, because images are opaque.
    pub fn rgb(&self) -> Vec<u8> {
        self.pixels.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect()
    }
}
