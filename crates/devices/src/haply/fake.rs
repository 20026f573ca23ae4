//! A fake Inverse service for the tests; the real one is the program of Haply's that passes forces to its haptic
//! devices. A *frame* is a JSON text with the state of all devices and of their *grips* (handles that sense
//! orientation). On each connection the fake service sends an inventory (the first frame, which lists the devices),
//! then reacts to each message as a script says.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::Ordering::SeqCst;
use std::sync::atomic::{AtomicBool, AtomicUsize};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use glam::DVec3;
use serde_json::{Value, json};
use tungstenite::{Error, Message};

/// How the service reacts to a message.
pub enum Act {
    /// Answers with this text.
    Reply(String),
    /// Answers after a delay, during which it reads no other message.
    Late(Duration, String),
    /// Answers with a binary message.
    Binary,
    /// Answers several times with the same text: the number of times, and the text.
    Flood(usize, String),
    /// Does not answer.
    Silence,
    /// Ends the connection.
    HangUp,
}

/// A message that the service received.
#[derive(Debug, Clone)]
pub struct Heard {
    pub at: Instant,
    pub connection: usize,
    pub message: Value,
}

impl Heard {
    /// The message's force, N, in the service's axes, under a key of `set_cursor_force`: "vector" or "values".
    pub fn force(&self, key: &str) -> Option<DVec3> {
        let vector = &self.message["inverse3"][0]["commands"]["set_cursor_force"][key];
        Some(DVec3::new(vector["x"].as_f64()?, vector["y"].as_f64()?, vector["z"].as_f64()?))
    }
}

/// Chooses the reaction to a message by the number of its connection and by the number of the message within the
/// connection, both from 0.
pub type Script = dyn Fn(usize, usize) -> Act + Send + Sync;

/// Gives the inventory of a connection by the connection's number, from 0.
pub type Inventory = dyn Fn(usize) -> String + Send + Sync;

/// What all threads of a fake service share.
struct Shared {
    version: Option<&'static str>,
    inventory: Box<Inventory>,
    script: Box<Script>,
    heard: Mutex<Vec<Heard>>,
    sent: AtomicUsize,
    connections: AtomicUsize,
    stop: AtomicBool,
}

/// A running fake service on a port of its own; the service ends when it is dropped.
pub struct Fake {
    shared: Arc<Shared>,
    url: String,
    thread: Option<JoinHandle<()>>,
}

/// A frame of one device, without grips.
pub fn frame(id: &str, position: [f64; 3], velocity: [f64; 3]) -> String {
    json!({"session_id": 7, "inverse3": [arm(id, position, velocity)], "verse_grip": []}).to_string()
}

/// A frame of one device at rest with these wired and wireless grips.
pub fn grips(id: &str, wired: Value, wireless: Value) -> String {
    let arms = [arm(id, [0.0; 3], [0.0; 3])];
    json!({"inverse3": arms, "verse_grip": wired, "wireless_verse_grip": wireless}).to_string()
}

/// The entry of one Inverse3 (a haptic device of Haply) in a frame.
pub fn arm(id: &str, position: [f64; 3], velocity: [f64; 3]) -> Value {
    arm_of(json!({"type": "inverse3"}), id, position, velocity)
}

/// An inventory of one device "A" at rest, with the device type `kind`.
pub fn inventory(kind: Value) -> String {
    json!({ "inverse3": [arm_of(json!({ "type": kind }), "A", [0.0, -0.12, 0.15], [0.0; 3])] }).to_string()
}

/// The entry of one device with this `config` in a frame.
fn arm_of(config: Value, id: &str, position: [f64; 3], velocity: [f64; 3]) -> Value {
    let vector = |[x, y, z]: [f64; 3]| json!({"x": x, "y": y, "z": z});
    let state =
        json!({"cursor_position": vector(position), "cursor_velocity": vector(velocity), "control_mode": "idle"});
    json!({"device_id": id, "config": config, "state": state, "status": {"ready": true}})
}

impl Fake {
    /// Starts a service of version 3.5.0 with a device "A" at (0, -0.12, 0.15) m.
    pub fn start(script: impl Fn(usize, usize) -> Act + Send + Sync + 'static) -> Fake {
        Fake::with(Some("3.5.0"), resting(), script)
    }

    /// Starts a service of this version, with this inventory on every connection.
    pub fn with(
        version: Option<&'static str>,
        inventory: String,
        script: impl Fn(usize, usize) -> Act + Send + Sync + 'static,
    ) -> Fake {
        Fake::listing(version, move |_| inventory.clone(), script)
    }

    /// Starts a service whose inventory depends on the connection.
    pub fn listing(
        version: Option<&'static str>,
        inventory: impl Fn(usize) -> String + Send + Sync + 'static,
        script: impl Fn(usize, usize) -> Act + Send + Sync + 'static,
    ) -> Fake {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let url = format!("ws://{}", listener.local_addr().unwrap());
        let shared = Arc::new(Shared {
            version,
            inventory: Box::new(inventory),
            script: Box::new(script),
            heard: Mutex::default(),
            sent: AtomicUsize::new(0),
            connections: AtomicUsize::new(0),
            stop: AtomicBool::new(false),
        });
        let ours = shared.clone();
        let thread = Some(thread::spawn(move || accept(&listener, &ours)));
        Fake { shared, url, thread }
    }

    pub fn url(&self) -> &str {
        &self.url
    }

    /// All messages received so far.
    pub fn heard(&self) -> Vec<Heard> {
        self.shared.heard.lock().unwrap().clone()
    }

    /// Number of frames sent so far, not counting inventories.
    pub fn sent(&self) -> usize {
        self.shared.sent.load(SeqCst)
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        self.shared.stop.store(true, SeqCst);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// A frame of the device "A" at rest.
pub fn resting() -> String {
    frame("A", [0.0, -0.12, 0.15], [0.0; 3])
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    let mut serving = Vec::new();
    while !shared.stop.load(SeqCst) {
        match listener.accept() {
            Ok((stream, _)) => {
                let ours = shared.clone();
                serving.push(thread::spawn(move || serve(stream, &ours)));
            }
            Err(_) => thread::sleep(Duration::from_millis(1)),
        }
    }
    serving.into_iter().for_each(|thread| drop(thread.join()));
}

fn serve(mut stream: TcpStream, shared: &Shared) -> Option<()> {
    stream.set_nonblocking(false).ok()?;
    stream.set_nodelay(true).ok()?;
    stream.set_read_timeout(Some(Duration::from_millis(500))).ok()?;
    let mut start = [0; 12];
    stream.peek(&mut start).ok()?;
    if start == *b"GET /version" {
        let _ = stream.read(&mut [0; 1024]);
        let body = shared.version.map(|version| json!({"project_version": version}).to_string());
        let status = if body.is_some() { "200 OK" } else { "404 Not Found" };
        return write!(stream, "HTTP/1.1 {status}\r\nContent-Type: x\r\n\r\n{}", body.unwrap_or_default()).ok();
    }
    let mut socket = tungstenite::accept(stream).ok()?;
    socket.get_mut().set_read_timeout(Some(Duration::from_millis(10))).ok()?;
    let connection = shared.connections.fetch_add(1, SeqCst);
    socket.send(Message::text((shared.inventory)(connection))).ok()?;
    let mut number = 0;
    while !shared.stop.load(SeqCst) {
        let text = match socket.read() {
            Ok(Message::Text(text)) => text,
            Ok(_) => continue,
            Err(Error::Io(e)) if e.kind() == ErrorKind::WouldBlock || e.kind() == ErrorKind::TimedOut => continue,
            Err(_) => return None,
        };
        let message = serde_json::from_str(&text).unwrap_or(Value::Null);
        shared.heard.lock().unwrap().push(Heard { at: Instant::now(), connection, message });
        let answers = match (shared.script)(connection, number) {
            Act::Reply(text) => vec![Message::text(text)],
            Act::Late(delay, text) => {
                thread::sleep(delay);
                vec![Message::text(text)]
            }
            Act::Binary => vec![Message::binary(vec![1, 2, 3])],
            Act::Flood(count, text) => vec![Message::text(text); count],
            Act::Silence => Vec::new(),
            Act::HangUp => return None,
        };
        number += 1;
        for answer in answers {
            shared.sent.fetch_add(1, SeqCst);
            // If sending fails because the client has gone, reading goes on: messages sent before may still arrive.
            let _ = socket.send(answer);
        }
    }
    None
}
