//! What preparing a body found, made and cost: `report.json` of `palpate prepare`, and its short text.

use std::fmt;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;

use super::repair::RepairReport;
use super::stuffing::LayerReport;
use super::{Layer, Proxy, Shape, Skin, coverage, embed, layer, mass, quality, repair, skin};
use crate::Result;

/// A stage of preparation, in the order in which they run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// A finished body looked for in the cache.
    Cache,
    /// The surface read, or generated.
    Read,
    /// Defects of the surface found and mended.
    Repair,
    /// The layer made or read.
    Layer,
    /// Skin vertices embedded in the layer.
    Embed,
    /// Convex hulls that cover the skin.
    Proxies,
    /// Nodes bound to cores, and everything brought to scale.
    Bind,
}

impl Stage {
    /// Every stage.
    pub const ALL: [Stage; 7] =
        [Stage::Cache, Stage::Read, Stage::Repair, Stage::Layer, Stage::Embed, Stage::Proxies, Stage::Bind];

    /// What is being done, for people.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Cache => "cache",
            Stage::Read => "read",
            Stage::Repair => "repair",
            Stage::Layer => "layer",
            Stage::Embed => "embed",
            Stage::Proxies => "proxies",
            Stage::Bind => "bind",
        }
    }
}

/// Where a body came from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CacheUse {
    /// Made, not looked for.
    #[default]
    Off,
    /// Made, and kept for the next time where the cache can be written.
    Made,
    /// Read from the cache.
    Found,
}

/// Is told each stage as it begins; an error ends the preparation there, and is its error.
pub type Watch<'a> = dyn FnMut(Stage) -> Result<()> + 'a;

/// Follows a preparation: tells the stages as they begin, and keeps their times.
pub struct Log<'a> {
    watch: &'a mut Watch<'a>,
    /// Wall time of each stage that ran, s.
    pub seconds: Vec<(Stage, f64)>,
    /// Where the body came from.
    pub cache: CacheUse,
    /// What the user should know and need not act on.
    pub notes: Vec<String>,
    /// What came of filling the surface with cells.
    pub filling: Option<LayerReport>,
}

impl<'a> Log<'a> {
    /// A log that calls `watch` as each stage begins.
    pub fn new(watch: &'a mut Watch<'a>) -> Self {
        Log { watch, seconds: Vec::new(), cache: CacheUse::Off, notes: Vec::new(), filling: None }
    }

    /// Runs a stage, unless who watches wants it to end here.
    pub fn stage<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> Result<T> {
        (self.watch)(stage)?;
        let begun = Instant::now();
        let result = work();
        let spent = begun.elapsed().as_secs_f64();
        match self.seconds.iter_mut().find(|(known, _)| *known == stage) {
            Some((_, seconds)) => *seconds += spent,
            None => self.seconds.push((stage, spent)),
        }
        Ok(result)
    }
}

/// The report. Lengths are in metres, after scale.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Name of the body.
    pub name: String,
    /// The skin, as repaired.
    pub skin: SkinFacts,
    /// What was found in the surface's file, mended, and left; null where it is not from a file.
    pub repair: Option<RepairReport>,
    /// The layer of a soft body.
    pub layer: Option<LayerFacts>,
    /// Proxies.
    pub proxies: ProxyFacts,
    /// Whether the body was made or found.
    pub cache: CacheUse,
    /// Wall time by stage, s.
    pub seconds: serde_json::Map<String, serde_json::Value>,
    /// Most memory the process ever had, bytes; null where the system does not say.
    pub peak_memory_bytes: Option<u64>,
    /// What the user should know.
    pub notes: Vec<String>,
    /// Version of palpate.
    pub version: &'static str,
}

/// Facts about a skin.
#[derive(Debug, Clone, Serialize)]
pub struct SkinFacts {
    /// Vertices, unused ones included.
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Parts connected through vertices.
    pub components: usize,
    /// Edges of one triangle.
    pub boundary_edges: usize,
    /// Edges of three or more triangles, or of two that run the same way.
    pub non_manifold_edges: usize,
    /// Enclosed volume, holes closed by fans, m^3.
    pub volume_m3: f64,
    /// Box, m.
    pub extent_m: [f64; 3],
}

/// Facts about a layer.
#[derive(Debug, Clone, Serialize)]
pub struct LayerFacts {
    /// Nodes.
    pub nodes: usize,
    /// Tetrahedra.
    pub tetrahedra: usize,
    /// Volume, m^3.
    pub volume_m3: f64,
    /// Volume less the skin's, as a share of the skin's; of a layer made here, of what the skin winds around.
    pub volume_difference: f64,
    /// Least dihedral angle, degrees.
    pub worst_dihedral_deg: f64,
    /// Dihedral angle that one in a hundred falls short of, degrees.
    pub first_percentile_dihedral_deg: f64,
    /// How far below zero the least embedding weight lies; 0 where all skin vertices lie inside.
    pub largest_extrapolation: f64,
    /// Nodes bound to cores.
    pub bound_nodes: usize,
    /// What came of filling the surface with cells, in file coordinates; null for a layer from a file.
    pub filling: Option<LayerReport>,
}

/// Facts about proxies.
#[derive(Debug, Clone, Serialize)]
pub struct ProxyFacts {
    /// How many.
    pub count: usize,
    /// Vertices of the largest hull.
    pub most_hull_vertices: usize,
    /// Triangles of all hulls.
    pub hull_triangles: usize,
    /// Distinct planes of all hulls.
    pub hull_faces: usize,
    /// Skin triangles that the busiest proxy draws.
    pub most_skin_triangles: usize,
    /// Largest distance that owned skin sticks out of its hull, m.
    pub largest_margin_m: f64,
    /// Share of skin vertices inside at least one inflated proxy; 1 is all.
    pub coverage: f64,
}

impl Report {
    /// Measures a prepared body; `None` for a half-space, which has nothing to measure.
    pub fn of(body: &super::Body, log: Log) -> Option<Report> {
        let (skin, proxies, layer) = match &body.shape {
            Shape::Soft { layer, embedding, skin, proxies, .. } => (skin, proxies, Some((layer, embedding))),
            Shape::Rigid { skin, proxies, .. } => (skin, proxies, None),
            Shape::Plane { .. } => return None,
        };
        let facts = skin_facts(skin);
        let layer = layer.map(|(layer, embedding)| {
            let mut measured = layer_facts(layer, embed::extrapolation(embedding), facts.volume_m3);
            // It counts what several sheets enclose once, and the inside that a shell leaves out.
            if let Some(filling) = &log.filling {
                measured.volume_difference = filling.volume_difference;
            }
            LayerFacts { filling: log.filling, ..measured }
        });
        Some(Report {
            name: body.name.clone(),
            skin: facts,
            repair: body.report.repair.clone(),
            layer,
            proxies: proxy_facts(skin, proxies),
            cache: log.cache,
            seconds: log.seconds.iter().map(|(stage, s)| (stage.name().to_string(), (*s).into())).collect(),
            peak_memory_bytes: peak_memory(),
            notes: body.report.notes.clone(),
            version: env!("CARGO_PKG_VERSION"),
        })
    }
}

fn skin_facts(skin: &Skin) -> SkinFacts {
    let (boundary_edges, non_manifold_edges) = skin::defects(&skin.triangles);
    let (vertices, triangles) = repair::closed(&skin.vertices, &skin.triangles);
    let used = |label: &[u32], count: usize| {
        let mut has = vec![false; count];
        skin.triangles.iter().flatten().for_each(|&v| has[label[v as usize] as usize] = true);
        has.into_iter().filter(|&h| h).count()
    };
    let (labels, count) = skin::parts(skin.vertices.len(), &skin.triangles);
    let low = skin.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = skin.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    SkinFacts {
        vertices: skin.vertices.len(),
        triangles: skin.triangles.len(),
        components: used(&labels, count),
        boundary_edges,
        non_manifold_edges,
        volume_m3: mass::properties(&vertices, &triangles).volume,
        extent_m: (high - low).to_array(),
    }
}

fn layer_facts(layer: &Layer, largest_extrapolation: f64, skin_volume: f64) -> LayerFacts {
    let volume = layer.tetrahedra.iter().map(|t| layer::volume6(&layer.nodes, t) / 6.0).sum::<f64>();
    let angles = quality::quality(layer);
    LayerFacts {
        nodes: layer.nodes.len(),
        tetrahedra: layer.tetrahedra.len(),
        volume_m3: volume,
        volume_difference: volume / skin_volume - 1.0,
        worst_dihedral_deg: angles.map_or(f64::NAN, |a| a.worst),
        first_percentile_dihedral_deg: angles.map_or(f64::NAN, |a| a.first_percentile),
        largest_extrapolation,
        filling: None,
        bound_nodes: layer.bound.iter().filter(|&&bound| bound).count(),
    }
}

fn proxy_facts(skin: &Skin, proxies: &[Proxy]) -> ProxyFacts {
    ProxyFacts {
        count: proxies.len(),
        most_hull_vertices: proxies.iter().map(|p| p.hull.len()).max().unwrap_or(0),
        // Euler: a triangulated hull of n vertices has 2 n - 4 triangles.
        hull_triangles: proxies.iter().map(|p| 2 * p.hull.len() - 4).sum(),
        hull_faces: proxies.iter().map(|p| p.faces.len()).sum(),
        most_skin_triangles: proxies.iter().map(|p| p.triangles.len()).max().unwrap_or(0),
        largest_margin_m: proxies.iter().map(|p| p.margin).fold(0.0, f64::max),
        coverage: coverage::share(skin, proxies),
    }
}

/// The process's peak resident memory, bytes, where the system tells (Linux).
pub fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|kilobytes| 1024 * kilobytes)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (skin, proxies) = (&self.skin, &self.proxies);
        let [x, y, z] = skin.extent_m;
        writeln!(f, "{}: {x:.4} x {y:.4} x {z:.4} m", self.name)?;
        writeln!(
            f,
            "skin: {} vertices, {} triangles, {} components, {} boundary edges, {} non-manifold edges, volume {:.6e} m^3",
            skin.vertices,
            skin.triangles,
            skin.components,
            skin.boundary_edges,
            skin.non_manifold_edges,
            skin.volume_m3
        )?;
        if let Some(repair) = &self.repair {
            let state = if repair.is_clean() { "sound" } else { "mended, see the notes" };
            writeln!(f, "surface: {state}, {} pairs of triangles cross", repair.self_intersections.count)?;
        }
        if let Some(layer) = &self.layer {
            writeln!(
                f,
                "layer: {} nodes, {} tetrahedra, volume {:+.2} % of the skin's, dihedral angles from {:.1} degrees \
                 (99 % above {:.1}), largest extrapolation {:.2e}",
                layer.nodes,
                layer.tetrahedra,
                100.0 * layer.volume_difference,
                layer.worst_dihedral_deg,
                layer.first_percentile_dihedral_deg,
                layer.largest_extrapolation
            )?;
        }
        writeln!(
            f,
            "proxies: {}, hulls of at most {} vertices, {} triangles in all; margin up to {:.2e} m; at most {} skin \
             triangles each; cover {:.2} % of the skin",
            proxies.count,
            proxies.most_hull_vertices,
            proxies.hull_triangles,
            proxies.largest_margin_m,
            proxies.most_skin_triangles,
            100.0 * proxies.coverage
        )?;
        let stages: Vec<String> =
            self.seconds.iter().map(|(stage, s)| format!("{stage} {:.2}", s.as_f64().unwrap_or(0.0))).collect();
        write!(f, "seconds: {}", stages.join(", "))?;
        match self.peak_memory_bytes {
            Some(bytes) => writeln!(f, "; peak memory {:.0} MB", bytes as f64 / 1e6)?,
            None => writeln!(f)?,
        }
        self.notes.iter().try_for_each(|note| writeln!(f, "note: {note}"))
    }
}
