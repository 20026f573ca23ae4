//! Build script: compiles every `shaders/<stage>/*.{comp,vert,frag}` from GLSL to SPIR-V, and writes what the Rust code
//! needs of them:
//! - `spirv.rs`, the sorted table of the binaries, for `src/gpu/kernel.rs`;
//! - `shaders.rs`, for `src/shaders.rs`: for each kernel a struct of its arguments, and the structs and constants that
//!   shaders and host (CPU side) share, which are defined in the shaders alone.
//!
//! `shaders/shared` holds only files that others include.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::{env, fs, process, thread};

use palpate_glsl::{Arrays, compile, digest, is_shader, whole_text};

mod arguments;
mod comments;
#[expect(dead_code)]
#[path = "../../src/gpu/specialise.rs"]
mod specialise;
#[allow(dead_code)]
#[path = "../../src/gpu/spirv.rs"]
mod spirv;
mod structs;

/// A compiled shader.
pub struct Shader {
    /// Its name: `solve/element_product` for a compute shader, `depth/ray_hits.vert` for a stage of the graphics
    /// pipeline.
    name: String,
    /// Its GLSL text, without included files.
    text: String,
    /// Files of its SPIR-V: one that reads arrays through texel buffers and one that reads arrays through storage
    /// buffers; only the latter if the shader has no such arrays (see [`Arrays`]).
    files: Vec<PathBuf>,
    /// Its SPIR-V with storage buffers.
    words: Vec<u32>,
}

fn main() {
    if let Err(message) = build() {
        eprintln!("{message}");
        process::exit(1);
    }
}

/// Compiles all shaders and writes the generated files; the message of an error names the file and line.
fn build() -> Result<(), String> {
    println!("cargo:rerun-if-changed=shaders");
    println!("cargo:rerun-if-env-changed=GLSLC");
    println!("cargo:rerun-if-env-changed=VULKAN_SDK");
    println!("cargo:rerun-if-changed=src/gpu/spirv.rs");
    println!("cargo:rerun-if-changed=src/gpu/specialise.rs");
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").map_err(|e| e.to_string())?).join("shaders");
    let out = PathBuf::from(env::var("OUT_DIR").map_err(|e| e.to_string())?);
    let mut sources = Vec::new();
    for folder in entries(&root)? {
        if folder.is_dir() && folder.file_name() != Some(OsStr::new("shared")) {
            sources.extend(entries(&folder)?.into_iter().filter(|path| is_shader(path)));
        }
    }
    let threads = thread::available_parallelism().map_or(1, |count| count.get());
    let shares = sources.chunks(sources.len().div_ceil(threads).max(1));
    let refreshed: Vec<_> = thread::scope(|scope| {
        let refresh_share =
            |share: &[PathBuf]| share.iter().map(|source| refresh(&root, source, &out)).collect::<Vec<_>>();
        let running: Vec<_> = shares.map(|share| scope.spawn(move || refresh_share(share))).collect();
        running.into_iter().flat_map(|share| share.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    let refreshed = refreshed.into_iter().collect::<Result<Vec<_>, _>>()?;
    println!("compiled {} of {} shaders", refreshed.iter().filter(|(_, is_new)| *is_new).count(), refreshed.len());
    let mut shaders: Vec<_> = refreshed.into_iter().map(|(shader, _)| shader).collect();
    shaders.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(twice) = shaders.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return Err(format!("two shaders are called {}", twice[0].name));
    }
    let headers = entries(&root.join("shared"))?.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
    write(&out.join("spirv.rs"), table(&shaders)?.as_bytes())?;
    let generated = format!("{}{}", structs::shared(&headers, &shaders)?, arguments::modules(&headers, &shaders)?);
    write(&out.join("shaders.rs"), generated.as_bytes())
}

/// The Rust text of the table of binaries.
fn table(shaders: &[Shader]) -> Result<String, String> {
    let texels = |shader: &Shader| -> Result<usize, String> {
        let Some(file) = shader.files.first() else { return Ok(0) };
        let is_texel = |kind| matches!(kind, spirv::BindingKind::TexelFloat | spirv::BindingKind::TexelUint);
        Ok(spirv::reflect(&words(file)?)?.bindings.iter().filter(|binding| is_texel(binding.kind)).count())
    };
    let most = shaders.iter().map(texels).collect::<Result<Vec<_>, _>>()?.into_iter().max().unwrap_or(0);
    let mut text = format!(
        "/// Greatest number of texel buffers of any shader.\n\
         pub const MOST_TEXEL_BUFFERS: u32 = {most};\n\
         /// Name of every shader, and its SPIR-V with texel buffers and with storage buffers; sorted by name.\n\
         pub static SHADERS: &[(&str, [&[u8]; 2])] = &[\n",
    );
    for Shader { name, files, .. } in shaders {
        let [texel, storage] = [files.first(), files.last()].map(|file| file.map(|f| f.display().to_string()));
        let [texel, storage] = [texel, storage].map(Option::unwrap_or_default);
        let _ = writeln!(text, "    ({name:?}, [include_bytes!({texel:?}), include_bytes!({storage:?})]),");
    }
    Ok(text + "];\n")
}

fn words(file: &Path) -> Result<Vec<u32>, String> {
    let bytes = fs::read(file).map_err(|e| format!("cannot read {}: {e}", file.display()))?;
    Ok(bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect())
}

/// Compiles a shader, unless there are binaries made from the same text: in the output folder, or in `shaders/compiled`
/// of a packaged engine. Also returns whether it was compiled.
fn refresh(root: &Path, source: &Path, out: &Path) -> Result<(Shader, bool), String> {
    let name = name(root, source);
    let whole = whole_text(root, source)?;
    let digest = digest(&whole);
    // A shader without read-only arrays has the same binary for texel buffers and for storage buffers.
    let kinds = if whole.contains("READ_ONLY(") { &[Arrays::Texel, Arrays::Storage][..] } else { &[Arrays::Storage] };
    let stem = name.replace('/', "-");
    let binaries = |folder: &Path| kinds.iter().map(|k| folder.join(format!("{stem}.{k:?}.spv"))).collect::<Vec<_>>();
    let made_of = |folder: &Path| folder.join(format!("{stem}.sha256"));
    let is_current = |folder: &&Path| {
        fs::read_to_string(made_of(folder)).is_ok_and(|made_of| made_of == digest)
            && binaries(folder).iter().all(|file| file.exists())
    };
    let packaged = root.join("compiled");
    let current = [packaged.as_path(), out].into_iter().find(is_current);
    if current.is_none() {
        // The file with the digest of what was compiled is removed first, so that after an interrupted build the next
        // one compiles this shader again.
        let _ = fs::remove_file(made_of(out));
        for (arrays, file) in kinds.iter().zip(binaries(out)) {
            write(&file, &compile(root, source, *arrays)?)?;
        }
        write(&made_of(out), digest.as_bytes())?;
    }
    let files = binaries(current.unwrap_or(out));
    let last = files.last().ok_or_else(|| format!("internal error: {name} was not compiled"))?;
    let words = words(last)?;
    Ok((Shader { name, text: read(source)?, files, words }, current.is_none()))
}

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|e| format!("cannot read {}: {e}", path.display()))
}

/// Writes a file only if its contents change, so that cargo rebuilds what depends on it only then.
fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    if fs::read(path).is_ok_and(|old| old == bytes) {
        return Ok(());
    }
    fs::write(path, bytes).map_err(|e| format!("cannot write {}: {e}", path.display()))
}

/// The sorted contents of a folder.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let list = fs::read_dir(folder).map_err(|e| format!("cannot read {}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = list.filter_map(|entry| entry.ok().map(|e| e.path())).collect();
    paths.sort();
    Ok(paths)
}

/// Name of a shader: `solve/element_product` for a compute shader, `depth/ray_hits.vert` for a stage of the graphics
/// pipeline.
fn name(root: &Path, source: &Path) -> String {
    let relative = source.strip_prefix(root).unwrap_or(source).to_string_lossy().replace('\\', "/");
    relative.strip_suffix(".comp").unwrap_or(&relative).to_string()
}
