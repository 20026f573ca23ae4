//! Build script: compiles every `shaders/<stage>/*.{comp,vert,frag}` from GLSL to SPIR-V and writes the sorted table
//! `SHADERS` that `src/gpu/kernel.rs` includes. `shaders/shared` holds only what others include.
//!
//! Names stay in the SPIR-V: reflection finds bindings, structs and specialization constants by them.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, process};

use palpate_glsl::{compile, ingredients, kind};

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
    let (mut table, mut compiled) = (Vec::new(), 0);
    for source in &sources {
        let name = name(&root, source);
        let file = out.join(format!("{}.spv", name.replace('/', "-")));
        compiled += usize::from(refresh(&root, source, &file)?);
        table.push((name, file));
    }
    println!("compiled {compiled} of {} shaders", table.len());
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

/// Compiles a shader into a file unless that was made of the same; whether it did.
fn refresh(root: &Path, source: &Path, file: &Path) -> Result<bool, String> {
    let (made_of, now) = (file.with_extension("made-of"), ingredients(root, source)?);
    if file.exists() && fs::read_to_string(&made_of).is_ok_and(|then| then == now) {
        return Ok(false);
    }
    let text = fs::read_to_string(source).map_err(|e| format!("cannot read {}: {e}", source.display()))?;
    let write =
        |to: &Path, bytes: &[u8]| fs::write(to, bytes).map_err(|e| format!("cannot write {}: {e}", to.display()));
    // Whoever is interrupted between the two compiles again.
    let _ = fs::remove_file(&made_of);
    write(file, &compile(root, source, &text)?)?;
    write(&made_of, now.as_bytes())?;
    Ok(true)
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
