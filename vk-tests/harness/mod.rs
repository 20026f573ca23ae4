//! The shader test harness. A [`Case`] takes arrays, runs one kernel (compute shader) on them and checks the arrays
//! afterwards: outputs start filled with a canary value, and the canaries must be overwritten; guard words behind the
//! end of an output, and all inputs, must be unchanged after the run. Any message of the Vulkan validation layer fails
//! the case. Kernels read arrays through one of two kinds of buffers: texel buffers or storage buffers.

pub mod bodies;
pub mod faults;
pub mod random;
#[path = "../../tests/real_meshes/mod.rs"]
pub mod real_meshes;
pub mod self_test;
pub mod spoil;

use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use bytemuck::Pod;
use palpate::internal::gpu::{Arrays, Buffer, Const, Kernel, Memory, Named, Recorder, Size};
use palpate::{Context, Options};

/// A quiet NaN that no arithmetic makes: a word of an output, float or integer, that still holds it was not written.
pub const CANARY: u32 = 0x7fc0_dead;
/// Kernels whose outputs are not compared between runs: they fill lists in the order in which their invocations arrive,
/// and this order differs from run to run. The results of kernels that read these lists do not depend on the order.
const UNORDERED: [&str; 10] = [
    "cull/pairs",
    "cull/contact_patches",
    "cull/meet",
    "contact/candidates",
    "contact/deepest",
    "skin/embed",
    "depth/ray_hits",
    "depth/overlaps",
    "contact/response",
    "contact/sort",
];
/// Number of guard words behind the end of each array that the kernel may write.
const GUARD_WORDS: usize = 16;

/// The Vulkan device that all cases share, opened once, with validation.
pub fn context() -> &'static Arc<Context> {
    static CONTEXT: OnceLock<Arc<Context>> = OnceLock::new();
    turn();
    CONTEXT.get_or_init(|| {
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        let context =
            Context::open(&Options { device, validation: validation(), arrays: arrays(), ..Options::of_program() })
                .unwrap_or_else(|e| panic!("{e}"));
        assert_clean(&context, "set-up");
        context
    })
}

/// Whether devices are opened with the validation layer: unless the environment variable `PALPATE_TEST_VALIDATION` is
/// `off`, for machines that have no such layer.
pub fn validation() -> bool {
    std::env::var("PALPATE_TEST_VALIDATION").as_deref() != Ok("off")
}

/// The kind of buffers through which kernels read their arrays in tests that do not compare both kinds. The environment
/// variable `PALPATE_TEST_ARRAYS` (`texel` or `storage`) sets it; `None` stands for the kind that the GPU prefers.
pub fn arrays() -> Option<Arrays> {
    match std::env::var("PALPATE_TEST_ARRAYS").as_deref() {
        Err(_) => None,
        Ok("texel") => Some(Arrays::Texel),
        Ok("storage") => Some(Arrays::Storage),
        Ok(other) => panic!("PALPATE_TEST_ARRAYS is {other}; give texel or storage"),
    }
}

/// Waits until no other test uses the validation layer, and keeps other tests from it until this test's thread ends.
/// The layer does not report to which test a message belongs. Also, version 1.3.239 of the layer crashes about once in
/// a hundred runs where tests open and close devices in parallel. Tests that open no device with validation do not call
/// this function, so they run in parallel.
pub fn turn() {
    static TURN: Mutex<()> = Mutex::new(());
    thread_local!(static HELD: Cell<Option<MutexGuard<'static, ()>>> = const { Cell::new(None) });
    HELD.with(|held| {
        let turn = held.take().unwrap_or_else(|| TURN.lock().unwrap_or_else(PoisonError::into_inner));
        held.set(Some(turn));
    });
}

/// Panics if the validation layer has reported anything since the last call; `what` names the test in the message.
pub fn assert_clean(context: &Context, what: &str) {
    let messages = context.validation_messages();
    assert!(messages.is_empty(), "{what}: the validation layer reported:\n{}", messages.join("\n"));
}

#[derive(Clone, Copy, PartialEq)]
enum Role {
    Input,
    InOut,
    Output,
    Partial,
}

struct Given {
    name: String,
    role: Role,
    words: Vec<u32>,
    /// Number of bytes that the kernel may use; in arrays that it may write, guard words lie behind these bytes.
    bytes: usize,
}

/// One run of one kernel.
pub struct Case {
    kernel: String,
    size: Size,
    constants: Vec<(String, Const)>,
    given: Vec<Given>,
    push: Vec<u8>,
    run: Extent,
}

#[derive(Clone, Copy)]
enum Extent {
    Unset,
    Elements(u32),
    Groups(u32),
}

/// A case for a kernel, without arrays at first. Each array is added under the name of the shader's buffer for it.
pub fn case(kernel: &str) -> Case {
    Case {
        kernel: kernel.into(),
        size: Size::Group,
        constants: vec![],
        given: vec![],
        push: vec![],
        run: Extent::Unset,
    }
}

impl Case {
    /// Sets the local size, which is `Size::Group` otherwise.
    pub fn size(mut self, size: Size) -> Self {
        self.size = size;
        self
    }

    /// Sets a specialization constant.
    pub fn constant(mut self, name: &str, value: impl Into<Const>) -> Self {
        self.constants.push((name.into(), value.into()));
        self
    }

    /// Adds an array that the kernel reads; the array must be the same after the run.
    pub fn input<T: Pod>(self, name: &str, data: &[T]) -> Self {
        self.with(name, Role::Input, bytemuck::cast_slice(data))
    }

    /// Adds an array that the kernel reads and writes.
    pub fn inout<T: Pod>(self, name: &str, data: &[T]) -> Self {
        self.with(name, Role::InOut, bytemuck::cast_slice(data))
    }

    /// Adds an array of `len` elements of which the kernel must write every word.
    pub fn output<T: Pod>(self, name: &str, len: usize) -> Self {
        let canaries = vec![CANARY; len * size_of::<T>() / 4];
        self.with(name, Role::Output, bytemuck::cast_slice(&canaries))
    }

    /// Adds an array of which the kernel writes only some elements; the others must stay as in `data`, which the test
    /// itself has to check.
    pub fn partial<T: Pod>(self, name: &str, data: &[T]) -> Self {
        self.with(name, Role::Partial, bytemuck::cast_slice(data))
    }

    /// Sets the push constants.
    pub fn push<T: Pod>(mut self, push: &T) -> Self {
        self.push = bytemuck::bytes_of(push).to_vec();
        self
    }

    /// Sets the number of invocations to run.
    pub fn elements(mut self, elements: usize) -> Self {
        self.run = Extent::Elements(elements as u32);
        self
    }

    /// Sets the number of workgroups to run, instead of a number of invocations.
    pub fn groups(mut self, groups: usize) -> Self {
        self.run = Extent::Groups(groups as u32);
        self
    }

    fn with(mut self, name: &str, role: Role, bytes: &[u8]) -> Self {
        assert_eq!(bytes.len() % 4, 0, "{name}: arrays are made of 32-bit words");
        let mut words: Vec<u32> = bytemuck::allocation::pod_collect_to_vec(bytes);
        // Read-only arrays get no guard words: nothing may be written to them, and shaders may ask for their length.
        if role != Role::Input {
            words.resize(words.len() + GUARD_WORDS, CANARY);
        }
        self.given.push(Given { name: name.into(), role, words, bytes: bytes.len() });
        self
    }

    /// Runs the case twice, with texel buffers and with storage buffers. Both runs must leave the same bits in the
    /// arrays. Where an array does not fit into a texel buffer of the device, or the device has too few, the case runs
    /// once, with storage buffers.
    /// Guard words, inputs, canaries and validation messages are checked too; any check that fails panics.
    pub fn run(self) -> Outcome {
        turn();
        let (_, most) = context().array_limits();
        let is_large = self.given.iter().any(|given| given.words.len().div_ceil(4) as u64 > most);
        if is_large || !self.binds_texel_buffers() {
            let after = self.run_with(Arrays::Storage);
            return Outcome { kernel: self.kernel, given: self.given, after };
        }
        let first = arrays().unwrap_or(context().arrays());
        let after = self.run_with(first);
        let second = if first == Arrays::Texel { Arrays::Storage } else { Arrays::Texel };
        let other = self.run_with(second);
        for ((given, after), other) in self.given.iter().zip(&after).zip(&other) {
            let is_nan = |word: u32| f32::from_bits(word).is_nan();
            let differ = |&i: &usize| after[i] != other[i] && !(is_nan(after[i]) && is_nan(other[i]));
            if let Some(i) = (0..after.len()).find(differ).filter(|_| !UNORDERED.contains(&self.kernel.as_str())) {
                let (kernel, name) = (&self.kernel, &given.name);
                panic!(
                    "{kernel}: word {i} of {name} is {:#x} with {first:?} buffers, but {:#x} with the other kind",
                    after[i], other[i]
                );
            }
        }
        Outcome { kernel: self.kernel, given: self.given, after }
    }

    /// Whether the device lets the kernel bind all of its texel buffers.
    fn binds_texel_buffers(&self) -> bool {
        let constants: Vec<_> = self.constants.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        context().binds_texel_buffers()
            || Kernel::with_arrays(context(), &self.kernel, self.size, &constants, Arrays::Texel).is_ok()
    }

    /// The contents of all arrays after a run with one kind of buffers.
    fn run_with(&self, arrays: Arrays) -> Vec<Vec<u32>> {
        let context = context();
        let constants: Vec<_> = self.constants.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        // Kernels are kept here once they are compiled: drivers take longer to compile a kernel than to run it, and
        // tests of the solver run the same kernels many times.
        static KERNELS: Mutex<BTreeMap<String, Arc<Kernel>>> = Mutex::new(BTreeMap::new());
        let make = || {
            let kernel = Kernel::with_arrays(context, &self.kernel, self.size, &constants, arrays);
            Arc::new(kernel.unwrap_or_else(|e| panic!("{e}")))
        };
        let key = format!("{} {:?} {constants:?} {arrays:?}", self.kernel, self.size);
        let mut kernels = KERNELS.lock().unwrap_or_else(|e| e.into_inner());
        let kernel = kernels.entry(key).or_insert_with(make).clone();
        drop(kernels);
        self.check_bindings(&kernel);
        let buffers: Vec<Buffer> = self
            .given
            .iter()
            .map(|g| Buffer::from_slice(context, &g.name, &g.words, Memory::Device).unwrap())
            .collect();
        let mut recorder = Recorder::new(context).unwrap();
        recorder.stage(&self.kernel);
        let named: Vec<_> =
            self.given.iter().zip(&buffers).map(|(given, buffer)| (given.name.as_str(), buffer)).collect();
        let arguments = Named { shader: &self.kernel, buffers: &named, push: &self.push };
        match self.run {
            Extent::Unset => panic!("{}: call .elements() or .groups() before .run()", self.kernel),
            Extent::Elements(n) => recorder.dispatch(&kernel, &arguments, n),
            Extent::Groups(n) => recorder.dispatch_groups(&kernel, &arguments, n),
        }
        recorder.finish().and_then(|r| r.submit_and_wait()).unwrap_or_else(|e| panic!("{e}"));
        let after: Vec<Vec<u32>> = buffers.iter().map(|b| b.read().unwrap()).collect();
        assert_clean(context, &self.kernel);
        for (given, words) in self.given.iter().zip(&after) {
            check(&self.kernel, given, words);
        }
        after
    }

    fn check_bindings(&self, kernel: &Kernel) {
        for binding in kernel.bindings() {
            let (kernel, name) = (&self.kernel, &binding.name);
            let given = self.given.iter().find(|given| given.name == *name);
            match given.unwrap_or_else(|| panic!("{kernel}: no array for {name} is given")).role {
                Role::Input => {}
                Role::InOut => {
                    assert!(binding.reads && binding.writes, "{kernel} must read and write in-out array {name}")
                }
                Role::Output | Role::Partial => assert!(binding.writes, "{kernel} never writes output {name}"),
            }
        }
    }
}

/// Checks that the guard words of an array, or all its words if it is an input, are unchanged, and that an output is
/// written in full.
fn check(kernel: &str, given: &Given, after: &[u32]) {
    let (end, name) = (given.bytes / 4, &given.name);
    if given.role == Role::Input {
        if let Some(i) = (0..end).find(|&i| after[i] != given.words[i]) {
            panic!("{kernel}: input {name} was changed: word {i} was {:#x}, is {:#x}", given.words[i], after[i]);
        }
        return;
    }
    if let Some(i) = (end..after.len()).find(|&i| after[i] != CANARY) {
        panic!(
            "{kernel}: {name} was written {} words behind its end, which is at {end} words; the value there is {:#x}",
            i - end,
            after[i]
        );
    }
    if given.role == Role::Output
        && let Some(i) = (0..end).find(|&i| after[i] == CANARY)
    {
        panic!("{kernel}: word {i} of output {name} was never written; the output has {end} words");
    }
}

/// The arrays after a run.
pub struct Outcome {
    kernel: String,
    given: Vec<Given>,
    after: Vec<Vec<u32>>,
}

impl Outcome {
    /// The contents of an array by its name, without its guard words.
    pub fn get<T: Pod>(&self, name: &str) -> Vec<T> {
        let at = self.given.iter().position(|g| g.name == name);
        let at = at.unwrap_or_else(|| panic!("{}: no array {name}", self.kernel));
        bytemuck::allocation::pod_collect_to_vec(&self.after[at][..self.given[at].bytes / 4])
    }
}

/// The allowed error of a value: `abs + rel * |want|`, where `want` is the expected value. Each constant of this type
/// has a comment that gives the reason for its numbers.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance {
    /// Absolute part, in the units of the value.
    pub abs: f64,
    /// Part relative to the magnitude of the expected value.
    pub rel: f64,
}

/// Checks that every value in `got` is within the tolerance of the value in `want`, and otherwise panics with a message
/// that names the worst value. A NaN in `got` never passes, nor do lists of different length.
pub fn expect_close(name: &str, got: &[f32], want: &[f64], tolerance: Tolerance) {
    assert_eq!(got.len(), want.len(), "{name}: number of values got, and number expected");
    // The error divided by the allowed error. The quotient is infinite where the error is NaN, and where there is an
    // error although none is allowed.
    let share = |(g, w): (&f32, &f64)| {
        let error = (f64::from(*g) - w).abs();
        let allowed = tolerance.abs + tolerance.rel * w.abs();
        if error.is_nan() || (error > 0.0 && allowed == 0.0) {
            f64::INFINITY
        } else {
            error / allowed.max(f64::MIN_POSITIVE)
        }
    };
    let shares: Vec<f64> = got.iter().zip(want).map(share).collect();
    let failing = shares.iter().filter(|s| **s > 1.0).count();
    if let Some((i, worst)) = shares.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))
        && failing > 0
    {
        let (g, w, n) = (got[i], want[i], got.len());
        panic!(
            "{name}: {failing} of {n} values are not within {tolerance:?}; the worst, at index [{i}], is {g:e}, but \
             {w:e} is expected: its error is {worst:.3} times the allowed error"
        );
    }
}
