//! The Vulkan room itself: order of dependent passes, indirect arguments, fills and copies, replay, timers, threads,
//! mapped memory, and the graphics pipeline.

use palpate::gpu::{
    Buffer, Context, DepthTest, Kernel, Memory, Options, Pass, RasterPipeline, RasterTarget, Recorder, Recording, Size,
};

use crate::harness::{assert_clean, context};

const CELLS: u32 = 100;

fn bump() -> Kernel {
    Kernel::new(context(), "test/bump", Size::Group, &[]).unwrap()
}

fn cells(name: &str) -> Buffer {
    Buffer::from_slice(context(), name, &[1u32; CELLS as usize], Memory::Device).unwrap()
}

fn push(amount: u32) -> [u8; 8] {
    bytemuck::cast([amount, CELLS])
}

/// The order of passes shows in this: a kernel's `cells = 3 cells + amount`, one amount after another.
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
        recorder.dispatch(&kernel, &[&a], &push(i), CELLS);
        recorder.dispatch(&kernel, &[&b], &push(2 * i), CELLS);
    }
    recorder.stage("second");
    recorder.dispatch(&kernel, &[&a], &push(7), 0);
    recorder.stage("first");
    recorder.copy(&a, &b);
    recorder.dispatch(&kernel, &[&b], &push(5), CELLS);
    let recording = recorder.finish().unwrap();
    assert!(recording.stage_times().is_empty(), "nothing ran yet");
    recording.submit_and_wait().unwrap();
    assert_eq!(a.read::<u32>().unwrap(), folded(1, 0..20));
    assert_eq!(b.read::<u32>().unwrap(), folded(1, (0..20).chain([5])));
    let passes: Vec<_> = recording.passes().iter().map(|p| (p.stage.as_str(), p.dispatches, p.dependent)).collect();
    assert_eq!(passes, [("first", 42, 22)], "20 dependent pairs, a copy, and what follows it");
    let times = recording.stage_times();
    assert_eq!(times.iter().map(|t| t.0.as_str()).collect::<Vec<_>>(), ["first", "second"]);
    assert!(times[0].1 > 0.0 && times[0].1 < 1e6, "{times:?}");
    assert_clean(context, "passes");
}

#[test]
fn recordings_replay_in_order_with_one_submit() {
    let (context, kernel, a) = (context(), bump(), cells("a"));
    let record = |amount| {
        let mut recorder = Recorder::untimed(context).unwrap();
        recorder.dispatch(&kernel, &[&a], &push(amount), CELLS);
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
        recorder.dispatch(&kernel, &[&a], &push(4), CELLS);
        recorder.copy(&a, &out);
        recorder.finish().unwrap()
    };
    recording.submit_and_wait().unwrap();
    assert_eq!(out.read::<u32>().unwrap(), folded(1, [4]));
    assert_clean(context, "keeping");
}

#[test]
fn indirect_passes_take_their_slot_and_wait_for_its_writer() {
    let (context, kernel, a) = (context(), bump(), cells("a"));
    let args = Buffer::from_slice(context, "args", &[9u32, 9, 9, 0, 1, 1, 2, 1, 1], Memory::Device).unwrap();
    let mut recorder = Recorder::new(context).unwrap();
    recorder.stage("indirect");
    recorder.dispatch_indirect(&kernel, &[&a], &push(1), &args, 1);
    recorder.dispatch_indirect(&kernel, &[&a], &push(2), &args, 2);
    // Zeroed on the device, after which the same slot runs nothing.
    recorder.fill_range(&args, 24, 12, 0);
    recorder.dispatch_indirect(&kernel, &[&a], &push(3), &args, 2);
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
    assert!(fails(&|r| r.dispatch_indirect(&kernel, &[&a], &push(1), &args, 3)).contains("lie outside args"));
    assert!(fails(&|r| r.fill_range(&args, 2, 4, 0)).contains("not whole words"));
    assert!(fails(&|r| r.fill_range(&args, 32, 8, 0)).contains("not whole words"));
    assert!(fails(&|r| r.copy(&a, &args)).contains("cannot be copied"));
    assert!(fails(&|r| r.dispatch_groups(&kernel, &[&a], &push(1), u32::MAX)).contains("the device's limit"));
    assert_clean(context, "indirect");
}

#[test]
fn arrays_come_back_as_they_went() {
    let context = context();
    let data: Vec<[f32; 4]> = (0..1234).map(|i| [i as f32, 0.5, -1.0, f32::MAX]).collect();
    for memory in [Memory::Device, Memory::Upload, Memory::Readback] {
        let buffer = Buffer::from_slice(context, "array", &data, memory).unwrap();
        assert_eq!(buffer.read::<[f32; 4]>().unwrap(), data, "{memory:?}");
        buffer.write(&[[1.0f32; 4]; 2]).unwrap();
        assert_eq!(buffer.read::<[f32; 4]>().unwrap()[1..3], [[1.0; 4], data[2]], "{memory:?}");
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
    // A context of its own, since other tests allocate at the same time.
    let context =
        Context::new(&Options { device: std::env::var("PALPATE_TEST_DEVICE").ok(), validation: true }).unwrap();
    assert_eq!(context.bytes_allocated(), 0);
    let _upload = Buffer::new(&context, "upload", 1 << 20, Memory::Upload).unwrap();
    assert_eq!(context.bytes_allocated(), 0, "mapped memory does not count");
    let array = Buffer::new(&context, "array", 1 << 20, Memory::Device).unwrap();
    let array_bytes = context.bytes_allocated();
    assert!((1 << 20..2 << 20).contains(&array_bytes), "{array_bytes}");
    let target = RasterTarget::new(&context, "target", 256, 256).unwrap();
    assert!(context.bytes_allocated() >= array_bytes + 256 * 256 * 8);
    drop((array, target));
    assert_eq!(context.bytes_allocated(), 0);
    assert_clean(&context, "allocation");
}

#[test]
fn threads_share_the_queue() {
    let (context, kernel) = (context(), bump());
    std::thread::scope(|scope| {
        for thread in 0..4u32 {
            let kernel = &kernel;
            scope.spawn(move || {
                let a = cells("own");
                let mut recorder = Recorder::new(context).unwrap();
                recorder.dispatch(kernel, &[&a], &push(thread), CELLS);
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
    let open = |device: &str| Context::new(&Options { device: Some(device.into()), validation: false });
    let usable = list.iter().find(|d| d.usable.is_ok()).expect("a usable device");
    assert_eq!(open(&usable.index.to_string()).unwrap().device_name(), usable.name);
    let part = usable.name.to_uppercase();
    assert_eq!(open(&part[..part.len().min(6)]).unwrap().device_name(), usable.name);
    let Err(error) = open("no such thing") else { panic!("opened a device that is not there") };
    assert!(error.to_string().contains("no such thing") && error.to_string().contains(&usable.name), "{error}");
    assert_eq!(error.exit_status(), 3);
}

/// Two triangles that each cover a whole 4 x 4 target, at depths 0.5 and 0.25, and one that covers its left half.
fn layers(test: DepthTest, added: u32) -> (RasterPipeline, Vec<Buffer>) {
    let context = context();
    let cover = |x: f32, z: f32| [[-1.0, -1.0, z, 0.0f32], [-1.0, 7.0, z, 0.0], [x, -1.0, z, 0.0]];
    let half = [[-1.0, -9.0, 0.5, 0.0f32], [0.0, -9.0, 0.5, 0.0], [0.0, 900.0, 0.5, 0.0]];
    let corners: Vec<[f32; 4]> = [cover(7.0, 0.5), cover(7.0, 0.25), half].concat();
    let pipeline = RasterPipeline::new(context, "test/layers", test, &[("added", added.into())]).unwrap();
    let corners = Buffer::from_slice(context, "corners", &corners, Memory::Device).unwrap();
    let table = Buffer::from_slice(context, "table", &[10u32, 11, 12, 13], Memory::Device).unwrap();
    // Vertex count, instances, first vertex, first instance.
    let args = [[6u32, 1, 0, 0], [3, 1, 6, 0], [0, 1, 0, 0]];
    (pipeline, vec![corners, table, Buffer::from_slice(context, "args", &args, Memory::Device).unwrap()])
}

/// Draws `slots` and returns colours and depths.
fn drawn(test: DepthTest, far: f32, draws: &[(u32, Option<[u32; 4]>)]) -> (Vec<u32>, Vec<f32>) {
    let context = context();
    let (pipeline, b) = layers(test, 100);
    let target = RasterTarget::new(context, "target", 4, 4).unwrap();
    let out = |name| Buffer::new(context, name, 64, Memory::Readback).unwrap();
    let (color, depth) = (out("color"), out("depth"));
    let mut recorder = Recorder::new(context).unwrap();
    recorder.stage("raster");
    // A pass that writes what the draws read: they must wait for it. Triangle 2 with base 1 reads word 3.
    recorder.fill_range(&b[1], 12, 4, 20);
    for (i, &(slot, area)) in draws.iter().enumerate() {
        let pass = if i == 0 { Pass::cleared(7, far) } else { Pass { clear: None, area } };
        recorder.draw_indirect(&pipeline, &target, &[&b[0], &b[1]], bytemuck::bytes_of(&1u32), &b[2], slot, pass);
    }
    recorder.copy_target(&target, &color, &depth);
    let recording = recorder.finish().unwrap();
    for _ in 0..3 {
        recording.submit_and_wait().unwrap();
    }
    assert_clean(context, "raster");
    (color.read().unwrap(), depth.read().unwrap())
}

#[test]
fn draws_keep_the_fragment_the_depth_test_chooses() {
    let (color, depth) = drawn(DepthTest::Less, 1.0, &[(0, None)]);
    assert_eq!((color, depth), (vec![112; 16], vec![0.25; 16]), "the nearer");
    let (color, depth) = drawn(DepthTest::GreaterOrEqual, 0.0, &[(0, None)]);
    assert_eq!((color, depth), (vec![111; 16], vec![0.5; 16]), "the farther");
    let (color, depth) = drawn(DepthTest::Less, 1.0, &[(2, None)]);
    assert_eq!((color, depth), (vec![7; 16], vec![1.0; 16]), "nothing drawn: cleared");
    // The half at depth 0.5 ties with the first triangle; its colour comes through the table's filled word.
    let left = |within: u32, without: u32| [within, within, without, without].repeat(4);
    let (color, _) = drawn(DepthTest::GreaterOrEqual, 0.0, &[(0, None), (1, None)]);
    assert_eq!(color, left(120, 111), "the later of equals");
    let (color, _) = drawn(DepthTest::Greater, 0.0, &[(0, None), (1, None)]);
    assert_eq!(color, vec![111; 16], "the earlier of equals");
}

#[test]
fn a_draw_stays_in_its_area() {
    let (color, _) = drawn(DepthTest::GreaterOrEqual, 0.0, &[(2, None), (0, Some([1, 2, 2, 1]))]);
    let mut want = vec![7; 16];
    want[9..11].fill(111);
    assert_eq!(color, want);
}
