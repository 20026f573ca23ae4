//! Compiles GLSL shaders to SPIR-V by glslc, the command of shaderc, with the same options for palpate's build script
//! and for tests.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest as _, Sha256};

/// The options of glslc that every shader is compiled with. Warnings are errors. The shaders' text gives buffers no
/// binding numbers: they are bound by name.
const OPTIONS: [&str; 6] =
    ["--target-env=vulkan1.3", "--target-spv=spv1.6", "-O", "-g", "-Werror", "-fauto-bind-uniforms"];

/// How a shader reads its read-only arrays of vectors; `shaders/shared/arrays.glsl` declares both ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrays {
    /// Through texel buffers.
    Texel,
    /// Through storage buffers.
    Storage,
}

/// Whether a file's extension is that of a shader stage.
pub fn is_shader(path: &Path) -> bool {
    path.extension().is_some_and(|extension| ["comp", "vert", "frag"].iter().any(|stage| extension == *stage))
}

/// The text of the shader `source`, in the folder of shaders `root`, and of all files that it includes, in order, each
/// after a line with its name.
pub fn whole_text(root: &Path, source: &Path) -> Result<String, String> {
    let (mut files, mut text, mut next) = (vec![source.to_path_buf()], String::new(), 0);
    while let Some(file) = files.get(next).cloned() {
        let content = fs::read_to_string(&file).map_err(|e| format!("cannot read {}: {e}", file.display()))?;
        text += &format!("// {}\n{content}\n", file.strip_prefix(root).unwrap_or(&file).display());
        for asked in content.lines().filter_map(|line| line.trim().strip_prefix("#include")) {
            let included = root.join(asked.trim().trim_matches(['"', '<', '>']));
            if !files.contains(&included) {
                files.push(included);
            }
        }
        next += 1;
    }
    Ok(text)
}

/// The SHA-256 digest of all that the binary of a shader depends on but for the compiler's version: the compiler's
/// options (this file) and the shader's [`whole_text`].
pub fn digest(whole_text: &str) -> String {
    let digest = Sha256::new().chain_update(include_str!("lib.rs")).chain_update(whole_text).finalize();
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Compiles the shader in the file `source`, which includes files of the folder of shaders `root`, to SPIR-V 1.6.
pub fn compile(root: &Path, source: &Path, arrays: Arrays) -> Result<Vec<u8>, String> {
    let glslc = glslc();
    let shown =
        |path: &Path| path.strip_prefix(root).map_or(path.to_path_buf(), |path| Path::new("shaders").join(path));
    let mut command = Command::new(&glslc);
    command.args(OPTIONS).arg("-Ishaders").args(["-o", "-"]).arg(shown(source));
    if arrays == Arrays::Texel {
        command.arg("-DTEXEL_ARRAYS");
    }
    // Names in the binary and in messages begin with `shaders/`, wherever the repository is.
    let output = command.current_dir(root.parent().unwrap_or(root)).output().map_err(|error| {
        format!(
            "the GLSL compiler {} cannot be run: {error}; run palpate's setup.sh, or name shaderc's glslc in the \
             environment variable GLSLC",
            glslc.display()
        )
    })?;
    if !output.status.success() {
        let messages = String::from_utf8_lossy(&output.stderr);
        return Err(format!("{} does not compile:\n{messages}", shown(source).display()));
    }
    Ok(output.stdout)
}

/// The command that compiles: what the environment variable GLSLC names, or else that of the Vulkan SDK in use, or
/// else the system's.
fn glslc() -> PathBuf {
    let sdk =
        || std::env::var_os("VULKAN_SDK").map(|sdk| Path::new(&sdk).join("bin/glslc")).filter(|path| path.exists());
    std::env::var_os("GLSLC").map(PathBuf::from).or_else(sdk).unwrap_or_else(|| OsString::from("glslc").into())
}
