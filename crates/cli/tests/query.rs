//! Tests of `palpate query`, which finds the contacts (vertices of one surface inside the other) between two surfaces a
//! and b, through the built program: contacts carry the numbers that vertices and triangles have in the surfaces'
//! files, even if repair changed the meshes; the other output files are written; bad input is refused.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use glam::{DQuat, DVec3};

/// Tolerance of depths and positions, as a share of the bodies' size.
const EXACT: f64 = 1e-5;

fn palpate(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).output().unwrap()
}

/// A row of `contacts.csv`: a vertex of `body` inside the other body, and a point on a `triangle` of the other body.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    body: String,
    vertex: usize,
    depth: f64,
    normal: DVec3,
    triangle: usize,
    barycentric: [f64; 3],
}

/// Vertices and triangles of an OBJ file, in the order in which `contacts.csv` numbers them; convex polygons are split
/// into fans of triangles.
fn parse(text: &str) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let rest = words.iter().skip(1);
        match words.first() {
            Some(&"v") => vertices.push(DVec3::from_slice(&rest.map(|w| w.parse().unwrap()).collect::<Vec<f64>>())),
            Some(&"f") => {
                let corners: Vec<usize> = rest.map(|w| w.parse::<usize>().unwrap() - 1).collect();
                triangles.extend((1..corners.len() - 1).map(|k| [corners[0], corners[k], corners[k + 1]]));
            }
            _ => {}
        }
    }
    (vertices, triangles)
}

struct Case {
    folder: tempfile::TempDir,
    files: [String; 2],
}

impl Case {
    fn new(a: &str, b: &str) -> Case {
        let case = Case { folder: tempfile::tempdir().unwrap(), files: [a.into(), b.into()] };
        for (name, text) in [("a.obj", a), ("b.obj", b)] {
            fs::write(case.folder.path().join(name), text).unwrap();
        }
        case
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().into()
    }

    /// Runs a query; returns the rows of `contacts.csv` and standard output, or `None` if there is no Vulkan device.
    fn ask(&self, options: &[&str]) -> Option<(Vec<Row>, String)> {
        let (a, b, out) = (self.path("a.obj"), self.path("b.obj"), self.path("out"));
        let mut arguments = vec!["query", &a, &b, "--out", &out, "--runs", "2"];
        arguments.extend(options);
        let output = palpate(&arguments);
        if output.status.code() == Some(3) {
            println!("skipped, because there is no Vulkan device: a query through the built program");
            return None;
        }
        assert!(output.status.success(), "palpate query failed: {}", String::from_utf8_lossy(&output.stderr));
        let mut reader = csv::Reader::from_path(self.folder.path().join("out/contacts.csv")).unwrap();
        let heads: Vec<&str> = "body,vertex,depth_m,nx,ny,nz,triangle,u,v,w".split(',').collect();
        assert_eq!(reader.headers().unwrap(), heads);
        let row = |record: csv::StringRecord| {
            let number = |k: usize| record[k].parse::<f64>().unwrap();
            Row {
                body: record[0].into(),
                vertex: record[1].parse().unwrap(),
                depth: number(2),
                normal: DVec3::new(number(3), number(4), number(5)),
                triangle: record[6].parse().unwrap(),
                barycentric: [number(7), number(8), number(9)],
            }
        };
        let rows = reader.records().map(|record| row(record.unwrap())).collect();
        Some((rows, String::from_utf8(output.stdout).unwrap()))
    }

    /// Checks every row against the files: the vertex, moved along the normal by its depth out of the other body, is
    /// the point that the barycentric coordinates give in the row's triangle. `pose_b` is the position (m) and
    /// orientation of body b, `size` the bodies' size (m).
    fn check(&self, rows: &[Row], pose_b: (DVec3, DQuat), size: f64) {
        let [a, mut b] = self.files.each_ref().map(|text| parse(text));
        b.0.iter_mut().for_each(|x| *x = pose_b.0 + pose_b.1 * *x);
        for row in rows {
            let (own, other, sign) = if row.body == "a" { (&a, &b, 1.0) } else { (&b, &a, -1.0) };
            let corners = other.1[row.triangle].map(|v| other.0[v]);
            let point: DVec3 = corners.iter().zip(row.barycentric).map(|(x, w)| *x * w).sum();
            let expected = own.0[row.vertex] - sign * row.depth * row.normal;
            assert!(
                point.distance(expected) < EXACT * size,
                "{row:?}: the point of the triangle must be {expected} m, but it is {point} m"
            );
            assert!((row.normal.length() - 1.0).abs() < 1e-12 && row.depth > 0.0, "wrong normal or depth: {row:?}");
            let sum: f64 = row.barycentric.iter().sum();
            assert!(
                (sum - 1.0).abs() < 1e-12 && row.barycentric.iter().all(|w| *w > -1e-6),
                "wrong barycentric coordinates: {row:?}"
            );
        }
        let mut keys: Vec<_> = rows.iter().map(|row| (row.body.clone(), row.vertex)).collect();
        let sorted = keys.clone();
        keys.sort();
        keys.dedup();
        assert_eq!(keys, sorted, "contacts.csv must list each vertex once, in order");
    }
}

/// Text of an OBJ file of the box between two corners, with six quadrilaterals.
fn cube(low: DVec3, high: DVec3) -> String {
    let at = |k: usize, axis: usize| if (k >> axis) & 1 == 0 { low[axis] } else { high[axis] };
    let lines: String = (0..8).map(|k| format!("v {} {} {}\n", at(k, 0), at(k, 1), at(k, 2))).collect();
    lines + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 2 4 8 6\nf 4 3 7 8\nf 3 1 5 7\n"
}

fn unit() -> String {
    cube(DVec3::ZERO, DVec3::ONE)
}

/// Text of an OBJ file of a cube with edges of 0.5 m, which lies above the unit cube, or reaches into it from above
/// where `z` is less than 1; `z` is the height of its lower face, m.
fn small(z: f64) -> String {
    let low = DVec3::new(0.27, 0.31, z);
    cube(low, low + 0.5)
}

#[test]
fn two_cubes_in_a_known_overlap() {
    let case = Case::new(&unit(), &small(0.96));
    let Some((rows, said)) = case.ask(&[]) else { return };
    case.check(&rows, (DVec3::ZERO, DQuat::IDENTITY), 1.0);
    // The four lower corners of body b lie 0.04 m below the top of body a, which consists of a's triangles 2 and 3.
    assert_eq!(
        rows.iter().map(|row| (row.body.as_str(), row.vertex)).collect::<Vec<_>>(),
        [("b", 0), ("b", 1), ("b", 2), ("b", 3)]
    );
    for row in &rows {
        assert!(
            (row.depth - 0.04).abs() < EXACT && row.normal.distance(DVec3::Z) < EXACT,
            "wrong depth or normal: {row:?}"
        );
        assert!([2, 3].contains(&row.triangle), "wrong triangle: {row:?}");
    }
    assert!(
        said.contains("4 contacts") && said.contains("flags: none") && said.contains("deepest: "),
        "the program printed: {said}"
    );

    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(case.folder.path().join("out/query.json")).unwrap()).unwrap();
    assert_eq!((&report["contacts"], &report["b"]["contacts"], &report["runs"]), (&4.into(), &4.into(), &2.into()));
    assert_eq!((&report["a"]["triangles"], report["regions"].as_array().unwrap().len()), (&12.into(), 1));
    assert!(report["stage_us"]["contact"]["median"].as_f64().unwrap() > 0.0);
    assert!(
        (report["depth_limit_m"].as_f64().unwrap() - 0.05).abs() < 1e-12,
        "the default depth limit must be a tenth of the smaller body's extent"
    );
    let picture = fs::read(case.folder.path().join("out/depth.png")).unwrap();
    assert_eq!(&picture[1..4], b"PNG");
    let mut names: Vec<_> =
        fs::read_dir(case.folder.path().join("out")).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["contacts.csv", "depth.png", "query.json"]);
}

#[test]
fn a_pose_a_direction_and_a_limit_are_obeyed() {
    // Body b is rotated by half a turn about the x axis and moved, so that it reaches 0.05 m into body a from below.
    let case = Case::new(&unit(), &small(0.9));
    let pose = (DVec3::new(-0.05, 1.1, 0.95), DQuat::from_array([1.0, 0.0, 0.0, 0.0]));
    let Some((rows, _)) = case.ask(&["--pose-b", "-0.05,1.1,0.95,1,0,0,0"]) else { return };
    case.check(&rows, pose, 1.0);
    assert!(
        rows.len() == 4
            && rows.iter().all(|r| (r.depth - 0.05).abs() < EXACT && (r.normal + DVec3::Z).length() < EXACT)
    );
    // Along the direction (0, 0.6, 0.8), an overlap of 0.1 m in height is 0.1 m / 0.8 = 0.125 m deep.
    let (rows, said) = case.ask(&["--direction", "0,3,4", "--depth-limit", "0.01"]).unwrap();
    case.check(&rows, (DVec3::ZERO, DQuat::IDENTITY), 1.0);
    assert!(rows.len() == 4 && rows.iter().all(|r| (r.depth - 0.125).abs() < EXACT), "rows of contacts.csv: {rows:?}");
    assert!(rows.iter().all(|r| r.normal.distance(DVec3::new(0.0, 0.6, 0.8)) < 1e-6));
    assert!(said.contains("flags: depth_beyond_limit"), "the program printed: {said}");
    let (rows, said) = case.ask(&["--pose-b", "5,0,0,0,0,0,1"]).unwrap();
    assert!(rows.is_empty() && said.contains("flags: none"), "the program printed: {said}");
}

/// Text of an OBJ file of a sphere, divided from pole to pole into `rings` parts: a flat polygon at each pole, and
/// bands of quadrilaterals between them.
fn sphere(centre: DVec3, radius: f64, rings: usize) -> String {
    let n = 2 * rings;
    let mut text = String::new();
    for ring in 1..rings {
        let polar = std::f64::consts::PI * ring as f64 / rings as f64;
        for k in 0..n {
            let around = std::f64::consts::TAU * k as f64 / n as f64;
            let x = centre + radius * DVec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
            text += &format!("v {} {} {}\n", x.x, x.y, x.z);
        }
    }
    let index = |ring: usize, k: usize| (ring - 1) * n + k % n + 1;
    let cap = |ring: usize, order: &mut dyn Iterator<Item = usize>| {
        order.map(|k| index(ring, k).to_string()).collect::<Vec<_>>().join(" ")
    };
    text += &format!("f {}\n", cap(1, &mut (0..n)));
    for ring in 1..rings - 1 {
        for k in 0..n {
            let corners = [index(ring, k), index(ring + 1, k), index(ring + 1, k + 1), index(ring, k + 1)];
            text += &format!("f {} {} {} {}\n", corners[0], corners[1], corners[2], corners[3]);
        }
    }
    text + &format!("f {}\n", cap(rings - 1, &mut (0..n).rev()))
}

#[test]
fn spheres_of_any_unit_with_polygons() {
    for radius in [1e-3, 1.0, 1e4] {
        let towards = DVec3::new(0.9, 0.3, 0.5).normalize();
        let case = Case::new(&sphere(DVec3::ZERO, radius, 24), &sphere(1.9 * radius * towards, radius, 30));
        let Some((rows, said)) = case.ask(&[]) else { return };
        case.check(&rows, (DVec3::ZERO, DQuat::IDENTITY), radius);
        let of = |body: &str| rows.iter().filter(|row| row.body == body).count();
        assert!(of("a") > 5 && of("b") > 5 && said.contains("flags: none"), "the program printed: {said}");
        let deepest = rows.iter().map(|row| row.depth).fold(0.0, f64::max);
        // The exact spheres overlap by a tenth of the radius, the meshes by a little less.
        assert!(deepest < 0.1 * radius && deepest > 0.08 * radius, "greatest depth {deepest} m, radius {radius} m");
        assert!(rows.iter().all(|row| row.normal.dot(towards) > 0.995));
    }
}

#[test]
fn numbers_are_those_of_the_file_after_repair() {
    // A unit cube with defects: the first vertex is unused; a degenerate face and a duplicate face precede the top; the
    // top has vertices of its own and is wound the wrong way.
    let dirty = "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
                 v 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf 5 4 3 2\nf 2 2 3\nf 5 4 3 2\nf 13 12 11 10\n\
                 f 2 3 7 6\nf 3 4 8 7\nf 4 5 9 8\nf 5 2 6 9\n";
    let case = Case::new(dirty, &small(0.9));
    let Some((rows, _)) = case.ask(&[]) else { return };
    case.check(&rows, (DVec3::ZERO, DQuat::IDENTITY), 1.0);
    // Triangles are numbered as in the file: 0 and 1 are the bottom, 2 is the degenerate one, 3 and 4 are duplicates,
    // so 5 and 6 are the top.
    assert!(
        rows.len() == 4 && rows.iter().all(|row| row.body == "b" && [5, 6].contains(&row.triangle)),
        "rows of contacts.csv: {rows:?}"
    );
    // Now vertices of the defective cube lie inside body b; contacts number these vertices in the order of the file.
    let case = Case::new(dirty, &cube(DVec3::new(-1.0, -1.1, 0.95), DVec3::new(2.0, 1.9, 3.95)));
    let (rows, _) = case.ask(&[]).unwrap();
    case.check(&rows, (DVec3::ZERO, DQuat::IDENTITY), 3.0);
    let vertices: Vec<_> = rows.iter().map(|row| (row.body.as_str(), row.vertex)).collect();
    assert_eq!(
        vertices,
        [("a", 5), ("a", 6), ("a", 7), ("a", 8)],
        "where repair joined vertices, contacts.csv must give the number of the first"
    );
}

#[test]
fn models_of_our_own_are_asked_by_name() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("out");
    let output = palpate(&["query", "gear:8000", "pumpkin:8000", "--runs", "1", "--out", folder.to_str().unwrap()]);
    if output.status.code() != Some(3) {
        assert!(output.status.success(), "palpate query failed: {}", String::from_utf8_lossy(&output.stderr));
        assert!(folder.join("depth.png").is_file());
    }
}

#[test]
fn bad_input_is_one_line_and_leaves_nothing() {
    let case = Case::new(&unit(), &small(0.9));
    fs::write(case.path("text.obj"), "v 0 0\n").unwrap();
    fs::write(case.path("file"), "").unwrap();
    let (a, b, missing, text) = (case.path("a.obj"), case.path("b.obj"), case.path("c.obj"), case.path("text.obj"));
    let cases: [(&[&str], &str); 22] = [
        (&[&a], "<B>"),
        (&[&a, &missing], "c.obj: cannot be read"),
        (&[&text, &b], "text.obj:1: a vertex with 2 coordinates"),
        (&[&a, "head.step"], "neither a file with a surface nor a model"),
        (&[&a, "head:5"], "is not a valid number of vertices"),
        (&[&a, &b, "--pose-b", "1,2,3"], "give 7 numbers"),
        (&[&a, &b, "--pose-b", "-1,2,3,x,0,0,1"], "give 7 numbers"),
        (&[&a, &b, "--pose-b", "0,0,0,0,0,0,nan"], "give 7 numbers"),
        (&[&a, &b, "--pose-b", "0,0,0,0,0,0,0"], "quaternion has length 0"),
        (&[&a, &b, "--pose-b", "0,0,0,0,0,0,2"], "give a unit quaternion"),
        (&[&a, &b, "--pose-b", "0,1e10,0,0,0,0,1"], "within 1e9 of the origin"),
        (&[&a, &b, "--pose-b", ""], "give 7 numbers"),
        (&[&a, &b, "--direction", "0,0,0"], "the direction has no length"),
        (&[&a, &b, "--direction", "0,0"], "give 3 numbers"),
        (&[&a, &b, "--depth-limit", "0"], "give a number greater than zero"),
        (&[&a, &b, "--depth-limit", "-1"], "give a number greater than zero"),
        (&[&a, &b, "--depth-limit", "1e300"], "1e9 at most"),
        (&[&a, &b, "--runs", "0"], "--runs"),
        (&[&a, &b, "--poseb", "0,0,0,0,0,0,1"], "--poseb"),
        (&[&a, &b, "--device", ""], "--device"),
        (&[&a, &b, "c"], "unexpected argument"),
        (&["", &b], "neither a file with a surface nor a model"),
    ];
    let out = case.path("made/out");
    for (arguments, words) in cases {
        let mut all = vec!["query", "--out", &out];
        all.extend(arguments);
        let message = refused(&all);
        assert!(message.contains(words), "palpate query {arguments:?}: wrong error: {message}");
        assert!(!Path::new(&case.path("made")).exists(), "palpate query {arguments:?} made an output directory");
    }
    // An output path that cannot be written is an error that is found only after the query, which needs a Vulkan
    // device.
    let under = PathBuf::from(case.path("file")).join("under");
    let output = palpate(&["query", &a, &b, "--out", under.to_str().unwrap()]);
    if output.status.code() != Some(3) {
        let message = refused(&["query", &a, &b, "--out", under.to_str().unwrap()]);
        assert!(message.contains("cannot write") && message.contains("under"), "wrong error: {message}");
        // If a folder stands in the place of `query.json`, which is written last, no other file is written either.
        fs::create_dir_all(case.path("taken/query.json")).unwrap();
        refused(&["query", &a, &b, "--runs", "1", "--out", &case.path("taken")]);
        assert_eq!(fs::read_dir(case.path("taken")).unwrap().count(), 1);
    }
}

/// Checks that the program refuses the arguments (exit status 2, one line, nothing on standard output); returns the
/// message.
fn refused(arguments: &[&str]) -> String {
    let output = palpate(arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "wrong exit status of palpate {arguments:?}; it printed: {message}");
    assert!(message.starts_with("error: ") && message.lines().count() == 1, "{arguments:?}: wrong error: {message}");
    assert!(output.stdout.is_empty(), "palpate {arguments:?} printed something to standard output");
    message
}
