//! Tests of recordings: writing, reading back, damaged files and tables. The tests of `replay` use the session of these
//! tests too. A *tick* is one iteration of the haptic loop.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use palpate::internal::haptics::environment::{Environment, Wall};
use palpate::internal::haptics::event::Event;
use palpate::internal::haptics::safety::Limits;
use palpate::internal::haptics::servo::Servo;
use palpate::internal::haptics::{Fault, Reading};
use palpate::scene::{Coupling, Lowered, Profile};
use palpate::{ContactPoint, Flags, RigidState};
use prost_reflect::Value;

use super::*;

/// Ticks from one simulation step to the next.
const EVERY: u64 = 20;
/// Ticks from the beginning of a step until the loop has the step's wrench.
const DELAY: u64 = 5;
/// Number of simulation steps before the first tick.
const FIRST: u64 = 2;
/// Ticks with a fault of the haptic device, one for each kind of fault: reading fails with `Fault::Lost`; reading fails
/// with `Fault::Garbled`; the reading holds a NaN; the device refuses the wrench that it is commanded to exert.
const FAULTS: [u64; 4] = [301, 351, 401, 451];
pub const TICKS: u64 = 500;

pub fn header() -> Header {
    Header {
        program: "0.0.0".into(),
        scene: "a/scene.toml".into(),
        scene_digest: [7; 32],
        device: "none".into(),
        driver: "none".into(),
        depth: Some("compute".into()),
        leaders: vec![Leader { tool: "tool".into(), profile: "premium".into(), device: "scripted".into() }],
    }
}

fn tool() -> Tool {
    Tool {
        mass: 0.05,
        inertia: DMat3::from_diagonal(DVec3::splat(8e-6)),
        coupling: Some(Coupling { stiffness: 500.0, damping: 3.0, angular_stiffness: 0.1, angular_damping: 1e-3 }),
        centre: DVec3::Y * 2e-3,
        orientation: DQuat::IDENTITY,
        velocity: DVec3::ZERO,
        angular_velocity: DVec3::ZERO,
    }
}

/// The source of contact wrenches in the tests' session, in place of the simulation: a wall. Its contact wrench of step
/// 12 holds a NaN.
pub struct Walled(Wall);

impl Walled {
    pub fn new() -> Walled {
        Walled(Wall { stiffness: 600.0, damping: 1.0, tells_gap: true, tool: tool(), steps: 0 })
    }
}

impl Environment for Walled {
    fn feel_each(&mut self, inputs: &[DeviceInput], h: f64) -> Result<Vec<ContactWrench>> {
        let mut wrenches = self.0.feel_each(inputs, h)?;
        if wrenches[0].step == 12 {
            wrenches[0].pressing = f64::NAN;
        }
        Ok(wrenches)
    }
}

/// Reading of a device that moves up and down through the wall's surface.
fn reading(time: f64) -> Reading {
    let turn = 20.0 * time;
    let state = RigidState {
        velocity: DVec3::Y * -0.1 * turn.sin(),
        ..RigidState::at_rest(DVec3::Y * 5e-3 * turn.cos(), DQuat::from_rotation_z(0.1 * turn.sin()))
    };
    Reading { time, state, buttons: u32::from(time > 0.1) }
}

/// Runs a session in virtual time, that is without waiting for a clock, and gives its entries to `keep`, in the order
/// in which the program would record them.
fn session(mut keep: impl FnMut(Entry)) {
    let (limits, _) = Limits::new(Profile::named("premium").unwrap(), &Lowered::default());
    let settings = Settings {
        period: 1e-3,
        limits,
        local_model: true,
        passivity: true,
        most_damping: [5.0, 0.0],
        trust: 5e-3,
        arm: 0.02,
        resolution: 2e-5,
    };
    let mut walled = Walled::new();
    let mut servo = Servo::new(settings, tool());
    keep(Entry::Begin(0, Box::new(Begin { settings, tool: tool() })));
    for _ in 0..FIRST {
        let (input, h) = (servo.input(), 0.01);
        let wrenches = vec![walled.feel(&input, h).unwrap()];
        keep(Entry::Step(Box::new(Step { inputs: vec![input], h, wrenches })));
    }
    let (mut newest, mut under_way, mut waiting) = (servo.newest(), None, Vec::new());
    for k in 0..TICKS {
        if k % EVERY == 0 {
            let (input, h) = (servo.input(), 1e-3 * EVERY as f64);
            under_way = Some(Step { inputs: vec![input], h, wrenches: vec![walled.feel(&input, h).unwrap()] });
        }
        if k % EVERY == DELAY {
            newest = under_way.as_ref().map_or(newest, |step| step.wrenches[0]);
        }
        let time = 1e-3 * k as f64;
        let mut said = Ok(reading(time));
        match FAULTS.iter().position(|at| *at == k) {
            Some(0) => said = Err(Fault::Lost("gone".into())),
            Some(1) => said = Err(Fault::Garbled("odd".into())),
            Some(2) => said.as_mut().unwrap().state.position.y = f64::NAN,
            _ => {}
        }
        let mut tick = servo.tick(time, 1e-5, said, &newest);
        if k == FAULTS[3] {
            servo.unplayed(&mut tick);
        }
        waiting.push(Entry::Tick(0, Box::new(tick)));
        // A step is recorded before the ticks that ran during it, but every third step is recorded after them.
        if k % EVERY == DELAY + 2 || k + 1 == TICKS {
            let step = under_way.take().map(|step| Entry::Step(Box::new(step)));
            let at = if (k / EVERY).is_multiple_of(3) { waiting.len() } else { 0 };
            waiting.splice(at..at, step);
            waiting.drain(..).for_each(&mut keep);
        }
    }
}

fn entries() -> Vec<Entry> {
    let mut entries = Vec::new();
    session(|entry| entries.push(entry));
    entries
}

fn write_all(recording: &mut Recording, entries: &[Entry]) {
    for entry in entries {
        match entry {
            Entry::Begin(index, begin) => recording.begin(*index, &begin.settings, &begin.tool),
            Entry::Tick(index, tick) => recording.tick(*index, tick),
            Entry::Step(step) => recording.step(&step.inputs, step.h, &step.wrenches),
            Entry::End(_) => Ok(()),
        }
        .unwrap();
    }
}

/// Records the tests' session, each entry changed by `spoil`, with its regular end; returns the file's path.
pub fn recorded(folder: &Path, spoil: impl Fn(&mut Entry)) -> PathBuf {
    let path = folder.join("session.palpate");
    let mut recording = Recording::create(&path, &header()).unwrap();
    let mut entries = entries();
    entries.iter_mut().for_each(spoil);
    write_all(&mut recording, &entries);
    recording.finish().unwrap();
    path
}

/// Offsets at which header and entries of a file begin, and the file's length, bytes.
fn places(bytes: &[u8]) -> Vec<usize> {
    let (mut at, mut places) = (12, vec![12]);
    while at < bytes.len() {
        at += 4 + u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        places.push(at);
    }
    places
}

fn error_of(path: &Path) -> String {
    let error = match Recorded::open(path) {
        Ok(recorded) => recorded.filter_map(Result::err).next().expect("no entry was refused"),
        Err(error) => error,
    };
    assert_eq!(error.exit_status(), 2);
    let message = error.to_string();
    assert!(message.contains("session.palpate") && !message.contains('\n'), "wrong message: {message}");
    message
}

#[test]
fn what_is_recorded_reads_back_the_same_not_numbers_included() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), |_| {});
    let recorded = Recorded::open(&path).unwrap();
    assert_eq!(recorded.header, header());
    let read: Vec<Entry> = recorded.collect::<Result<_>>().unwrap();
    let (end, read) = read.split_last().unwrap();
    assert_eq!(*end, Entry::End(Totals { ticks: TICKS, steps: FIRST + TICKS / EVERY, lost: 0 }));
    let bytes = |entries: &[Entry]| -> Vec<Vec<u8>> {
        entries.iter().map(|entry| postcard::to_stdvec(entry).unwrap()).collect()
    };
    let all = entries();
    assert_eq!(bytes(read), bytes(&all));
    // The session covers what a recording must hold: contact, times without contact, and every kind of fault.
    let ticks: Vec<&Tick> =
        all.iter().filter_map(|entry| if let Entry::Tick(_, tick) = entry { Some(&**tick) } else { None }).collect();
    let seen = |event| ticks.iter().filter(|tick| tick.events.has(event)).count();
    assert_eq!((seen(Event::DeviceLost), seen(Event::BadReading)), (2, 2));
    assert!(seen(Event::BadWrench) > 0);
    assert!(ticks.iter().filter(|tick| tick.contact.force.y > 0.5 && tick.played.force.y > 0.1).count() > 50);
    assert!(ticks.iter().filter(|tick| tick.step > 0 && tick.contact.force.y == 0.0).count() > 50);
}

#[test]
fn a_recording_that_was_cut_short_is_read_up_to_its_last_whole_entry() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), |_| {});
    let bytes = std::fs::read(&path).unwrap();
    let places = places(&bytes);
    for (cut, whole) in [(places[40], 39), (places[40] + 3, 39), (places[40] - 1, 38), (places[1], 0)] {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        let read: Vec<Entry> = Recorded::open(&path).unwrap().collect::<Result<_>>().unwrap();
        assert_eq!(read.len(), whole, "number of entries read from a file of {cut} bytes");
        assert!(!matches!(read.last(), Some(Entry::End(_))));
    }
    for cut in [0, 5, 11] {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        assert!(error_of(&path).contains("is not a recording"), "wrong error for a file of {cut} bytes");
    }
    std::fs::write(&path, &bytes[..places[1] - 1]).unwrap();
    assert!(error_of(&path).contains("ends within the header"));
}

#[test]
fn every_way_a_file_can_be_wrong_is_one_line_that_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), |_| {});
    let bytes = std::fs::read(&path).unwrap();
    let places = places(&bytes);
    let (at, end) = (places[30], places[places.len() - 2]);
    let damaged = |at: usize| format!("entry at byte {at} is damaged");
    type Spoil = Box<dyn Fn(&mut Vec<u8>)>;
    let put =
        |at: usize, new: &'static [u8]| -> Spoil { Box::new(move |b| b[at..at + new.len()].copy_from_slice(new)) };
    let wrong: [(Spoil, String); 8] = [
        (put(0, b"PALPATE"), "is not a recording".into()),
        (put(8, &[1, 0]), "version 1; this palpate reads version 7".into()),
        (put(at, &[1, 0, 16, 0]), format!("{}: it is 1048577 bytes long", damaged(at))),
        (put(at, &[255; 4]), damaged(at)),
        (put(at + 4, &[9]), damaged(at)),
        (put(end + 5, &[0xf5]), format!("{}: it counts", damaged(end))),
        (Box::new(|b| b.push(0)), format!("{}: there is more data", damaged(bytes.len()))),
        (Box::new(move |b| b.splice(at..at, b[at - 1000..at].to_vec()).for_each(drop)), "is damaged".into()),
    ];
    for (spoil, words) in wrong {
        let mut spoiled = bytes.clone();
        spoil(&mut spoiled);
        std::fs::write(&path, &spoiled).unwrap();
        assert!(error_of(&path).contains(&words), "expected `{words}` in: {}", error_of(&path));
    }
    // In this file a tick is repeated.
    let mut twice = bytes.clone();
    twice.splice(at..at, bytes[at..places[31]].to_vec());
    std::fs::write(&path, &twice).unwrap();
    assert!(error_of(&path).contains("is repeated"), "wrong error: {}", error_of(&path));
}

#[test]
fn ticks_that_are_missing_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.palpate");
    let mut recording = Recording::create(&path, &header()).unwrap();
    let mut entries = entries();
    entries.retain(|entry| !matches!(entry, Entry::Tick(_, tick) if (50..53).contains(&tick.index)));
    write_all(&mut recording, &entries);
    let totals = recording.finish().unwrap();
    assert_eq!((totals.ticks, totals.lost), (TICKS - 3, 3));
    assert!(Recorded::open(&path).unwrap().all(|entry| entry.is_ok()));
}

#[test]
fn a_name_that_ends_in_csv_gives_a_table_of_the_ticks_in_full_precision() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ticks.CSV");
    let mut recording = Recording::create(&path, &header()).unwrap();
    let all = entries();
    write_all(&mut recording, &all);
    recording.finish().unwrap();
    let mut table = csv::Reader::from_path(&path).unwrap();
    let heads: Vec<String> = table.headers().unwrap().iter().map(String::from).collect();
    assert_eq!(
        heads.iter().collect::<std::collections::BTreeSet<_>>().len(),
        heads.len(),
        "the headings must differ: {heads:?}"
    );
    let rows: Vec<csv::StringRecord> = table.records().map(|row| row.unwrap()).collect();
    let cell = |row: usize, head: &str| rows[row][heads.iter().position(|name| name == head).unwrap()].to_string();
    let number = |row: usize, head: &str| cell(row, head).parse::<f64>().unwrap();
    let mut row = 0;
    for entry in &all {
        let Entry::Tick(_, tick) = entry else { continue };
        assert_eq!(cell(row, "tick"), tick.index.to_string());
        assert_eq!(number(row, "time_s"), tick.time);
        assert_eq!(number(row, "played_force_y"), tick.played.force.y);
        assert_eq!(number(row, "device_qz"), tick.device.orientation.z);
        assert_eq!(number(row, "energy_given_y"), tick.energy.given[1]);
        assert_eq!(cell(row, "read_vy"), tick.reading.map_or(String::new(), |r| format!("{:?}", r.state.velocity.y)));
        assert_eq!(cell(row, "events"), tick.events.names().collect::<Vec<_>>().join("|"));
        row += 1;
    }
    assert_eq!((row, rows.len()), (TICKS as usize, TICKS as usize));
    assert_eq!(cell(FAULTS[0] as usize, "read_x"), "");
    assert_eq!(cell(FAULTS[0] as usize, "events"), "device_lost|engaging");
    assert_eq!(cell(FAULTS[2] as usize, "read_y"), "NaN");
}

#[test]
fn a_place_that_cannot_be_written_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = Recording::create(&folder.path().join("none/session"), &header()).err().unwrap();
    assert!(matches!(&error, Error::Output { file, .. } if file.ends_with("none/session")), "wrong error: {error}");
}

/// The messages of an MCAP log by topic, decoded by the schemas in the file: time, ns, and values by name.
fn messages(path: &Path) -> BTreeMap<String, Vec<(u64, Value)>> {
    let bytes = std::fs::read(path).unwrap();
    let mut topics = BTreeMap::<String, Vec<_>>::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let of_topic = topics.entry(message.channel.topic.clone()).or_default();
        assert_eq!(message.sequence as usize, of_topic.len());
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!((&*schema.encoding, &*message.channel.message_encoding), ("protobuf", "protobuf"));
        let pool = prost_reflect::DescriptorPool::decode(&*schema.data).unwrap();
        let kind = pool.get_message_by_name(&schema.name).unwrap();
        let value = prost_reflect::DynamicMessage::decode(kind, &*message.data).unwrap();
        of_topic.push((message.log_time, Value::Message(value)));
    }
    topics
}

fn get(value: &Value, path: &str) -> Value {
    let next = |value: Value, name| value.as_message().unwrap().get_field_by_name(name).unwrap().into_owned();
    path.split('.').fold(value.clone(), next)
}

#[test]
fn a_name_that_ends_in_mcap_gives_a_log_of_every_tick_step_and_contact() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let mut recording = Recording::create(&path, &header()).unwrap();
    assert!(recording.takes_outcomes());
    let all = entries();
    write_all(&mut recording, &all);
    let contact = |k: f64| ContactPoint {
        bodies: [1, 0],
        vertex: 7 + k as usize,
        position: DVec3::new(k, 0.1, -0.2),
        normal: DVec3::Z,
        depth: 1e-3 * k,
        area: 2e-6,
        pressure: 1e3,
        friction: DVec3::X * 200.0,
    };
    let flags = Flags::FROZEN | Flags::CONTACT_OVERFLOW;
    recording.outcome(0.25, &Outcome { contacts: Vec::new(), flags: Flags::default() }).unwrap();
    recording.outcome(0.5, &Outcome { contacts: vec![contact(1.0), contact(2.0)], flags }).unwrap();
    recording.finish().unwrap();

    let topics = messages(&path);
    let names = ["/contacts", "/device", "/flags", "/step", "/tick", "/tool"];
    assert_eq!(topics.keys().collect::<Vec<_>>(), names);
    // Every field of every tick and step has the same bits, and is missing where it has no value.
    let ticks = all.iter().filter_map(|entry| if let Entry::Tick(_, tick) = entry { Some(&**tick) } else { None });
    let rows = ticks.clone().map(|tick| (tick.time, fields::of_tick(tick)));
    let steps = all.iter().filter_map(step_of);
    let steps = steps.map(|step| (step.inputs[0].time, fields::of_step(&step.inputs[0], step.h, &step.wrenches[0])));
    let mut empty = 0;
    for (topic, rows) in [("/tick", rows.collect::<Vec<_>>()), ("/step", steps.collect())] {
        assert_eq!(topics[topic].len(), rows.len());
        for ((at, message), (time, fields)) in topics[topic].iter().zip(rows) {
            assert_eq!(*at, (1e9 * time).round() as u64);
            let message = message.as_message().unwrap();
            for field in fields {
                let there = message.get_field_by_name(&field.name()).unwrap();
                let has = message.has_field_by_name(&field.name());
                let same = match field.value {
                    fields::Value::Count(count) => count == has.then(|| there.as_u64().unwrap()),
                    fields::Value::Number(number) => {
                        number.map(f64::to_bits) == has.then(|| there.as_f64().unwrap().to_bits())
                    }
                    fields::Value::Events(events) => {
                        let names = there.as_list().unwrap().iter().map(|name| name.as_str().unwrap());
                        names.eq(events.names())
                    }
                };
                assert!(same, "{} is {there} at {time} s; it was {}", field.name(), field.told());
                empty += u32::from(field.text().is_empty());
            }
        }
    }
    assert!(empty > 30, "only {empty} fields were empty");
    assert_eq!([topics["/device"].len(), topics["/tool"].len()], [TICKS as usize; 2]);
    for (tick, ((at, device), (_, tool))) in ticks.zip(topics["/device"].iter().zip(&topics["/tool"])) {
        for (message, state) in [(device, tick.device), (tool, tick.tool)] {
            assert_eq!(get(message, "frame_id").as_str(), Some("world"));
            let of_stamp = get(message, "timestamp.seconds").as_i64().unwrap() * 1_000_000_000;
            assert_eq!(of_stamp + i64::from(get(message, "timestamp.nanos").as_i32().unwrap()), *at as i64);
            let number = |name: String| get(message, &name).as_f64().unwrap();
            let position = ["x", "y", "z"].map(|k| number(format!("pose.position.{k}")));
            let orientation = ["x", "y", "z", "w"].map(|k| number(format!("pose.orientation.{k}")));
            assert_eq!(DVec3::from(position), state.position);
            assert_eq!(DQuat::from_array(orientation), state.orientation);
        }
    }

    let [(first, none), (second, two)] = &topics["/contacts"][..] else { panic!() };
    assert_eq!((*first, *second), (250_000_000, 500_000_000));
    assert_eq!(get(none, "data").as_bytes().map(|data| data.len()), Some(0));
    let (data, stride) = (get(two, "data"), get(two, "point_stride").as_u32().unwrap() as usize);
    let data = data.as_bytes().unwrap();
    assert_eq!(data.len(), 2 * stride);
    let field = |point: usize, name: &str| {
        let fields = get(two, "fields");
        let mut fields = fields.as_list().unwrap().iter();
        let field = fields.find(|field| get(field, "name").as_str() == Some(name)).unwrap();
        let at = point * stride + get(field, "offset").as_u32().unwrap() as usize;
        match get(field, "type").as_enum_number() {
            Some(8) => f64::from_le_bytes(data[at..at + 8].try_into().unwrap()),
            Some(5) => u32::from_le_bytes(data[at..at + 4].try_into().unwrap()).into(),
            other => panic!("{name} has the type {other:?}"),
        }
    };
    let expected = [
        ("x", 2.0),
        ("y", 0.1),
        ("z", -0.2),
        ("normal_z", 1.0),
        ("force_x", 2e-6 * 200.0),
        ("force_y", 0.0),
        ("force_z", 2e-6 * 1e3),
        ("force", 2e-6 * 200f64.hypot(1e3)),
        ("depth", 2e-3),
        ("area", 2e-6),
        ("pressure", 1e3),
        ("body", 1.0),
        ("vertex", 9.0),
        ("touched_body", 0.0),
    ];
    for (name, value) in expected {
        assert!((field(1, name) - value).abs() <= 1e-15 * value.abs(), "{name} is {}, not {value}", field(1, name));
    }
    let [(at, flags)] = &topics["/flags"][..] else { panic!() };
    assert_eq!((*at, get(flags, "message").as_str()), (500_000_000, Some("contact_overflow frozen")));

    let bytes = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count as usize, topics.values().map(Vec::len).sum::<usize>());
    let described: Vec<_> = summary.metadata_indexes.iter().map(|index| &*index.name).collect();
    assert_eq!(described, ["session", "loop"]);
    let session = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!((&*session.metadata["profile"], session.metadata["scene_sha256"].len()), ("premium", 64));

    // Of a log that was cut short, the messages of all whole chunks can be recovered.
    let cut = &bytes[..bytes.len() / 2];
    let options = mcap::read::Options::IgnoreEndMagic;
    let whole =
        mcap::MessageStream::new_with_options(cut, options.into()).unwrap().take_while(|message| message.is_ok());
    assert!(whole.count() > TICKS as usize / 2);
}

fn step_of(entry: &Entry) -> Option<&Step> {
    if let Entry::Step(step) = entry { Some(step) } else { None }
}
