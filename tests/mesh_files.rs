//! Tests of the readers and writers of tetrahedral mesh files: every format, also binary files in both byte orders,
//! must give the same mesh, and no bytes whatever may make a reader panic.

mod real_meshes;

use std::path::Path;

use glam::DVec3;
use palpate::scene::tetrahedra::{TetMesh, read};
use palpate::scene::{gmsh, vtk};

use real_meshes::meshes;

/// Positions of the five nodes of a mesh of two tetrahedra, m.
const NODES: [[f64; 3]; 5] =
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0 / 3.0]];
const TETRAHEDRA: [[u32; 4]; 2] = [[0, 1, 2, 3], [1, 4, 2, 3]];

/// Tolerance, m, for coordinates of less than 1 m that are read from different files of the same mesh: some of the
/// files give coordinates with nine digits, others with seventeen.
const NINE_DIGITS: f64 = 1e-9;

/// Reads bytes as the contents of a file with the name `name`, whose extension decides the format.
fn read_bytes(name: &str, bytes: &[u8]) -> Result<TetMesh, String> {
    let parse = if name.ends_with(".msh") { gmsh::parse } else { vtk::parse };
    parse(bytes, Path::new(name)).map_err(|error| error.to_string())
}

/// A binary file that is being written; `big` tells whether its numbers are big-endian or little-endian.
struct Bytes {
    bytes: Vec<u8>,
    big: bool,
}

impl Bytes {
    fn text(mut self, text: &str) -> Self {
        self.bytes.extend(text.as_bytes());
        self
    }

    fn raw<const N: usize>(&mut self, little: [u8; N]) {
        let mut bytes = little;
        if self.big {
            bytes.reverse();
        }
        self.bytes.extend(bytes);
    }

    fn ints(mut self, numbers: impl IntoIterator<Item = i32>) -> Self {
        numbers.into_iter().for_each(|number| self.raw(number.to_le_bytes()));
        self
    }

    fn sizes(mut self, numbers: impl IntoIterator<Item = i64>) -> Self {
        numbers.into_iter().for_each(|number| self.raw(number.to_le_bytes()));
        self
    }

    fn reals(mut self, numbers: impl IntoIterator<Item = f64>) -> Self {
        numbers.into_iter().for_each(|number| self.raw(number.to_le_bytes()));
        self
    }
}

fn msh_4(big: bool, node_count: i64) -> Vec<u8> {
    Bytes { bytes: Vec::new(), big }
        .text("$MeshFormat\n4.1 1 8\n")
        .ints([1])
        .text("\n$EndMeshFormat\n$Entities\n")
        // The file has a surface in no physical group and without borders, and a volume in physical group 4 that is
        // bordered by this surface.
        .sizes([0, 0, 1, 1])
        .ints([1])
        .reals([0.0; 6])
        .sizes([0, 0])
        .ints([1])
        .reals([0.0; 6])
        .sizes([1])
        .ints([4])
        .sizes([1])
        .ints([1])
        .text("\n$EndEntities\n$Nodes\n")
        // The first node lies on a surface and is written with two surface parameters, as Gmsh can write it.
        .sizes([2, 5, 3, 70])
        .ints([2, 1, 1])
        .sizes([1, 70])
        .reals(NODES[0].into_iter().chain([0.5, 0.5]))
        .ints([3, 1, 0])
        .sizes([node_count, 3, 4, 5, 6])
        .reals(NODES[1..].iter().flatten().copied())
        .text("\n$EndNodes\n$Elements\n")
        .sizes([2, 3, 1, 3])
        .ints([2, 1, 2])
        .sizes([1, 1, 70, 3, 4])
        .ints([3, 1, 4])
        .sizes([2, 2, 70, 3, 4, 5, 3, 3, 6, 4, 5])
        .text("\n$EndElements\n")
        .bytes
}

fn msh_2(big: bool) -> Vec<u8> {
    let nodes = |bytes: Bytes| (0..5).fold(bytes, |bytes, k| bytes.ints([10 * k as i32 + 7]).reals(NODES[k]));
    let bytes = Bytes { bytes: Vec::new(), big }.text("$MeshFormat\n2.2 1 8\n").ints([1]);
    nodes(bytes.text("\n$EndMeshFormat\n$Nodes\n5\n"))
        .text("\n$EndNodes\n$Elements\n3\n")
        .ints([2, 1, 2, 1, 0, 0, 7, 17, 27])
        .ints([4, 2, 2, 2, 1, 1, 7, 17, 27, 37, 3, 1, 1, 17, 47, 27, 37])
        .text("\n$EndElements\n")
        .bytes
}

fn vtk_binary(version_5: bool) -> Vec<u8> {
    let bytes = Bytes { bytes: Vec::new(), big: true }
        .text("# vtk DataFile Version 5.1\nsomething\nBINARY\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\nTIME 1 1 double\n")
        .reals([0.5])
        .text("\nPOINTS 5 double\n")
        .reals(NODES.into_iter().flatten());
    let bytes = if version_5 {
        bytes
            .text("\nCELLS 4 11\nOFFSETS vtktypeint64\n")
            .sizes([0, 3, 7, 11])
            .text("\nCONNECTIVITY vtktypeint64\n")
            .sizes([0, 1, 2, 0, 1, 2, 3, 1, 4, 2, 3])
    } else {
        bytes.text("\nCELLS 3 14\n").ints([3, 0, 1, 2, 4, 0, 1, 2, 3, 4, 1, 4, 2, 3])
    };
    bytes.text("\nCELL_TYPES 3\n").ints([5, 10, 10]).text("\nPOINT_DATA 5\n").bytes
}

/// Small files, one or more of every format: each file's name, whose extension tells the format, and its contents.
fn small_files() -> Vec<(&'static str, Vec<u8>)> {
    let nodes = NODES.map(DVec3::from_array);
    let (mut msh, mut grid) = (Vec::new(), Vec::new());
    gmsh::write(&mut msh, &nodes, &TETRAHEDRA).unwrap();
    vtk::write(&mut grid, &nodes, &TETRAHEDRA).unwrap();
    vec![
        ("text.msh", msh),
        ("text.vtk", grid),
        ("little_4.msh", msh_4(false, 4)),
        ("big_4.msh", msh_4(true, 4)),
        ("little_2.msh", msh_2(false)),
        ("big_2.msh", msh_2(true)),
        ("binary_4.vtk", vtk_binary(false)),
        ("binary_5.vtk", vtk_binary(true)),
    ]
}

#[test]
fn every_format_gives_the_same_mesh_bit_by_bit() {
    for (name, bytes) in small_files() {
        let mesh = read_bytes(name, &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(
            (mesh.nodes, &mesh.tetrahedra[..]),
            (NODES.map(DVec3::from_array).to_vec(), &TETRAHEDRA[..]),
            "nodes and tetrahedra of the mesh read from {name}"
        );
        let notes: &[&str] = match name.starts_with("text") {
            true => &[],
            false => &["elements that are not four-node tetrahedra were left out: 1 triangles"],
        };
        assert_eq!(mesh.notes, notes, "notes that the reader made on {name}");
        let group = match name {
            "little_4.msh" | "big_4.msh" => Some(4),
            "little_2.msh" | "big_2.msh" => Some(1),
            _ => None,
        };
        assert_eq!(mesh.groups.of, [group; 2], "physical groups of the tetrahedra of {name}");
    }
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    for (name, bytes) in small_files() {
        // A file may be read although it is cut, if all that the reader needs stands before the cut: a VTK file up to
        // its last cell type, any file without its last line break.
        for length in 0..bytes.len() {
            if let Ok(mesh) = read_bytes(name, &bytes[..length]) {
                assert_eq!(mesh.tetrahedra, TETRAHEDRA, "tetrahedra of {name} cut to {length} bytes");
                assert!(
                    length + 20 >= bytes.len(),
                    "{name} must be refused when cut to {length} of {} bytes",
                    bytes.len()
                );
            }
        }
    }
}

#[test]
fn no_byte_makes_the_reader_panic_or_ask_for_memory() {
    for (name, bytes) in small_files() {
        for place in 0..bytes.len() {
            for value in [0, 0x7f, 0xff, b'9', b'-', b' '] {
                let mut spoiled = bytes.clone();
                spoiled[place] = value;
                let _ = read_bytes(name, &spoiled);
            }
        }
    }
}

#[test]
fn damage_is_named_with_its_place() {
    let spoil = |bytes: Vec<u8>, from: &[u8], to: &[u8]| {
        let place = bytes.windows(from.len()).position(|window| window == from).unwrap();
        [&bytes[..place], to, &bytes[place + from.len()..]].concat()
    };
    let nan = |big: bool| if big { f64::NAN.to_be_bytes() } else { f64::NAN.to_le_bytes() };
    let third = 1.0_f64 / 3.0;
    let cases: [(&str, Vec<u8>, &str); 12] = [
        ("a.msh", msh_4(false, i64::MAX), "the file ends early, within a node id, at byte"),
        ("a.msh", msh_4(false, -4), "-4 is not valid for the number of nodes in a block, at byte"),
        ("a.msh", spoil(msh_4(false, 4), &third.to_le_bytes(), &nan(false)), "not a finite number in range, at byte"),
        ("a.msh", spoil(msh_4(false, 4), &[1, 0, 0, 0], &[2, 0, 0, 0]), "2 instead of the 1 that shows the byte order"),
        ("a.msh", spoil(msh_4(false, 4), b"4.1 1 8", b"4.1 1 4"), "binary numbers of 4 bytes"),
        ("a.msh", spoil(msh_4(false, 4), b"4.1 1 8", b"3.0 1 8"), "MSH version 3.0 is not supported"),
        ("a.msh", spoil(msh_2(false), &[47, 0, 0, 0], &[1, 0, 0, 0]), "node 47, which does not exist, at byte"),
        ("a.msh", b"solid something\n".to_vec(), "a.msh:1: found \"solid something\" instead of $MeshFormat"),
        ("a.vtk", b"$MeshFormat\n".to_vec(), "a.vtk:1: found \"$MeshFormat\" instead of"),
        ("a.vtk", spoil(vtk_binary(false), &third.to_be_bytes(), &nan(true)), "not a finite number in range, at byte"),
        ("a.vtk", spoil(vtk_binary(false), b"CELLS 3 14", b"CELLS 3 13"), "cell 2 goes beyond the 13 numbers"),
        (
            "a.vtk",
            spoil(vtk_binary(true), b"UNSTRUCTURED_GRID", b"STRUCTURED_POINTS"),
            "a dataset of type STRUCTURED_POINTS",
        ),
    ];
    for (name, bytes, words) in cases {
        let message = read_bytes(name, &bytes).unwrap_err();
        assert!(message.contains(words), "expected `{words}` in the error: {message}");
    }
    for (text, words) in [
        ("CELLS 1 5\n4 0 1 2 9\nCELL_TYPES 1\n10\n", "a.vtk:10: tetrahedron 0 names node 9"),
        ("CELLS 1 5\n4 0 1 2 -3\nCELL_TYPES 1\n10\n", "a.vtk:10: -3 is not valid for a cell's point"),
        ("CELLS 1 5\n4 0 1 1 3\nCELL_TYPES 1\n10\n", "a.vtk:10: tetrahedron 0 has no volume"),
        ("CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 2\n10\n5\n", "1 cells, but 2 cell types"),
        ("CELLS 1 11\n10 0 1 2 3 0 1 2 3 0 1\nCELL_TYPES 1\n24\n", "its second-order tetrahedra are not supported"),
        ("CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n5\n", "cell 0 is one of the triangles, but has 4 points"),
        ("CELL 1 5\n", "a.vtk:9: unknown keyword \"CELL\""),
        ("CELLS 99999999999 99999999999\n4 0 1 2 3\n", "the file ends early"),
    ] {
        let head = "# vtk DataFile Version 2.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0\n0 1 0\n0 0 1\n";
        let message = read_bytes("a.vtk", format!("{head}{text}").as_bytes()).unwrap_err();
        assert!(message.contains(words), "expected `{words}` in the error: {message}");
    }
}

#[test]
#[ignore = "needs real meshes"]
fn the_human_is_the_same_in_every_format() {
    let Some(meshes) = meshes() else { return };
    let [first, others @ ..] = ["human.v41.msh", "human.v22.msh", "human.vtk", "human.node", "human.ele"]
        .map(|name| read(&meshes.join("tet").join(name)).unwrap());
    assert_eq!((first.nodes.len(), first.tetrahedra.len()), (3128, 10_204));
    for other in others {
        assert_eq!(other.tetrahedra, first.tetrahedra);
        assert!(other.nodes.iter().zip(&first.nodes).all(|(a, b)| a.distance(*b) < NINE_DIGITS));
    }
}

#[test]
#[ignore = "needs real meshes"]
fn what_is_written_is_read_back_bit_by_bit() {
    let Some(meshes) = meshes() else { return };
    let mesh = read(&meshes.join("tet/pumpkin.v41.msh")).unwrap();
    let (mut msh, mut grid) = (Vec::new(), Vec::new());
    gmsh::write(&mut msh, &mesh.nodes, &mesh.tetrahedra).unwrap();
    vtk::write(&mut grid, &mesh.nodes, &mesh.tetrahedra).unwrap();
    for (name, bytes) in [("a.msh", msh), ("a.vtk", grid)] {
        let back = read_bytes(name, &bytes).unwrap();
        assert_eq!((&back.nodes, &back.tetrahedra), (&mesh.nodes, &mesh.tetrahedra));
    }
}
