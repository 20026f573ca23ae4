//! The report of the proximity benchmark, made from its [`Results`]. The benchmark times the query (the stages of a
//! step that find contacts: broad phase, narrow phase, contacts) by itself. All numbers of the report's findings (the
//! sentences that answer a section's question) are computed from the measurements. A skin is a body's surface mesh.

use palpate::Result;
use palpate::internal::stages::QUERY;
use serde_json::Value;

use super::{Area, Peers, Place, Results, Sensitivity};
use crate::plot::{Axis, Bar, Line, bars, lines};
use crate::{Section, Table};

/// Greatest allowed ratio of the query's time for the largest skin to its time for the smallest.
const ALLOWED_RATIO: f64 = 1.5;
/// Quoted times, ms, of queries that find the closest points of one body for the vertices of another body of 30,000
/// vertices, on one CPU core of another machine. The first time is for the 713 vertices that lie in the intersection of
/// the two bodies' bounding boxes, the second for all vertices.
const QUOTED_MS: [f64; 2] = [2.3, 11.0];

/// Text that says how the benchmark was measured.
pub fn preface(settings: &Value) -> String {
    format!(
        "Times are medians of {} runs (half as many in the section on contact area) by the device's own clock, stage by stage. A total is \
         the median of as many other runs, each timed as a whole without timestamps between its stages.",
        settings["runs"]
    )
}

/// A section for each part of the benchmark that was measured.
pub fn sections(results: &Results) -> Result<Vec<Section>> {
    let mut sections = Vec::new();
    if !results.sensitivity.is_empty() {
        sections.push(sensitivity(&results.sensitivity)?);
    }
    if !results.area.is_empty() {
        sections.push(area(&results.area)?);
    }
    if let Some(found) = &results.peers {
        sections.push(peers(found)?);
    }
    Ok(sections)
}

fn heads(first: &[&str]) -> Table {
    let stages = QUERY.map(|stage| format!("{stage} ms"));
    let first = first.iter().map(|head| head.to_string());
    Table::new(first.chain(stages).chain(["total ms".to_string()]))
}

/// Table cells with times in ms: the median time of each stage, and that of the whole query.
fn times(place: &Place) -> impl Iterator<Item = String> {
    place.samples_us.medians_ms().into_iter().chain([place.samples_us.total_ms()]).map(ms)
}

fn ms(time: f64) -> String {
    format!("{time:.3}")
}

/// Lines of a plot: the time of the whole query and the time of each stage, over the given x values.
fn stage_lines<'a>(points: impl Iterator<Item = (f64, &'a Place)> + Clone) -> Vec<Line> {
    let total = points.clone().map(|(x, place)| (x, place.samples_us.total_ms())).collect();
    let stage = |(k, name): (usize, &str)| Line {
        name: name.into(),
        points: points.clone().map(|(x, place)| (x, place.samples_us.medians_ms()[k])).collect(),
        ..Line::default()
    };
    let mut all = vec![Line { name: "total".into(), points: total, ..Line::default() }];
    all.extend(QUERY.into_iter().enumerate().map(stage));
    all
}

/// A sentence that names the flags (warnings) that any query raised; empty if no flag was raised.
fn flagged<'a>(flags: impl Iterator<Item = &'a String>) -> String {
    let mut names: Vec<&str> = flags.map(String::as_str).collect();
    names.sort_unstable();
    names.dedup();
    if names.is_empty() { String::new() } else { format!(" Flags were raised: {}.", names.join(", ")) }
}

fn sensitivity(rows: &[Sensitivity]) -> Result<Section> {
    let mut table = heads(&["vertices", "proxies", "chunks", "contacts"]);
    table.heads.push("ratio".into());
    let first = rows.first().map_or(0.0, |row| row.place.samples_us.total_ms());
    for Sensitivity { vertices, proxies, place, .. } in rows {
        let whole = [vertices.to_string(), proxies.to_string(), place.chunks.to_string(), place.contacts.to_string()];
        let ratio = format!("{:.2}", place.samples_us.total_ms() / first);
        table.rows.push(whole.into_iter().chain(times(place)).chain([ratio]).collect());
    }
    let names = rows.iter().map(|row| format!("{:.0} k", 1e-3 * row.vertices as f64)).collect();
    let axis = Axis { label: "vertices of the skin".into(), names };
    let points = rows.iter().enumerate().map(|(k, row)| (k as f64, &row.place));
    let flags = flagged(rows.iter().flat_map(|row| &row.place.flags));
    Ok(Section {
        title: "Output sensitivity".into(),
        question: "Does the query's time depend on the contact or on the mesh? A ball is pressed by 1 mm into bodies \
                   whose triangles are the same, bit for bit, about the contact and ever finer elsewhere. `chunks` is \
                   the number of groups of at most 64 vertices, of both skins, that culling kept."
            .into(),
        table,
        plot: Some(lines(&axis, "median time, ms", &stage_lines(points))?),
        finding: sensitivity_finding(rows) + &flags,
        ..Section::default()
    })
}

fn sensitivity_finding(rows: &[Sensitivity]) -> String {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return "nothing was measured.".into() };
    let ratio = last.place.samples_us.total_ms() / first.place.samples_us.total_ms();
    let verdict = if ratio <= ALLOWED_RATIO { "within" } else { "beyond" };
    format!(
        "From {} to {} vertices, {:.0} times as many, the query takes {ratio:.2} times as long: {verdict} the allowed \
         ratio of {ALLOWED_RATIO}.",
        first.vertices,
        last.vertices,
        last.vertices as f64 / first.vertices as f64
    )
}

fn area(rows: &[Area]) -> Result<Section> {
    let mut table = heads(&["area cm^2", "contacts", "chunks", "depth mm"]);
    for Area { place, .. } in rows {
        let area = format!("{:.2}", 1e4 * place.area);
        let depth = format!("{:.2}", 1e3 * place.max_depth);
        let whole = [area, place.contacts.to_string(), place.chunks.to_string(), depth];
        table.rows.push(whole.into_iter().chain(times(place)).collect());
    }
    let axis = Axis { label: "contact area, cm^2".into(), names: Vec::new() };
    let points = rows.iter().map(|row| (1e4 * row.place.area, &row.place));
    let vertices = rows.first().map_or(0, |row| row.vertices);
    let flags = flagged(rows.iter().flat_map(|row| &row.place.flags));
    Ok(Section {
        title: "Time against contact area".into(),
        question: format!(
            "What does a larger contact area cost? Two equal skins of {vertices} vertices each, with triangle edges \
             of 0.8 mm, are pressed together; the area is that of the contacts of both skins. In the first row there \
             is a gap of 0.5 mm between the skins."
        ),
        table,
        plot: Some(lines(&axis, "median time, ms", &stage_lines(points))?),
        finding: area_finding(rows) + &flags,
        ..Section::default()
    })
}

/// Says in words what more contact area costs, from the first row with contacts to the last row.
fn area_finding(rows: &[Area]) -> String {
    let touching: Vec<&Place> = rows.iter().map(|row| &row.place).filter(|place| place.contacts > 0).collect();
    let [first, second, .., before, last] = touching[..] else { return "too few rows with contacts.".into() };
    let (cm2, time) = (|place: &Place| 1e4 * place.area, |place: &Place| place.samples_us.total_ms());
    let slope = |a: &Place, b: &Place| (time(b) - time(a)) / (cm2(b) - cm2(a));
    let stages = last.samples_us.medians_ms().into_iter().zip(QUERY);
    let (longest, stage) = stages.fold((0.0, ""), |most, stage| if stage.0 > most.0 { stage } else { most });
    format!(
        "From {:.1} to {:.1} cm^2, {:.1} times the area, the query takes {:.1} times as long ({:.2} and {:.2} ms). \
         One more cm^2 costs {:.2} ms between the first two areas and {:.2} ms between the last two; at the last, \
         {:.0} % of the time is that of the stage `{stage}`.",
        cm2(first),
        cm2(last),
        cm2(last) / cm2(first),
        time(last) / time(first),
        time(first),
        time(last),
        slope(first, second),
        slope(before, last),
        100.0 * longest / time(last)
    )
}

fn peers(peers: &Peers) -> Result<Section> {
    let Peers { vertices: [small, large], inside, boxed, colliding, place, .. } = peers;
    let total = place.samples_us.total_ms();
    let mut table = Table::new(["method", "vertices tested", "body", "colliding vertices", "ms"]);
    let mut row = |cells: [String; 5]| table.rows.push(cells.into());
    row([
        "palpate: depth along the normal".into(),
        (small + large).to_string(),
        "both".into(),
        format!("{} + {}", colliding[0], colliding[1]),
        ms(total),
    ]);
    let one = |name: &str, asked: usize, time: f64| {
        [name.to_string(), asked.to_string(), "pumpkin".into(), inside.to_string(), ms(time)]
    };
    row(one("parry3d f64: closest point, in the box", *boxed, peers.boxed_ms()));
    row(one("parry3d f64: closest point, all", *small, peers.all_ms()));
    row(["parry3d f64: bounding-volume tree and normals of the head, refitted", "", "", "", &ms(peers.refit_ms())]
        .map(String::from));
    let quoted = |name: &str, asked: &str, time: f64| [name, asked, "one", "320", &ms(time)].map(String::from);
    row(quoted("quoted: closest point, in the box", "713", QUOTED_MS[0]));
    row(quoted("quoted: closest point, all", "30000", QUOTED_MS[1]));
    let bar = |name: &str, length: f64, kind: usize| Bar { name: name.into(), length, kind };
    let drawn = [
        bar("palpate, both skins", total, 0),
        bar("parry3d, in the box", peers.boxed_ms(), 1),
        bar("parry3d, all", peers.all_ms(), 1),
        bar("parry3d, refit", peers.refit_ms(), 1),
        bar("quoted, in the box", QUOTED_MS[0], 2),
        bar("quoted, all", QUOTED_MS[1], 2),
    ];
    Ok(Section {
        title: "Comparison with closest-point queries".into(),
        question: format!(
            "How long do other methods take for the same pose? A pumpkin of {small} vertices is pressed into the back \
             of a head of {large}. Closest points within {:.0} mm give the Euclidean depth of the pumpkin's vertices \
             only, on one core, by a tree of boxes that is built beforehand and would have to be refitted in each \
             step in which the head deforms. palpate's query gives the depth along the contact's normal for both \
             bodies, and culls and places them in each run. The quoted times are of another machine, for 30,000 \
             vertices against a skin of 41,000, with 320 colliding vertices.",
            1e3 * peers.reach
        ),
        table,
        plot: Some(bars("median time, ms", &drawn)?),
        finding: peers_finding(peers) + &flagged(place.flags.iter()),
        ..Section::default()
    })
}

fn peers_finding(peers: &Peers) -> String {
    let total = peers.place.samples_us.total_ms();
    let against = |time: f64| match time / total {
        ratio if ratio > 1.0 => format!("{ratio:.2} times as fast as"),
        ratio => format!("{:.2} times as slow as", 1.0 / ratio),
    };
    format!(
        "palpate's query of both skins ({:.2} ms) is {} closest points for the {} vertices in the box ({:.2} ms; \
         {:.2} ms with the refit), and {} closest points for all vertices ({:.2} ms). It is {} the quoted query of {} \
         ms in the box, and {} the quoted one of {} ms for all vertices.",
        total,
        against(peers.boxed_ms()),
        peers.boxed,
        peers.boxed_ms(),
        peers.boxed_ms() + peers.refit_ms(),
        against(peers.all_ms()),
        peers.all_ms(),
        against(QUOTED_MS[0]),
        QUOTED_MS[0],
        against(QUOTED_MS[1]),
        QUOTED_MS[1]
    )
}

#[cfg(test)]
#[path = "document_tests.rs"]
mod tests;
