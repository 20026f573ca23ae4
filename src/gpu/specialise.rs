//! Finds which bindings (buffers) a shader still uses once its specialization constants have values, and removes the
//! other bindings from its SPIR-V. Sparse conditional constant propagation (Wegman and Zadeck 1991) finds the basic
//! blocks that can run; a binding that none of these blocks uses is removed. So a kernel with given constants binds
//! only the buffers that it uses.
//!
//! Instruction numbers are those of the Khronos SPIR-V specification, version 1.6.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use super::spirv::{HEADER, Instruction, instructions};

/// What is known of an SSA value (the result of one instruction).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Value {
    /// The value has these 32 bits in every run of the shader; booleans are 0 and 1.
    Constant(u32),
    /// The value depends on specialization constants that are not given yet. Only [`optional`] uses such values: it
    /// follows a branch on such a value straight to the branch's merge block, since some choice of the constants may
    /// skip all code in between.
    Open,
    /// The value is known only when the shader runs.
    Varying,
}

/// The control flow of a SPIR-V module: which functions are called, and which basic blocks can run.
struct Flow<'a> {
    instructions: Vec<Instruction<'a>>,
    values: HashMap<u32, Value>,
    /// For each function, by its id: the range of its instructions in `instructions`.
    functions: HashMap<u32, Range<usize>>,
    /// Ids of the values inside functions that propagation evaluates; all others there are known only at run time.
    evaluated: HashSet<u32>,
    /// Ids of the image types: the types of texel buffers.
    images: HashSet<u32>,
    /// Ids of the functions that are called.
    called: HashSet<u32>,
    /// Ids of the labels of the basic blocks that can run.
    running: HashSet<u32>,
    /// Edges of the control flow that are taken: labels of the block that is left and of the block that is entered. The
    /// value is `true` for an edge from a branch on a [`Value::Open`] straight to the branch's merge block.
    ways: HashMap<(u32, u32), bool>,
}

/// Bit patterns of the values of specialization constants, keyed by constant id.
type Constants = HashMap<u32, u32>;

/// Returns a module without the bindings that it cannot use with these values of its specialization constants.
pub fn specialised(words: &[u32], constants: &Constants) -> Result<Vec<u32>, String> {
    Flow::of(words, Some(constants))?.stripped(words)
}

/// Ids of the bindings' variables that some choice of the specialization constants leaves unused; for the build script.
#[allow(dead_code)]
pub fn optional(words: &[u32]) -> Result<HashSet<u32>, String> {
    let flow = Flow::of(words, None)?;
    let used = flow.used();
    let variables = flow.instructions.iter().filter(|i| i.opcode == VARIABLE && is_binding(i.operands));
    Ok(variables.map(|i| i.operands[1]).filter(|id| !used.contains(id)).collect())
}

// Opcodes of SPIR-V instructions.
const NAME: u32 = 5;
const CAPABILITY: u32 = 17;
const ENTRY_POINT: u32 = 15;
const TYPE_BOOL: u32 = 20;
const CONSTANT_TRUE: u32 = 41;
const CONSTANT_FALSE: u32 = 42;
const CONSTANT: u32 = 43;
const CONSTANT_NULL: u32 = 46;
const SPEC_TRUE: u32 = 48;
const SPEC_FALSE: u32 = 49;
const SPEC: u32 = 50;
const SPEC_OP: u32 = 52;
const FUNCTION: u32 = 54;
const FUNCTION_END: u32 = 56;
const CALL: u32 = 57;
const VARIABLE: u32 = 59;
const DECORATE: u32 = 71;
const PHI: u32 = 245;
const LOOP_MERGE: u32 = 246;
const SELECTION_MERGE: u32 = 247;
const LABEL: u32 = 248;
const BRANCH: u32 = 249;
const BRANCH_CONDITIONAL: u32 = 250;
const SWITCH: u32 = 251;
const TYPE_IMAGE: u32 = 25;
const PTR_ACCESS_CHAIN: u32 = 67;
const IMAGE_TEXEL_POINTER: u32 = 60;
const IMAGE_QUERY_SIZE: u32 = 104;
const IMAGE_READ: u32 = 98;
const IMAGE_WRITE: u32 = 99;
const ATOMIC_STORE: u32 = 228;
/// Opcode of the first atomic instruction. All atomic instructions but `ATOMIC_STORE` return a value.
const ATOMIC_FIRST: u32 = 227;
/// Opcode of the last atomic instruction.
const ATOMIC_LAST: u32 = 242;
/// Opcodes of the first and of the last instruction that works on a whole subgroup. All of them return a value.
const SUBGROUP_FIRST: u32 = 333;
const SUBGROUP_LAST: u32 = 366;
/// Numbers of the capabilities `GroupNonUniform` and `GroupNonUniformArithmetic`.
const SUBGROUP_CAPABILITIES: [u32; 2] = [61, 63];
/// First word of an OpUndef instruction: its length (3 words) and its opcode (1).
const UNDEFINED_WORDS: u32 = (3 << 16) | 1;
const LOAD: u32 = 61;
const STORE: u32 = 62;
const COPY_MEMORY: u32 = 63;
const ACCESS_CHAIN: u32 = 65;
const IN_BOUNDS_ACCESS_CHAIN: u32 = 66;
const ARRAY_LENGTH: u32 = 68;
const COPY_OBJECT: u32 = 83;
/// Number of the decoration `SpecId`, which gives a specialization constant its id.
const SPEC_ID: u32 = 1;

/// Number of words of an OpEntryPoint before the variables that it names: one each for opcode, execution model and
/// function, and two for the name "main" with its terminating zero.
const ENTRY_WORDS: usize = 5;

/// Whether the OpVariable with the operands `variable` is a binding. The storage class is then uniform constant (0),
/// uniform block (2) or storage buffer (12).
fn is_binding(variable: &[u32]) -> bool {
    matches!(variable.get(2), Some(0 | 2 | 12))
}

/// Evaluates an instruction with operands `w`. The outer `None` means that instructions with this opcode are not
/// evaluated; the inner `None`, that nothing is known yet of an operand.
fn evaluate(opcode: u32, w: &[u32], value: impl Fn(u32) -> Option<Value>) -> Option<Option<Value>> {
    use Value::{Constant, Open, Varying};
    let both = |of: fn(u32, u32) -> Option<u32>| {
        let (Some(a), Some(b)) = (value(w[0]), value(w[1])) else { return None };
        Some(match (a, b) {
            (Constant(a), Constant(b)) => of(a, b).map_or(Varying, Constant),
            (Varying, _) | (_, Varying) => Varying,
            _ => Open,
        })
    };
    // For a logical operation, `deciding` is the operand value that decides the result alone: false for "and", true for
    // "or".
    let logical = |deciding: u32| {
        let (a, b) = (value(w[0]), value(w[1]));
        if [a, b].contains(&Some(Constant(deciding))) {
            return Some(Constant(deciding));
        }
        Some(match (a?, b?) {
            (Constant(_), other) | (other, Constant(_)) => other,
            (Open, _) | (_, Open) => Open,
            _ => Varying,
        })
    };
    Some(match (opcode, w.len()) {
        // Add.
        (128, 2) => both(|a, b| Some(a.wrapping_add(b))),
        // Subtract.
        (130, 2) => both(|a, b| Some(a.wrapping_sub(b))),
        // Multiply.
        (132, 2) => both(|a, b| Some(a.wrapping_mul(b))),
        // Unsigned divide.
        (134, 2) => both(u32::checked_div),
        // Unsigned remainder.
        (137, 2) => both(u32::checked_rem),
        // Equal, for booleans and for integers.
        (164 | 170, 2) => both(|a, b| Some(u32::from(a == b))),
        // Not equal.
        (165 | 171, 2) => both(|a, b| Some(u32::from(a != b))),
        // Or.
        (166, 2) => logical(1),
        // And.
        (167, 2) => logical(0),
        // Not.
        (168, 1) => value(w[0]).map(|v| if let Constant(a) = v { Constant(1 - a) } else { v }),
        // Select.
        (169, 3) => match value(w[0]) {
            None => None,
            Some(Constant(0)) => value(w[2]),
            Some(Constant(_)) => value(w[1]),
            Some(condition) => match (value(w[1]), value(w[2])) {
                (None, _) | (_, None) => None,
                (Some(a), Some(b)) if a == b => Some(a),
                // The operands differ, so the result is as uncertain as the condition: `Open` or `Varying`.
                _ => Some(condition),
            },
        },
        // Comparisons: greater, greater or equal; the even opcodes are unsigned, the odd ones signed.
        (172, 2) => both(|a, b| Some(u32::from(a > b))),
        (173, 2) => both(signed_greater),
        (174, 2) => both(|a, b| Some(u32::from(a >= b))),
        (175, 2) => both(|a, b| signed_greater(b, a).map(|less| 1 - less)),
        // Less, less or equal. No unsigned number is less than zero.
        (176, 2) if value(w[1]) == Some(Constant(0)) => Some(Constant(0)),
        (176, 2) => both(|a, b| Some(u32::from(a < b))),
        (177, 2) => both(|a, b| signed_greater(b, a)),
        (178, 2) => both(|a, b| Some(u32::from(a <= b))),
        (179, 2) => both(|a, b| signed_greater(a, b).map(|greater| 1 - greater)),
        // Bitwise or, exclusive or, and.
        (197, 2) => both(|a, b| Some(a | b)),
        (198, 2) => both(|a, b| Some(a ^ b)),
        (199, 2) => both(|a, b| Some(a & b)),
        _ => return None,
    })
}

fn signed_greater(a: u32, b: u32) -> Option<u32> {
    Some(u32::from(a.cast_signed() > b.cast_signed()))
}

impl<'a> Flow<'a> {
    fn of(words: &'a [u32], constants: Option<&Constants>) -> Result<Flow<'a>, String> {
        let instructions = instructions(words)?;
        let mut flow = Flow {
            instructions,
            values: HashMap::new(),
            functions: HashMap::new(),
            evaluated: HashSet::new(),
            images: HashSet::new(),
            called: HashSet::new(),
            running: HashSet::new(),
            ways: HashMap::new(),
        };
        flow.read_constants(constants);
        flow.find_functions();
        while flow.advance() {}
        Ok(flow)
    }

    /// Notes the values of the module's constants, all of which come before the functions.
    fn read_constants(&mut self, given: Option<&Constants>) {
        let is_id = |i: &&Instruction| i.opcode == DECORATE && i.operands.get(1) == Some(&SPEC_ID);
        let numbers: HashMap<u32, u32> =
            self.instructions.iter().filter(is_id).map(|i| (i.operands[0], i.operands[2])).collect();
        let special = |id: u32, default: u32| match given {
            None if numbers.contains_key(&id) => Value::Open,
            None => Value::Constant(default),
            Some(given) => Value::Constant(numbers.get(&id).and_then(|n| given.get(n)).copied().unwrap_or(default)),
        };
        for Instruction { opcode, operands, .. } in &self.instructions {
            let (value, id) = match (*opcode, *operands) {
                (FUNCTION, _) => break,
                (CONSTANT_TRUE, [_, id]) => (Some(Value::Constant(1)), *id),
                (CONSTANT_FALSE | CONSTANT_NULL, [_, id]) => (Some(Value::Constant(0)), *id),
                (CONSTANT, [_, id, value]) => (Some(Value::Constant(*value)), *id),
                (SPEC_TRUE, [_, id]) => (Some(special(*id, 1)), *id),
                (SPEC_FALSE, [_, id]) => (Some(special(*id, 0)), *id),
                (SPEC, [_, id, default]) => (Some(special(*id, *default)), *id),
                (SPEC_OP, [_, id, opcode, operands @ ..]) => {
                    let known = |id: u32| Some(self.values.get(&id).copied().unwrap_or(Value::Varying));
                    (evaluate(*opcode, operands, known).flatten(), *id)
                }
                _ => continue,
            };
            self.values.extend(value.map(|value| (id, value)));
        }
    }

    /// Fills `functions` and `evaluated`, and notes the image types and the entry point's function.
    fn find_functions(&mut self) {
        let mut begun = None;
        for (at, instruction) in self.instructions.iter().enumerate() {
            match (instruction.opcode, instruction.operands) {
                (TYPE_IMAGE, [id, ..]) => drop(self.images.insert(*id)),
                (ENTRY_POINT, [_, main, ..]) => drop(self.called.insert(*main)),
                (FUNCTION, [_, id, ..]) => begun = Some((*id, at)),
                (FUNCTION_END, _) => self.functions.extend(begun.take().map(|(id, from)| (id, from..at))),
                (opcode, [_, id, operands @ ..])
                    if begun.is_some() && (opcode == PHI || evaluate(opcode, operands, |_| None).is_some()) =>
                {
                    self.evaluated.insert(*id);
                }
                _ => {}
            }
        }
    }

    /// Goes once over all functions that are called, with the values known so far; returns whether anything new was
    /// found.
    fn advance(&mut self) -> bool {
        let before = (self.values.clone(), self.called.len(), self.running.len(), self.ways.len());
        let ranges: Vec<_> = self.called.iter().filter_map(|id| self.functions.get(id)).cloned().collect();
        let bools: HashSet<u32> =
            self.instructions.iter().filter(|i| i.opcode == TYPE_BOOL).map(|i| i.operands[0]).collect();
        for range in ranges {
            let (mut block, mut merge, mut is_first) = (0, None, true);
            for at in range {
                let Instruction { opcode, operands: w, .. } = self.instructions[at];
                if opcode == LABEL {
                    (block, merge) = (w[0], None);
                    if std::mem::take(&mut is_first) {
                        self.running.insert(block);
                    }
                }
                if !self.running.contains(&block) {
                    continue;
                }
                match (opcode, w) {
                    (PHI, [ty, id, incoming @ ..]) => {
                        let value = self.merged(block, bools.contains(ty), incoming);
                        self.values.extend(value.map(|value| (*id, value)));
                    }
                    (CALL, [_, _, function, ..]) => drop(self.called.insert(*function)),
                    (SELECTION_MERGE | LOOP_MERGE, [target, ..]) => merge = Some(*target),
                    (BRANCH, [to]) => self.go(block, *to, false),
                    (BRANCH_CONDITIONAL, [condition, yes, no, ..]) => {
                        let ways = [(Some(1), *yes), (None, *no)];
                        self.decide(block, self.value(*condition), merge, &ways);
                    }
                    (SWITCH, [selector, default, cases @ ..]) => {
                        let mut ways: Vec<_> = cases.chunks_exact(2).map(|case| (Some(case[0]), case[1])).collect();
                        ways.push((None, *default));
                        self.decide(block, self.value(*selector), merge, &ways);
                    }
                    (_, [_, id, operands @ ..]) => {
                        let value = evaluate(opcode, operands, |id| self.value(id));
                        self.values.extend(value.flatten().map(|value| (*id, value)));
                    }
                    _ => {}
                }
            }
        }
        before != (self.values.clone(), self.called.len(), self.running.len(), self.ways.len())
    }

    /// Follows edges from the branch at the end of `block`. `ways` lists the edges, the default last: the value for
    /// which the edge is taken (`None`: any other), and the target. A constant takes one edge; an open value goes to
    /// the merge block, if there is one; any other known value takes all edges.
    fn decide(&mut self, block: u32, value: Option<Value>, merge: Option<u32>, ways: &[(Option<u32>, u32)]) {
        match (value, merge) {
            (None, _) => {}
            (Some(Value::Constant(value)), _) => {
                let taken = ways.iter().find(|(of, _)| of.is_none_or(|of| of == value));
                taken.iter().for_each(|(_, to)| self.go(block, *to, false));
            }
            (Some(Value::Open), Some(merge)) => self.go(block, merge, true),
            _ => ways.iter().for_each(|(_, to)| self.go(block, *to, false)),
        }
    }

    /// Notes that the edge between two blocks is taken; `around`: it leads straight from a branch to
    /// the branch's merge block.
    fn go(&mut self, from: u32, to: u32, around: bool) {
        self.running.insert(to);
        *self.ways.entry((from, to)).or_default() |= around;
    }

    /// The value of a phi instruction in `block`, merged from the taken edges into that block; `incoming` lists pairs
    /// of a value's id and the block from which it comes.
    fn merged(&self, block: u32, is_bool: bool, incoming: &[u32]) -> Option<Value> {
        if self.ways.iter().any(|((_, to), around)| *to == block && *around) {
            return Some(if is_bool { Value::Open } else { Value::Varying });
        }
        let mut merged = None;
        for pair in incoming.chunks_exact(2).filter(|pair| self.ways.contains_key(&(pair[1], block))) {
            merged = match (merged, self.value(pair[0])) {
                (None, other) | (other, None) => other,
                (Some(a), Some(b)) if a == b => Some(a),
                (Some(Value::Varying), _) | (_, Some(Value::Varying)) => Some(Value::Varying),
                (Some(Value::Open), _) | (_, Some(Value::Open)) => Some(Value::Open),
                _ => Some(Value::Varying),
            };
        }
        merged
    }

    /// What is known of the value with this id; `None`: nothing is known yet.
    fn value(&self, id: u32) -> Option<Value> {
        match self.values.get(&id) {
            None if self.evaluated.contains(&id) => None,
            value => Some(value.copied().unwrap_or(Value::Varying)),
        }
    }

    /// Ids of the variables that are used in blocks that can run.
    fn used(&self) -> HashSet<u32> {
        let mut used = HashSet::new();
        self.in_functions(|instruction, runs| {
            let w = instruction.operands;
            match (instruction.opcode, w) {
                _ if !runs => {}
                (STORE | ATOMIC_STORE, [pointer, ..]) => drop(used.insert(*pointer)),
                (COPY_MEMORY, [to, from, ..]) => used.extend([*to, *from]),
                (
                    LOAD
                    | ACCESS_CHAIN
                    | IN_BOUNDS_ACCESS_CHAIN
                    | PTR_ACCESS_CHAIN
                    | ARRAY_LENGTH
                    | COPY_OBJECT
                    | IMAGE_TEXEL_POINTER
                    | ATOMIC_FIRST..=ATOMIC_LAST,
                    [_, _, pointer, ..],
                ) => {
                    used.insert(*pointer);
                }
                (CALL, [_, _, _, arguments @ ..]) => used.extend(arguments),
                _ => {}
            }
        });
        used
    }

    /// Calls `see` with every instruction of every function, and with whether the instruction's block can run.
    fn in_functions(&self, mut see: impl FnMut(&Instruction, bool)) {
        let (mut is_within, mut runs) = (false, true);
        for instruction in &self.instructions {
            is_within |= instruction.opcode == FUNCTION;
            match instruction.opcode {
                FUNCTION => runs = true,
                LABEL => runs = self.running.contains(&instruction.operands[0]),
                _ => {}
            }
            if is_within {
                see(instruction, runs);
            }
        }
    }

    /// The module without its unused bindings. In blocks that never run, reads of a removed binding become undefined
    /// values and writes to it are left out, and sums over a subgroup become undefined; otherwise these blocks are
    /// unchanged, and the driver may remove them. Where no sum over a subgroup is left, the module no longer asks for
    /// the capability, which a device may lack.
    fn stripped(&self, words: &[u32]) -> Result<Vec<u32>, String> {
        let used = self.used();
        let mut needs_subgroups = false;
        self.in_functions(|instruction, runs| {
            needs_subgroups |= runs && (SUBGROUP_FIRST..=SUBGROUP_LAST).contains(&instruction.opcode);
        });
        let bindings = self.instructions.iter().filter(|i| i.opcode == VARIABLE && is_binding(i.operands));
        // Ids of the removed variables, and of pointers and images that are derived from them.
        let mut gone: HashSet<u32> = bindings.map(|i| i.operands[1]).filter(|id| !used.contains(id)).collect();
        let (mut out, mut runs) = (words[..HEADER].to_vec(), true);
        for Instruction { opcode, operands, words } in &self.instructions {
            if *opcode == LABEL {
                runs = self.running.contains(&operands[0]);
            }
            match (*opcode, *operands) {
                (CAPABILITY, [which]) if !needs_subgroups && SUBGROUP_CAPABILITIES.contains(which) => {}
                (SUBGROUP_FIRST..=SUBGROUP_LAST, [ty, id, ..]) if !runs => out.extend([UNDEFINED_WORDS, *ty, *id]),
                (ENTRY_POINT, _) => {
                    let (entry, variables) = words.split_at(ENTRY_WORDS);
                    let kept: Vec<u32> = variables.iter().filter(|id| !gone.contains(id)).copied().collect();
                    out.push((((ENTRY_WORDS + kept.len()) as u32) << 16) | ENTRY_POINT);
                    out.extend(entry[1..].iter().chain(&kept));
                }
                (NAME | DECORATE | STORE | ATOMIC_STORE | IMAGE_WRITE, [id, ..]) | (VARIABLE, [_, id, ..])
                    if gone.contains(id) => {}
                (ACCESS_CHAIN | IN_BOUNDS_ACCESS_CHAIN, [_, id, from, ..]) if gone.contains(from) => {
                    gone.insert(*id);
                }
                // A load from a removed buffer gives a value, which becomes undefined; a load of a removed texel buffer
                // gives the buffer's image, whose id is removed as well.
                (LOAD, [ty, id, from, ..]) if gone.contains(from) => {
                    if self.images.contains(ty) {
                        gone.insert(*id);
                    } else {
                        out.extend([UNDEFINED_WORDS, *ty, *id]);
                    }
                }
                (ARRAY_LENGTH | IMAGE_READ | ATOMIC_FIRST..=ATOMIC_LAST, [ty, id, from, ..]) if gone.contains(from) => {
                    out.extend([UNDEFINED_WORDS, *ty, *id]);
                }
                (
                    CALL | COPY_OBJECT | COPY_MEMORY | PTR_ACCESS_CHAIN | IMAGE_TEXEL_POINTER | IMAGE_QUERY_SIZE,
                    operands,
                ) if operands.iter().any(|id| gone.contains(id)) => {
                    return Err(format!("the SPIR-V instruction {opcode} of an unused buffer cannot be removed"));
                }
                _ => out.extend(*words),
            }
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::super::context::Arrays;
    use super::super::kernel::{ONE_SUBGROUP, known};
    use super::*;

    #[test]
    fn a_variant_without_sums_over_a_subgroup_needs_no_capability_for_them() {
        let words: Vec<u32> = bytemuck::allocation::pod_collect_to_vec(known("solve/gather", Arrays::Texel).unwrap());
        let capabilities = |one_subgroup: u32| -> Vec<u32> {
            let variant = specialised(&words, &Constants::from([(ONE_SUBGROUP, one_subgroup)])).unwrap();
            let all = instructions(&variant).unwrap();
            all.iter().filter(|i| i.opcode == CAPABILITY).map(|i| i.operands[0]).collect()
        };
        let (with, without) = (capabilities(1), capabilities(0));
        assert!(SUBGROUP_CAPABILITIES.iter().all(|one| with.contains(one) && !without.contains(one)));
        assert_eq!(without.len() + SUBGROUP_CAPABILITIES.len(), with.len());
    }
}
