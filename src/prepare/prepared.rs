//! The costly parts of a body, in file coordinates: repaired skin, layer, embedding, proxies. Made once, then cached;
//! binding, scale, material and placement are cheap and done by `body.rs` each time.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::body::Keys;
use super::cache::{Cache, Entry, Key, KeyMaker};
use super::repair::{self, RepairReport};
use super::report::{CacheUse, Log, Stage};
use super::stuffing::{self, LayerReport, Options, stuff};
use super::{Embedding, Layer, Proxy, Skin, embed, layer, proxies, proxy, skin};
use crate::Result;
use crate::scene::groups::Groups;
use crate::scene::obj::{self, TriangleMesh};
use crate::scene::tetrahedra::{self, TetMesh};
use crate::scene::{self, Surface};

/// What to know about a cell that does not do.
const UNITS: &str = "cells are in the file's coordinates, before scale";

/// All that the costly parts depend on.
#[derive(Debug, Clone)]
pub struct Recipe<'a> {
    /// The skin; without it the layer's boundary.
    pub surface: Option<&'a Surface>,
    /// The layer; without it the body is rigid.
    pub layer: Option<&'a scene::Layer>,
    /// Proxies at most; `None` for the usual number.
    pub hulls: Option<u32>,
}

/// The costly parts of a body, in file coordinates.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Prepared {
    /// Triangles of the skin.
    pub mesh: TriangleMesh,
    /// The layer of a soft body, nothing bound.
    pub layer: Option<Layer>,
    /// Groups of the layer's file.
    pub groups: Groups,
    /// What came of filling the surface with cells.
    pub filling: Option<LayerReport>,
    /// The number that each node has in the layer's file, ascending: nodes of no tetrahedron are left out.
    pub node_numbers: Vec<u32>,
    /// What of the layer's file or of the surface's shape was left out or changed, a sentence each.
    pub layer_notes: Vec<String>,
    /// Embedding of each skin vertex of a soft body.
    pub embedding: Vec<Embedding>,
    /// Convex cover of the skin.
    pub proxies: Vec<Proxy>,
    /// What was found in the given surface and mended; `None` where it was made here.
    pub repair: Option<RepairReport>,
}

impl Recipe<'_> {
    /// The parts, from the cache where it has them.
    pub(super) fn prepared(&self, keys: &Keys, cache: &Cache, log: &mut Log) -> Result<Prepared> {
        // Files that cannot be read are for their readers to complain about.
        let key = if cache.is_on() { log.stage(Stage::Cache, || self.key(keys))?.ok() } else { None };
        let Some(key) = key else { return self.make(keys, log) };
        match log.stage(Stage::Cache, || cache.load(&key))? {
            Entry::Found(prepared) => {
                log.cache = CacheUse::Found;
                return Ok(prepared);
            }
            Entry::Damaged(file) => log.notes.push(format!("{} is damaged and is made again", file.display())),
            Entry::Missing => {}
        }
        let prepared = self.make(keys, log)?;
        log.cache = CacheUse::Made;
        // A file that was changed while it was read must not lie under the key of what it was before.
        let kept = log.stage(Stage::Cache, || match self.key(keys) {
            Ok(now) if now == key => cache.store(&key, &prepared),
            _ => Ok(()),
        })?;
        log.notes.extend(kept.err());
        Ok(prepared)
    }

    /// What to do about a layer that leaves skin far outside.
    fn surrounding(&self) -> &'static str {
        match self.layer {
            Some(scene::Layer::File(_) | scene::Layer::Mesh(_) | scene::Layer::Box { .. }) => {
                "give a layer that surrounds the skin, in the same units"
            }
            _ => "give smaller cells: a part of the skin is too thin for these",
        }
    }

    /// Digest of the algorithms, of the contents of files, and of every number.
    fn key(&self, keys: &Keys) -> std::io::Result<Key> {
        let mut maker = KeyMaker::new();
        match self.surface {
            Some(Surface::File(path)) => add_file(&mut maker, path)?,
            Some(Surface::Mesh(mesh)) => add_mesh(&mut maker, &mesh.vertices, &mesh.triangles),
            other => maker.add(format!("{other:?}").as_bytes()),
        }
        match self.layer {
            Some(scene::Layer::File(path)) => {
                tetrahedra::files(path).iter().try_for_each(|f| add_file(&mut maker, f))?
            }
            Some(scene::Layer::Mesh(mesh)) => add_mesh(&mut maker, &mesh.nodes, &mesh.tetrahedra),
            other => maker.add(format!("{other:?}").as_bytes()),
        }
        maker.add(format!("{:?} {:?}", self.hulls, keys.repair).as_bytes());
        Ok(maker.finish())
    }

    /// Read, repair, layer, embed, proxies.
    fn make(&self, keys: &Keys, log: &mut Log) -> Result<Prepared> {
        let read = |surface| log.stage(Stage::Read, || read(keys, surface))?;
        let surface = self.surface.map(read).transpose()?;
        let (surface, mut repair) = match surface {
            Some(mesh) if keys.is_surface_given() => {
                let mend = if keys.repair { repair::repair } else { repair::strict };
                let made = log.stage(Stage::Repair, || mend(mesh))?;
                let (mesh, found) = made.map_err(|refusal| keys.refusal(&refusal))?;
                (Some(mesh), Some(found))
            }
            surface => (surface, None),
        };
        let made = self.layer.map(|source| log.stage(Stage::Layer, || make_layer(keys, surface.as_ref(), source))?);
        let Filled { mut layer, groups, notes: mut layer_notes, report: filling } =
            made.transpose()?.unwrap_or_default();
        let (node_numbers, dropped) = drop_unused(&mut layer);
        layer_notes.extend(dropped);
        let layer = self.layer.map(|_| layer);
        let mesh = match (surface, &layer) {
            (Some(mesh), _) => mesh,
            (None, Some(layer)) => {
                let (mesh, found) = log.stage(Stage::Repair, || boundary(keys, layer, self.layer))??;
                let said = found.iter().flat_map(RepairReport::sentences);
                layer_notes.extend(said.map(|(_, text)| format!("of the boundary, {text}")));
                repair = found;
                mesh
            }
            (None, None) => return Err(keys.error("surface", "missing", "give `surface` or `layer`")),
        };
        let embedding = match &layer {
            Some(layer) => log
                .stage(Stage::Embed, || embed(&mesh.vertices, layer))?
                .map_err(|problem| keys.error("layer", problem, self.surrounding()))?,
            None => Vec::new(),
        };
        let (mesh, proxies) = log.stage(Stage::Proxies, || cover(keys, mesh, self.hulls))??;
        Ok(Prepared { mesh, layer, groups, filling, node_numbers, layer_notes, embedding, proxies, repair })
    }
}

/// Name ending (it chooses the reader) and contents of a file.
fn add_file(maker: &mut KeyMaker, path: &Path) -> std::io::Result<()> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    maker.add(ending.as_bytes());
    maker.add(&std::fs::read(path)?);
    Ok(())
}

/// Points and elements of a mesh in memory.
fn add_mesh<const N: usize>(maker: &mut KeyMaker, points: &[DVec3], elements: &[[u32; N]]) {
    let coordinates = points.iter().flat_map(|point| point.to_array()).flat_map(f64::to_le_bytes);
    let indices = elements.iter().flatten().flat_map(|index| index.to_le_bytes());
    maker.add(format!("{N} points to an element").as_bytes());
    maker.add(&coordinates.collect::<Vec<u8>>());
    maker.add(&indices.collect::<Vec<u8>>());
}

/// Triangles of a surface in file coordinates.
fn read(keys: &Keys, surface: &Surface) -> Result<TriangleMesh> {
    match surface {
        Surface::File(path) => obj::read(path),
        Surface::Mesh(mesh) => Ok((**mesh).clone()),
        Surface::Model { model, vertices } if !model.vertices().contains(vertices) => {
            let range = model.vertices();
            let problem = format!("a {} of {vertices} vertices is not made", model.name());
            Err(keys.error("surface.vertices", problem, format!("give {} to {}", range.start(), range.end())))
        }
        Surface::Model { model, vertices } => {
            let (vertices, triangles) = crate::prepare::model::surface(*model, *vertices);
            Ok(TriangleMesh { vertices, triangles })
        }
    }
}

/// The layer's boundary as a surface. That of a given mesh is repaired like any other: elements may overlap or be missing.
fn boundary(keys: &Keys, layer: &Layer, source: Option<&scene::Layer>) -> Result<(TriangleMesh, Option<RepairReport>)> {
    let (vertices, triangles, _) = layer::boundary(layer);
    let mesh = TriangleMesh { vertices, triangles };
    if !matches!(source, Some(scene::Layer::File(_) | scene::Layer::Mesh(_))) {
        return Ok((mesh, None));
    }
    let (mesh, found) = repair::repair(mesh)
        .map_err(|refusal| keys.error("layer", format!("of its boundary, {}", refusal.problem), refusal.remedy))?;
    Ok((mesh, Some(found)))
}

/// A layer, and what came of making it.
#[derive(Default)]
struct Filled {
    layer: Layer,
    groups: Groups,
    notes: Vec<String>,
    report: Option<LayerReport>,
}

/// The layer in file coordinates, nothing bound.
fn make_layer(keys: &Keys, mesh: Option<&TriangleMesh>, source: &scene::Layer) -> Result<Filled> {
    match (source, mesh) {
        (&scene::Layer::Cell { cell, grade, thickness }, Some(mesh)) => {
            fill(mesh, Options { cell, grade, thickness }).map_err(|p| keys.error("layer.cell", p, UNITS))
        }
        (&scene::Layer::Across { cells, grade, thickness }, Some(mesh)) => {
            let cell = largest_extent(mesh) / f64::from(cells);
            fill(mesh, Options { cell, grade, thickness }).map_err(|p| keys.error("layer.across", p, UNITS))
        }
        (scene::Layer::Cell { .. } | scene::Layer::Across { .. }, None) => {
            Err(keys.error("layer", "there is no surface to fill", "give `surface` too"))
        }
        (scene::Layer::File(path), _) => Ok(given(tetrahedra::read(path)?)),
        (scene::Layer::Mesh(mesh), _) => Ok(given((**mesh).clone())),
        (scene::Layer::Box { low, high, cells }, _) => {
            let count = cells.iter().map(|&c| f64::from(c)).product::<f64>() * 6.0;
            if !(1.0..=stuffing::MAX_TETRAHEDRA).contains(&count) {
                let problem = format!("{count:.0} tetrahedra; there are at least 6 and at most 4 million");
                return Err(keys.error("layer.cells", problem, "give other numbers of cells"));
            }
            Ok(Filled { layer: layer::kuhn_box(*low, *high, *cells), ..Filled::default() })
        }
    }
}

/// A layer that is not made here.
fn given(mesh: TetMesh) -> Filled {
    let bound = vec![false; mesh.nodes.len()];
    let layer = Layer { nodes: mesh.nodes, tetrahedra: mesh.tetrahedra, bound, ..Layer::default() };
    Filled { layer, groups: mesh.groups, notes: mesh.notes, report: None }
}

/// The surface filled with cells.
fn fill(mesh: &TriangleMesh, options: Options) -> std::result::Result<Filled, String> {
    // Holes are closed, so that volumes are compared with those of the same solid.
    let (vertices, triangles) = repair::closed(&mesh.vertices, &mesh.triangles);
    let (layer, report) = stuff(&vertices, &triangles, &options)?;
    let notes = notes_of(&report);
    Ok(Filled { layer, notes, report: Some(report), ..Filled::default() })
}

/// Leaves out nodes of no tetrahedron, which have no mass and whose motion has no meaning; the number in the file of each
/// that stays, and a note. The others keep their order, in the step and in what is written.
fn drop_unused(layer: &mut Layer) -> (Vec<u32>, Option<String>) {
    let before = layer.nodes.len();
    let numbers = layer::drop_unused(layer);
    let dropped = before - numbers.len();
    let note = format!("{dropped} nodes of no tetrahedron left out; `nodes` of a core keep the file's numbers");
    (numbers, (dropped > 0).then_some(note))
}

/// What of the surface a filling could not follow, a sentence each.
fn notes_of(made: &LayerReport) -> Vec<String> {
    let at = |places: &[[f64; 3]]| match places.first() {
        Some([x, y, z]) => format!(", first near [{x:.4}, {y:.4}, {z:.4}]"),
        None => String::new(),
    };
    let mut notes = Vec::new();
    if made.welded.count > 0 {
        let widest: Vec<[f64; 3]> = made.welded.widest.iter().map(|crossing| crossing.place).collect();
        let place = at(&widest);
        notes.push(format!(
            "{} gaps narrower than a cell are filled, and their sides hang together{place}; smaller cells part them",
            made.welded.count
        ));
    }
    if made.dropped.parts > 0 {
        let place = at(&made.dropped.places);
        notes.push(format!(
            "{} bits thinner than a cell are left out{place}; smaller cells hold them",
            made.dropped.parts
        ));
    }
    if made.volume_difference.abs() > VOLUME {
        let percent = 100.0 * made.volume_difference;
        notes.push(format!("the layer's volume is {percent:+.1} % off the skin's; choose a smaller cell"));
    }
    notes
}

fn largest_extent(mesh: &TriangleMesh) -> f64 {
    let low = mesh.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    (mesh.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - low).max_element()
}

/// A layer's volume may differ from the skin's by this much without a word.
const VOLUME: f64 = 0.02;

/// Proxies of a skin, and the skin back.
fn cover(keys: &Keys, mesh: TriangleMesh, hulls: Option<u32>) -> Result<(TriangleMesh, Vec<Proxy>)> {
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let made = hulls.map_or_else(|| proxies(&skin), |hulls| proxy::at_most(&skin, hulls));
    let proxies = made.map_err(|p| keys.error("surface", p, "give a closed surface with volume"))?;
    let Skin { vertices, triangles, .. } = skin;
    Ok((TriangleMesh { vertices, triangles }, proxies))
}
