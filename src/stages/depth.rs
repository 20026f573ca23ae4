//! Depth: which triangle of the other body lies over each texel of a region's tile. Two interchangeable paths.

use std::sync::Arc;

use super::cull::Cull;
use super::model::Model;
use super::skin::Skin;
use super::{Common, args, array, count, upload};
use crate::gpu::{Buffer, Context, DepthTest, DeviceKind, Kernel, Pass, RasterPipeline, RasterTarget, Recorder, Size};
use crate::scene::Scene;
use crate::{Error, Result};

/// Texels a side of a region's tile. Depth is exact by walking triangles, so the tile only has to name a triangle near the
/// right one; finer costs more (a tile of 128 took 2.7 times as long on lavapipe) and finds nothing more.
pub const TILE: u32 = 64;
/// The same where the scene asks for a texel of its own.
const FINE_TILE: u32 = 256;

/// Texels a side of a region's tile at most.
pub fn tile_of(scene: &Scene) -> u32 {
    if scene.contact.texel.is_some() { FINE_TILE } else { TILE }
}

/// Greatest side of an image that every device offers.
const MAX_IMAGE: u32 = 4096;

/// How triangles get into the tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// The graphics pipeline's depth passes, as in the paper.
    Graphics,
    /// Integer atomics in compute.
    Compute,
}

impl Path {
    /// Graphics on a GPU; compute on a CPU device, whose rasterizer pays for every triangle.
    pub fn of(kind: DeviceKind) -> Path {
        if kind == DeviceKind::Cpu { Path::Compute } else { Path::Graphics }
    }

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Path::Graphics => "graphics",
            Path::Compute => "compute",
        }
    }
}

enum Raster {
    Graphics { pipeline: RasterPipeline, target: RasterTarget },
    Compute { heights: Kernel, names: Kernel },
}

/// Tiles of all regions.
pub struct Depth {
    raster: Raster,
    proxy_triangles: Buffer,
    heights: Buffer,
    /// Triangle over each texel; a tile a side, two a region.
    pub names: Buffer,
}

impl Depth {
    /// Kernels and arrays for a model; see [`tile_of`].
    pub fn new(context: &Arc<Context>, model: &Model, path: Path, tile: u32) -> Result<Depth> {
        let tiles = 2 * model.pairs.len();
        let texels = tiles * (tile * tile) as usize;
        let raster = match path {
            Path::Graphics => {
                let height = tile * tiles as u32;
                if height > MAX_IMAGE {
                    let most = MAX_IMAGE / (2 * tile);
                    return Err(Error::Simulation(format!(
                        "{} pairs of bodies may touch, but the depth image holds {most}; list fewer in `collides`",
                        model.pairs.len()
                    )));
                }
                let constants = [("TILE", tile.into()), ("TILES", count(tiles))];
                Raster::Graphics {
                    pipeline: RasterPipeline::new(context, "depth/depth", DepthTest::Less, &constants)?,
                    target: RasterTarget::new(context, "depth field", tile, height)?,
                }
            }
            Path::Compute => {
                let kernel = |names: bool| {
                    let constants = [("TILE", tile.into()), ("NAMES", names.into())];
                    Kernel::new(context, "depth/raster", Size::Group, &constants)
                };
                Raster::Compute { heights: kernel(false)?, names: kernel(true)? }
            }
        };
        Ok(Depth {
            raster,
            proxy_triangles: upload(context, "triangles of proxies", &model.proxy_triangles)?,
            heights: array::<u32>(context, "heights", texels)?,
            names: array::<u32>(context, "names", texels)?,
        })
    }

    /// Graphics: a draw and a copy. Compute: least height, then least triangle of that height.
    pub fn record(&self, recorder: &mut Recorder, common: &Common, cull: &Cull, skin: &Skin) {
        recorder.stage("depth");
        let mut buffers = vec![
            &common.counts,
            &cull.active_list,
            &skin.proxies,
            &self.proxy_triangles,
            &cull.regions,
            &skin.triangles,
            &skin.skin,
        ];
        match &self.raster {
            Raster::Graphics { pipeline, target } => {
                let pass = Pass::cleared(super::types::NONE, 1.0);
                recorder.draw_indirect(pipeline, target, &buffers, &[], &common.args, args::DRAW, pass);
                recorder.copy_target(target, &self.names, &self.heights);
            }
            Raster::Compute { heights, names } => {
                recorder.fill(&self.heights, u32::MAX);
                recorder.fill(&self.names, super::types::NONE);
                buffers.extend([&self.heights, &self.names]);
                recorder.dispatch_indirect(heights, &buffers, &[], &common.args, args::RASTER);
                recorder.dispatch_indirect(names, &buffers, &[], &common.args, args::RASTER);
            }
        }
    }
}
