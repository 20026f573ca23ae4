//! Build script: compiles every `shaders/<stage>/*.{comp,vert,frag}` from GLSL to SPIR-V and writes the sorted table
//! `SHADERS` that `src/gpu/kernel.rs` includes. `shaders/shared` holds only what others include.
//!
//! Names stay in the SPIR-V: reflection finds bindings, structs and specialization constants by them.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, process};

use shaderc::{
    CompileOptions, Compiler, EnvVersion, IncludeType, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion,
    TargetEnv,
};

fn main() {
    if let Err(message) = build() {
        eprintln!("{message}");
        process::exit(1);
    }
}

/// Compiles all shaders; the message of an error names the file and line.
fn build() -> Result<(), String> {
    println!("cargo:rerun-if-changed=shaders");
    tell_commit();
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
        fs::write(&file, compile(&root, source)?).map_err(|e| format!("cannot write {}: {e}", file.display()))?;
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

/// The commit that reports name, as `PALPATE_COMMIT`; changes since then are not known to it.
fn tell_commit() {
    let git = |arguments: &[&str]| {
        let output = process::Command::new("git").args(arguments).output().ok().filter(|o| o.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string()).filter(|text| !text.is_empty())
    };
    println!(
        "cargo:rustc-env=PALPATE_COMMIT={}",
        git(&["rev-parse", "--short=10", "HEAD"]).unwrap_or("unknown".into())
    );
    // Written with every commit and checkout; a file that is not there would have this script run every time.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo:rerun-if-changed={log}");
    }
}

/// The sorted contents of a folder.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let list = fs::read_dir(folder).map_err(|e| format!("cannot read {}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = list.filter_map(|entry| entry.ok().map(|e| e.path())).collect();
    paths.sort();
    Ok(paths)
}

/// The shader stage a file's ending stands for.
fn kind(path: &Path) -> Option<ShaderKind> {
    match path.extension()?.to_str()? {
        "comp" => Some(ShaderKind::Compute),
        "vert" => Some(ShaderKind::Vertex),
        "frag" => Some(ShaderKind::Fragment),
        _ => None,
    }
}

/// `solve/apply` for a compute shader, `depth/depth.vert` for a stage of the graphics pipeline.
fn name(root: &Path, source: &Path) -> String {
    let relative = source.strip_prefix(root).unwrap_or(source).to_string_lossy().replace('\\', "/");
    relative.strip_suffix(".comp").unwrap_or(&relative).to_string()
}

/// One shader to SPIR-V 1.6; warnings are errors.
fn compile(root: &Path, source: &Path) -> Result<Vec<u8>, String> {
    let text = fs::read_to_string(source).map_err(|e| format!("cannot read {}: {e}", source.display()))?;
    let compiler = Compiler::new().map_err(|e| format!("shaderc does not start: {e}; run setup.sh"))?;
    let mut options = CompileOptions::new().map_err(|e| format!("shaderc has no options: {e}"))?;
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(SpirvVersion::V1_6);
    options.set_optimization_level(OptimizationLevel::Performance);
    options.set_generate_debug_info();
    options.set_warnings_as_errors();
    options.set_include_callback(move |asked, _: IncludeType, from, _| {
        let path = root.join(asked);
        match fs::read_to_string(&path) {
            Ok(content) => Ok(ResolvedInclude { resolved_name: format!("shaders/{asked}"), content }),
            Err(e) => Err(format!("{from} includes \"{asked}\", which cannot be read at {}: {e}", path.display())),
        }
    });
    let kind = kind(source).ok_or("not a shader")?;
    let shown = format!("shaders/{}", source.strip_prefix(root).unwrap_or(source).display());
    let binary = compiler
        .compile_into_spirv(&text, kind, &shown, "main", Some(&options))
        .map_err(|e| format!("a shader does not compile:\n{e}"))?;
    Ok(binary.as_binary_u8().to_vec())
}
