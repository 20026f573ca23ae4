//! Compiles GLSL shaders to SPIR-V by shaderc, with the same options for palpate's build script and for tests.

use std::fs;
use std::path::Path;

use shaderc::{
    CompileOptions, Compiler, EnvVersion, IncludeType, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion,
    TargetEnv,
};

/// The shader stage that a file's extension names; `None` if it names no stage.
pub fn kind(path: &Path) -> Option<ShaderKind> {
    match path.extension()?.to_str()? {
        "comp" => Some(ShaderKind::Compute),
        "vert" => Some(ShaderKind::Vertex),
        "frag" => Some(ShaderKind::Fragment),
        _ => None,
    }
}

/// The text of everything that the binary of the shader `source` depends on: how it is compiled (this file), the
/// shader's own file, and all files that it includes, in order. If this text has not changed, neither has the binary,
/// as long as shaderc is the same.
pub fn ingredients(root: &Path, source: &Path) -> Result<String, String> {
    let (mut files, mut text) = (vec![source.to_path_buf()], include_str!("lib.rs").to_string());
    let mut next = 0;
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

/// How a shader reads its read-only arrays of vectors; `shaders/shared/arrays.glsl` declares both ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrays {
    /// Through texel buffers.
    Texel,
    /// Through storage buffers.
    Storage,
}

/// Compiles the text of the shader `source`, in the folder of shaders `root`, to SPIR-V 1.6; warnings are errors.
pub fn compile(root: &Path, source: &Path, text: &str, arrays: Arrays) -> Result<Vec<u8>, String> {
    let compiler = Compiler::new().map_err(|e| format!("shaderc (GLSL compiler) cannot start: {e}; run setup.sh"))?;
    let mut options = CompileOptions::new().map_err(|e| format!("shaderc cannot create compile options: {e}"))?;
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(SpirvVersion::V1_6);
    options.set_optimization_level(OptimizationLevel::Performance);
    options.set_generate_debug_info();
    options.set_warnings_as_errors();
    // The shaders' text gives buffers no binding numbers: they are bound by name.
    options.set_auto_bind_uniforms(true);
    if arrays == Arrays::Texel {
        options.add_macro_definition("TEXEL_ARRAYS", None);
    }
    let folder = root.to_path_buf();
    options.set_include_callback(move |asked, _: IncludeType, from, _| {
        let path = folder.join(asked);
        match fs::read_to_string(&path) {
            Ok(content) => Ok(ResolvedInclude { resolved_name: format!("shaders/{asked}"), content }),
            Err(e) => Err(format!("{from} includes \"{asked}\", which cannot be read at {}: {e}", path.display())),
        }
    });
    let shown = format!("shaders/{}", source.strip_prefix(root).unwrap_or(source).display());
    let unknown = || format!("{shown} is not a shader: its extension must be .comp, .vert or .frag");
    let kind = kind(source).ok_or_else(unknown)?;
    let binary = compiler
        .compile_into_spirv(text, kind, &shown, "main", Some(&options))
        .map_err(|e| format!("{shown} does not compile:\n{e}"))?;
    Ok(binary.as_binary_u8().to_vec())
}
