//! The report on the preparation of a body, before the first step: facts about its *skin* (surface mesh), *layer*
//! (tetrahedral mesh of a soft body) and *proxies* (convex hulls that cover the skin, each of which owns some of its
//! triangles), repairs, times and memory. The command `palpate prepare` writes it as `report.json` and displays it as a
//! short text.

use std::fmt;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;

use super::repair::RepairReport;
use super::stuffing::LayerReport;
use super::{Layer, Proxy, Shape, Skin, coverage, embed, layer, mass, quality, repair, skin};
use crate::Result;

/// A stage of the preparation; the variants are in the order in which the stages run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Looks up the results of the costly stages in the cache, or stores them there.
    Cache,
    /// Reads or generates the surface.
    Read,
    /// Finds and repairs defects of the surface.
    Repair,
    /// Makes or reads the layer (tetrahedral mesh).
    Layer,
    /// Embeds the skin's vertices in the layer.
    Embed,
    /// Makes the convex hulls that cover the skin.
    Proxies,
    /// Attaches nodes of the layer to rigid cores (rigid bodies inside the soft one), and scales everything.
    Bind,
    /// Nothing: the body is ready. Only the progress of several bodies tells of this stage.
    Ready,
}

impl Stage {
    /// Name of the stage, for display.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Cache => "cache",
            Stage::Read => "read",
            Stage::Repair => "repair",
            Stage::Layer => "layer",
            Stage::Embed => "embed",
            Stage::Proxies => "proxies",
            Stage::Bind => "bind",
            Stage::Ready => "ready",
        }
    }
}

/// Where a prepared body came from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CacheUse {
    /// It was made, and the cache was not looked into.
    #[default]
    Off,
    /// It was made and stored in the cache, if the cache can be written.
    Made,
    /// It was read from the cache.
    Found,
}

/// A callback that is called at the beginning of each stage. If it returns an error, the preparation stops with that
/// error.
pub type Watch<'a> = dyn FnMut(Stage) -> Result<()> + 'a;

/// Log of a preparation: calls the callback at the beginning of each stage, and measures the stages' times.
pub struct Log<'a> {
    watch: &'a mut Watch<'a>,
    /// Wall-clock time of each stage that ran, s.
    pub seconds: Vec<(Stage, f64)>,
    /// Whether the body was made, or read from the cache.
    pub cache: CacheUse,
    /// Information for the user that needs no action.
    pub notes: Vec<String>,
    /// Report on the layer if it was made by filling the surface with tetrahedra.
    pub filling: Option<LayerReport>,
}

impl<'a> Log<'a> {
    /// A log that calls `watch` as each stage begins.
    pub fn new(watch: &'a mut Watch<'a>) -> Self {
        Log { watch, seconds: Vec::new(), cache: CacheUse::Off, notes: Vec::new(), filling: None }
    }

    /// Calls the callback; unless it returns an error, runs a stage and adds its time to the log.
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

/// The report on one body. Lengths are in metres, after scaling, unless said otherwise.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Name of the body.
    pub name: String,
    /// Facts about the skin after the repair.
    pub skin: SkinFacts,
    /// Report on the repair of the surface, in file coordinates; null if the engine generated the surface itself.
    pub repair: Option<RepairReport>,
    /// Facts about the layer of a soft body; null for a rigid body.
    pub layer: Option<LayerFacts>,
    /// Facts about the proxies.
    pub proxies: ProxyFacts,
    /// Whether the body was made or found in the cache.
    pub cache: CacheUse,
    /// Wall-clock time of each stage, s.
    pub seconds: serde_json::Map<String, serde_json::Value>,
    /// Greatest memory use of the process until now, bytes; null if the operating system does not report it.
    pub peak_memory_bytes: Option<u64>,
    /// Information for the user.
    pub notes: Vec<String>,
    /// Version of palpate that prepared the body.
    pub version: &'static str,
}

/// Facts about the skin, the surface mesh.
#[derive(Debug, Clone, Serialize)]
pub struct SkinFacts {
    /// Number of vertices, including unused ones.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of connected parts: two triangles belong to one part if they are connected through shared vertices.
    pub components: usize,
    /// Number of edges with one triangle.
    pub boundary_edges: usize,
    /// Number of edges with three or more triangles, or with two that run along the edge in the same direction.
    pub non_manifold_edges: usize,
    /// Enclosed volume with holes closed by triangle fans, m^3.
    pub volume_m3: f64,
    /// Size of the bounding box along the axes, m.
    pub extent_m: [f64; 3],
}

/// Facts about the layer, the tetrahedral simulation mesh.
#[derive(Debug, Clone, Serialize)]
pub struct LayerFacts {
    /// Number of nodes.
    pub nodes: usize,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Volume of the layer, m^3.
    pub volume_m3: f64,
    /// Ratio of the layer's volume to the skin's, less one. For a layer made by filling the surface, the value is taken
    /// from the report on the filling (`LayerReport::volume_difference`).
    pub volume_difference: f64,
    /// Smallest dihedral angle, degrees.
    pub worst_dihedral_deg: f64,
    /// First percentile of the tetrahedra's smallest dihedral angles, degrees.
    pub first_percentile_dihedral_deg: f64,
    /// How far the least embedding weight (weight with which a skin vertex follows a node of its tetrahedron) lies
    /// below zero; 0 if all skin vertices lie inside the layer.
    pub largest_extrapolation: f64,
    /// Number of nodes attached to rigid cores.
    pub bound_nodes: usize,
    /// Report on the filling of the surface with tetrahedra, in file coordinates; null for a layer that was not made by
    /// filling.
    pub filling: Option<LayerReport>,
}

/// Facts about the proxies, the convex hulls that cover the skin.
#[derive(Debug, Clone, Serialize)]
pub struct ProxyFacts {
    /// Number of proxies.
    pub count: usize,
    /// Number of vertices of the hull that has the most vertices.
    pub most_hull_vertices: usize,
    /// Number of triangles of all hulls together.
    pub hull_triangles: usize,
    /// Number of distinct face planes of all hulls together.
    pub hull_faces: usize,
    /// Number of skin triangles of the proxy that owns the most triangles.
    pub most_skin_triangles: usize,
    /// Greatest distance by which skin sticks out of the hull of the proxy that owns it, m.
    pub largest_margin_m: f64,
    /// Share of the skin's vertices that lie inside at least one hull, when each hull is inflated by its margin
    /// (distance by which the skin of its proxy sticks out); 1 means all vertices.
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
            // The report on the filling has a better value: it counts overlapping pieces of the surface once, and
            // includes the inner volume that a hollow layer (with `thickness`) leaves out.
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
        bound_nodes: layer.attached.iter().filter(|&&bound| bound).count(),
    }
}

fn proxy_facts(skin: &Skin, proxies: &[Proxy]) -> ProxyFacts {
    ProxyFacts {
        count: proxies.len(),
        most_hull_vertices: proxies.iter().map(|p| p.hull.len()).max().unwrap_or(0),
        // By Euler's formula a triangulated hull with n vertices has 2 n - 4 triangles.
        hull_triangles: proxies.iter().map(|p| 2 * p.hull.len() - 4).sum(),
        hull_faces: proxies.iter().map(|p| p.faces.len()).sum(),
        most_skin_triangles: proxies.iter().map(|p| p.triangles.len()).max().unwrap_or(0),
        largest_margin_m: proxies.iter().map(|p| p.margin).fold(0.0, f64::max),
        coverage: coverage::share(skin, proxies),
    }
}

/// Peak resident memory of the process, bytes, if the operating system reports it (Linux does).
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
            let state = if repair.is_clean() { "sound" } else { "repaired, see the notes" };
            writeln!(f, "surface: {state}, {} pairs of triangles intersect", repair.self_intersections.count)?;
        }
        if let Some(layer) = &self.layer {
            let off = format!("{:+.2} % off the skin's", 100.0 * layer.volume_difference);
            // A hollow layer, which a thickness makes, is compared with its inside.
            let is_hollow = layer.volume_m3 < 0.99 * (1.0 + layer.volume_difference) * skin.volume_m3;
            let volume = match is_hollow {
                true => format!("a shell of {:.6e} m^3, with its inside {off}", layer.volume_m3),
                false => format!("volume {off}"),
            };
            writeln!(
                f,
                "layer: {} nodes, {} tetrahedra, {volume}, least dihedral angle {:.1} degrees \
                 (above {:.1} degrees in 99 % of the tetrahedra), largest extrapolation {:.2e}",
                layer.nodes,
                layer.tetrahedra,
                layer.worst_dihedral_deg,
                layer.first_percentile_dihedral_deg,
                layer.largest_extrapolation
            )?;
        }
        writeln!(
            f,
            "proxies: {}, with hulls of at most {} vertices and {} triangles in all; the skin is up to {:.2e} m \
             outside the hulls; a proxy has at most {} skin triangles; {:.2} % of the skin's vertices are covered",
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
