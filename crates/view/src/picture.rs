//! Images in the CPU's memory, and as PNG files.

use std::io::Write;

/// An image: rows from the top, sRGB.
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

    /// Joins images from left to right; lower ones are filled up with white.
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
