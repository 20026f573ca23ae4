//! Build script: links the libraries that shaderc (compiler from GLSL to SPIR-V) needs besides its own archive, for all
//! programs that use palpate.
//!
//! Debian and Ubuntu divide shaderc into archives that do not refer to each other: `libshaderc_combined.a` lacks
//! glslang and SPIRV-Tools. This script merges the missing libraries into one archive, which is linked as a whole.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::{env, fs};

/// Libraries that Debian's shaderc archive lacks; the list covers the names that they have in several versions.
const PARTS: [&str; 10] = [
    "glslang",
    "SPIRV",
    "MachineIndependent",
    "GenericCodeGen",
    "OGLCompiler",
    "OSDependent",
    "HLSL",
    "glslang-default-resource-limits",
    "SPIRV-Tools-opt",
    "SPIRV-Tools",
];

fn main() -> ExitCode {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=SHADERC_LIB_DIR");
    match link() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

/// Links the libraries that the system's shaderc lacks on Linux. On other systems, and where the user names a folder
/// with shaderc or builds shaderc from source, shaderc's own archive is complete.
fn link() -> Result<(), String> {
    let is_linux = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux");
    let is_given = env::var_os("SHADERC_LIB_DIR").is_some() || env::var_os("VULKAN_SDK").is_some();
    if !is_linux || is_given || env::var_os("CARGO_FEATURE_BUILD_FROM_SOURCE").is_some() {
        return Ok(());
    }
    let architecture = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
    let folders = [format!("/usr/lib/{architecture}-linux-gnu"), "/usr/lib64".into(), "/usr/lib".into()];
    let has = |folder: &&String, file: &str| Path::new(folder.as_str()).join(file).exists();
    let Some(system) =
        folders.iter().find(|folder| has(folder, "libshaderc_combined.a") || has(folder, "libshaderc.so"))
    else {
        return Err(
            "shaderc, which compiles the shaders, is missing: run palpate's setup.sh, or name the folder of a \
                    prebuilt one in SHADERC_LIB_DIR, or build it by the feature palpate/build-shaderc"
                .into(),
        );
    };
    if has(&system, "libshaderc_combined.a") && has(&system, "libglslang.a") {
        merge(Path::new(system))?;
    }
    Ok(())
}

/// Whether an archive holds nothing: since glslang 15 some of its libraries are kept only so that old build scripts find
/// them, and each has the same single member, whose symbol cannot be linked twice.
fn is_stub(archive: &Path) -> Result<bool, String> {
    let listed = Command::new("ar").arg("t").arg(archive).output();
    let listed = listed.map_err(|error| format!("`ar` cannot be run: {error}; run palpate's setup.sh"))?;
    Ok(String::from_utf8_lossy(&listed.stdout).trim() == "stub.cpp.o")
}

/// Merges the libraries in [`PARTS`] that exist in the folder `system` into one archive, and links the archive.
fn merge(system: &Path) -> Result<(), String> {
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("cargo did not set OUT_DIR")?);
    let merged = out.join("libpalpate_glslang.a");
    if merged.exists() {
        fs::remove_file(&merged).map_err(|error| format!("cannot replace {}: {error}", merged.display()))?;
    }
    let mut script = format!("CREATE {}\n", merged.display());
    for file in PARTS.map(|part| system.join(format!("lib{part}.a"))).iter().filter(|file| file.exists()) {
        if !is_stub(file)? {
            script += &format!("ADDLIB {}\n", file.display());
        }
    }
    script += "SAVE\nEND\n";
    let failed = |why: String| format!("shaderc's archives cannot be merged by `ar -M`: {why}; run palpate's setup.sh");
    let mut ar =
        Command::new("ar").arg("-M").stdin(Stdio::piped()).spawn().map_err(|error| failed(error.to_string()))?;
    let mut input = ar.stdin.take().ok_or("cannot write to the standard input of `ar`")?;
    input.write_all(script.as_bytes()).map_err(|error| failed(error.to_string()))?;
    drop(input);
    let status = ar.wait().map_err(|error| failed(error.to_string()))?;
    if !status.success() || !merged.exists() {
        return Err(failed(format!("it ended with {status}")));
    }
    println!("cargo:rustc-link-search=native={}", out.display());
    println!("cargo:rustc-link-lib=static:+whole-archive=palpate_glslang");
    println!("cargo:rustc-link-lib=stdc++");
    Ok(())
}
