//! Writes unstructured grids as VTK XML files (`.vtu`), and the files (`.pvd`) that list such files with their times.
//! Arrays are appended as raw bytes, compressed by zlib or not; the same arrays give the same bytes.

use std::io::Write;

use bytemuck::cast_slice;
use miniz_oxide::deflate::compress_to_vec_zlib;

/// Bytes of an array that are compressed at a time.
const BLOCK: usize = 1 << 16;
/// The library that compresses; written into every compressed file, since another version may give other bytes.
const COMPRESSOR: &str = "miniz_oxide 0.9.1";
/// Order of the bytes in a number, that of this machine.
const ORDER: &str = if cfg!(target_endian = "big") { "BigEndian" } else { "LittleEndian" };

/// The numbers of an array.
pub enum Numbers<'a> {
    /// Floating-point numbers in single precision.
    F32(&'a [f32]),
    /// Floating-point numbers in double precision.
    F64(&'a [f64]),
    /// Whole numbers.
    I32(&'a [i32]),
    /// Whole numbers from 0 to 255.
    U8(&'a [u8]),
}

/// An array with a name, as a file has it.
#[derive(Clone)]
pub struct Array {
    attributes: String,
    bytes: Vec<u8>,
}

/// Encodes arrays at one level of compression.
#[derive(Clone, Copy, Debug)]
pub struct Encoder {
    /// From 1 (fast) to 9 (small), or 0: not compressed.
    pub level: u8,
}

/// Arrays of a grid that have a number, or several, for each point, or for each cell.
#[derive(Default)]
pub struct Data {
    /// Of points.
    pub points: Vec<Array>,
    /// Of cells.
    pub cells: Vec<Array>,
}

/// The cells of a grid, all of one kind.
#[derive(Clone)]
pub struct Cells {
    arrays: [Array; 3],
    count: usize,
}

impl Encoder {
    /// An array called `name`, with `components` numbers for each point or cell, 1 of them unless it is a vector.
    pub fn array(self, name: &str, components: usize, numbers: &Numbers) -> Array {
        let (kind, bytes): (&str, &[u8]) = match numbers {
            Numbers::F32(all) => ("Float32", cast_slice(all)),
            Numbers::F64(all) => ("Float64", cast_slice(all)),
            Numbers::I32(all) => ("Int32", cast_slice(all)),
            Numbers::U8(all) => ("UInt8", all),
        };
        let name = escaped(name);
        // One number is the default; meshio would make a column of an array that says so.
        let shape = if components == 1 { String::new() } else { format!(" NumberOfComponents=\"{components}\"") };
        Array { attributes: format!("type=\"{kind}\" Name=\"{name}\"{shape}"), bytes: self.encoded(bytes) }
    }

    /// Cells of the VTK type `kind` with `N` points each.
    pub fn cells<const N: usize>(self, kind: u8, all: &[[u32; N]]) -> Cells {
        let connectivity: Vec<i32> = all.iter().flatten().map(|point| *point as i32).collect();
        let offsets: Vec<i32> = (1..=all.len()).map(|k| (N * k) as i32).collect();
        let arrays = [
            self.array("connectivity", 1, &Numbers::I32(&connectivity)),
            self.array("offsets", 1, &Numbers::I32(&offsets)),
            self.array("types", 1, &Numbers::U8(&vec![kind; all.len()])),
        ];
        Cells { arrays, count: all.len() }
    }

    /// Writes a file with one grid. `points` has three coordinates for each point.
    pub fn write(
        self,
        w: &mut impl Write,
        time: f64,
        points: &[f64],
        cells: &Cells,
        data: &Data,
    ) -> std::io::Result<()> {
        let (compressor, with) = match self.level {
            0 => ("", "not compressed".into()),
            level => (" compressor=\"vtkZLibDataCompressor\"", format!("compressed by {COMPRESSOR}, level {level}")),
        };
        write!(
            w,
            "<?xml version=\"1.0\"?>\n<!-- written by palpate {}, {with} -->\n\
             <VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"{ORDER}\" header_type=\"UInt64\"\
             {compressor}>\n<UnstructuredGrid>\n<FieldData>\n\
             <DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">{time:?}</DataArray>\n\
             </FieldData>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n",
            env!("CARGO_PKG_VERSION"),
            points.len() / 3,
            cells.count,
        )?;
        let points = [self.array("Points", 3, &Numbers::F64(points))];
        let all =
            [("PointData", &data.points[..]), ("CellData", &data.cells), ("Points", &points), ("Cells", &cells.arrays)];
        let mut offset = 0;
        for (element, arrays) in all {
            writeln!(w, "<{element}>")?;
            for array in arrays {
                writeln!(w, "<DataArray {} format=\"appended\" offset=\"{offset}\"/>", array.attributes)?;
                offset += array.bytes.len();
            }
            writeln!(w, "</{element}>")?;
        }
        write!(w, "</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_")?;
        all.iter().flat_map(|(_, arrays)| *arrays).try_for_each(|array| w.write_all(&array.bytes))?;
        writeln!(w, "\n</AppendedData>\n</VTKFile>")
    }

    /// Bytes with a header. That of compressed bytes has the number of blocks, the size of a block, that of the last one if
    /// it is smaller, and the compressed size of each; that of others the number of bytes.
    fn encoded(self, bytes: &[u8]) -> Vec<u8> {
        if self.level == 0 {
            return [&(bytes.len() as u64).to_ne_bytes(), bytes].concat();
        }
        let blocks = bytes.chunks(BLOCK).map(|block| compress_to_vec_zlib(block, self.level));
        let blocks: Vec<Vec<u8>> = blocks.collect();
        let mut header = vec![blocks.len() as u64, BLOCK as u64, (bytes.len() % BLOCK) as u64];
        header.extend(blocks.iter().map(|block| block.len() as u64));
        [cast_slice(&header).to_vec(), blocks.concat()].concat()
    }
}

/// Text within an attribute in double quotes.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// Writes a file that lists others with their times, s.
pub fn write_series(w: &mut impl Write, files: &[(f64, String)]) -> std::io::Result<()> {
    let line = |(time, file): &(f64, String)| {
        format!("<DataSet timestep=\"{time:?}\" part=\"0\" file=\"{}\"/>\n", escaped(file))
    };
    let text: String = files.iter().map(line).collect();
    write!(
        w,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"{ORDER}\">\n\
         <Collection>\n{text}</Collection>\n</VTKFile>\n"
    )
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::{read, read_surface};
    use super::*;

    #[test]
    fn what_is_written_is_read_again_at_every_level() {
        let folder = tempfile::tempdir().unwrap();
        // Tetrahedra and triangles with nodes of their own, more than fit into a block; then no point.
        let corner = |k: u32, [x, y, z]: [f64; 3]| [f64::from(k) / 7.0 + x, y, z];
        let corners = |k| [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.5]].map(|at| corner(k, at));
        let points: Vec<f64> = (0..750).flat_map(corners).flatten().collect();
        let tetrahedra: Vec<[u32; 4]> = (0..750).map(|k| [0, 1, 2, 3].map(|node| 4 * k + node)).collect();
        let triangles: Vec<[u32; 3]> = (0..750).map(|k| [2, 0, 1].map(|node| 4 * k + node)).collect();
        let groups: Vec<i32> = (0..750).map(|k| k % 5).collect();
        for level in [0, 1, 9] {
            let encoder = Encoder { level };
            let file = folder.path().join("grid.vtu");
            let cells = vec![encoder.array("group", 1, &Numbers::I32(&groups))];
            let data = Data { points: vec![encoder.array("a < \"b\" & c", 1, &Numbers::F32(&[0.5; 3000]))], cells };
            let mut bytes = Vec::new();
            encoder.write(&mut bytes, 0.25, &points, &encoder.cells(10, &tetrahedra), &data).unwrap();
            fs::write(&file, &bytes).unwrap();
            let mesh = read(&file).unwrap();
            let got: Vec<f64> = mesh.nodes.iter().flat_map(|x| x.to_array()).collect();
            assert!(got == points && mesh.tetrahedra == tetrahedra && mesh.notes.is_empty(), "level {level}");
            assert_eq!(mesh.groups.of, groups.iter().map(|group| Some((*group).into())).collect::<Vec<_>>());
            let text = String::from_utf8_lossy(&bytes);
            assert_eq!(text.contains(COMPRESSOR), level > 0);
            assert!(text.contains("Name=\"a &lt; &quot;b&quot; &amp; c\"") && text.contains(">0.25</DataArray>"));

            let mut bytes = Vec::new();
            encoder.write(&mut bytes, 0.0, &points, &encoder.cells(5, &triangles), &Data::default()).unwrap();
            fs::write(&file, bytes).unwrap();
            assert_eq!(read_surface(&file).unwrap().mesh.triangles.len(), 750);
            let mut bytes = Vec::new();
            encoder.write(&mut bytes, 0.0, &[], &encoder.cells::<1>(1, &[]), &Data::default()).unwrap();
            assert!(String::from_utf8_lossy(&bytes).contains("NumberOfPoints=\"0\" NumberOfCells=\"0\""));
        }
    }

    #[test]
    fn the_compressor_that_files_name_is_the_one_in_use() {
        let lock = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.lock")).unwrap();
        let lock: toml::Table = lock.parse().unwrap();
        let packages = lock["package"].as_array().unwrap();
        let engine = packages.iter().find(|package| package["name"].as_str() == Some("palpate")).unwrap();
        let uses = engine["dependencies"].as_array().unwrap().iter().filter_map(|name| name.as_str());
        let versions: Vec<&str> = packages
            .iter()
            .filter(|package| package["name"].as_str() == Some("miniz_oxide"))
            .filter_map(|package| package["version"].as_str())
            .collect();
        let used = uses.into_iter().find(|name| name.starts_with("miniz_oxide")).unwrap();
        // The version stands in the list of dependencies where there are several.
        let used = if versions.len() == 1 { format!("miniz_oxide {}", versions[0]) } else { used.into() };
        assert_eq!(used, COMPRESSOR);
    }
}
