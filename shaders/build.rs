//! Build script: compiles every `shaders/<stage>/*.{comp,vert,frag}` from GLSL to SPIR-V and writes the sorted table
//! `SHADERS` that `src/gpu/kernel.rs` includes. `shaders/shared` holds only what others include.
//!
//! Names stay in the SPIR-V: reflection finds bindings, structs and specialization constants by them.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, process};

#[path = "compile.rs"]
mod compile;

use compile::{compile, kind};

fn main() {
    if let Err(message) = build() {
        eprintln!("{message}");
        process::exit(1);
    }
}

/// Compiles all shaders; the message of an error names the file and line.
fn build() -> Result<(), String> {
    println!("cargo:rerun-if-changed=shaders");
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").map_err(|e| e.to_string())?).join("shaders");
    let out = PathBuf::from(env::var("OUT_DIR").map_err(|e| e.to_string())?);
    let mut sources = Vec::new();
    for folder in entries(&root)? {
        if folder.is_dir() && folder.file_name() != Some(OsStr::new("shared")) {
            sources.extend(entries(&folder)?.into_iter().filter(|path| kind(path).is_some()));
        }
    }
    let mut table = Vec::new();
    for source in &sources {
        let name = name(&root, source);
        let file = out.join(format!("{}.spv", name.replace('/', "-")));
        let text = fs::read_to_string(source).map_err(|e| format!("cannot read {}: {e}", source.display()))?;
        fs::write(&file, compile(&root, source, &text)?)
            .map_err(|e| format!("cannot write {}: {e}", file.display()))?;
        table.push((name, file));
    }
    table.sort();
    if let Some(twice) = table.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(format!("two shaders are called {}", twice[0].0));
    }
    let mut text = String::from(
        "/// Name and SPIR-V of every shader, sorted by name.\npub static SHADERS: &[(&str, &[u8])] = &[\n",
    );
    for (name, file) in &table {
        let _ = writeln!(text, "    ({name:?}, include_bytes!({:?})),", file.display().to_string());
    }
    text.push_str("];\n");
    let list = out.join("shaders.rs");
    fs::write(&list, text).map_err(|e| format!("cannot write {}: {e}", list.display()))
}

/// The sorted contents of a folder.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let list = fs::read_dir(folder).map_err(|e| format!("cannot read {}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = list.filter_map(|entry| entry.ok().map(|e| e.path())).collect();
    paths.sort();
    Ok(paths)
}

/// `solve/apply` for a compute shader, `depth/depth.vert` for a stage of the graphics pipeline.
fn name(root: &Path, source: &Path) -> String {
    let relative = source.strip_prefix(root).unwrap_or(source).to_string_lossy().replace('\\', "/");
    relative.strip_suffix(".comp").unwrap_or(&relative).to_string()
}
