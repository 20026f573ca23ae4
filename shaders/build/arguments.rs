//! Generates a Rust struct of the arguments of each kernel (compute shader, or graphics pipeline of a vertex and a
//! fragment shader): push constants and buffers under the names that the shader gives them. Part of the build script.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::structs::{self, Types};
use super::{Shader, comments, specialise, spirv};

/// A buffer of a shader.
struct Buffer {
    name: String,
    /// Rust type of its contents.
    content: String,
    /// The shader's comment on the buffer, for documentation.
    comment: String,
    /// How the shader accesses the buffer: "read", "written" or "read and written".
    access: &'static str,
    /// Whether the shader leaves the buffer unused at some values of its specialization constants.
    is_optional: bool,
}

/// The Rust text of one module for each stage (folder of shaders), with the arguments of its kernels and its own
/// structs.
pub fn modules(headers: &[String], shaders: &[Shader]) -> Result<String, String> {
    let mut stages: BTreeMap<&str, String> = BTreeMap::new();
    let mut structs: BTreeMap<&str, BTreeMap<String, String>> = BTreeMap::new();
    // The vertex and fragment shader of a graphics pipeline share one struct of arguments.
    let mut pipelines: BTreeMap<&str, Vec<&Shader>> = BTreeMap::new();
    for shader in shaders {
        let pipeline = shader.name.strip_suffix(".vert").or(shader.name.strip_suffix(".frag"));
        let Some((stage, _)) = shader.name.split_once('/') else { continue };
        for (name, text) in structs::own(headers, shader)? {
            if *structs.entry(stage).or_default().entry(name.clone()).or_insert_with(|| text.clone()) != text {
                return Err(format!("two shaders of stage {stage} declare the struct {name} with different layouts"));
            }
        }
        match pipeline {
            Some(name) => pipelines.entry(name).or_default().push(shader),
            None => *stages.entry(stage).or_default() += &arguments(&shader.name, "", &[shader])?,
        }
    }
    for (name, shaders) in pipelines {
        let stage = name.split_once('/').map_or("", |(stage, _)| stage);
        *stages.entry(stage).or_default() += &arguments(name, "Draw", &shaders)?;
    }
    let storage = |shader: &Shader| -> Result<usize, String> {
        let bindings = spirv::reflect(&shader.words)?.bindings;
        Ok(bindings.iter().filter(|binding| binding.kind == spirv::BindingKind::Storage).count())
    };
    let most = shaders.iter().map(storage).collect::<Result<Vec<_>, _>>()?.into_iter().max().unwrap_or(0);
    let mut out = format!(
        "/// Greatest number of storage buffers of any shader, in its version without texel buffers.\n\
         pub const MOST_STORAGE_BUFFERS: u32 = {most};\n"
    );
    for (stage, text) in stages {
        let own: String = structs.remove(stage).unwrap_or_default().into_values().collect();
        let _ = write!(
            out,
            "/// Shaders of `shaders/{stage}`.\npub mod {stage} {{\nuse crate::gpu::{{Arguments, Buffer}};\n\
             #[allow(unused_imports)]\nuse super::*;\n{own}{text}}}\n"
        );
    }
    Ok(out)
}

/// The Rust text of the struct of arguments for a shader or pipeline; `prefix` begins the struct's name.
fn arguments(name: &str, prefix: &str, shaders: &[&Shader]) -> Result<String, String> {
    let stem = name.rsplit('/').next().unwrap_or(name);
    let words: String = stem.split('_').map(|word| word[..1].to_uppercase() + &word[1..]).collect();
    let type_name = format!("{prefix}{words}");
    let (mut push, mut buffers): (Vec<structs::Member>, Vec<Buffer>) = (Vec::new(), Vec::new());
    for shader in shaders {
        let types = Types::of(&shader.words)?;
        let own = types.push();
        if !push.is_empty() && !own.is_empty() && own != push {
            return Err(format!("vertex and fragment shader of {name} declare different push constants"));
        }
        push = if push.is_empty() { own } else { push };
        let optional = specialise::optional(&shader.words)?;
        for binding in spirv::reflect(&shader.words)?.bindings {
            let own = Buffer {
                content: types.content(binding.variable),
                comment: comments::declaration(&shader.text, &binding.name),
                access: match (binding.reads, binding.writes) {
                    (true, true) => "read and written",
                    (_, true) => "written",
                    _ => "read",
                },
                is_optional: optional.contains(&binding.variable),
                name: binding.name,
            };
            match buffers.iter_mut().find(|other| other.name == own.name) {
                None => buffers.push(own),
                Some(other) if other.content != own.content => {
                    return Err(format!(
                        "vertex and fragment shader of {name} declare buffer {} with different types",
                        own.name
                    ));
                }
                Some(other) => other.is_optional &= own.is_optional,
            }
        }
    }
    let lifetime = if buffers.is_empty() { "" } else { "<'a>" };
    let mut out = format!("/// Arguments of `shaders/{name}`.\npub struct {type_name}{lifetime} {{\n");
    for structs::Member { name, ty, .. } in &push {
        let comment = shaders.iter().map(|shader| comments::declaration(&shader.text, name)).find(|c| !c.is_empty());
        let comment = comment.map(|comment| format!(": {comment}")).unwrap_or_default();
        let _ = writeln!(out, "    /// A push constant{comment}.\n    pub {name}: {ty},");
    }
    for Buffer { name, content, comment, access, is_optional } in &buffers {
        let comment = if comment.is_empty() { String::new() } else { format!(": {comment}") };
        let ty = if *is_optional { "Option<&'a Buffer>" } else { "&'a Buffer" };
        let when = if *is_optional { " by some variants" } else { "" };
        let _ = writeln!(out, "    /// `{content}`, {access}{when}{comment}.\n    pub {name}: {ty},");
    }
    let unnamed = if buffers.is_empty() { "" } else { "<'_>" };
    let list = |item: &dyn Fn(&Buffer) -> String| buffers.iter().map(item).collect::<Vec<_>>().join(", ");
    let given = list(&|b| {
        let Buffer { name, is_optional, .. } = b;
        format!("({name:?}, {})", if *is_optional { format!("self.{name}") } else { format!("Some(self.{name})") })
    });
    let bytes = |member: &structs::Member| format!("bytemuck::bytes_of(&self.{})", member.name);
    let pushed = match &push[..] {
        [] => "Vec::new()".into(),
        members => format!("[{}].concat()", members.iter().map(bytes).collect::<Vec<_>>().join(", ")),
    };
    let _ = writeln!(
        out,
        "}}\nimpl Arguments for {type_name}{unnamed} {{\n    fn shader(&self) -> &str {{\n        {name:?}\n    }}\n    \
         fn buffers(&self) -> Vec<(&str, Option<&Buffer>)> {{\n        vec![{given}]\n    }}\n    \
         fn push(&self) -> Vec<u8> {{\n        {pushed}\n    }}\n}}"
    );
    Ok(out)
}
