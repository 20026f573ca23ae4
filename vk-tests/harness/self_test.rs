//! Tests of the shader test harness itself: the kernel `shaders/test/copy.comp` commits a fault (a misdeed) that breaks
//! one of the rules that the harness checks, and the harness must panic. The kernel's constant `misdeed` selects which.

use std::panic::{AssertUnwindSafe, catch_unwind};

use palpate::internal::gpu::{Arrays, Buffer, Kernel, Memory, Named, Recorder, Size};
use palpate::internal::shaders::test::CopyParams;

use crate::harness::{Outcome, Tolerance, assert_clean, case, context, expect_close};

/// Rounding of one multiplication and one addition in f32.
const TOLERANCE: Tolerance = Tolerance { abs: 0.0, rel: 2.4e-7 };
const SCALE: f32 = 3.0;

/// Runs the copy kernel over `n` elements with one of its misdeeds (0: no misdeed), and returns the arrays after the
/// run and the expected contents of the array `target`. Misdeed 2 changes the array `marked`; `marked_is_input` tells
/// whether the case declares this array as an input, and so forbids the change.
fn copy(n: usize, misdeed: u32, marked_is_input: bool) -> (Outcome, Vec<f64>) {
    let params = CopyParams { unused: [0.0; 3], count: n as u32, also_unused: [[0.0; 3]; 3] };
    let source: Vec<f32> = (0..n).map(|i| 1.0 + i as f32 * 0.7).collect();
    let offsets: Vec<[f32; 4]> = (0..n).map(|i| [i as f32 * 0.01, -1.0, -2.0, -3.0]).collect();
    let want = source.iter().zip(&offsets).map(|(s, o)| f64::from(SCALE) * f64::from(*s) + f64::from(o[0])).collect();
    let given = case("test/copy")
        .size(Size::Group)
        .constant("scale", SCALE)
        .constant("misdeed", misdeed)
        .input("params", &[params])
        .input("source", &source)
        .input("offsets", &offsets);
    let marked = [5u32, 6];
    let given = if marked_is_input { given.input("marked", &marked) } else { given.inout("marked", &marked) };
    let outcome = given.output::<f32>("target", n).push(&0u32).elements(n).run();
    (outcome, want)
}

/// Runs a closure, which must panic, and returns the message of the panic.
fn message(what: impl FnOnce()) -> String {
    let panic = catch_unwind(AssertUnwindSafe(what)).expect_err("the closure did not panic, but it must");
    panic.downcast_ref::<String>().cloned().unwrap_or_else(|| panic.downcast_ref::<&str>().unwrap().to_string())
}

#[test]
fn an_honest_kernel_passes_at_every_size() {
    let width = context().group_size() as usize;
    for n in [0, 1, width - 1, width, width + 1, 1234] {
        let (outcome, want) = copy(n, 0, true);
        expect_close("target", &outcome.get::<f32>("target"), &want, TOLERANCE);
        assert_eq!(outcome.get::<u32>("marked"), [5, 6]);
    }
}

#[test]
fn one_spoiled_value_fails() {
    let (outcome, want) = copy(100, 0, true);
    let good = outcome.get::<f32>("target");
    for spoiled in [good[41] * 1.00001, f32::NAN, f32::INFINITY] {
        let mut got = good.clone();
        got[41] = spoiled;
        let said = message(|| expect_close("target", &got, &want, TOLERANCE));
        assert!(said.contains("1 of 100 values are not") && said.contains("[41]"), "wrong panic: {said}");
    }
    assert!(message(|| expect_close("target", &good[1..], &want, TOLERANCE)).contains("values got"));
}

#[test]
fn writing_behind_the_end_fails() {
    let said = message(|| drop(copy(100, 1, true)));
    assert!(said.contains("target was written 0 words behind its end"), "wrong panic: {said}");
}

#[test]
fn a_changed_input_fails() {
    let said = message(|| drop(copy(100, 2, true)));
    assert!(said.contains("input marked was changed: word 0 was 0x5, is 0x6"), "wrong panic: {said}");
    let (outcome, _) = copy(100, 2, false);
    assert_eq!(outcome.get::<u32>("marked"), [6, 6], "contents of `marked`, declared as in-out, may change");
}

#[test]
fn a_value_left_unwritten_fails() {
    let said = message(|| drop(copy(100, 3, true)));
    assert!(said.contains("word 99 of output target was never written"), "wrong panic: {said}");
}

#[test]
fn a_wrong_buffer_name_fails() {
    let said = message(|| drop(case("test/copy").input("parameters", &[0u32]).elements(1).run()));
    assert!(said.contains("test/copy: no array for params is given"), "wrong panic: {said}");
}

#[test]
fn misuse_is_refused_by_name() {
    let context = context();
    let error = |result: palpate::Result<_>| result.map(|_: Kernel| ()).unwrap_err().to_string();
    assert!(error(Kernel::new(context, "test/cop", Size::Group, &[])).contains("nearest is test/copy"));
    let unknown = error(Kernel::new(context, "test/copy", Size::Group, &[("scael", 1.0.into())]));
    assert!(unknown.contains("scael") && unknown.contains("misdeed, scale"), "wrong error: {unknown}");
    assert!(error(Kernel::new(context, "test/copy", Size::Group, &[("scale", 1u32.into())])).contains("not Uint"));

    let kernel = Kernel::new(context, "test/copy", Size::Group, &[]).unwrap();
    const ANY: &[&str] = &["params", "source", "offsets", "target", "cells"];
    let array = |name, words: usize| Buffer::from_slice(context, name, &vec![0u32; words], Memory::Device).unwrap();
    let any = |name, words| array(name, words).known_as(ANY);
    let (a, b, c, d, odd) = (any("a", 16), any("b", 4), any("c", 4), any("d", 4), any("odd", 5));
    let record = |buffers: &[(&str, &Buffer)], push: &[u8]| {
        let mut recorder = Recorder::new(context).unwrap();
        recorder.stage("trial");
        recorder.dispatch(&kernel, &Named { shader: "test/copy", buffers, push }, 1);
        recorder.finish().map(|_| ()).unwrap_err().to_string()
    };
    let given =
        |source, offsets, target| [("params", &a), ("source", source), ("offsets", offsets), ("target", target)];
    let few = record(&given(&b, &c, &d)[..2], &[0; 4]);
    assert!(few.contains("stage trial: kernel test/copy uses buffer offsets, which"), "wrong error: {few}");
    let unknown = record(&[("aim", &a)], &[0; 4]);
    assert!(
        unknown.contains("no buffer aim; its buffers are params, source, offsets, marked, target"),
        "wrong error: {unknown}"
    );
    // An array that the kernel writes may be bound to only one of the kernel's buffers.
    assert!(record(&given(&b, &c, &b), &[0; 4]).contains("writes array b and also binds it to target"));
    assert!(record(&given(&b, &c, &a), &[0; 4]).contains("writes array a and"));
    assert!(record(&given(&b, &c, &odd), &[]).contains("4 bytes of push constants, but was given 0"));
    // A kernel's buffer takes an array only if the array has the buffer's name; `known_as` gives an array further
    // names.
    let target = b.known_as(&["target"]);
    let swapped = record(&given(&target, &c, &d), &[0; 4]);
    assert!(swapped.contains("array b may not be bound to its buffer source"), "wrong error: {swapped}");
    let named = array("source", 4);
    let swapped = record(&[("params", &named)], &[0; 4]);
    assert!(swapped.contains("array source may not be bound to its buffer params"), "wrong error: {swapped}");
    let other = Named { shader: "test/bump", buffers: &[("cells", &a)], push: &[0; 8] };
    let mut recorder = Recorder::new(context).unwrap();
    recorder.dispatch(&kernel, &other, 1);
    let other = recorder.finish().map(|_| ()).unwrap_err().to_string();
    assert!(other.contains("kernel test/copy was given the arguments of test/bump"), "wrong error: {other}");
    let texels = Kernel::with_arrays(context, "test/copy", Size::Group, &[], Arrays::Texel).unwrap();
    let mut recorder = Recorder::new(context).unwrap();
    let buffers = given(&b, &odd, &d);
    recorder.dispatch(&texels, &Named { shader: "test/copy", buffers: &buffers, push: &[0; 4] }, 1);
    let odd = recorder.finish().map(|_| ()).unwrap_err().to_string();
    assert!(odd.contains("array odd for buffer offsets has 20 bytes"), "wrong error: {odd}");
    let huge = Buffer::new(context, "huge", context.array_limits().0 + 4, Memory::Device);
    assert!(huge.map(|_| ()).unwrap_err().to_string().contains("array huge needs"));
    assert_clean(context, "misuse of kernels and buffers");
}

#[test]
fn workgroups_that_meet_at_barriers_sum() {
    let (groups, length) = (5usize, 77usize);
    let values: Vec<[u32; 4]> = (0..(groups * length) as u32).map(|i| [9, i, 9, 9]).collect();
    for size in [Size::One, Size::Reduce, Size::Group] {
        let outcome = case("test/sum")
            .size(size)
            .constant("negated", true)
            .constant("added", -4i32)
            .input("length_of_each", &[length as u32])
            .input("values", &values)
            .output::<i32>("sums", groups)
            .groups(groups)
            .run();
        let sum = |part: &[[u32; 4]]| 4 - part.iter().map(|v| v[1] as i32).sum::<i32>();
        assert_eq!(
            outcome.get::<i32>("sums"),
            values.chunks(length).map(sum).collect::<Vec<_>>(),
            "sums with a local size of {size:?}"
        );
    }
}
