//! The output of `palpate query`, which finds where two undeformed surfaces, a and b, overlap: a table on the terminal,
//! `contacts.csv` and `query.json`. The query runs in *stages* on the GPU.

use std::fmt;
use std::io::Write;

use palpate::QueryContact;
use palpate::internal::query::Answer;
use palpate::internal::stages::POSE_TO_CONTACT;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::StageSamples;
use super::summary::quantiles;

const HEAD: &str = "body,vertex,depth_m,nx,ny,nz,triangle,u,v,w";

/// One of the two surfaces.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Subject {
    /// File or model of the surface.
    pub surface: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of this surface's vertices that lie within the other surface.
    pub contacts: usize,
    /// Notes on what preparation changed in the data of the surface's file, one line each.
    pub notes: Vec<String>,
}

/// The contents of `query.json`.
#[derive(Debug, Clone, Default, Serialize)]
pub struct QueryReport {
    /// Name of the Vulkan device.
    pub device: String,
    /// Name and version of the device's driver.
    pub driver: String,
    /// Name of the implementation of the depth stage, which finds where rays from the vertices of one surface meet
    /// triangles of the other.
    pub depth_path: String,
    /// The first surface.
    pub a: Subject,
    /// The second surface.
    pub b: Subject,
    /// Position (m) of b, and its orientation as a quaternion (x y z w).
    pub pose_b: [f64; 7],
    /// Depth beyond which a flag is raised, m.
    pub depth_limit_m: f64,
    /// Number of runs; every run gives the same answer.
    pub runs: usize,
    /// `median` and `p99` (99th percentile) of times, microseconds: of each stage; of all stages timed as one (`pose to
    /// contact`, in every other run); and of the whole `query` (wall time, which includes writing the timestamps).
    pub stage_us: Map<String, Value>,
    /// Number of GPU passes (dispatches, draws, fills and copies) by stage.
    pub passes: Map<String, Value>,
    /// Number of chunks (groups of at most 64 vertices of a surface, culled as a whole) that passed culling.
    pub chunks: u32,
    /// Number of ray hits: a vertex's ray along the contact normal meets a triangle of the other surface.
    pub crossings: u32,
    /// Number of colliding vertices of both surfaces.
    pub contacts: usize,
    /// Greatest depth, m; null without contact.
    pub max_depth_m: Option<f64>,
    /// For each contact patch (place with one contact normal) the `normal`, and the patch's `extent_m` along its two
    /// tangents.
    pub regions: Vec<Value>,
    /// Names of the flags that were raised.
    pub flags: Vec<&'static str>,
    /// Version of palpate.
    pub version: &'static str,
    /// Body (0 for a, 1 for b) and vertex with the greatest depth; printed in the table, left out of the file.
    #[serde(skip)]
    pub deepest: Option<(usize, u32)>,
}

impl QueryReport {
    /// Adds the answer of a query.
    pub fn add_answer(&mut self, answer: &Answer) {
        let of = |body: usize| answer.contacts.iter().filter(|contact| contact.body == body).count();
        (self.a.contacts, self.b.contacts) = (of(0), of(1));
        (self.chunks, self.crossings) = (answer.counts.chunks, answer.counts.hits);
        self.contacts = answer.contacts.len();
        // The deepest contact; if several are equally deep, the first of them.
        let deepest = answer.contacts.iter().rev().max_by(|x, y| x.depth.total_cmp(&y.depth));
        self.max_depth_m = deepest.map(|contact| contact.depth);
        self.deepest = deepest.map(|contact| (contact.body, contact.vertex));
        let region = |region: &palpate::internal::shaders::ContactPatch| {
            json!({
                "normal": region.normal,
                "extent_m": [region.high[0] - region.low[0], region.high[1] - region.low[1]],
            })
        };
        self.regions = answer.contact_patches.iter().map(region).collect();
        self.flags = answer.flags.names().collect();
        self.version = env!("CARGO_PKG_VERSION");
    }

    /// Adds the times of the stages, and the wall time of each run, microseconds.
    pub fn add_times(&mut self, stages: &[StageSamples], wall_us: &[f64]) {
        self.runs = wall_us.len();
        let times = |(median, p99): (f64, f64)| json!({ "median": median, "p99": p99 });
        self.stage_us = stages.iter().filter_map(|s| Some((s.stage.clone(), times(s.quantiles()?)))).collect();
        self.stage_us.extend(quantiles(wall_us).map(|query| ("query".into(), times(query))));
        self.passes = stages.iter().map(|s| (s.stage.clone(), s.passes.into())).collect();
    }
}

impl fmt::Display for QueryReport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{:<16} {:>6} {:>12} {:>12}", "stage", "passes", "median us", "p99 us")?;
        for (stage, times) in &self.stage_us {
            let passes = self.passes.get(stage).and_then(Value::as_u64);
            let all = || self.passes.get(POSE_TO_CONTACT).and_then(Value::as_u64);
            let passes = passes.or_else(all).unwrap_or(0);
            let [median, p99] = ["median", "p99"].map(|key| times[key].as_f64().unwrap_or(0.0));
            writeln!(f, "{stage:<16} {passes:>6} {median:>12.1} {p99:>12.1}")?;
        }
        writeln!(f, "device: {} ({}), {} runs", self.device, self.driver, self.runs)?;
        for (name, Subject { surface, vertices, triangles, contacts, .. }) in [("a", &self.a), ("b", &self.b)] {
            writeln!(f, "{name}: {surface}: {vertices} vertices, {triangles} triangles, {contacts} contacts")?;
        }
        for region in &self.regions {
            let normal = [0, 1, 2].map(|k| region["normal"][k].as_f64().unwrap_or(0.0));
            writeln!(f, "contact patch: normal {:.6} {:.6} {:.6}", normal[0], normal[1], normal[2])?;
        }
        if let (Some(depth), Some((body, vertex))) = (self.max_depth_m, self.deepest) {
            writeln!(f, "deepest: {depth:.6e} m at vertex {vertex} of {}", ["a", "b"][body.min(1)])?;
        }
        writeln!(f, "flags: {}", if self.flags.is_empty() { "none".into() } else { self.flags.join(", ") })
    }
}

/// Writes contacts as CSV: one row per colliding vertex, first the vertices of a. Each number has the shortest form
/// that is read back as the same f64.
pub fn write_contacts(w: &mut impl Write, contacts: &[QueryContact]) -> std::io::Result<()> {
    writeln!(w, "{HEAD}")?;
    for contact in contacts {
        let [x, y, z] = contact.normal.to_array();
        let [u, v, q] = contact.barycentric;
        write!(w, "{},{},{:?},{x:?},{y:?},{z:?}", ["a", "b"][contact.body.min(1)], contact.vertex, contact.depth)?;
        writeln!(w, ",{},{u:?},{v:?},{q:?}", contact.triangle)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use palpate::Flags;
    use palpate::internal::shaders::Counts;

    use super::*;

    fn answer() -> Answer {
        let contact = |body, vertex, depth| QueryContact {
            body,
            vertex,
            depth,
            normal: DVec3::Z,
            triangle: 7,
            barycentric: [0.5, 0.25, 0.25],
            area: 1.0,
        };
        Answer {
            contacts: vec![contact(0, 3, 1e-3), contact(1, 0, 2.5e-3), contact(1, 9, 2.5e-3)],
            contact_patches: vec![],
            origin: DVec3::ZERO,
            flags: Flags::NOT_A_HEIGHT_FIELD,
            counts: Counts { chunks: 12, hits: 30, ..Counts::default() },
            stage_times: vec![],
        }
    }

    #[test]
    fn the_report_says_what_was_found() {
        let mut report = QueryReport::default();
        report.add_answer(&answer());
        let cull = StageSamples { stage: "cull".into(), passes: 3, us: vec![3.0, 1.0, 2.0] };
        let all = StageSamples { stage: POSE_TO_CONTACT.into(), passes: 5, us: vec![6.0] };
        report.add_times(&[cull, all], &[9.0, 8.0, 7.0]);
        let value = serde_json::to_value(&report).unwrap();
        assert_eq!(value["stage_us"]["cull"], json!({ "median": 2.0, "p99": 3.0 }));
        assert_eq!((&value["contacts"], &value["b"]["contacts"]), (&json!(3), &json!(2)));
        assert_eq!((&value["flags"], &value["max_depth_m"]), (&json!(["not_a_height_field"]), &json!(2.5e-3)));
        let text = report.to_string();
        assert!(text.contains("deepest: 2.500000e-3 m at vertex 0 of b"), "no line names the deepest contact: {text}");
        assert!(
            text.contains("query                 5          8.0          9.0"),
            "no line has the wall time of the query: {text}"
        );
    }

    #[test]
    fn contacts_stand_under_their_heads() {
        let mut bytes = Vec::new();
        write_contacts(&mut bytes, &answer().contacts[..1]).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert_eq!(text, format!("{HEAD}\na,3,0.001,0.0,0.0,1.0,7,0.5,0.25,0.25\n"));
    }
}
