//! Tests of sessions (runs of the haptic loop with a haptic device) through the built program: a session is run,
//! recorded and replayed; a signal ends a session; the limits of force and workspace in the scene and in the *profile*
//! (limits for a type of device) apply to a session; impossible requests are refused. A *tick* is one iteration of the
//! loop; the *tool* is the rigid body that the device leads.

use std::fs;
use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::Message;

/// A scene in which the tool, a ball of 50 g, is above a soft block; the scene's keys lead the device downwards.
const SCENE: &str = "[step]\ngravity = [0.0, 0.0, 0.0]\n[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.05, -0.03, -0.05], [0.05, 0.03, 0.05]], cells = [4, 3, 4] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [[body.core]]\nname = \"bottom\"\nbind = { box = [[-0.06, -0.04, -0.06], [0.06, -0.029, 0.06]] }\n\
    [tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.053, 0.0]\n\
    [drive]\nkeys = [[0.0, 0.0, 0.053, 0.0], [0.3, 0.0, 0.053, 0.0], [0.6, 0.0, 0.04, 0.0]]\n";

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_palpate"))
}

/// Runs the program; returns exit status, standard output and standard error.
fn palpate(arguments: &[&str]) -> (i32, String, String) {
    let output = program().args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn scene(folder: &Path, more: &str) -> PathBuf {
    let file = folder.join("scene.toml");
    fs::write(&file, format!("{SCENE}{more}")).unwrap();
    file
}

/// Runs a session of 1.5 s with the scene and the lines `more`, and records it into the file `record`; returns `haptics`
/// of `summary.json`.
fn hold(folder: &Path, more: &str, record: &str) -> Value {
    let (scene, out, record) = (scene(folder, more), folder.join("out"), folder.join(record));
    // A recording does not replace another.
    let _ = fs::remove_file(&record);
    let [scene, out_name, record] = [&scene, &out, &record].map(|path| path.to_str().unwrap());
    let arguments = ["run", scene, "--seconds", "1.5", "--out", out_name, "--record", record];
    let (status, _, stderr) = palpate(&arguments);
    assert_eq!(status, 0, "standard error: {stderr}");
    assert!(stderr.contains("coupling "), "the gains of the virtual coupling must be printed: {stderr}");
    let summary: Value = serde_json::from_str(&fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
    summary["haptics"].clone()
}

#[test]
fn a_session_is_held_recorded_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let report = hold(folder.path(), "[haptics]\ndevice = \"hand\"\nprofile = \"touch\"\n", "session.palpate");
    let record = folder.path().join("session.palpate");
    let (status, text, stderr) = palpate(&["replay", record.to_str().unwrap()]);
    let (ticks, steps) = (report["ticks"].as_u64().unwrap(), report["steps"].as_u64().unwrap());
    assert!(ticks > 100 && steps > 10, "summary: {report}");
    // The number of steps is not compared, because the recording also has the steps before the first tick.
    assert!(
        text.starts_with(&format!("replayed {ticks} ticks and ")),
        "the session had {ticks} ticks; the replay printed output {text}, errors {stderr}"
    );
    assert_eq!((status, text.contains("the same bits")), (0, true), "output {text}, errors {stderr}");
    let peak = report["peak_force_n"].as_f64().unwrap();
    assert!(peak > 0.05 && peak <= 3.3, "summary: {report}");
    assert_eq!(report["profile"], "touch");
    assert!(
        report["age_ms"]["p99"].as_f64().unwrap() > 0.0 && report["bare_timer"]["p99_us"].is_number(),
        "summary: {report}"
    );
    assert!(report["energy_j"]["net_given"].as_f64().unwrap() <= 3.3 * 2e-5, "summary: {report}");
}

/// Two balls of 10 mm, each held by a device of its own, that press on a soft block from above and from the side.
fn two_devices(devices: [&str; 2]) -> String {
    let block = SCENE.split("[tool]").next().unwrap();
    let ball = |name: &str, device: &str, [start, end]: [[f64; 3]; 2]| {
        let [sx, sy, sz] = start;
        let [ex, ey, ez] = end;
        format!(
            "[[body]]\nname = \"{name}\"\nsurface = {{ model = \"sphere\", vertices = 200 }}\nscale = 0.01\n\
             motion = \"dynamic\"\nmass = 0.05\nposition = [{sx:?}, {sy:?}, {sz:?}]\n\
             [[tool]]\nname = \"{name}\"\nbody = \"{name}\"\ncoupling = {{ stiffness = 500, damping = 5, angular_stiffness = 0.5, angular_damping = 0.002 }}\n\
             drive = {{ keys = [[0.3, {sx:?}, {sy:?}, {sz:?}], [0.6, {ex:?}, {ey:?}, {ez:?}]] }}\nhaptics = {{ {device} }}\n"
        )
    };
    block.to_owned()
        + &ball("above", devices[0], [[0.0, 0.043, 0.0], [0.0, 0.03, 0.0]])
        + &ball("aside", devices[1], [[0.063, 0.0, 0.0], [0.05, 0.0, 0.0]])
}

#[test]
fn two_devices_are_held_recorded_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let scene = two_devices(["device = \"hand\", profile = \"touch\"", "profile = \"premium\""]);
    fs::write(at("scene.toml"), scene).unwrap();
    let run = |record: &str| {
        let (status, text, stderr) =
            palpate(&["run", &at("scene.toml"), "--seconds", "1.5", "--out", &at("out"), "--record", &at(record)]);
        assert_eq!(status, 0, "standard error: {stderr}");
        (text, stderr)
    };
    let (text, stderr) = run("session.palpate");
    for words in ["haptic loop of above: ", "haptic loop of aside: "] {
        assert!(text.contains(words), "{text}");
    }
    assert!(stderr.contains("above: coupling ") && stderr.contains("aside: coupling "), "{stderr}");
    let summary: Value = serde_json::from_str(&fs::read_to_string(at("out/summary.json")).unwrap()).unwrap();
    let (above, aside) = (&summary["haptics"], &summary["further_haptics"]["aside"]);
    assert_eq!([&above["profile"], &aside["profile"]], ["touch", "premium"], "{summary}");
    let peaks = [above, aside].map(|report| report["peak_force_n"].as_f64().unwrap());
    assert!(peaks[0] > 0.05 && peaks[0] <= 3.3 && peaks[1] > 0.05 && peaks[1] <= 8.5, "peaks {peaks:?} N");
    let page = fs::read_to_string(at("out/report.html")).unwrap();
    assert!(page.contains("The haptic device of above") && page.contains("The haptic device of aside"));
    let ticks: u64 = [above, aside].iter().map(|report| report["ticks"].as_u64().unwrap()).sum();
    let (status, text, stderr) = palpate(&["replay", &at("session.palpate")]);
    assert!(text.starts_with(&format!("replayed {ticks} ticks and ")), "{text} {stderr}");
    assert_eq!((status, text.contains("the same bits")), (0, true), "output {text}, errors {stderr}");

    // As a table the ticks say of which tool they are, and as a log each tool has topics of its own.
    assert_eq!(palpate(&["replay", &at("session.palpate"), "--csv", &at("ticks")]).0, 0);
    let table = fs::read_to_string(at("ticks")).unwrap();
    let of = |name: &str| table.lines().filter(|line| line.starts_with(name)).count() as u64;
    assert_eq!((of("tool,tick,time_s"), of("above,") + of("aside,")), (1, ticks));
    run("session.mcap");
    let bytes = fs::read(at("session.mcap")).unwrap();
    let topics = mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap().channel.topic.clone());
    // Steps that a slow machine makes longer may raise flags.
    let topics: std::collections::BTreeSet<String> = topics.filter(|topic| topic != "/flags").collect();
    let names = [
        "/aside/device",
        "/aside/step",
        "/aside/tick",
        "/aside/tool",
        "/contacts",
        "/device",
        "/step",
        "/tick",
        "/tool",
    ];
    assert_eq!(topics.iter().collect::<Vec<_>>(), names);

    // Two devices that may be one are refused.
    for (devices, remedy) in [
        (["device = \"haply\""; 2], ", or have its grip; give each a `device_id` and a `grip` of its own"),
        (
            [
                "device = \"haply\", haply = { device_id = \"1\" }",
                "device = \"haply\", haply = { device_id = \"2\", grip = \"61548\" }",
            ],
            ", or have its grip; give each a `device_id` and a `grip` of its own",
        ),
        (["device = \"touch\", unit = \"Left Device\""; 2], "; give each a `unit` of its own"),
        (["device = \"space-mouse\", unit = \"/dev/hidraw9\""; 2], "; give each a `unit` of its own"),
        (["device = \"openxr\", unit = \"right\"", "device = \"openxr\""], "; give each a `unit` of its own"),
    ] {
        fs::write(at("twice.toml"), two_devices(devices)).unwrap();
        let (status, _, error) = palpate(&["run", &at("twice.toml")]);
        let words = format!("tool.aside.haptics.device`: may be the device of above{remedy}");
        assert!(status == 2 && error.contains(&words), "{status}: {error}");
    }

    // What a device was recorded with plays again, each for its own tool.
    let recording = format!("device = \"replay\", recording = {:?}", at("session.palpate"));
    fs::write(at("scene.toml"), two_devices([&recording, &recording])).unwrap();
    let (_, stderr) = run("again.palpate");
    assert!(stderr.contains("aside: coupling "), "{stderr}");
    let summary: Value = serde_json::from_str(&fs::read_to_string(at("out/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["further_haptics"]["aside"]["profile"], "premium", "{summary}");
}

#[test]
fn a_log_has_every_tick_and_the_contacts_of_every_step() {
    let folder = tempfile::tempdir().unwrap();
    let report = hold(folder.path(), "[haptics]\ndevice = \"scripted\"\n", "session.mcap");
    let bytes = fs::read(folder.path().join("session.mcap")).unwrap();
    let messages: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap()).collect();
    let of = |topic| messages.iter().filter(move |message| message.channel.topic == topic);
    assert_eq!(of("/tick").count() as u64, report["ticks"].as_u64().unwrap());
    assert_eq!(of("/tool").count(), of("/tick").count());
    let times = |topic| of(topic).map(|message| message.log_time).collect::<Vec<_>>();
    let steps = times("/step");
    // The log also has the steps before the first tick.
    assert!(steps.len() as u64 > report["steps"].as_u64().unwrap() && steps.is_sorted());
    assert_eq!(times("/contacts"), steps);
    // The tool comes down after 0.3 s: the first cloud has no point, the last one has several of 116 bytes.
    let sizes: Vec<usize> = of("/contacts").map(|message| message.data.len()).collect();
    let (first, last) = (sizes[0], sizes[sizes.len() - 1]);
    assert!(first < 350 && last > first + 2 * 116, "the first cloud has {first} bytes, the last {last}");
}

#[test]
fn a_scene_lowers_limits_and_is_told_where_it_would_raise_them() {
    let folder = tempfile::tempdir().unwrap();
    let haptics = |more: &str| format!("[haptics]\ndevice = \"hand\"\nprofile = \"touch\"\n{more}");
    let low = hold(folder.path(), &haptics("max_force = 0.03\n"), "session.palpate");
    let peak = low["peak_force_n"].as_f64().unwrap();
    assert!(peak > 0.0 && peak <= 0.03, "summary: {low}");
    let high =
        hold(folder.path(), &haptics("max_force = 300.0\nmax_torque = 5.0\nworkspace = 9.0\n"), "session.palpate");
    assert!(high["peak_force_n"].as_f64().unwrap() <= 3.3, "summary: {high}");
    let notes = high["notes"].to_string();
    for key in ["haptics.max_force", "haptics.max_torque", "haptics.workspace"] {
        assert!(notes.contains(&format!("{key} exceeds the limit of profile touch")), "notes in summary.json: {notes}");
    }
}

#[test]
fn a_profile_of_the_command_line_takes_the_place_of_the_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path(), "[haptics]\ndevice = \"hand\"\nprofile = \"sigma.7\"\n");
    let (file, out) = (file.to_str().unwrap(), folder.path().join("out"));
    // The first run uses the device that the scene names, the second the device that the command line names.
    for more in [&[][..], &["--haptics", "scripted"]] {
        let arguments = ["run", file, "--seconds", "0.3", "--profile", "touch", "--out", out.to_str().unwrap()];
        let (status, _, stderr) = palpate(&[&arguments, more].concat());
        assert_eq!(status, 0, "standard error: {stderr}");
        let summary: Value = serde_json::from_str(&fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
        assert_eq!(summary["haptics"]["profile"], "touch");
    }
}

/// Starts a simulated Inverse service (through which programs reach Haply's haptic devices) with one device of the type
/// `kind`, which rests; the service answers every message. Returns the service's address and the greatest force that
/// was sent to the device so far, N.
fn inverse_service(kind: &'static str) -> (String, Arc<Mutex<f64>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", listener.local_addr().unwrap());
    let most = Arc::new(Mutex::new(0.0_f64));
    let told = most.clone();
    let zero = json!({"x": 0.0, "y": 0.0, "z": 0.0});
    let state = json!({"cursor_position": zero, "cursor_velocity": zero});
    let inventory = json!({"inverse3": [{"device_id": "A", "config": {"type": kind}, "state": state}]}).to_string();
    let frame = json!({"inverse3": [{"device_id": "A", "state": state}]}).to_string();
    let serve = move |mut stream: TcpStream| -> Option<()> {
        let mut start = [0; 12];
        stream.peek(&mut start).ok()?;
        if start == *b"GET /version" {
            return stream.write_all(b"HTTP/1.1 404 Not Found\r\n\r\n").ok();
        }
        let mut socket = tungstenite::accept(stream).ok()?;
        socket.send(Message::text(inventory.as_str())).ok()?;
        loop {
            let Message::Text(text) = socket.read().ok()? else { continue };
            let message: Value = serde_json::from_str(&text).ok()?;
            let force = &message["inverse3"][0]["commands"]["set_cursor_force"]["vector"];
            let length = ["x", "y", "z"].iter().map(|axis| force[axis].as_f64().unwrap().powi(2)).sum::<f64>().sqrt();
            let mut most = told.lock().unwrap();
            *most = most.max(length);
            socket.send(Message::text(frame.as_str())).ok()?;
        }
    };
    let serve = Arc::new(serve);
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let serve = serve.clone();
            std::thread::spawn(move || serve(stream));
        }
    });
    (url, most)
}

#[test]
fn a_haply_is_held_with_the_profile_of_the_type_that_its_service_reports() {
    let cases = [
        ("inverse3", "inverse3", None),
        ("minverse", "minverse", None),
        ("minverse", "minverse", Some("inverse3")),
        ("inverse3", "minverse", Some("minverse")),
        ("maxverse", "minverse", None),
    ];
    for (kind, profile, asked) in cases {
        let folder = tempfile::tempdir().unwrap();
        let (url, most) = inverse_service(kind);
        // The ball begins partly inside the block, which pushes the ball away from the resting device; so a force is
        // sent to the device.
        let inside = SCENE.replace("position = [0.0, 0.053, 0.0]", "position = [0.0, 0.04, 0.0]");
        let file = folder.path().join("scene.toml");
        fs::write(&file, format!("{inside}[haptics]\ndevice = \"haply\"\nhaply = {{ address = \"{url}\" }}\n"))
            .unwrap();
        let (out, record) = (folder.path().join("out"), folder.path().join("session.palpate"));
        let [file, out_name, record] = [&file, &out, &record].map(|path| path.to_str().unwrap());
        let arguments = ["run", file, "--seconds", "0.5", "--out", out_name, "--record", record];
        let (status, _, stderr) =
            palpate(&[&arguments[..], &asked.map_or(vec![], |name| vec!["--profile", name])].concat());
        assert_eq!(status, 0, "device type {kind}: standard error: {stderr}");
        let summary: Value = serde_json::from_str(&fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
        let report = &summary["haptics"];
        assert_eq!(report["profile"], profile, "device type {kind}, requested profile {asked:?}");
        let played = *most.lock().unwrap();
        let limit = if profile == "minverse" { 2.0 } else { 10.0 };
        assert!(
            played > 0.02 && played <= limit + 1e-9,
            "device type {kind}: greatest force sent {played} N, report {report}"
        );
        let (status, text, _) = palpate(&["replay", record]);
        assert_eq!((status, text.contains("the same bits")), (0, true), "the program printed: {text}");
    }
}

#[cfg(unix)]
#[test]
fn a_signal_ends_a_session_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, record) = (scene(folder.path(), ""), folder.path().join("session.palpate"));
    let [scene, file] = [&scene, &record].map(|path| path.to_str().unwrap());
    let mut child = program();
    child.args(["run", scene, "--haptics", "scripted", "--seconds", "600", "--record", file]);
    let child = child.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    while fs::metadata(&record).map_or(0, |data| data.len()) < 200_000 {
        assert!(begun.elapsed() < Duration::from_secs(120), "the recording stays shorter than 200,000 bytes");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "output {text}, errors {}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("ended early: it was stopped"), "the program printed: {text}");
    let (status, text, notes) = palpate(&["replay", file]);
    assert!(status == 0 && text.contains("the same bits") && notes.is_empty(), "output {text}, errors {notes}");
}

#[test]
fn what_cannot_be_held_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path(), "");
    let file = file.to_str().unwrap();
    let missing = folder.path().join("no/such/session.palpate");
    let refused = |arguments: &[&str], words: &str| {
        let (status, _, stderr) = palpate(&[&["run", file], arguments].concat());
        assert!(
            status == 2 && stderr.contains(words) && !stderr.contains("panicked"),
            "palpate run {arguments:?}: wrong error: {stderr}"
        );
    };
    refused(&["--haptics", "phantom"], "possible values: scripted, hand, replay, haply, touch, force-dimension");
    refused(&["--haptics", "hand", "--steps", "10"], "give --seconds instead of --steps");
    refused(&["--haptics", "hand", "--profile", "omni"], "possible values: scripted, premium, touch, omega.x, delta.6");
    refused(&["--profile", "touch"], "none holds the tool: give --haptics DEVICE as well");
    refused(
        &["--haptics", "haply", "--profile", "touch"],
        "--profile touch is not that of a Haply: remove it, or give",
    );
    refused(&["--haptics", "replay", "--profile", "touch"], "the profile of its recording: leave it out");
    refused(&["--haptics", "replay"], "`haptics.recording`");
    refused(&["--haptics", "scripted", "--seconds", "1", "--record", missing.to_str().unwrap()], "session.palpate");
    let there = folder.path().join("there.palpate");
    fs::write(&there, "an older session").unwrap();
    refused(&["--haptics", "scripted", "--seconds", "1", "--record", there.to_str().unwrap()], "is there already");
    assert_eq!(fs::read_to_string(&there).unwrap(), "an older session");
    let (status, _, stderr) = {
        let bare = folder.path().join("bare.toml");
        fs::write(&bare, &SCENE[..SCENE.find("[tool]").unwrap()]).unwrap();
        palpate(&["run", bare.to_str().unwrap(), "--haptics", "hand"])
    };
    assert!(status == 2 && stderr.contains("`tool`") && stderr.contains("add a [tool]"), "standard error: {stderr}");
    let (status, _, stderr) = {
        let haply =
            scene(folder.path(), "[haptics]\ndevice = \"haply\"\nhaply = { address = \"ws://192.0.2.1:10001\" }\n");
        palpate(&["run", haply.to_str().unwrap(), "--seconds", "1"])
    };
    assert!(status != 0 && stderr.contains("192.0.2.1") && !stderr.contains("panicked"), "standard error: {stderr}");
}

#[test]
fn a_resolution_is_measured_and_printed_as_lines_of_a_scene() {
    let (status, text, stderr) = palpate(&["devices", "--calibrate", "hand"]);
    assert_eq!(status, 0, "standard error: {stderr}");
    let printed: toml::Table = text.parse().unwrap();
    // The simulated hand has the resolution of the profile `premium`.
    assert_eq!(printed["haptics"]["resolution"].as_float(), Some(3e-5), "{text}");
    let nobody = ["devices", "--calibrate", "haply", "--address", "ws://localhost:1"];
    let senseless = ["devices", "--calibrate", "hand", "--address", "ws://localhost:1"];
    let unit = ["devices", "--test", "hand", "--unit", "1"];
    let lone = ["devices", "--unit", "1"];
    let cases: [(&[&str], i32, &str); 4] = [
        (&nobody, 3, "start the Inverse service"),
        (&senseless, 2, "leave it out"),
        (&unit, 2, "--unit belongs to touch and force-dimension"),
        (&lone, 2, "give --calibrate or --test as well"),
    ];
    for (arguments, status, said) in cases {
        let (ended, _, stderr) = palpate(arguments);
        assert!(ended == status && stderr.contains(said) && stderr.lines().count() == 1, "status {ended}: {stderr}");
    }
}

/// Without a maker's library, one line says what to install; with a stand-in for it, where the loader finds it, a session
/// is held.
#[test]
fn a_device_is_driven_through_the_library_of_its_maker() {
    let folder = tempfile::tempdir().unwrap();
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("../devices/src/vendor/stand_in");
    for (device, source, library, install, profile) in [
        ("touch", "hd.rs", "libHD.so", "install OpenHaptics", "touch"),
        ("force-dimension", "dhd.rs", "libdrd.so.3", "install Force Dimension's SDK", "sigma.7"),
    ] {
        let file = scene(folder.path(), &format!("[haptics]\ndevice = \"{device}\"\n"));
        let run = |path: &Path| {
            let mut run = program();
            run.args(["run", "--seconds", "0.5", "--out"]).args([&folder.path().join(device), &file]);
            run.env("LD_LIBRARY_PATH", path).env("STAND_IN", "1").output().unwrap()
        };
        let absent = run(Path::new("/nowhere"));
        let said = String::from_utf8(absent.stderr).unwrap();
        assert_eq!(absent.status.code(), Some(3), "{said}");
        assert!(said.lines().count() == 1 && said.contains(install), "{said}");
        let compiled = Command::new(std::env::var("RUSTC").unwrap_or("rustc".into()))
            .args(["--edition", "2024", "--crate-type", "cdylib", "--crate-name", "stand_in"])
            .args([sources.join(source), "-o".into(), folder.path().join(library)])
            .output()
            .unwrap();
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
        let held = run(folder.path());
        let said = String::from_utf8(held.stderr).unwrap();
        assert!(held.status.success() && said.contains("never met a real one"), "{said}");
        let summary = fs::read_to_string(folder.path().join(device).join("summary.json")).unwrap();
        let report: Value = serde_json::from_str(&summary).unwrap();
        let report = &report["haptics"];
        assert!(report["ticks"].as_u64().unwrap() > 100 && report["profile"] == profile, "summary: {report}");
        // A stall of the machine may cost the device for some ticks.
        let lost = &report["events"]["device_lost"]["ticks"];
        assert!(lost.as_u64().unwrap_or(0) < 100, "summary: {report}");
    }
    let list = |path: &Path| {
        let list = program().args(["devices", "--haptic"]).env("LD_LIBRARY_PATH", path).env("STAND_IN", "1").output();
        let list = list.unwrap();
        (list.status.code(), String::from_utf8(list.stdout).unwrap())
    };
    let (status, found) = list(folder.path());
    let lines: Vec<&str> = found.lines().collect();
    assert!(status == Some(0) && lines.len() == 6, "status {status:?}: {found}");
    let without_force = ["space-mouse ", "game-pad ", "openxr "];
    assert!(without_force.iter().zip(&lines[3..]).all(|(name, line)| line.starts_with(name)), "{found}");
    assert!(lines[1].starts_with("touch            profile touch") && lines[2].contains("profile sigma.7"), "{found}");
    let (status, found) = list(Path::new("/nowhere"));
    assert!(status == Some(3) && found.contains("install OpenHaptics"), "status {status:?}: {found}");
}

/// A scene of another device is held by one without force: its profile is said to be left out, and a unit that is not
/// there is named.
#[test]
fn a_device_without_force_that_is_absent_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let keys = "[haptics]\ndevice = \"force-dimension\"\nunit = \"12345\"\nprofile = \"sigma.7\"\n";
    let file = scene(folder.path(), keys);
    for (device, words) in [
        ("space-mouse", "controller called 12345 is plugged in"),
        ("game-pad", "no game pad called 12345"),
        ("openxr", "12345 is no hand; give left or right"),
    ] {
        let (status, _, said) = palpate(&["run", "--haptics", device, file.to_str().unwrap()]);
        let left_out = format!("profile sigma.7 does not apply to {device}, which plays no force");
        assert!(status == 3 && said.contains(&left_out), "status {status}: {said}");
        assert!(said.contains(words) || said.contains("on Linux alone"), "{said}");
    }
}

/// The check of a device, rehearsed with the simulated hand.
#[test]
#[ignore = "takes 15 s"]
fn a_device_is_checked_with_little_force() {
    let (status, text, stderr) = palpate(&["devices", "--test", "hand"]);
    assert!(status == 0 && text.lines().count() == 8 && text.lines().all(|line| line.starts_with("well")), "{text}");
    assert!(stderr.contains("hold the handle loosely"), "{stderr}");
}
