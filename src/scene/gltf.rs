//! Reads the triangles of glTF 2.0 files (Khronos Group, "glTF 2.0 Specification", 2021), `.gltf` with its buffers and
//! `.glb`. All meshes of the default scene become one surface, each where its nodes place it; skins, morph targets, lines
//! and points are not read, nor are colours. Lengths in glTF are metres, and y is up, as in a scene.
//!
//! What is needed of the JSON is read here, because the crate gltf panics on files whose indices do not exist.

use std::path::{Path, PathBuf};

use glam::{DMat4, DQuat, DVec3};
use serde::Deserialize;

use super::cursor::{BYTE_ORDER_MARK, LARGEST};
use super::triangles::{MOST_TRIANGLES, Polygons, TriangleFile, TriangleMesh};
use crate::{Error, Result, files};

const REMEDY: &str = "export the surface as glTF again, without compression";
/// Beginning of a URI that contains its data.
const DATA: &str = "data:";
/// Beginnings of the names of extensions that do not change where triangles are.
const HARMLESS: [&str; 4] = ["KHR_materials_", "KHR_lights_", "KHR_texture_", "EXT_texture_"];

/// The JSON of a file, as far as it is needed.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Root {
    asset: Asset,
    #[serde(default)]
    extensions_required: Vec<String>,
    scene: Option<usize>,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<Mesh>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
    #[serde(default)]
    buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Asset {
    version: String,
    /// Version that a reader must know at least.
    min_version: Option<String>,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
struct Node {
    #[serde(default)]
    children: Vec<usize>,
    mesh: Option<usize>,
    skin: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

impl Node {
    /// Where the node places what is below it.
    fn placed(&self) -> DMat4 {
        if let Some(matrix) = &self.matrix {
            return DMat4::from_cols_array(matrix);
        }
        // The format asks for a unit quaternion, which files give to seven digits.
        let rotation = DQuat::from_array(self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0])).normalize();
        let [scale, translation] = [self.scale.unwrap_or([1.0; 3]), self.translation.unwrap_or_default()];
        DMat4::from_scale_rotation_translation(scale.into(), rotation, translation.into())
    }
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    /// What the vertices are drawn as; triangles by default.
    #[serde(default = "triangles")]
    mode: u32,
    #[serde(default)]
    targets: Vec<serde::de::IgnoredAny>,
}

const STRIP: u32 = 5;
const FAN: u32 = 6;

fn triangles() -> u32 {
    4
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Buffer {
    uri: Option<String>,
    byte_length: usize,
}

/// The files of buffers that a `.gltf` file names; none if the file cannot be read.
pub(super) fn buffers(path: &Path) -> Vec<PathBuf> {
    let Ok(File { root, .. }) = open(path) else { return Vec::new() };
    let uris = root.buffers.iter().filter_map(|buffer| buffer.uri.as_ref());
    uris.filter(|uri| !uri.starts_with(DATA)).map(|uri| beside(path, uri)).collect()
}

/// The file that a relative URI names.
fn beside(path: &Path, uri: &str) -> PathBuf {
    let name = percent_encoding::percent_decode_str(uri).decode_utf8_lossy().into_owned();
    path.parent().unwrap_or(Path::new("")).join(name)
}

fn wrong(path: &Path, problem: impl Into<String>) -> Error {
    Error::input(path, None, problem, REMEDY)
}

/// A file that was opened.
struct File {
    root: Root,
    /// Bytes of the first buffer, if the file contains them.
    binary: Option<Vec<u8>>,
    /// Number of bytes behind the end of a `.glb` file that its head tells.
    left_over: usize,
}

fn open(path: &Path) -> Result<File> {
    let bytes = files::mesh(path, "give a glTF file")?;
    let Chunks { json, binary, left_over } = match bytes.starts_with(b"glTF") {
        true => chunks(&bytes).map_err(|problem| wrong(path, problem))?,
        false => Chunks { json: bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&bytes), binary: None, left_over: 0 },
    };
    let root: Root = serde_json::from_slice(json).map_err(|error| {
        let line = (error.line() > 0 && binary.is_none()).then_some(error.line());
        Error::input(path, line, format!("is no glTF file: {error}"), REMEDY)
    })?;
    if !root.asset.version.starts_with("2.") {
        return Err(wrong(path, format!("is of version {}, not 2", root.asset.version.escape_debug())));
    }
    if let Some(least) = root.asset.min_version.as_ref().filter(|least| *least != "2.0") {
        return Err(wrong(path, format!("needs a reader of version {}; this one reads 2.0", least.escape_debug())));
    }
    let unknown = |name: &&String| !HARMLESS.iter().any(|harmless| name.starts_with(harmless));
    if let Some(name) = root.extensions_required.iter().find(unknown) {
        return Err(wrong(path, format!("needs the extension {}, which is not supported", name.escape_debug())));
    }
    Ok(File { root, binary: binary.map(<[u8]>::to_vec), left_over })
}

/// Parts of a file: its JSON, its binary chunk, and the number of bytes behind the end that its head tells.
struct Chunks<'a> {
    json: &'a [u8],
    binary: Option<&'a [u8]>,
    left_over: usize,
}

/// The parts of a `.glb` file, which begins with a head of three numbers.
fn chunks(bytes: &[u8]) -> std::result::Result<Chunks<'_>, String> {
    let number = |at: usize| {
        let bytes = bytes.get(at..at + 4).ok_or("is cut off")?;
        Ok::<u32, String>(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    };
    if number(4)? != 2 {
        return Err(format!("is a binary glTF of version {}, not 2", number(4)?));
    }
    let (length, found) = (number(8)? as usize, bytes.len());
    if found < length {
        return Err(format!("is cut off: it has {found} bytes instead of {length}"));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at < length {
        let (size, kind) = (number(at)? as usize, number(at + 4)?);
        let chunk = bytes.get(at + 8..at + 8 + size).ok_or("is cut off within a chunk")?;
        match (&kind.to_le_bytes(), json, binary) {
            (b"JSON", None, _) => json = Some(chunk),
            (b"BIN\0", _, None) => binary = Some(chunk),
            _ => {}
        }
        // Chunks begin at multiples of four.
        at += 8 + size.next_multiple_of(4);
    }
    Ok(Chunks { json: json.ok_or("has no JSON")?, binary, left_over: found - length })
}

/// Reads a glTF file.
pub(super) fn read(path: &Path) -> Result<TriangleFile> {
    let File { root, binary, left_over } = open(path)?;
    let buffers = read_buffers(path, &root, binary)?;
    let mut reader =
        Reader { path, root: &root, buffers, mesh: TriangleMesh::default(), left_out: Vec::new(), part: None };
    reader.scene()?;
    let mut notes: Vec<String> = reader.left_out.iter().map(|what| format!("{what} left out")).collect();
    notes.sort();
    notes.dedup();
    if left_over > 0 {
        notes.push(format!("{left_over} bytes behind the end of the file were left out"));
    }
    Ok(TriangleFile { mesh: reader.mesh, notes })
}

fn read_buffers(path: &Path, root: &Root, mut binary: Option<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
    let (mut buffers, mut sum) = (Vec::new(), 0);
    for (k, buffer) in root.buffers.iter().enumerate() {
        let mut bytes = match &buffer.uri {
            None => binary.take().ok_or_else(|| wrong(path, format!("has no data for buffer {k}")))?,
            Some(uri) if uri.starts_with(DATA) => {
                let text = uri.split_once(";base64,").map(|(_, text)| text.as_bytes());
                let bytes = text.and_then(|text| data_encoding::BASE64.decode(text).ok());
                bytes.ok_or_else(|| wrong(path, format!("buffer {k} is no valid base64")))?
            }
            Some(uri) if beside(Path::new(""), uri).is_absolute() => {
                let problem = format!("buffer {k} is the file {}, not one beside it", uri.escape_debug());
                return Err(wrong(path, problem));
            }
            Some(uri) => files::mesh(&beside(path, uri), &format!("keep it beside {}", path.display()))?,
        };
        let (found, told) = (bytes.len(), buffer.byte_length);
        if found < told {
            return Err(wrong(path, format!("buffer {k} is cut off: it has {found} bytes instead of {told}")));
        }
        bytes.truncate(told);
        sum += bytes.len() as u64;
        if sum > files::MOST_MESH {
            return Err(wrong(path, format!("has buffers of more than {} MiB", files::MOST_MESH >> 20)));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

struct Reader<'a> {
    path: &'a Path,
    root: &'a Root,
    buffers: Vec<Vec<u8>>,
    mesh: TriangleMesh,
    left_out: Vec<&'static str>,
    /// The part of a mesh that is being read, for messages.
    part: Option<(usize, usize)>,
}

impl<'a> Reader<'a> {
    fn error(&self, problem: impl Into<String>) -> Error {
        let problem = problem.into();
        wrong(
            self.path,
            self.part.map_or_else(|| problem.clone(), |(m, k)| format!("mesh {m}, primitive {k} {problem}")),
        )
    }

    /// The item of a list that the file names by its index; `what` is the kind of its items.
    fn item<T>(&self, list: &'a [T], index: usize, what: &str) -> Result<&'a T> {
        let missing = || self.error(format!("names {what} {index}, but the file has {}", list.len()));
        list.get(index).ok_or_else(missing)
    }

    /// Adds all meshes of the default scene, or of the first.
    fn scene(&mut self) -> Result<()> {
        let root = self.root;
        if root.scenes.is_empty() {
            return Err(self.error("has no scene, which would say where its meshes are"));
        }
        let scene = self.item(&root.scenes, root.scene.unwrap_or_default(), "scene")?;
        // Nodes that are still to be visited, the next one last, each with the place of what is above it.
        let mut open: Vec<(usize, DMat4)> = scene.nodes.iter().rev().map(|node| (*node, DMat4::IDENTITY)).collect();
        let mut seen = vec![false; root.nodes.len()];
        while let Some((index, above)) = open.pop() {
            let node = self.item(&root.nodes, index, "node")?;
            if std::mem::replace(&mut seen[index], true) {
                return Err(self.error(format!("node {index} has two parents")));
            }
            let placed = above * node.placed();
            if let Some(mesh) = node.mesh {
                for (k, primitive) in self.item(&root.meshes, mesh, "mesh")?.primitives.iter().enumerate() {
                    self.part = Some((mesh, k));
                    self.primitive(primitive, &placed)?;
                }
                self.part = None;
            }
            if node.skin.is_some() {
                self.left_out.push("a skin, which would move vertices with bones, was");
            }
            open.extend(node.children.iter().rev().map(|child| (*child, placed)));
        }
        Ok(())
    }

    /// Adds the triangles of one part of a mesh.
    fn primitive(&mut self, primitive: &Primitive, placed: &DMat4) -> Result<()> {
        if primitive.mode < triangles() {
            self.left_out.push("points or lines were");
            return Ok(());
        }
        if !primitive.targets.is_empty() {
            self.left_out.push("morph targets were");
        }
        let position = primitive.attributes.position.ok_or_else(|| self.error("has no positions"))?;
        let count = self.item(&self.root.accessors, position, "accessor")?.count;
        if self.mesh.vertices.len().saturating_add(count) > MOST_TRIANGLES {
            return Err(
                self.error(format!("has more than {MOST_TRIANGLES} vertices in all, since nodes repeat meshes"))
            );
        }
        let vertices = self.positions(position, placed)?;
        let indices: Vec<u64> = match primitive.indices {
            Some(indices) => self.indices(indices)?,
            None => (0..vertices.len() as u64).collect(),
        };
        let mut polygons = Polygons::new(vertices);
        let fan = || indices.windows(2).skip(1);
        let added = match primitive.mode {
            STRIP => polygons.add_strip(&indices),
            FAN => fan().try_for_each(|two| polygons.add(&[indices[0], two[0], two[1]])),
            mode if mode != triangles() => Err(format!("is drawn in the unknown mode {mode}")),
            _ if !indices.len().is_multiple_of(3) => {
                Err(format!("has {} indices, which are no triangles", indices.len()))
            }
            _ => indices.chunks(3).try_for_each(|triangle| polygons.add(triangle)),
        };
        added.map_err(|problem| self.error(problem))?;
        if self.mesh.triangles.len() + indices.len() > MOST_TRIANGLES {
            return Err(
                self.error(format!("has more than {MOST_TRIANGLES} triangles in all, since nodes repeat meshes"))
            );
        }
        let (first, is_mirrored) = (self.mesh.vertices.len() as u32, placed.determinant() < 0.0);
        let TriangleMesh { vertices, triangles } = polygons.into_mesh();
        self.mesh.vertices.extend(vertices);
        self.mesh.triangles.extend(triangles.iter().map(|&[a, b, c]| {
            let [a, b, c] = if is_mirrored { [a, c, b] } else { [a, b, c] };
            [first + a, first + b, first + c]
        }));
        Ok(())
    }

    fn positions(&self, index: usize, placed: &DMat4) -> Result<Vec<DVec3>> {
        const FLOAT: u32 = 5126;
        let accessor = self.item(&self.root.accessors, index, "accessor")?;
        if (accessor.component_type, accessor.kind.as_str()) != (FLOAT, "VEC3") {
            return Err(self.error(format!("has positions in accessor {index} that are not three floats each")));
        }
        let place = |bytes: &[u8]| {
            let float = |k: usize| f64::from(f32::from_le_bytes([bytes[k], bytes[k + 1], bytes[k + 2], bytes[k + 3]]));
            let point = placed.transform_point3(DVec3::new(float(0), float(4), float(8)));
            let is_usable = point.is_finite() && point.abs().max_element() <= LARGEST;
            is_usable.then_some(point).ok_or_else(|| {
                self.error(format!("has a position in accessor {index} that is not finite, or too large"))
            })
        };
        self.items(index, accessor, 12)?.map(place).collect()
    }

    fn indices(&self, index: usize) -> Result<Vec<u64>> {
        let accessor = self.item(&self.root.accessors, index, "accessor")?;
        let size = match (accessor.component_type, accessor.kind.as_str()) {
            (5121, "SCALAR") => 1,
            (5123, "SCALAR") => 2,
            (5125, "SCALAR") => 4,
            _ => return Err(self.error(format!("has indices in accessor {index} that are not whole numbers"))),
        };
        let whole = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte));
        Ok(self.items(index, accessor, size)?.map(whole).collect())
    }

    /// The bytes of each item of an accessor, `size` of them.
    fn items(&self, index: usize, accessor: &Accessor, size: usize) -> Result<impl Iterator<Item = &[u8]>> {
        if accessor.sparse.is_some() {
            return Err(self.error(format!("names accessor {index}, which is sparse: that is not supported")));
        }
        let view =
            accessor.buffer_view.ok_or_else(|| self.error(format!("names accessor {index}, which has no data")))?;
        let view = self.item(&self.root.buffer_views, view, "buffer view")?;
        let Some(buffer) = self.buffers.get(view.buffer) else {
            return Err(self.error(format!("names buffer {}, but the file has {}", view.buffer, self.buffers.len())));
        };
        let (stride, count) = (view.byte_stride.unwrap_or(size), accessor.count);
        if stride < size {
            let problem = format!("names accessor {index}, whose items of {size} bytes are {stride} bytes apart");
            return Err(self.error(problem));
        }
        let bytes = || {
            let end = view.byte_offset.checked_add(view.byte_length)?;
            let bytes = buffer.get(view.byte_offset..end)?.get(accessor.byte_offset..)?;
            let needed = match count.checked_sub(1) {
                Some(last) => last.checked_mul(stride)?.checked_add(size)?,
                None => 0,
            };
            (needed <= bytes.len()).then_some(bytes)
        };
        let bytes =
            bytes().ok_or_else(|| self.error(format!("names accessor {index}, which goes beyond its buffer")))?;
        Ok((0..count).map(move |item| &bytes[item * stride..item * stride + size]))
    }
}
