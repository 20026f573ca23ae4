//! Generates Rust structs for the structs that shaders keep in buffers, with the same layout: names and offsets from
//! the SPIR-V, comments from the GLSL. Part of the build script.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;

use super::spirv::instructions;
use super::{Shader, comments};

/// The types, names and layouts of a SPIR-V module, by the ids that the module gives them.
#[derive(Default)]
pub struct Types {
    names: HashMap<u32, String>,
    member_names: HashMap<(u32, u32), String>,
    offsets: HashMap<(u32, u32), u32>,
    blocks: Vec<u32>,
    constants: HashMap<u32, u32>,
    types: BTreeMap<u32, Type>,
    /// Type of the block of push constants.
    push: Option<u32>,
    variables: HashMap<u32, u32>,
}

#[derive(Clone)]
enum Type {
    Scalar(&'static str),
    Several { of: u32, count: u32 },
    Unbounded { of: u32 },
    Struct { members: Vec<u32> },
    Pointer { to: u32 },
}

/// A member of a struct.
#[derive(Clone, PartialEq)]
pub struct Member {
    /// Its name.
    pub name: String,
    /// Its Rust type.
    pub ty: String,
    /// Its offset in bytes.
    pub offset: u32,
}

impl Types {
    /// Reads the types of a SPIR-V module. The numbers below are opcodes and operands of the SPIR-V specification.
    pub fn of(words: &[u32]) -> Result<Types, String> {
        let mut out = Types::default();
        for instruction in instructions(words)? {
            match (instruction.opcode, instruction.operands) {
                (5, [id, text @ ..]) => drop(out.names.insert(*id, string(text))),
                (6, [id, member, text @ ..]) => drop(out.member_names.insert((*id, *member), string(text))),
                (71, [id, 2]) => out.blocks.push(*id),
                (72, [id, member, 35, offset]) => drop(out.offsets.insert((*id, *member), *offset)),
                (21, [id, 32, 0]) => drop(out.types.insert(*id, Type::Scalar("u32"))),
                (21, [id, 32, 1]) => drop(out.types.insert(*id, Type::Scalar("i32"))),
                (22, [id, 32, ..]) => drop(out.types.insert(*id, Type::Scalar("f32"))),
                (23 | 24, [id, of, count]) => drop(out.types.insert(*id, Type::Several { of: *of, count: *count })),
                (28, [id, of, length]) => {
                    let count = out.constants.get(length).copied().unwrap_or(0);
                    out.types.insert(*id, Type::Several { of: *of, count });
                }
                (29, [id, of]) => drop(out.types.insert(*id, Type::Unbounded { of: *of })),
                (30, [id, members @ ..]) => drop(out.types.insert(*id, Type::Struct { members: members.to_vec() })),
                (32, [id, _, to]) => drop(out.types.insert(*id, Type::Pointer { to: *to })),
                (43, [_, id, value]) => drop(out.constants.insert(*id, *value)),
                (59, [ty, id, class, ..]) => {
                    if let Some(Type::Pointer { to }) = out.types.get(ty) {
                        out.variables.insert(*id, *to);
                        out.push = if *class == 9 { Some(*to) } else { out.push };
                    }
                }
                _ => {}
            }
        }
        Ok(out)
    }

    /// The Rust name of a type; `None` if a buffer cannot hold the type.
    fn rust(&self, id: u32) -> Option<String> {
        match self.types.get(&id)? {
            Type::Scalar(name) => Some((*name).into()),
            Type::Several { of, count } => Some(format!("[{}; {count}]", self.rust(*of)?)),
            Type::Unbounded { of } => Some(format!("[{}]", self.rust(*of)?)),
            Type::Struct { .. } => self.names.get(&id).cloned(),
            Type::Pointer { .. } => None,
        }
    }

    fn members(&self, id: u32) -> Option<Vec<Member>> {
        let Some(Type::Struct { members }) = self.types.get(&id) else { return None };
        let member = |(&ty, m): (&u32, u32)| {
            let name = self.member_names.get(&(id, m))?.clone();
            Some(Member { name, ty: self.rust(ty)?, offset: *self.offsets.get(&(id, m))? })
        };
        members.iter().zip(0..).map(member).collect()
    }

    /// The push constants, as members of their block.
    pub fn push(&self) -> Vec<Member> {
        self.push.and_then(|id| self.members(id)).unwrap_or_default()
    }

    /// Rust type of a buffer's contents: the type of its block's only member, or of the block if it has several
    /// members.
    pub fn content(&self, variable: u32) -> String {
        let block = self.variables.get(&variable).copied().unwrap_or_default();
        let members = self.members(block).unwrap_or_default();
        match members.as_slice() {
            [only] => only.ty.clone(),
            _ => self.names.get(&block).cloned().unwrap_or_default(),
        }
    }

    /// The structs that are members of buffers, without the blocks that are the buffers themselves.
    fn held(&self) -> impl Iterator<Item = (&str, Vec<Member>)> {
        let held = self.types.keys().filter(|id| !self.blocks.contains(id));
        held.filter_map(|id| Some((self.names.get(id)?.as_str(), self.members(*id)?)))
    }
}

/// The Rust text of the constants and structs of headers (files of `shaders/shared`).
pub fn shared(headers: &[String], shaders: &[Shader]) -> Result<String, String> {
    let mut out = String::new();
    for constant in headers.iter().flat_map(|header| comments::constants(header)) {
        let comments::Constant { ty, name, value, comment } = constant;
        let comment = if comment.is_empty() { format!("`{name}` of the shaders.") } else { sentence(&comment) };
        let _ = writeln!(out, "/// {comment}\npub const {name}: {ty} = {value};");
    }
    let mut known = BTreeMap::new();
    for shader in shaders {
        for (name, members) in Types::of(&shader.words)?.held() {
            if let Some(header) = headers.iter().find(|header| comments::defines(header, name)) {
                let own = definition(header, name, &members);
                if *known.entry(name.to_string()).or_insert_with(|| own.clone()) != own {
                    return Err(format!(
                        "shader {} declares {name} with a different layout than other shaders",
                        shader.name
                    ));
                }
            }
        }
    }
    Ok(out + &known.into_values().collect::<String>())
}

/// The Rust text of each struct that a shader defines itself, not a header; by the struct's name.
pub fn own(headers: &[String], shader: &Shader) -> Result<BTreeMap<String, String>, String> {
    let types = Types::of(&shader.words)?;
    let own = types.held().filter(|(name, _)| !headers.iter().any(|header| comments::defines(header, name)));
    Ok(own.map(|(name, members)| (name.to_string(), definition(&shader.text, name, &members))).collect())
}

/// The Rust text of a struct, with assertions that let the compiler check its offsets.
fn definition(text: &str, name: &str, members: &[Member]) -> String {
    let above = comments::above(text, name);
    let above = if above.is_empty() { format!("`{name}` of the shaders.") } else { above };
    let mut out = format!(
        "/// {above}\n#[repr(C)]\n#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]\n\
         pub struct {name} {{\n"
    );
    for Member { name: member, ty, .. } in members {
        let comment = comments::member(text, name, member);
        let comment = if comment.is_empty() { format!("`{member}` of the shaders.") } else { sentence(&comment) };
        let _ = writeln!(out, "    /// {comment}\n    pub {member}: {ty},");
    }
    let _ = write!(
        out,
        "}}\nimpl Default for {name} {{\n    fn default() -> Self {{\n        bytemuck::Zeroable::zeroed()\n    }}\n}}\n"
    );
    for Member { name: member, offset, .. } in members {
        let _ = writeln!(out, "const _: () = assert!(std::mem::offset_of!({name}, {member}) == {offset});");
    }
    out
}

/// Turns a comment into a sentence: with a capital letter and a full stop.
fn sentence(comment: &str) -> String {
    let mut letters = comment.chars();
    let first = letters.next().map(|first| first.to_uppercase().to_string()).unwrap_or_default();
    let rest = letters.as_str();
    format!("{first}{rest}{}", if rest.ends_with('.') { "" } else { "." })
}

/// Decodes a literal string of SPIR-V: UTF-8 in little-endian words, ended by a zero.
fn string(words: &[u32]) -> String {
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).take_while(|&b| b != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}
