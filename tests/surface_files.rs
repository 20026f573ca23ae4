//! Tests of the readers of surfaces: files that other tools wrote (tests/surface_files) must give the box that was put
//! into them, and damaged ones an error of one line with its place.

use std::fs;
use std::path::{Path, PathBuf};

use palpate::internal::prepare::repair::repair;
use palpate::scene::tetrahedra;
use palpate::scene::triangles::{TriangleFile, TriangleMesh, read};

/// Volume of the box in all files, m^3.
const VOLUME: f64 = 6.0;
/// Tolerance of the volume, as a share.
const SINGLE: f64 = 1e-6;
/// Tolerance of the volume in the ASCII PLY file of Open3D, as a share; it gives coordinates with six digits.
const SIX_DIGITS: f64 = 5e-6;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/surface_files")
}

/// All files of surfaces, by name.
fn files() -> Vec<PathBuf> {
    let all = fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path());
    let is_surface = |path: &PathBuf| path.extension().is_some_and(|extension| extension != "bin" && extension != "md");
    let mut files: Vec<PathBuf> = all.filter(is_surface).collect();
    files.sort();
    files
}

fn volume(mesh: &TriangleMesh) -> f64 {
    let corners = |triangle: &[u32; 3]| triangle.map(|vertex| mesh.vertices[vertex as usize]);
    mesh.triangles.iter().map(corners).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

/// Reads bytes as a file of this name, beside which are the buffers of the glTF files.
fn read_bytes(name: &str, bytes: &[u8]) -> Result<TriangleFile, String> {
    let beside = tempfile::tempdir().unwrap();
    let path = beside.path().join(name);
    fs::write(&path, bytes).unwrap();
    if name.ends_with(".gltf") {
        for entry in fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap()) {
            if entry.path().extension().is_some_and(|extension| extension == "bin") {
                fs::copy(entry.path(), beside.path().join(entry.file_name())).unwrap();
            }
        }
    }
    read(&path).map_err(|error| error.to_string())
}

#[test]
fn what_other_tools_write_is_the_box_that_was_put_in() {
    let files = files();
    assert_eq!(files.len(), 50);
    for path in files {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let TriangleFile { mesh, notes } = read(&path).unwrap();
        // Gmsh cuts the box's faces otherwise; glTF repeats vertices where normals differ, which the repair joins.
        let is_gmsh = name.starts_with("gmsh");
        let wanted = if is_gmsh { (12, 20) } else { (8, 12) };
        let found = (mesh.vertices.len(), mesh.triangles.len());
        let repeats = matches!(&*name, "blender.glb" | "blender.gltf");
        assert_eq!(found, if repeats { (24, 12) } else { wanted }, "vertices and triangles of {name}");
        let tolerance = if name == "open3d-ascii.ply" { SIX_DIGITS } else { SINGLE };
        let off = (volume(&mesh) / VOLUME - 1.0).abs();
        assert!(off <= tolerance, "the volume of {name} is off by {off}");
        assert_eq!(notes.len(), usize::from(name == "gmsh.vtk"), "notes of {name}: {notes:?}");
        let (mended, report) = repair(mesh).unwrap();
        assert_eq!((report.triangles_kept, mended.triangles.len()), (wanted.1, wanted.1));
        assert!(report.is_clean() || repeats, "defects of {name}: {report:?}");
        let used: std::collections::BTreeSet<u32> = mended.triangles.iter().flatten().copied().collect();
        assert_eq!(used.len(), wanted.0, "vertices of {name} after the repair");
    }
}

/// A file that is cut off is refused, wherever it is cut; only white space at its end may be missing.
#[test]
fn a_file_cut_anywhere_is_refused() {
    for path in files() {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let bytes = fs::read(&path).unwrap();
        let whole = bytes.trim_ascii_end().len();
        let is_text = bytes.is_ascii();
        for length in (0..whole).step_by(1 + whole / 60).chain([whole - 1]) {
            let Err(said) = read_bytes(&name, &bytes[..length]) else {
                // Text that ends within its last number, within the name of a solid, or within data that belong to no
                // face, may still be a mesh.
                let lost = whole - length;
                let is_named = name.ends_with(".stl") && bytes[..length].windows(8).any(|word| word == b"endsolid");
                let ends = is_named || lost < 600 && ends_in_data(&name);
                assert!(is_text && ends, "{name} cut to {length} of {whole} bytes");
                continue;
            };
            assert!(is_one_line(&said) && said.contains(&name), "{name} cut to {length} bytes: {said}");
        }
    }
}

/// Whether a format ends with numbers, or with data that a surface does not need.
fn ends_in_data(name: &str) -> bool {
    name.ends_with(".ply") || name.ends_with(".vtk")
}

fn is_one_line(said: &str) -> bool {
    !said.is_empty() && !said.contains(char::is_control)
}

/// Whatever a byte is changed to, there is a mesh with valid indices or an error of one line.
#[test]
fn no_byte_makes_a_reader_panic() {
    for path in files() {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let bytes = fs::read(&path).unwrap();
        for place in (0..bytes.len()).step_by(1 + bytes.len() / 150) {
            for value in [0, 0x20, 0x39, 0xff] {
                let mut damaged = bytes.clone();
                damaged[place] = value;
                match read_bytes(&name, &damaged) {
                    Err(said) => assert!(is_one_line(&said), "{name}, byte {place} set to {value}: {said:?}"),
                    Ok(TriangleFile { mesh, .. }) => {
                        let count = mesh.vertices.len() as u32;
                        assert!(mesh.vertices.iter().all(|vertex| vertex.is_finite()), "{name}, byte {place}");
                        assert!(mesh.triangles.iter().flatten().all(|vertex| *vertex < count), "{name}, byte {place}");
                    }
                }
            }
        }
    }
}

/// A binary STL file may begin with the word by which text begins, and have bytes after its last triangle.
#[test]
fn a_binary_stl_file_may_begin_like_a_text() {
    let mut bytes = fs::read(folder().join("vtk.stl")).unwrap();
    bytes[..80].fill(b' ');
    bytes[..9].copy_from_slice(b"solid box");
    let whole = read_bytes("a.stl", &bytes).unwrap();
    assert_eq!((whole.mesh.vertices.len(), whole.mesh.triangles.len(), whole.notes.len()), (8, 12, 0));
    bytes.extend([0; 7]);
    let more = read_bytes("a.stl", &bytes).unwrap();
    assert_eq!(more.mesh, whole.mesh);
    assert_eq!(more.notes, ["7 bytes after the last triangle were left out"]);
}

/// Files of a few bytes that would need much stack, memory or time.
#[test]
fn what_would_take_too_much_is_refused() {
    let deep = format!("<VTKFile type=\"PolyData\">{}{}</VTKFile>", "<a>".repeat(20_000), "</a>".repeat(20_000));
    assert!(read_bytes("deep.vtp", deep.as_bytes()).unwrap_err().contains("within more than a hundred others"));
    let points = "0 0 0\n".repeat(5000);
    let corners: String = (0..5000).map(|corner| format!(" {corner}")).collect();
    let polygon = format!(
        "ply\nformat ascii 1.0\nelement vertex 5000\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list int int vertex_indices\nend_header\n{points}5000{corners}\n"
    );
    assert!(read_bytes("large.ply", polygon.as_bytes()).unwrap_err().contains("at most 4096"));
    let node = "{\"mesh\":0},".repeat(20_000);
    let nodes: Vec<String> = (0..20_000).map(|node| node.to_string()).collect();
    let many = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scenes\":[{{\"nodes\":[{}]}}],\"nodes\":[{}],\"meshes\":[{{\"primitives\":\
         [{{\"attributes\":{{\"POSITION\":0}}}}]}}],\"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":3000,\
         \"type\":\"VEC3\"}}],\"bufferViews\":[{{\"buffer\":0,\"byteLength\":36000}}],\"buffers\":[{{\"byteLength\":36000,\
         \"uri\":\"data:application/octet-stream;base64,{}\"}}]}}",
        nodes.join(","),
        node.trim_end_matches(','),
        "A".repeat(48_000)
    );
    assert!(read_bytes("many.gltf", many.as_bytes()).unwrap_err().contains("since nodes repeat meshes"));
}

/// Several pieces are one mesh; what is no face is counted, and polygons of any size are cut into triangles.
#[test]
fn pieces_and_polygons() {
    let array = |name: &str, numbers: &str| format!("<DataArray type=\"Int64\" Name=\"{name}\">{numbers}</DataArray>");
    let piece = |x: i32, cells: &str| {
        let points: String = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(y, z)| format!("{x} {y} {z} ")).concat();
        format!(
            "<Piece NumberOfPoints=\"4\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">\n\
             <InformationKey name=\"a\"/>{points}</DataArray></Points>{cells}</Piece>"
        )
    };
    let square = format!("<Polys>{}{}</Polys>", array("connectivity", "0 1 2 3"), array("offsets", "4"));
    let line = format!("<Lines>{}{}</Lines>", array("connectivity", "0 1"), array("offsets", "2"));
    let text = format!(
        "<VTKFile type=\"PolyData\"><PolyData>{}{}</PolyData></VTKFile>",
        piece(0, &square),
        piece(2, &format!("{line}{square}"))
    );
    let read = read_bytes("two.vtp", text.as_bytes()).unwrap();
    assert_eq!(read.mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]);
    assert_eq!(read.mesh.vertices[6].to_array(), [2.0, 1.0, 1.0]);
    assert_eq!(read.notes, ["cells that are no faces were left out: 1 lines of several points"]);
    // An empty piece has no array of points; cells may neither leave corners over nor name points of other pieces.
    let empty = "<Piece NumberOfPoints=\"0\"><Points/></Piece>";
    assert_eq!(
        read_bytes("e.vtp", text.replacen("<Piece", &format!("{empty}<Piece"), 1).as_bytes()).unwrap().mesh,
        read.mesh
    );
    for (old, new, words) in [
        ("0 1 2 3<", "0 1 2 3 0<", "do not lead through its 5 corners"),
        ("0 1 2 3<", "0 1 2 4<", "names point 4, but its piece has 4"),
    ] {
        let said = read_bytes("w.vtp", text.replacen(old, new, 1).as_bytes()).unwrap_err();
        assert!(said.contains(words) && said.contains("w.vtp:"), "expected {words}: {said}");
    }
    let facets = fs::read_to_string(folder().join("vtk-ascii.stl")).unwrap();
    let (name, rest) = facets.split_once('\n').unwrap();
    let lines = format!("\u{feff}{name}\n{}", rest.replace('\n', " ").replace(" endsolid", "\nendsolid"));
    assert_eq!(read_bytes("lines.stl", lines.as_bytes()).unwrap().mesh.triangles.len(), 12);
}

/// Legacy VTK: points that are whole numbers, and fields with strings (short and longer ones, whose lengths take one, two
/// and four bytes) and bits in a binary file.
#[test]
fn legacy_vtk_with_whole_numbers_strings_and_bits() {
    let string = |length: usize| {
        let head = match length {
            0..64 => vec![0xc0 | length as u8],
            64..16384 => (0x8000 | length as u16).to_be_bytes().to_vec(),
            _ => (0x4000_0000 | length as u32).to_be_bytes().to_vec(),
        };
        [head, vec![b'x'; length]].concat()
    };
    let strings = [0, 63, 64, 20_000].map(string).concat();
    let head = b"# vtk DataFile Version 5.1\nt\nBINARY\nDATASET POLYDATA\nFIELD FieldData 2\nnote 1 4 string\n";
    let bits = b"\nflags 1 9 bit\nab\nPOINTS 3 short\n";
    let points: Vec<u8> = [0i16, 0, 0, 2, 0, 0, 0, -3, 0].iter().flat_map(|x| x.to_be_bytes()).collect();
    let cells: Vec<u8> = [3i32, 0, 1, 2].iter().flat_map(|x| x.to_be_bytes()).collect();
    let file = [&head[..], &strings, bits, &points, b"\nPOLYGONS 1 4\n", &cells, b"\n"].concat();
    let mesh = read_bytes("s.vtk", &file).unwrap().mesh;
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.vertices, [[0.0; 3], [2.0, 0.0, 0.0], [0.0, -3.0, 0.0]].map(glam::DVec3::from));
    let cut = read_bytes("s.vtk", &file[..head.len() + 100]).unwrap_err();
    assert!(is_one_line(&cut) && cut.contains("within an array of a FIELD"), "{cut}");
    let text = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\n\
                POINTS 3 int\n0 0 0 2 0 0 0 -3 0\nPOLYGONS 1 4\n3 0 1 2\n";
    assert_eq!(read_bytes("i.vtk", text.as_bytes()).unwrap().mesh, mesh);
    let said = read_bytes("i.vtk", text.replace("POLYGONS 1 4", "POLYGONS 1 5").as_bytes()).unwrap_err();
    assert!(said.contains("i.vtk:8: the 1 cells of POLYGONS have 4 numbers, not 5"), "{said}");
}

/// An STL text may end its lines with `\r`, or be one line with one or several solids.
#[test]
fn stl_with_other_line_ends() {
    let text = fs::read_to_string(folder().join("vtk-ascii.stl")).unwrap();
    let expected = read_bytes("a.stl", text.as_bytes()).unwrap();
    for (old, new) in [("\n", "\r"), ("\n", "\r\n"), ("\n", " ")] {
        assert_eq!(read_bytes("a.stl", text.replace(old, new).as_bytes()).unwrap(), expected, "ends of lines {new:?}");
    }
    let facet = |z: i32| {
        format!("facet normal 0 0 1 outer loop vertex 0 0 {z} vertex 1 0 {z} vertex 0 1 {z} endloop endfacet ")
    };
    let two = format!("solid a facet {}endsolid a facet solid b {}endsolid b", facet(0), facet(1));
    assert_eq!(read_bytes("two.stl", two.as_bytes()).unwrap().mesh.triangles, [[0, 1, 2], [3, 4, 5]]);
    let cut = read_bytes("two.stl", two.strip_suffix("endsolid b").unwrap().as_bytes()).unwrap_err();
    assert!(cut.contains("before `endsolid`"), "{cut}");
    let damaged = text.replacen("outer", "inner", 1).replace('\n', "\r");
    let said = read_bytes("a.stl", damaged.as_bytes()).unwrap_err();
    assert!(said.contains("a.stl:3:"), "{said}");
}

/// A byte order mark before the first vertex of an OBJ is no part of it; what follows a PLY's last element is told.
#[test]
fn marks_before_and_data_after_the_mesh() {
    let obj = b"\xef\xbb\xbfv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    assert_eq!(read_bytes("bom.obj", obj).unwrap().mesh.vertices.len(), 3);
    let ply = fs::read(folder().join("trimesh-ascii.ply")).unwrap();
    let longer = read_bytes("a.ply", &[&ply[..], b"3 0 1 2\n"].concat()).unwrap();
    assert_eq!(longer.mesh, read_bytes("a.ply", &ply).unwrap().mesh);
    assert_eq!(longer.notes, ["7 bytes after the last element were left out"]);
}

/// The head of a `.glb` file says where the file ends; the buffer's length, where its data end.
#[test]
fn glb_lengths() {
    let bytes = fs::read(folder().join("trimesh.glb")).unwrap();
    let longer = read_bytes("a.glb", &[&bytes[..], b"abcd"].concat()).unwrap();
    assert_eq!(longer.mesh, read_bytes("a.glb", &bytes).unwrap().mesh);
    assert_eq!(longer.notes, ["4 bytes behind the end of the file were left out"]);
}

/// Groups of a grid in pieces: each piece must have them.
#[test]
fn pieces_have_groups_together_or_not_at_all() {
    let array = |kind: &str, name: &str, numbers: &str| {
        format!("<DataArray type=\"{kind}\" Name=\"{name}\">{numbers}</DataArray>")
    };
    let piece = |x: i32, group: Option<i32>| {
        let points = array("Float64", "p", &format!("{x} 0 0 {x} 1 0 {x} 0 1 {} 0 0", x + 1));
        let cells = array("Int32", "connectivity", "0 1 2 3")
            + &array("Int32", "offsets", "4")
            + &array("UInt8", "types", "10");
        let data = group.map(|group| array("Int32", "group", &group.to_string())).unwrap_or_default();
        format!(
            "<Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><Points>{points}</Points><Cells>{cells}</Cells>\
             <CellData>{data}</CellData></Piece>"
        )
    };
    let folder = tempfile::tempdir().unwrap();
    for (groups, found, notes) in [
        ([Some(3), Some(-4)], [Some(3), Some(-4)], 0),
        ([Some(3), None], [None, None], 1),
        ([None, Some(3)], [None, None], 1),
        ([None, None], [None, None], 0),
    ] {
        let path = folder.path().join("two.vtu");
        let pieces = piece(0, groups[0]) + &piece(5, groups[1]);
        let text =
            format!("<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid>{pieces}</UnstructuredGrid></VTKFile>");
        fs::write(&path, text).unwrap();
        let mesh = tetrahedra::read(&path).unwrap();
        assert_eq!((mesh.nodes.len(), &mesh.groups.of[..]), (8, &found[..]), "groups {groups:?}");
        assert_eq!(mesh.notes.len(), notes, "notes with groups {groups:?}: {:?}", mesh.notes);
    }
}

/// Text with each `(old, new)` replaced once; a part that is not there fails the test.
fn changed(name: &str, changes: &[(&str, &str)]) -> Vec<u8> {
    let mut text = String::from_utf8(fs::read(folder().join(name)).unwrap()).unwrap();
    for (old, new) in changes {
        assert!(text.contains(old), "{name} has no \"{old}\"");
        text = text.replacen(old, new, 1);
    }
    text.into_bytes()
}

/// A file, what is replaced in it, and words of the error.
type Case = (&'static str, &'static [(&'static str, &'static str)], &'static [&'static str]);

#[test]
fn damage_is_named_with_its_place() {
    let ply = "trimesh-ascii.ply";
    let stl = "vtk-ascii.stl";
    let vtp = "vtk-ascii.vtp";
    let gltf = "open3d.gltf";
    let cases: &[Case] = &[
        (stl, &[("vertex ", "vertex x")], &[":4:", "is not valid for a triangle's corner"]),
        (stl, &[("vertex ", "vertex nan ")], &[":4:", "not a finite number"]),
        (stl, &[("endloop", "")], &["the last facet has no `endloop`"]),
        (stl, &[("endsolid", "")], &["before `endsolid`"]),
        (stl, &[("facet", "face")], &[":2:", "unknown keyword \"face\""]),
        (ply, &[("ply\n", "plx\n")], &[":1:", "found \"plx\""]),
        (ply, &[("format ascii 1.0\n", "")], &["no line \"format\""]),
        (ply, &[("float x", "half x")], &["unknown type \"half\""]),
        (ply, &[("property float z", "property float w")], &["no coordinate z"]),
        (ply, &[("\n3 ", "\n3 -")], &["a face has an index that is none"]),
        (ply, &[("\n3 ", "\n3 9")], &["names vertex 9", "8 vertices"]),
        (ply, &[("\n3 ", "\n9 ")], &["the line ends early"]),
        (ply, &[("element face 12", "element face 13")], &["the file ends early"]),
        (ply, &[("element face 12", "element face 0")], &["has no faces"]),
        (vtp, &[("PolyData", "RectilinearGrid")], &[":1:", "a file of type \"RectilinearGrid\""]),
        (vtp, &[("NumberOfPoints=\"8\"", "NumberOfPoints=\"9\"")], &["24 coordinates for 9 points"]),
        (vtp, &[("Name=\"connectivity\"", "Name=\"c\"")], &["has no array \"connectivity\""]),
        (vtp, &[("NumberOfPolys=\"12\"", "NumberOfPolys=\"11\"")], &["12 cells, but NumberOfPolys differs"]),
        ("meshio-ascii.vtu", &[("NumberOfCells=\"12\"", "NumberOfCells=\"11\"")], &["12 cells, but NumberOfCells"]),
        (vtp, &[("</Polys>", "</Poly>")], &["is no XML"]),
        (vtp, &[("<VTKFile", "<!DOCTYPE a [<!ENTITY a \"&a;\">]><VTKFile")], &["is no XML"]),
        (gltf, &[("\"primitives\"", "\"primitive\"")], &["is no glTF file", "missing field"]),
        (
            gltf,
            &[("\"asset\"", "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"asset\"")],
            &["KHR_draco_mesh_compression"],
        ),
        (gltf, &[("base64,", "base64,!")], &["buffer 0 is no valid base64"]),
        (gltf, &[("\"componentType\": 5126", "\"componentType\": 5123")], &["mesh 0, primitive 0", "not three floats"]),
        (gltf, &[("\"byteStride\": 12", "\"byteStride\": 4")], &["mesh 0, primitive 0", "4 bytes apart"]),
        (gltf, &[("\"version\"", "\"minVersion\": \"2.1\", \"version\"")], &["needs a reader of version 2.1"]),
        (gltf, &[("\"byteLength\": 264", "\"byteLength\": 260")], &["accessor 1", "beyond its buffer"]),
        (gltf, &[("\"uri\": \"data:", "\"uri\": \"/data:")], &["not one beside it"]),
        (gltf, &[("\"buffer\": 0", "\"buffer\": 7")], &["mesh 0, primitive 0", "names buffer 7"]),
        (gltf, &[("\"uri\": \"data:", "\"uri\": \"none")], &["cannot be read"]),
        (gltf, &[("\"byteLength\": 264", "\"byteLength\": 265")], &["is cut off"]),
        ("blender.gltf", &[("blender.bin", "absent.bin")], &["absent.bin", "cannot be read", "keep it beside"]),
    ];
    for &(name, changes, words) in cases {
        let said = read_bytes(name, &changed(name, changes)).map(|_| ()).unwrap_err();
        assert!(is_one_line(&said), "{name}, {changes:?}: {said}");
        assert!(words.iter().all(|word| said.contains(word)), "{name}, {changes:?}, expected {words:?}: {said}");
    }
}
