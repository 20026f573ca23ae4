//! Makes the costly parts of a body, in *file coordinates* (those of the mesh files, before `scale`): the repaired
//! *skin* (surface mesh), the *layer* (tetrahedral mesh of a soft body), the *embedding* (for each skin vertex a
//! tetrahedron of the layer, and weights of its nodes), and the *proxies* (convex hulls that cover the skin, for
//! collision). They are made once, before the first step, and then cached. `body.rs` does the cheap rest each time: it
//! attaches nodes to rigid cores (rigid bodies inside the soft one), sets materials, and scales and places the body.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::body::Keys;
use super::cache::{Cache, Entry, Key, KeyMaker};
use super::repair::{self, RepairReport};
use super::report::{CacheUse, Log, Stage};
use super::stuffing::{self, LayerReport, Options, stuff};
use super::{Embedding, Layer, MAX_HULL_VERTICES, Proxy, Skin, embed, layer, proxies, proxy, skin};
use crate::scene::groups::Groups;
use crate::scene::tetrahedra::{self, TetMesh};
use crate::scene::triangles::{self, TriangleFile, TriangleMesh};
use crate::scene::{self, Surface};
use crate::{Result, files, memory};

/// Advice in the message about a refused cell size. A cell is a cube of the lattice from which the layer is made.
const UNITS: &str = "give cells in the file's coordinates, before `scale`";

/// Sources and parameters from which the costly parts are made.
#[derive(Debug, Clone)]
pub struct Recipe<'a> {
    /// Source of the skin; without it the skin is the layer's boundary.
    pub surface: Option<&'a Surface>,
    /// Source of the layer; without it the body is rigid.
    pub layer: Option<&'a scene::Layer>,
    /// Greatest number of proxies; `None` stands for the default number.
    pub hulls: Option<u32>,
}

/// The costly parts of a body, in file coordinates.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Prepared {
    /// Vertices and triangles of the skin.
    pub mesh: TriangleMesh,
    /// The layer of a soft body, with no node attached to a rigid core yet.
    pub layer: Option<Layer>,
    /// Groups of tetrahedra and of nodes that the layer's file defines.
    pub groups: Groups,
    /// Report on the layer if it was made by filling the surface with tetrahedra.
    pub filling: Option<LayerReport>,
    /// For each node of the layer, its number in the layer's file, in ascending order; unused nodes of the file are
    /// left out.
    pub node_numbers: Vec<u32>,
    /// Notes on parts of the surface's file that were left out, one sentence each.
    pub surface_notes: Vec<String>,
    /// Notes on parts of the layer's file or of the surface's shape that were left out or changed, one sentence each.
    pub layer_notes: Vec<String>,
    /// Embedding of each skin vertex of a soft body in the layer.
    pub embedding: Vec<Embedding>,
    /// Convex hulls that cover the skin.
    pub proxies: Vec<Proxy>,
    /// Report on the repair of a given surface; `None` if the surface was generated here.
    pub repair: Option<RepairReport>,
}

impl Recipe<'_> {
    /// Returns the costly parts of the body, from the cache if it has them; otherwise they are made and stored there.
    pub(super) fn prepared(&self, keys: &Keys, cache: &Cache, log: &mut Log) -> Result<Prepared> {
        // The cache's key depends on the files' contents. An error in reading them is ignored here: `make` reports it.
        let key = if cache.is_on() { log.stage(Stage::Cache, || self.key(keys))?.ok() } else { None };
        let Some(key) = key else { return self.make(keys, log) };
        let damaged = match log.stage(Stage::Cache, || cache.load(&key))? {
            Entry::Found(prepared) if self.can_have_made(&prepared) => {
                log.cache = CacheUse::Found;
                return Ok(prepared);
            }
            Entry::Found(_) => cache.path(&key),
            Entry::Damaged(file) => Some(file),
            Entry::Missing => None,
        };
        log.notes.extend(damaged.map(|file| format!("{} is damaged and is made again", file.display())));
        let prepared = self.make(keys, log)?;
        log.cache = CacheUse::Made;
        // A file that changed while it was read must not be stored under the key of its former contents.
        let kept = log.stage(Stage::Cache, || match self.key(keys) {
            Ok(now) if now == key => cache.store(&key, &prepared),
            _ => Ok(()),
        })?;
        log.notes.extend(kept.err());
        Ok(prepared)
    }

    /// Whether parts read from the cache are of the recipe's kind and fit together: indices, lengths of lists, finite
    /// numbers, volumes above zero. A checksum shows only that an entry is as it was written.
    fn can_have_made(&self, parts: &Prepared) -> bool {
        let are_below = |indices: &[u32], count: usize| indices.iter().all(|&index| (index as usize) < count);
        let are_finite = |points: &[DVec3]| points.iter().all(|point| point.is_finite());
        let (vertices, triangles) = (parts.mesh.vertices.len(), parts.mesh.triangles.len());
        let is_mesh = triangles > 0
            && are_finite(&parts.mesh.vertices)
            && are_below(parts.mesh.triangles.as_flattened(), vertices);
        let is_layer = |layer: &Layer| {
            let (nodes, tetrahedra) = (layer.nodes.len(), layer.tetrahedra.len());
            let is_embedding = |e: &Embedding| {
                (e.tetrahedron as usize) < tetrahedra && e.weights.iter().all(|weight| weight.is_finite())
            };
            tetrahedra > 0
                && are_finite(&layer.nodes)
                && are_below(layer.tetrahedra.as_flattened(), nodes)
                && layer.tetrahedra.iter().all(|t| layer::volume6(&layer.nodes, t) > 0.0)
                && layer.attached.len() == nodes
                && parts.node_numbers.len() == nodes
                && parts.node_numbers.is_sorted_by(|a, b| a < b)
                && [0, tetrahedra].contains(&parts.groups.of.len())
                && parts.embedding.len() == vertices
                && parts.embedding.iter().all(is_embedding)
        };
        let is_proxy = |proxy: &Proxy| {
            (1..=MAX_HULL_VERTICES).contains(&proxy.hull.len())
                && are_finite(&proxy.hull)
                && proxy.faces.len() >= 4
                && proxy.faces.iter().all(|(normal, offset)| normal.is_finite() && offset.is_finite())
                && (0.0..f64::INFINITY).contains(&proxy.margin)
                && proxy.frame == 0
                && !proxy.triangles.is_empty()
        };
        let owned = |of: fn(&Proxy) -> &[u32], count: usize| {
            let mut all: Vec<u32> = parts.proxies.iter().flat_map(of).copied().collect();
            all.sort_unstable();
            all.len() == count && all.iter().zip(0..).all(|(&index, place)| index == place)
        };
        self.layer.is_some() == parts.layer.is_some()
            && is_mesh
            && parts.layer.iter().all(is_layer)
            && parts.proxies.iter().all(is_proxy)
            && owned(|proxy| &proxy.vertices, vertices)
            && owned(|proxy| &proxy.triangles, triangles)
    }

    /// Advice in the error message which says that skin vertices lie far outside the layer.
    fn surrounding(&self) -> &'static str {
        match self.layer {
            Some(scene::Layer::File(_) | scene::Layer::Mesh(_) | scene::Layer::Box { .. }) => {
                "give a layer that surrounds the skin, in the same units"
            }
            _ => "give smaller cells: a part of the skin is too thin for cells of this size",
        }
    }

    /// The cache's key for the parts: a digest of the source code, of the contents of all files, and of every
    /// parameter.
    fn key(&self, keys: &Keys) -> Result<Key> {
        let mut maker = KeyMaker::new();
        match self.surface {
            Some(Surface::File(path)) => triangles::files(path).iter().try_for_each(|f| add_file(&mut maker, f))?,
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

    /// Makes the parts: reads and repairs the surface, makes the layer, embeds the skin, makes the proxies.
    fn make(&self, keys: &Keys, log: &mut Log) -> Result<Prepared> {
        let read = |surface| log.stage(Stage::Read, || read(keys, surface))?;
        let surface = self.surface.map(read).transpose()?;
        let (surface, surface_notes) = surface.map_or((None, Vec::new()), |file| (Some(file.mesh), file.notes));
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
                layer_notes.extend(said.map(|(_, text)| format!("boundary of the layer: {text}")));
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
        Ok(Prepared {
            mesh,
            layer,
            groups,
            filling,
            node_numbers,
            surface_notes,
            layer_notes,
            embedding,
            proxies,
            repair,
        })
    }
}

/// Adds to a key the extension of a file's name, by which the file's reader is chosen, and the file's contents.
fn add_file(maker: &mut KeyMaker, path: &Path) -> Result<()> {
    maker.add(files::extension(path).as_bytes());
    maker.add(&files::mesh(path, "give a mesh file")?);
    Ok(())
}

/// Adds points and elements of a mesh in memory to a key.
fn add_mesh<const N: usize>(maker: &mut KeyMaker, points: &[DVec3], elements: &[[u32; N]]) {
    let coordinates = points.iter().flat_map(|point| point.to_array()).flat_map(f64::to_le_bytes);
    let indices = elements.iter().flatten().flat_map(|index| index.to_le_bytes());
    maker.add(format!("{N} points to an element").as_bytes());
    maker.add(&coordinates.collect::<Vec<u8>>());
    maker.add(&indices.collect::<Vec<u8>>());
}

/// Reads or generates a surface, in file coordinates.
fn read(keys: &Keys, surface: &Surface) -> Result<TriangleFile> {
    let made = |mesh| Ok(TriangleFile { mesh, notes: Vec::new() });
    match surface {
        Surface::File(path) => triangles::read(path),
        Surface::Mesh(mesh) => made((**mesh).clone()),
        Surface::Model { model, vertices } if !model.vertices().contains(vertices) => {
            let range = model.vertices();
            let problem = format!("the model {} cannot be generated with {vertices} vertices", model.name());
            Err(keys.error("surface.vertices", problem, format!("give {} to {}", range.start(), range.end())))
        }
        Surface::Model { model, vertices } => {
            let (vertices, triangles) = crate::prepare::model::surface(*model, *vertices);
            made(TriangleMesh { vertices, triangles })
        }
    }
}

/// The layer's boundary as a surface, and the report on the repair of this surface. Only the boundary of a layer that
/// the user gave is repaired, because elements of such a mesh may overlap or be missing.
fn boundary(keys: &Keys, layer: &Layer, source: Option<&scene::Layer>) -> Result<(TriangleMesh, Option<RepairReport>)> {
    let (vertices, triangles, _) = layer::boundary(layer);
    let mesh = TriangleMesh { vertices, triangles };
    if !matches!(source, Some(scene::Layer::File(_) | scene::Layer::Mesh(_))) {
        return Ok((mesh, None));
    }
    let (mesh, found) = repair::repair(mesh)
        .map_err(|refusal| keys.error("layer", format!("boundary is no skin: {}", refusal.problem), refusal.remedy))?;
    Ok((mesh, Some(found)))
}

/// A layer, its groups of tetrahedra and nodes, notes for the user, and, if the layer was made by filling a surface with
/// tetrahedra, the report on the filling.
#[derive(Default)]
struct Filled {
    layer: Layer,
    groups: Groups,
    notes: Vec<String>,
    report: Option<LayerReport>,
}

/// Makes or reads the layer, in file coordinates and with no node attached to a rigid core.
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
                let problem = format!("gives {count:.0} tetrahedra, allowed are 6 to 4 million");
                return Err(keys.error("layer.cells", problem, "give other numbers of cells"));
            }
            memory::ask(memory::BYTES_PER_TETRAHEDRON * count)
                .map_err(|problem| keys.error("layer.cells", problem, "give fewer cells, or free memory"))?;
            Ok(Filled { layer: layer::kuhn_box(*low, *high, *cells), ..Filled::default() })
        }
    }
}

/// Makes the layer of a tetrahedral mesh that the user gave.
fn given(mesh: TetMesh) -> Filled {
    let bound = vec![false; mesh.nodes.len()];
    let layer = Layer { nodes: mesh.nodes, tetrahedra: mesh.tetrahedra, attached: bound, ..Layer::default() };
    Filled { layer, groups: mesh.groups, notes: mesh.notes, report: None }
}

/// Makes a layer by filling the surface with tetrahedra.
fn fill(mesh: &TriangleMesh, options: Options) -> std::result::Result<Filled, String> {
    // Holes are closed, so that the layer's volume is compared with the volume of the solid that was filled.
    let (vertices, triangles) = repair::closed(&mesh.vertices, &mesh.triangles);
    let (layer, report) = stuff(&vertices, &triangles, &options)?;
    let notes = notes_of(&report);
    Ok(Filled { layer, notes, report: Some(report), ..Filled::default() })
}

/// Removes nodes that belong to no tetrahedron: they have no mass, and their motion has no meaning. The other nodes
/// keep their order. Returns the number of each remaining node in the layer's file, and a note if nodes were removed.
fn drop_unused(layer: &mut Layer) -> (Vec<u32>, Option<String>) {
    let before = layer.nodes.len();
    let numbers = layer::drop_unused(layer);
    let dropped = before - numbers.len();
    let note = format!(
        "{dropped} nodes that belong to no tetrahedron were left out; `nodes` of a core still use the file's numbering"
    );
    (numbers, (dropped > 0).then_some(note))
}

/// Notes on features of the surface that the layer does not follow, one sentence each.
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
            "{} gaps narrower than a cell were filled, which connects their sides{place}; use a smaller cell",
            made.welded.count
        ));
    }
    if made.dropped.parts > 0 {
        let place = at(&made.dropped.places);
        notes.push(format!(
            "{} parts thinner than a cell were left out{place}; use a smaller cell to keep them",
            made.dropped.parts
        ));
    }
    if made.volume_difference.abs() > VOLUME {
        let percent = 100.0 * made.volume_difference;
        notes.push(format!("the layer's volume differs by {percent:+.1} % from the skin's; choose a smaller cell"));
    }
    notes
}

fn largest_extent(mesh: &TriangleMesh) -> f64 {
    let low = mesh.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    (mesh.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - low).max_element()
}

/// Relative difference between the layer's volume and the skin's above which a note tells the user.
const VOLUME: f64 = 0.02;

/// Makes the proxies of the skin `mesh`; returns `mesh` unchanged, and the proxies.
fn cover(keys: &Keys, mesh: TriangleMesh, hulls: Option<u32>) -> Result<(TriangleMesh, Vec<Proxy>)> {
    let skin = skin::build(mesh.vertices, mesh.triangles);
    let made = hulls.map_or_else(|| proxies(&skin), |hulls| proxy::at_most(&skin, hulls));
    let proxies = made.map_err(|p| keys.error("surface", p, "give a closed surface with volume"))?;
    let Skin { vertices, triangles, .. } = skin;
    Ok((TriangleMesh { vertices, triangles }, proxies))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::body_and_report;
    use crate::scene::Scene;

    const BOX: scene::Layer = scene::Layer::Box { low: DVec3::ZERO, high: DVec3::ONE, cells: [2, 1, 1] };
    const SCENE: &str = "[[body]]\nname = \"b\"\nlayer = { box = [[0, 0, 0], [1, 1, 1]], cells = [2, 1, 1] }\n\
                         material = { young = 1e4, poisson = 0.4, density = 1e3 }\n";

    type Spoil = fn(&mut Prepared);

    /// Every way in which an entry under a right checksum may be none that the recipe made.
    #[test]
    fn parts_that_do_not_fit_together_are_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path());
        let scene = Scene::parse(Path::new("scene.toml"), SCENE).unwrap();
        let found = || body_and_report(&scene.bodies[0], &scene, &cache, &mut |_| Ok(())).unwrap().1.unwrap();
        assert_eq!(found().cache, CacheUse::Made);
        assert_eq!(found().cache, CacheUse::Found);
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let recipe = Recipe { surface: None, layer: Some(&BOX), hulls: None };
        let key = recipe.key(&Keys::of_body(&scene, &scene.bodies[0])).unwrap();
        assert_eq!(cache.path(&key), Some(file));
        let Entry::Found(sound) = cache.load::<Prepared>(&key) else { panic!("no entry") };
        let spoil: [(&str, Spoil); 26] = [
            ("no layer", |parts| parts.layer = None),
            ("no triangles", |parts| parts.mesh.triangles.clear()),
            ("a triangle's vertex", |parts| parts.mesh.triangles[3][1] = 12),
            ("a vertex", |parts| parts.mesh.vertices[2].y = f64::NAN),
            ("vertices", |parts| parts.mesh.vertices.push(DVec3::ZERO)),
            ("no tetrahedra", |parts| parts.layer.as_mut().unwrap().tetrahedra.clear()),
            ("a tetrahedron's node", |parts| parts.layer.as_mut().unwrap().tetrahedra[5][0] = 12),
            ("a node", |parts| parts.layer.as_mut().unwrap().nodes[0].x = f64::INFINITY),
            ("a volume", |parts| parts.layer.as_mut().unwrap().tetrahedra[0].swap(0, 1)),
            ("attached", |parts| parts.layer.as_mut().unwrap().attached.truncate(3)),
            ("numbers", |parts| parts.node_numbers.truncate(3)),
            ("order of numbers", |parts| parts.node_numbers.reverse()),
            ("groups", |parts| parts.groups.of.push(None)),
            ("embeddings", |parts| parts.embedding.truncate(3)),
            ("an embedding's tetrahedron", |parts| parts.embedding[0].tetrahedron = 12),
            ("a weight", |parts| parts.embedding[0].weights[0] = f64::NAN),
            ("a hull", |parts| parts.proxies[0].hull = vec![DVec3::ZERO; MAX_HULL_VERTICES + 1]),
            ("no hull", |parts| parts.proxies[0].hull.clear()),
            ("a corner of a hull", |parts| parts.proxies[0].hull[0].z = f64::NAN),
            ("faces", |parts| parts.proxies[0].faces.truncate(3)),
            ("a face", |parts| parts.proxies[0].faces[0].1 = f64::INFINITY),
            ("a margin", |parts| parts.proxies[0].margin = -1.0),
            ("a proxy of nothing", |parts| {
                let idle = Proxy { vertices: Vec::new(), triangles: Vec::new(), ..parts.proxies[0].clone() };
                parts.proxies.push(idle);
            }),
            ("a frame", |parts| parts.proxies[0].frame = 1),
            ("an owner of a vertex", |parts| parts.proxies[0].vertices[0] += 1),
            ("no owner of a triangle", |parts| parts.proxies[0].triangles.truncate(3)),
        ];
        let rigid = Recipe { layer: None, ..recipe.clone() };
        assert!(recipe.can_have_made(&sound) && !rigid.can_have_made(&sound));
        for (what, spoil) in spoil {
            let mut parts = sound.clone();
            spoil(&mut parts);
            cache.store(&key, &parts).unwrap();
            let report = found();
            assert_eq!(report.cache, CacheUse::Made, "{what}");
            assert!(report.notes.iter().any(|note| note.contains("is damaged and is made again")), "{what}");
            assert_eq!(cache.load(&key), Entry::Found(sound.clone()), "{what}");
        }
    }
}
