//! Tests of the Vulkan module (`palpate::internal::gpu`) itself: order of dependent passes (a pass is one dispatch,
//! draw, fill or copy), indirect arguments, fills and copies, replay of recordings (recorded command buffers), timers,
//! threads, mapped memory, and rasterizing without attachments, which the engine uses to find penetration depths.

use palpate::internal::gpu::{Buffer, Kernel, Memory, Named, RasterPipeline, Recorder, Recording, Size};
use palpate::internal::shaders::test::{Bump, DrawRasterCells};
use palpate::internal::stages::cull::MOST_CELLS;
use palpate::{Context, Options};

use crate::harness::random::Random;
use crate::harness::{assert_clean, context};

const CELLS: u32 = 100;

fn bump() -> Kernel {
    Kernel::new(context(), "test/bump", Size::Group, &[]).unwrap()
}

fn cells(name: &str) -> Buffer {
    let cells = Buffer::from_slice(context(), name, &[1u32; CELLS as usize], Memory::Device).unwrap();
    cells.known_as(&["cells", "rectangles", "raster_cells"])
}

fn bump_of(cells: &Buffer, amount: u32) -> Bump<'_> {
    Bump { cells, amount, count: CELLS }
}

/// The expected contents of an array whose cells all have the value `start` at first, after one pass of the kernel
/// `test/bump` for each of `amounts`. A pass sets each cell to 3 times its value plus the amount, so that the result
/// depends on the order of the passes.
fn folded(start: u32, amounts: impl IntoIterator<Item = u32>) -> Vec<u32> {
    let value = amounts.into_iter().fold(start, |v, amount| v.wrapping_mul(3).wrapping_add(amount));
    vec![value; CELLS as usize]
}

#[test]
fn dependent_passes_run_in_order_and_independent_ones_do_not_wait() {
    let (context, kernel, a, b) = (context(), bump(), cells("a"), cells("b"));
    let mut recorder = Recorder::new(context).unwrap();
    recorder.stage("first");
    for i in 0..20 {
        recorder.dispatch(&kernel, &bump_of(&a, i), CELLS);
        recorder.dispatch(&kernel, &bump_of(&b, 2 * i), CELLS);
    }
    recorder.stage("second");
    recorder.dispatch(&kernel, &bump_of(&a, 7), 0);
    recorder.stage("first");
    recorder.copy(&a, &b);
    recorder.dispatch(&kernel, &bump_of(&b, 5), CELLS);
    let recording = recorder.finish().unwrap();
    assert!(recording.stage_times().is_empty(), "a recording must have no stage times before its first run");
    recording.submit_and_wait().unwrap();
    assert_eq!(a.read::<u32>().unwrap(), folded(1, 0..20));
    assert_eq!(b.read::<u32>().unwrap(), folded(1, (0..20).chain([5])));
    let passes = recording.passes();
    let passes: Vec<_> = passes.iter().map(|p| (p.stage.as_str(), p.dispatches, p.dependent)).collect();
    assert_eq!(
        passes,
        [("first", 42, 22)],
        "stage, number of its passes, and number of these that wait for an earlier pass (one of each of the 20 pairs, \
         the copy and the last dispatch must wait)"
    );
    let times = recording.stage_times();
    assert_eq!(times.iter().map(|t| t.0.as_str()).collect::<Vec<_>>(), ["first", "second"]);
    assert!(times[0].1 > 0.0 && times[0].1 < 1e6, "first stage takes no time, or over 1 s; stage times, us: {times:?}");
    assert_clean(context, "passes");
}

#[test]
fn recordings_replay_in_order_with_one_submit() {
    let (context, kernel, a) = (context(), bump(), cells("a"));
    let record = |amount| {
        let mut recorder = Recorder::untimed(context).unwrap();
        recorder.dispatch(&kernel, &bump_of(&a, amount), CELLS);
        recorder.finish().unwrap()
    };
    let (one, two) = (record(1), record(2));
    Recording::submit_all(&[&one, &two]).unwrap();
    Recording::submit_all(&[&two, &one]).unwrap();
    one.submit_and_wait().unwrap();
    assert_eq!(a.read::<u32>().unwrap(), folded(1, [1, 2, 2, 1, 1]));
    assert!(Recording::submit_all(&[&one, &one]).is_err());
    assert_clean(context, "replay");
}

#[test]
fn a_recording_keeps_what_it_uses_alive() {
    let (context, out) = (context(), Buffer::new(context(), "out", u64::from(CELLS) * 4, Memory::Readback).unwrap());
    let recording = {
        let (kernel, a) = (bump(), cells("a"));
        let mut recorder = Recorder::new(context).unwrap();
        recorder.dispatch(&kernel, &bump_of(&a, 4), CELLS);
        recorder.copy(&a, &out);
        recorder.finish().unwrap()
    };
    recording.submit_and_wait().unwrap();
    assert_eq!(out.read::<u32>().unwrap(), folded(1, [4]));
    assert_clean(context, "a recording that keeps its buffers alive");
}

#[test]
fn indirect_passes_take_their_slot_and_wait_for_its_writer() {
    let (context, kernel, a) = (context(), bump(), cells("a"));
    let args = Buffer::from_slice(context, "args", &[9u32, 9, 9, 0, 1, 1, 2, 1, 1], Memory::Device).unwrap();
    let mut recorder = Recorder::new(context).unwrap();
    recorder.stage("indirect");
    recorder.dispatch_indirect(&kernel, &bump_of(&a, 1), &args, 1);
    recorder.dispatch_indirect(&kernel, &bump_of(&a, 2), &args, 2);
    // Slot 2 of the indirect arguments (three words from byte 24) is zeroed on the GPU, so that the next dispatch runs
    // nothing.
    recorder.fill_range(&args, 24, 12, 0);
    recorder.dispatch_indirect(&kernel, &bump_of(&a, 3), &args, 2);
    let recording = recorder.finish().unwrap();
    recording.submit_and_wait().unwrap();
    assert_eq!(a.read::<u32>().unwrap(), folded(1, [2]));
    assert_eq!(args.read::<u32>().unwrap(), [9, 9, 9, 0, 1, 1, 0, 0, 0]);
    assert_eq!((recording.passes()[0].dispatches, recording.passes()[0].dependent), (4, 4));

    let fails = |act: &dyn Fn(&mut Recorder)| {
        let mut recorder = Recorder::new(context).unwrap();
        recorder.stage("wrong");
        act(&mut recorder);
        recorder.finish().map(|_| ()).unwrap_err().to_string()
    };
    assert!(fails(&|r| r.dispatch_indirect(&kernel, &bump_of(&a, 1), &args, 3)).contains("outside array args"));
    assert!(fails(&|r| r.fill_range(&args, 2, 4, 0)).contains("not whole words"));
    assert!(fails(&|r| r.fill_range(&args, 32, 8, 0)).contains("not whole words"));
    assert!(fails(&|r| r.copy(&a, &args)).contains("cannot be copied"));
    assert!(fails(&|r| r.dispatch_groups(&kernel, &bump_of(&a, 1), u32::MAX)).contains("the device's limit"));
    assert_clean(context, "indirect dispatches");
}

#[test]
fn arrays_come_back_as_they_went() {
    let context = context();
    let data: Vec<[f32; 4]> = (0..1234).map(|i| [i as f32, 0.5, -1.0, f32::MAX]).collect();
    for memory in [Memory::Device, Memory::Upload, Memory::Readback] {
        let buffer = Buffer::from_slice(context, "array", &data, memory).unwrap();
        assert_eq!(buffer.read::<[f32; 4]>().unwrap(), data, "contents read back from memory of kind {memory:?}");
        buffer.write(&[[1.0f32; 4]; 2]).unwrap();
        assert_eq!(
            buffer.read::<[f32; 4]>().unwrap()[1..3],
            [[1.0; 4], data[2]],
            "rewritten contents in memory of kind {memory:?}"
        );
        assert!(buffer.write(&vec![0u8; 1234 * 16 + 1]).unwrap_err().to_string().contains("do not fit"));
        assert_eq!(buffer.mapped::<u32>().is_ok(), memory != Memory::Device);
        let empty = Buffer::from_slice::<u32>(context, "empty", &[], memory).unwrap();
        assert!(empty.read::<u32>().unwrap().is_empty());
    }
    let upload = Buffer::new(context, "upload", 12, Memory::Upload).unwrap();
    upload.mapped_mut::<u32>().unwrap().copy_from_slice(&[1, 2, 3]);
    assert_eq!(*upload.mapped::<u32>().unwrap(), [1, 2, 3]);
    assert_clean(context, "arrays");
}

#[test]
fn device_bytes_are_counted_and_given_back() {
    crate::harness::turn();
    // This test opens a context of its own, since other tests allocate memory in the context that they share.
    let context = Context::open(&Options {
        device: std::env::var("PALPATE_TEST_DEVICE").ok(),
        validation: crate::harness::validation(),
        ..Options::of_program()
    })
    .unwrap();
    assert_eq!(context.bytes_allocated(), 0);
    let _upload = Buffer::new(&context, "upload", 1 << 20, Memory::Upload).unwrap();
    assert_eq!(context.bytes_allocated(), 0, "mapped memory must not count as device memory");
    let array = Buffer::new(&context, "array", 1 << 20, Memory::Device).unwrap();
    let array_bytes = context.bytes_allocated();
    assert!((1 << 20..2 << 20).contains(&array_bytes), "bytes counted for an array of 1 MiB: {array_bytes}");
    drop(array);
    assert_eq!(context.bytes_allocated(), 0);
    assert_clean(&context, "allocation");
}

#[test]
fn threads_share_the_queue() {
    let (context, kernel) = (context(), bump());
    std::thread::scope(|scope| {
        for thread in 0..4u32 {
            // The test's own thread holds the lock that keeps other tests out (`harness::turn`), also on behalf of the
            // threads that it spawns here; these must not call `context()`, which would wait for that lock.
            let (kernel, a) = (&kernel, cells("own"));
            scope.spawn(move || {
                let mut recorder = Recorder::new(context).unwrap();
                recorder.dispatch(kernel, &bump_of(&a, thread), CELLS);
                let recording = recorder.finish().unwrap();
                for _ in 0..25 {
                    recording.submit_and_wait().unwrap();
                }
                assert_eq!(a.read::<u32>().unwrap(), folded(1, std::iter::repeat_n(thread, 25)));
            });
        }
    });
    assert_clean(context, "threads");
}

#[test]
fn a_device_is_found_by_index_and_by_part_of_its_name() {
    let list = Context::list().unwrap();
    let open = |device: &str| {
        Context::open(&Options { device: Some(device.into()), validation: false, ..Options::of_program() })
    };
    let usable = list.iter().find(|d| d.usable.is_ok()).expect("no Vulkan device is usable");
    assert_eq!(open(&usable.index.to_string()).unwrap().device_name(), usable.name);
    let part = usable.name.to_uppercase();
    assert_eq!(open(&part[..part.len().min(6)]).unwrap().device_name(), usable.name);
    let Err(error) = open("no such thing") else { panic!("a device that does not exist was opened") };
    assert!(
        error.to_string().contains("no such thing") && error.to_string().contains(&usable.name),
        "wrong error: {error}"
    );
    assert_eq!(error.exit_status(), 3);
}

/// Draws the rectangles from index `first` on over a grid of `side` x `side` cells on the GPU. Each rectangle adds its
/// index plus 1 to the cells that it covers; the cells' sums are returned. A rectangle is given by its first and its
/// last cell: x and y of the first, then x and y of the last.
fn covered(side: u32, rectangles: &[[i32; 4]], first: u32) -> Vec<u32> {
    let context = context();
    let pipeline = RasterPipeline::new(context, "test/raster_cells", &[("RASTER_CELLS", side.into())]).unwrap();
    let rectangles_there = Buffer::from_slice(context, "rectangles", rectangles, Memory::Device).unwrap();
    let raster_cells = Buffer::new(context, "raster_cells", u64::from(side * side) * 4, Memory::Device).unwrap();
    let out = Buffer::new(context, "out", raster_cells.bytes(), Memory::Readback).unwrap();
    // The buffer holds the arguments of two indirect draws (numbers of vertices and instances, first vertex, first
    // instance); only the second draw is run.
    let args = [[9u32; 4], [6, rectangles.len() as u32 - first, 0, 0]];
    let args = Buffer::from_slice(context, "args", &args, Memory::Device).unwrap();
    let mut recorder = Recorder::new(context).unwrap();
    recorder.stage("raster");
    // The draw waits for the fill, and the copy for the draw.
    recorder.fill(&raster_cells, 0);
    let arguments =
        DrawRasterCells { first_rectangle: first, rectangles: &rectangles_there, raster_cells: &raster_cells };
    recorder.draw_indirect(&pipeline, &arguments, &args, 1, side);
    recorder.copy(&raster_cells, &out);
    let recording = recorder.finish().unwrap();
    assert_eq!((recording.passes()[0].dispatches, recording.passes()[0].dependent), (3, 3));
    for _ in 0..2 {
        recording.submit_and_wait().unwrap();
    }
    assert_clean(context, "rasterizing");
    out.read().unwrap()
}

#[test]
fn a_rectangle_of_squares_has_a_fragment_each_and_no_other() {
    let mut random = Random(5);
    for side in [1u32, 2, 3, 7, 64, 65, 1000, MOST_CELLS + 1, 4096] {
        let end = side.cast_signed() - 1;
        let mut rectangles = vec![[0, 0, end, end], [end; 4], [0; 4], [0, end, end, end], [end, 0, end, end]];
        // Further rectangles: one without any cell, and random ones in turn of a single cell, part of a column, part of
        // a row, and up to 100 cells along each side.
        rectangles.push([1, 1, 0, 0]);
        for k in 0..200 {
            let mut at = || random.below(side as usize) as i32;
            let (x, y, to_x, to_y) = (at(), at(), at(), at());
            rectangles.push(match k % 4 {
                0 => [x, y, x, y],
                1 => [x, y.min(to_y), x, y.max(to_y)],
                2 => [x.min(to_x), y, x.max(to_x), y],
                _ => [x.min(to_x), y.min(to_y), x.max(to_x).min(x.min(to_x) + 99), y.max(to_y).min(y.min(to_y) + 99)],
            });
        }
        for first in [0, 3] {
            let mut want = vec![0u32; (side * side) as usize];
            for (colour, [x, y, to_x, to_y]) in rectangles.iter().enumerate().skip(first as usize) {
                for row in *y..=*to_y {
                    (*x..=*to_x).for_each(|column| want[(row * (end + 1) + column) as usize] += 1 + colour as u32);
                }
            }
            let got = covered(side, &rectangles, first);
            let wrong = got.iter().zip(&want).filter(|(a, b)| a != b).count();
            assert!(
                wrong == 0,
                "grid with {side} cells a side, rectangles from index {first} on: {wrong} cells have a wrong sum"
            );
        }
    }
}

#[test]
fn draws_that_cannot_be_are_refused() {
    let context = context();
    let pipeline = RasterPipeline::new(context, "test/raster_cells", &[]).unwrap();
    let (a, args) = (cells("a"), Buffer::from_slice(context, "args", &[0u32; 4], Memory::Device).unwrap());
    let fails = |buffers: &[(&str, &Buffer)], push: &[u8], slot, side| {
        let mut recorder = Recorder::new(context).unwrap();
        let arguments = Named { shader: "test/raster_cells", buffers, push };
        recorder.draw_indirect(&pipeline, &arguments, &args, slot, side);
        recorder.finish().map(|_| ()).unwrap_err().to_string()
    };
    let b = cells("b");
    let both = [("rectangles", &a), ("raster_cells", &b)];
    assert!(fails(&both, &[0; 4], 1, 8).contains("outside array args"));
    assert!(fails(&both, &[0; 4], 0, 0).contains("0 pixels a side"));
    assert!(fails(&both, &[0; 4], 0, u32::MAX).contains("pixels a side"));
    assert!(fails(&both, &[], 0, 8).contains("push constants"));
    assert!(fails(&both[..1], &[0; 4], 0, 8).contains("raster_cells, which was left out"));
    assert!(fails(&[("rectangles", &a), ("raster_cells", &a)], &[0; 4], 0, 8).contains("writes a"));
    assert_clean(context, "refused draws");
}

#[test]
fn a_workgroup_of_a_size_that_kernels_do_not_know_is_refused() {
    let open = |size: u32| {
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        Context::open(&Options { device, workgroup: Some(size), ..Options::default() })
    };
    for size in [0, 4, 24, 512] {
        let Err(error) = open(size) else { panic!("workgroups of {size} were accepted") };
        assert!(error.to_string().starts_with(&format!("workgroups of {size} ")), "wrong error: {error}");
        assert_eq!(error.exit_status(), 2);
    }
    assert_eq!(open(64).unwrap().reduce_size(), 64);
}
