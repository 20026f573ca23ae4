//! Reads a shader's interface from its SPIR-V: bindings (buffers), push constants and specialization constants. The
//! interface is written down only in the shader: pipelines make their Vulkan layouts from what is read here, and the
//! build script generates from it the structs of arguments that Rust code fills.
//!
//! Numbers of instructions and decorations are those of the Khronos SPIR-V specification, version 1.6.

use std::collections::{BTreeMap, HashMap};

/// The kind of buffer of a binding, as GLSL declares it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BindingKind {
    /// `buffer` block.
    Storage,
    /// `uniform` block.
    Uniform,
    /// `imageBuffer`: four floats an element.
    TexelFloat,
    /// `uimageBuffer`: four unsigned integers an element.
    TexelUint,
}

/// One binding of descriptor set 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Binding {
    /// SPIR-V id of the shader's variable for the buffer.
    pub variable: u32,
    /// Binding number of the buffer.
    pub binding: u32,
    /// Name of the buffer in the shader: the block's instance name; without one, the name of the block's only member;
    /// if there are several members, the block's name.
    pub name: String,
    /// Kind of the buffer.
    pub kind: BindingKind,
    /// Whether the shader may read the buffer, that is, does not declare it `writeonly`.
    pub reads: bool,
    /// Whether the shader may write the buffer, that is, does not declare it `readonly`.
    pub writes: bool,
}

/// The type of a specialization constant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConstKind {
    /// `bool`.
    Bool,
    /// `uint`.
    Uint,
    /// `int`.
    Int,
    /// `float`.
    Float,
}

/// Everything reflected from one shader.
#[derive(Debug, Clone, Default)]
pub struct Reflection {
    /// Bindings of descriptor set 0, by ascending binding number.
    pub bindings: Vec<Binding>,
    /// Size of the push constants, bytes; 0 where there are none.
    pub push_bytes: u32,
    /// For each specialization constant, by name: its constant id and its type.
    pub constants: BTreeMap<String, (u32, ConstKind)>,
}

impl Reflection {
    /// Names of the buffers in `bindings`.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.bindings.iter().map(|binding| binding.name.as_str())
    }
}

/// Sets the binding number of each variable of a SPIR-V module that `bindings` lists to the number in `bindings`.
pub fn renumber(words: &mut [u32], bindings: &[Binding]) -> Result<(), String> {
    let mut at = HEADER;
    let lengths: Vec<usize> = instructions(words)?.iter().map(|instruction| instruction.words.len()).collect();
    for length in lengths {
        if let [first, variable, BINDING, number] = &mut words[at..at + length]
            && *first & 0xffff == DECORATE
            && let Some(binding) = bindings.iter().find(|binding| binding.variable == *variable)
        {
            *number = binding.binding;
        }
        at += length;
    }
    Ok(())
}

/// A type of the module; the fields `of`, `to`, `sampled` and `members` are ids of types.
#[derive(Debug, Clone)]
enum Type {
    Bool,
    Int { bytes: u32, signed: bool },
    Float { bytes: u32 },
    Vector { of: u32, count: u32 },
    Matrix { columns: u32 },
    Array { of: u32, length: u32 },
    RuntimeArray,
    Struct { members: Vec<u32> },
    BufferImage { sampled: u32 },
    Pointer { to: u32 },
}

/// Those decorations of a variable, a type or a struct member that this file needs.
#[derive(Debug, Clone, Copy, Default)]
struct Marks {
    spec_id: Option<u32>,
    binding: Option<u32>,
    set: Option<u32>,
    block: bool,
    offset: Option<u32>,
    array_stride: u32,
    matrix_stride: u32,
    non_writable: bool,
    non_readable: bool,
}

/// What this file needs of a SPIR-V module, by SPIR-V ids; a member is named by its struct type's id and its index.
#[derive(Default)]
struct Module {
    names: HashMap<u32, String>,
    member_names: HashMap<(u32, u32), String>,
    marks: HashMap<u32, Marks>,
    member_marks: HashMap<(u32, u32), Marks>,
    types: BTreeMap<u32, Type>,
    constants: HashMap<u32, u32>,
    /// Id and type of each specialization constant.
    spec_constants: Vec<(u32, u32)>,
    /// Id, type and storage class of each variable.
    variables: Vec<(u32, u32, u32)>,
}

const DECORATE: u32 = 71;
const BINDING: u32 = 33;
const MAGIC: u32 = 0x0723_0203;
const STORAGE_UNIFORM_CONSTANT: u32 = 0;
const STORAGE_UNIFORM: u32 = 2;
const STORAGE_PUSH_CONSTANT: u32 = 9;
const STORAGE_BUFFER: u32 = 12;

/// Reads the interface that a SPIR-V module declares; an error names the part of the module that the engine cannot use.
pub fn reflect(words: &[u32]) -> Result<Reflection, String> {
    let module = parse(words)?;
    let mut out = Reflection::default();
    for &(id, ty, storage) in &module.variables {
        let Some(Type::Pointer { to }) = module.types.get(&ty) else { continue };
        match storage {
            STORAGE_PUSH_CONSTANT => out.push_bytes = module.size(*to, 0),
            STORAGE_UNIFORM_CONSTANT | STORAGE_UNIFORM | STORAGE_BUFFER => {
                out.bindings.push(module.binding(id, *to, storage)?);
            }
            _ => {}
        }
    }
    out.bindings.sort_by_key(|b| b.binding);
    if let Some(pair) = out.bindings.windows(2).find(|pair| pair[0].binding == pair[1].binding) {
        return Err(format!("binding {} is declared twice: {} and {}", pair[0].binding, pair[0].name, pair[1].name));
    }
    for &(id, ty) in &module.spec_constants {
        let (Some(name), Some(spec_id)) = (module.names.get(&id), module.marks.get(&id).and_then(|m| m.spec_id)) else {
            continue;
        };
        let kind = match module.types.get(&ty) {
            Some(Type::Bool) => ConstKind::Bool,
            Some(Type::Int { signed: true, bytes: 4 }) => ConstKind::Int,
            Some(Type::Int { signed: false, bytes: 4 }) => ConstKind::Uint,
            Some(Type::Float { bytes: 4 }) => ConstKind::Float,
            _ => return Err(format!("specialization constant {name} is not a 32-bit scalar")),
        };
        out.constants.insert(name.clone(), (spec_id, kind));
    }
    Ok(out)
}

fn parse(words: &[u32]) -> Result<Module, String> {
    let mut module = Module::default();
    for Instruction { opcode, operands, .. } in instructions(words)? {
        module.instruction(opcode, operands);
    }
    Ok(module)
}

/// An instruction of a module.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instruction<'a> {
    pub opcode: u32,
    pub operands: &'a [u32],
    /// All words of the instruction: one for its length and opcode, then the operands.
    pub words: &'a [u32],
}

/// Number of words of a module before its first instruction.
pub(super) const HEADER: usize = 5;

/// All instructions of a module, in order.
pub(super) fn instructions(words: &[u32]) -> Result<Vec<Instruction<'_>>, String> {
    if words.len() < HEADER || words[0] != MAGIC {
        return Err("not SPIR-V".into());
    }
    let (mut at, mut out) = (HEADER, Vec::new());
    while at < words.len() {
        let (length, opcode) = ((words[at] >> 16) as usize, words[at] & 0xffff);
        let words = words[at..].get(..length).filter(|words| !words.is_empty());
        let words = words.ok_or_else(|| format!("instruction at word {at} runs past the end"))?;
        out.push(Instruction { opcode, operands: &words[1..], words });
        at += length;
    }
    Ok(out)
}

/// Decodes a literal string: UTF-8 in little-endian words, ended by a zero byte.
fn string(words: &[u32]) -> String {
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).take_while(|&b| b != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

impl Module {
    fn instruction(&mut self, opcode: u32, w: &[u32]) {
        match (opcode, w) {
            (5, [id, text @ ..]) => drop(self.names.insert(*id, string(text))),
            (6, [id, member, text @ ..]) => drop(self.member_names.insert((*id, *member), string(text))),
            (71, [id, mark, rest @ ..]) => self.marks.entry(*id).or_default().set(*mark, rest),
            (72, [id, member, mark, rest @ ..]) => {
                self.member_marks.entry((*id, *member)).or_default().set(*mark, rest);
            }
            (20, [id]) => drop(self.types.insert(*id, Type::Bool)),
            (21, [id, bits, sign]) => {
                self.types.insert(*id, Type::Int { bytes: bits / 8, signed: *sign == 1 });
            }
            (22, [id, bits, ..]) => drop(self.types.insert(*id, Type::Float { bytes: bits / 8 })),
            (23, [id, of, count]) => drop(self.types.insert(*id, Type::Vector { of: *of, count: *count })),
            (24, [id, _, columns]) => drop(self.types.insert(*id, Type::Matrix { columns: *columns })),
            // Images with dimensionality 5 (buffer) that are used as storage images (2) are storage texel buffers. All
            // other images are left out here, so that a binding which uses one is reported as an error.
            (25, [id, sampled, 5, _, _, _, 2, ..]) => {
                drop(self.types.insert(*id, Type::BufferImage { sampled: *sampled }))
            }
            (28, [id, of, length]) => {
                let length = self.constants.get(length).copied().unwrap_or(0);
                self.types.insert(*id, Type::Array { of: *of, length });
            }
            (29, [id, _]) => drop(self.types.insert(*id, Type::RuntimeArray)),
            (30, [id, members @ ..]) => drop(self.types.insert(*id, Type::Struct { members: members.to_vec() })),
            (32, [id, _, to]) => drop(self.types.insert(*id, Type::Pointer { to: *to })),
            (43, [_, id, value, ..]) => drop(self.constants.insert(*id, *value)),
            (48..=50, [ty, id, ..]) => self.spec_constants.push((*id, *ty)),
            (59, [ty, id, storage, ..]) => self.variables.push((*id, *ty, *storage)),
            _ => {}
        }
    }

    fn binding(&self, id: u32, ty: u32, storage: u32) -> Result<Binding, String> {
        let marks = self.marks.get(&id).copied().unwrap_or_default();
        let name = self.binding_name(id, ty);
        let number = marks.binding.ok_or_else(|| format!("{name} has no binding number"))?;
        if marks.set.unwrap_or(0) != 0 {
            return Err(format!("{name} is in descriptor set {}; only set 0 is used", marks.set.unwrap_or(0)));
        }
        let kind = match storage {
            STORAGE_BUFFER => BindingKind::Storage,
            STORAGE_UNIFORM if self.marks.get(&ty).is_some_and(|m| m.block) => BindingKind::Uniform,
            _ => self.texel_kind(ty).ok_or_else(|| {
                format!("{name} is neither a buffer block, a uniform block, an imageBuffer nor a uimageBuffer")
            })?,
        };
        let all = |mark: fn(&Marks) -> bool| match self.types.get(&ty) {
            Some(Type::Struct { members }) => {
                (0..members.len() as u32).all(|m| self.member_marks.get(&(ty, m)).is_some_and(mark))
            }
            _ => false,
        };
        let reads = !(marks.non_readable || all(|m| m.non_readable));
        let writes = kind != BindingKind::Uniform && !(marks.non_writable || all(|m| m.non_writable));
        Ok(Binding { variable: id, binding: number, name, kind, reads, writes })
    }

    fn binding_name(&self, id: u32, ty: u32) -> String {
        let named = |name: Option<&String>| name.filter(|n| !n.is_empty()).cloned();
        let only_member = match self.types.get(&ty) {
            Some(Type::Struct { members }) if members.len() == 1 => named(self.member_names.get(&(ty, 0))),
            _ => None,
        };
        named(self.names.get(&id))
            .or(only_member)
            .or_else(|| named(self.names.get(&ty)))
            .unwrap_or_else(|| format!("variable {id}"))
    }

    fn texel_kind(&self, ty: u32) -> Option<BindingKind> {
        match self.types.get(&ty)? {
            Type::BufferImage { sampled } => match self.types.get(sampled)? {
                Type::Float { bytes: 4 } => Some(BindingKind::TexelFloat),
                Type::Int { bytes: 4, signed: false } => Some(BindingKind::TexelUint),
                _ => None,
            },
            _ => None,
        }
    }

    /// Size of a type, bytes. `matrix_stride` (bytes) decorates the struct member that has this type; 0 if none is
    /// given.
    fn size(&self, id: u32, matrix_stride: u32) -> u32 {
        match self.types.get(&id) {
            Some(Type::Int { bytes, .. } | Type::Float { bytes }) => *bytes,
            Some(Type::Vector { of, count }) => self.size(*of, 0) * count,
            Some(Type::Matrix { columns, .. }) => matrix_stride * columns,
            Some(Type::Array { of, length }) => {
                let stride = self.marks.get(&id).map_or(0, |m| m.array_stride);
                length * if stride > 0 { stride } else { self.size(*of, matrix_stride) }
            }
            Some(Type::Struct { members }) => members.iter().zip(0..).fold(0, |end: u32, (&ty, m)| {
                let marks = self.member_marks.get(&(id, m)).copied().unwrap_or_default();
                end.max(marks.offset.unwrap_or(0) + self.size(ty, marks.matrix_stride))
            }),
            _ => 0,
        }
    }
}

impl Marks {
    fn set(&mut self, mark: u32, rest: &[u32]) {
        let value = rest.first().copied();
        match mark {
            1 => self.spec_id = value,
            2 => self.block = true,
            6 => self.array_stride = value.unwrap_or(0),
            7 => self.matrix_stride = value.unwrap_or(0),
            24 => self.non_writable = true,
            25 => self.non_readable = true,
            33 => self.binding = value,
            34 => self.set = value,
            35 => self.offset = value,
            _ => {}
        }
    }
}
