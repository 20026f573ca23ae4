//! Converts the triangles and textures of egui (the user interface library) to the form in which the *painter*
//! (`painter.rs`) draws them over an image.

use egui::epaint::textures::TexturesDelta;
use egui::epaint::{ImageData, Primitive};
use egui::{ClippedPrimitive, TextureId};

use super::painter::{Atlas, CORNER_WORDS, Flat, Piece};

/// The texture with the fonts, the only texture that this program's user interface has.
const FONTS: TextureId = TextureId::Managed(0);

/// The triangles of egui in the painter's form, for an image of this size, pixels.
pub fn flat(primitives: &[ClippedPrimitive], pixels_per_point: f32, size: [u32; 2]) -> Flat {
    let points = size.map(|side| side as f32 / pixels_per_point);
    let mut flat = Flat { points, ..Flat::default() };
    for ClippedPrimitive { clip_rect, primitive } in primitives {
        let Primitive::Mesh(mesh) = primitive else { continue };
        let pixel = |x: f32, most: u32| ((x * pixels_per_point).round().max(0.0) as u32).min(most);
        let (left, top) = (pixel(clip_rect.min.x, size[0]), pixel(clip_rect.min.y, size[1]));
        let (right, bottom) = (pixel(clip_rect.max.x, size[0]), pixel(clip_rect.max.y, size[1]));
        if right <= left || bottom <= top || mesh.indices.is_empty() || mesh.texture_id != FONTS {
            continue;
        }
        let base = (flat.corners.len() / CORNER_WORDS) as u32;
        let range = (flat.indices.len() as u32, mesh.indices.len() as u32);
        flat.pieces.push(Piece { part: [left, top, right - left, bottom - top], range });
        flat.indices.extend(mesh.indices.iter().map(|index| base + index));
        for vertex in &mesh.vertices {
            let places = [vertex.pos.x, vertex.pos.y, vertex.uv.x, vertex.uv.y].map(f32::to_bits);
            flat.corners.extend(places);
            flat.corners.push(u32::from_le_bytes(vertex.color.to_array()));
        }
    }
    flat
}

/// Brings the atlas (the painter's texture with the letters) up to date; returns whether the atlas changed.
pub fn update(atlas: &mut Atlas, delta: &TexturesDelta) -> bool {
    let Some(changes) = delta.set.get(&FONTS) else { return false };
    for change in changes {
        let ImageData::Color(image) = &change.image;
        let texels = image.pixels.iter().map(|texel| texel.to_array());
        match change.pos {
            None => *atlas = Atlas { size: image.size, texels: texels.collect() },
            Some([left, top]) => {
                let texels: Vec<[u8; 4]> = texels.collect();
                for (row, line) in texels.chunks(image.size[0].max(1)).enumerate() {
                    let first = (top + row) * atlas.size[0] + left;
                    if let Some(into) = atlas.texels.get_mut(first..first + line.len()) {
                        into.copy_from_slice(line);
                    }
                }
            }
        }
    }
    true
}
