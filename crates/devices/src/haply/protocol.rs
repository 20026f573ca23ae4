//! The messages between this program and Haply's Inverse service, a program on the same machine that reads Haply's
//! haptic devices and takes forces for them: JSON text in SI units, z up, quaternions in the order w x y z
//! (docs.haply.co, Inverse service 3.5, "Simulation channel" and "Control commands"). A *frame* is a text with the
//! state of all devices; a *grip* is a handle that senses orientation; the *cursor* is the point of the device that the
//! user moves. Nothing from the service is trusted: all that is needed must be there, of the right type, finite and
//! plausible.

use glam::{DQuat, DVec3};
use palpate::internal::haptics::Fault;
use palpate::scene::{Dialect, HaplyService};
use serde::Deserialize;
use serde_json::{Value, json};

use super::kind::{Identity, Kind};

/// Greatest plausible distance of a cursor from the device's origin, m: about seven times the radius of an Inverse3's
/// workspace.
const FARTHEST: f64 = 1.0;
/// Greatest plausible speed of a cursor, m/s.
const FASTEST: f64 = 50.0;
/// Greatest plausible difference of a quaternion's norm from 1; real grips send rounded quaternions, whose norms are
/// off by 0.2 %.
const NORM_ERROR: f64 = 0.01;

/// The dialect (JSON key under which a force is sent) that a service of the given version, such as `3.5.0`, expects;
/// `None` if the text is no version.
pub fn dialect_of(version: &str) -> Option<Dialect> {
    let mut numbers = version.split('.').map(|part| part.parse::<u32>().ok());
    let (major, minor) = (numbers.next()??, numbers.next()??);
    Some(if (major, minor) >= (3, 5) { Dialect::Vector } else { Dialect::Values })
}

fn key_of(dialect: Dialect) -> &'static str {
    match dialect {
        Dialect::Vector => "vector",
        Dialect::Values => "values",
    }
}

/// State of one device in a frame, in palpate's axes (y up).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Position of the cursor from the device's origin, m.
    pub position: DVec3,
    /// Velocity of the cursor, m/s.
    pub velocity: DVec3,
    /// Orientation of the grip that counts; `None` if it is not awake.
    pub orientation: Option<DQuat>,
    /// Pressed buttons of the grip whose orientation is given, one bit each.
    pub buttons: u32,
}

/// Converts a vector from the service's axes (z up) to palpate's (y up): a quarter turn about x.
fn from_service(v: DVec3) -> DVec3 {
    DVec3::new(v.x, v.z, -v.y)
}

/// Converts a vector from palpate's axes (y up) to the service's (z up).
fn to_service(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.z, v.y)
}

/// The message that is sent each period: it commands a finite force, given in palpate's axes, N.
pub fn command(device_id: &str, dialect: Dialect, force: DVec3) -> String {
    tick(device_id, dialect, force).to_string()
}

/// The first message of a connection: it names this program to the service and commands zero force.
pub fn greeting(device_id: &str, dialect: Dialect) -> String {
    let mut message = tick(device_id, dialect, DVec3::ZERO);
    message["session"] = json!({"configure": {"profile": {"name": "palpate:hand"}}});
    message.to_string()
}

fn tick(device_id: &str, dialect: Dialect, force: DVec3) -> Value {
    let f = to_service(force);
    let force = json!({key_of(dialect): {"x": f.x, "y": f.y, "z": f.z}});
    json!({"inverse3": [{"device_id": device_id, "commands": {"set_cursor_force": force}}]})
}

/// Identity and state, in a frame, of the device whose id is `wanted`, or of the first device listed if `wanted` is
/// `None`. `grip`: id of the grip whose orientation and buttons count, [`HaplyService::NO_GRIP`], or `None` for the first
/// one that is awake. The type of the device is known only from the *inventory*, the first frame of a connection: later frames
/// have no `config`.
///
/// # Errors
/// [`Fault::Lost`] if the service does not list the device, [`Fault::Garbled`] if the text is not a plausible frame.
pub fn find(text: &str, wanted: Option<&str>, grip: Option<&str>) -> Result<(Identity, State), Fault> {
    let frame = Frame::of(text)?;
    let is_wanted = |arm: &&Arm| wanted.is_none_or(|id| arm.device_id == id);
    let listed = frame.inverse3.as_deref().unwrap_or_default();
    let Some(arm) = listed.iter().find(is_wanted) else {
        let name = wanted.map_or(String::from("no inverse3"), |id| format!("no inverse3 {id:?}"));
        return Err(Fault::Lost(format!(
            "the service lists {name} among {} devices: plug the device in",
            listed.len()
        )));
    };
    let state = arm.state.as_ref().ok_or_else(|| garbled("an inverse3 without its state".into()))?;
    let counts = |other: &Grip| match grip {
        Some(HaplyService::NO_GRIP) => false,
        Some(id) => other.is_awake() && other.id().as_deref() == Some(id),
        None => other.is_awake(),
    };
    let state_of = |grip: Grip| grip.state.filter(|state| state.orientation.is_some());
    let grip = frame.grips().filter(counts).find_map(state_of);
    let orientation = grip.as_ref().and_then(|grip| grip.orientation.as_ref()).map(Quaternion::checked).transpose()?;
    let state = State {
        position: from_service(state.cursor_position.checked("cursor_position", FARTHEST)?),
        velocity: from_service(state.cursor_velocity.checked("cursor_velocity", FASTEST)?),
        orientation,
        buttons: grip.map_or(0, |grip| grip.pressed()),
    };
    Ok((Identity { device_id: arm.device_id.clone(), kind: Kind::of_config(arm.config.as_ref()) }, state))
}

/// Checks that a frame lists a grip.
///
/// # Errors
/// [`Fault::Lost`] if it does not, [`Fault::Garbled`] if the text is not a plausible frame.
pub fn find_grip(text: &str, id: &str) -> Result<(), Fault> {
    let listed: Vec<String> = Frame::of(text)?.grips().filter_map(|grip| grip.id()).collect();
    if listed.iter().any(|other| other == id) {
        return Ok(());
    }
    let which = if listed.is_empty() { "it lists none".into() } else { format!("it lists {}", listed.join(", ")) };
    Err(Fault::Lost(format!("the service lists no grip {id:?} ({which}): switch it on, or correct `grip`")))
}

fn garbled(what: String) -> Fault {
    Fault::Garbled(what)
}

#[derive(Deserialize)]
struct Frame {
    inverse3: Option<Vec<Arm>>,
    verse_grip: Option<Vec<Grip>>,
    wireless_verse_grip: Option<Vec<Grip>>,
    custom_verse_grip: Option<Vec<Value>>,
}

impl Frame {
    fn of(text: &str) -> Result<Frame, Fault> {
        serde_json::from_str(text).map_err(|e| garbled(format!("not a message with device states: {e}")))
    }

    /// The grips that are listed, wired ones first.
    fn grips(&self) -> impl Iterator<Item = Grip> + '_ {
        // What a custom grip sends is its maker's choice; one that sends no orientation as the others do is passed over.
        let custom = self.custom_verse_grip.iter().flatten().filter_map(|grip| Grip::deserialize(grip).ok());
        let own = [&self.verse_grip, &self.wireless_verse_grip];
        own.into_iter().flatten().flatten().cloned().chain(custom)
    }
}

#[derive(Deserialize)]
struct Arm {
    device_id: String,
    config: Option<Value>,
    state: Option<ArmState>,
}

#[derive(Deserialize)]
struct ArmState {
    cursor_position: Vector,
    cursor_velocity: Vector,
}

#[derive(Clone, Deserialize)]
struct Grip {
    device_id: Option<Value>,
    state: Option<GripState>,
    status: Option<GripStatus>,
}

impl Grip {
    /// The id, a text or a number; `None` if the service gives none.
    fn id(&self) -> Option<String> {
        match self.device_id.as_ref()? {
            Value::String(id) => Some(id.clone()),
            Value::Number(id) => Some(id.to_string()),
            _ => None,
        }
    }

    /// Whether the grip's state is current: a wireless grip that sleeps or is out of reach is listed with its last
    /// state.
    fn is_awake(&self) -> bool {
        self.status.as_ref().is_none_or(|s| s.connected.unwrap_or(true) && s.awake.unwrap_or(true))
    }
}

#[derive(Clone, Deserialize)]
struct GripStatus {
    connected: Option<bool>,
    awake: Option<bool>,
}

#[derive(Clone, Deserialize)]
struct GripState {
    orientation: Option<Quaternion>,
    /// The only button of a wired grip.
    button: Option<bool>,
    buttons: Option<Buttons>,
}

impl GripState {
    fn pressed(&self) -> u32 {
        let b = self.buttons.as_ref();
        let first = self.button.unwrap_or(false) || b.is_some_and(|b| b.a);
        [first, b.is_some_and(|b| b.b), b.is_some_and(|b| b.c)]
            .iter()
            .rev()
            .fold(0, |bits, &on| bits << 1 | u32::from(on))
    }
}

#[derive(Clone, Deserialize)]
struct Buttons {
    #[serde(default)]
    a: bool,
    #[serde(default)]
    b: bool,
    #[serde(default)]
    c: bool,
}

#[derive(Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

impl Vector {
    fn checked(&self, name: &str, longest: f64) -> Result<DVec3, Fault> {
        let v = DVec3::new(self.x, self.y, self.z);
        // `<=` is used, and not a negated `>`, so that NaN is refused too.
        if v.length() <= longest { Ok(v) } else { Err(garbled(format!("an implausible {name} of {v}"))) }
    }
}

#[derive(Clone, Deserialize)]
struct Quaternion {
    w: f64,
    x: f64,
    y: f64,
    z: f64,
}

impl Quaternion {
    /// The rotation in palpate's axes, normalised; an error if the quaternion's norm is implausible.
    fn checked(&self) -> Result<DQuat, Fault> {
        let v = from_service(DVec3::new(self.x, self.y, self.z));
        let q = DQuat::from_xyzw(v.x, v.y, v.z, self.w);
        let plausible = (q.length() - 1.0).abs() <= NORM_ERROR;
        if plausible { Ok(q.normalize()) } else { Err(garbled(format!("a quaternion of norm {}", q.length()))) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fake::{frame, grips};
    use super::*;

    fn state(text: &str) -> Result<State, Fault> {
        find(text, None, None).map(|(_, state)| state)
    }

    #[test]
    fn axes_turn_by_a_quarter_about_x() {
        let read = state(&frame("A", [0.1, 0.2, 0.3], [1.0, 2.0, 3.0])).unwrap();
        assert_eq!(read.position, DVec3::new(0.1, 0.3, -0.2));
        assert_eq!(read.velocity, DVec3::new(1.0, 3.0, -2.0));
        assert_eq!((read.orientation, read.buttons), (None, 0));
        let sent: Value = serde_json::from_str(&command("A", Dialect::Vector, DVec3::new(1.0, 2.0, 3.0))).unwrap();
        let force = json!({"vector": {"x": 1.0, "y": -3.0, "z": 2.0}});
        assert_eq!(sent, json!({"inverse3": [{"device_id": "A", "commands": {"set_cursor_force": force}}]}));
    }

    #[test]
    fn a_turn_about_the_services_up_is_a_turn_about_palpates_up() {
        let half = 0.3_f64;
        let wired =
            json!([{"state": {"orientation": {"w": half.cos(), "x": 0, "y": 0, "z": half.sin()}, "button": true}}]);
        let read = state(&grips("A", wired, json!([]))).unwrap();
        assert!(read.orientation.unwrap().dot(DQuat::from_rotation_y(2.0 * half)).abs() > 1.0 - 1e-12);
        assert_eq!(read.buttons, 1);
        // In palpate's axes the orientation that was read turns any vector as the orientation that was sent turns it in
        // the service's axes.
        let sent = DQuat::from_xyzw(0.48, -0.36, 0.64, 0.48);
        let q = json!({"w": sent.w, "x": sent.x, "y": sent.y, "z": sent.z});
        let wireless = json!([{"state": {"orientation": q, "buttons": {"a": false, "b": true, "c": true}}}]);
        let read = state(&grips("A", json!([]), wireless)).unwrap();
        let v = DVec3::new(0.3, -0.5, 0.7);
        let expected = from_service(sent * v);
        assert!((read.orientation.unwrap() * from_service(v) - expected).length() < 1e-12);
        assert_eq!(read.buttons, 0b110);
    }

    #[test]
    fn a_custom_grip_counts_if_it_is_like_the_others() {
        let of = |custom: Value| {
            let mut frame: Value = serde_json::from_str(&grips("A", json!([]), json!([]))).unwrap();
            frame["custom_verse_grip"] = custom;
            state(&frame.to_string()).unwrap()
        };
        let turned = json!({"w": 0, "x": 0, "y": 0, "z": 1});
        let read = of(json!([{"state": {"raw": [1, 2]}}, {"state": {"orientation": turned, "buttons": {"b": true}}}]));
        assert!(read.orientation.unwrap().dot(DQuat::from_rotation_y(std::f64::consts::PI)).abs() > 1.0 - 1e-12);
        assert_eq!(read.buttons, 0b10);
        for other in [json!([]), json!([7]), json!([{"state": {"orientation": turned, "buttons": 3}}])] {
            assert_eq!(of(other).orientation, None);
        }
    }

    #[test]
    fn the_grip_that_is_named_counts() {
        let turned = |z: f64, is_awake: bool, pressed: bool| {
            let orientation = json!({"w": (1.0 - z * z).sqrt(), "x": 0.0, "y": 0.0, "z": z});
            let state = json!({"orientation": orientation, "button": pressed});
            json!({"state": state, "status": {"awake": is_awake}})
        };
        let named = |id: &str, mut grip: Value| {
            grip["device_id"] = json!(id);
            grip
        };
        let wired = json!([named("left", turned(0.1, true, false)), named("right", turned(0.2, true, true))]);
        let mut numbered = turned(0.4, true, true);
        numbered["device_id"] = json!(61548);
        let text = grips("A", wired, json!([named("asleep", turned(0.3, false, false)), numbered]));
        // The service's z is palpate's y.
        let felt = |grip: Option<&str>| {
            let (_, state) = find(&text, None, grip).unwrap();
            (state.orientation.map(|q| (1e6 * q.y).round() / 1e6), state.buttons)
        };
        assert_eq!(felt(None), (Some(0.1), 0));
        assert_eq!(felt(Some("left")), (Some(0.1), 0));
        assert_eq!(felt(Some("right")), (Some(0.2), 1));
        assert_eq!(felt(Some("61548")), (Some(0.4), 1));
        assert_eq!(felt(Some("asleep")), (None, 0));
        assert_eq!(felt(Some("none")), (None, 0));
        assert!(find_grip(&text, "asleep").is_ok());
        let missing = find_grip(&text, "other").unwrap_err().to_string();
        assert!(missing.contains("no grip \"other\" (it lists left, right, asleep, 61548)"), "{missing}");
        let missing = find_grip(&grips("A", json!([]), json!([])), "other").unwrap_err().to_string();
        assert!(missing.contains("(it lists none)"), "{missing}");
    }

    #[test]
    fn a_sleeping_grip_is_passed_over() {
        let zero = json!({"w": 0, "x": 0, "y": 0, "z": 0});
        let asleep = json!([{"state": {"orientation": zero}, "status": {"awake": false}}]);
        assert_eq!(state(&grips("A", json!([]), asleep)).unwrap().orientation, None);
        let awake = json!([{"state": {"orientation": zero}, "status": {"awake": true}}]);
        assert!(matches!(state(&grips("A", json!([]), awake)), Err(Fault::Garbled(_))));
    }

    #[test]
    fn the_first_device_or_the_wanted_one() {
        let text = r#"{"inverse3":[
            {"device_id":"A","state":{"cursor_position":{"x":0.1,"y":0,"z":0},"cursor_velocity":{"x":0,"y":0,"z":0}}},
            {"device_id":"B","state":{"cursor_position":{"x":0.2,"y":0,"z":0},"cursor_velocity":{"x":0,"y":0,"z":0}}}]}"#;
        assert_eq!(find(text, None, None).unwrap().0.device_id, "A");
        let (identity, state) = find(text, Some("B"), None).unwrap();
        assert_eq!((identity.device_id.as_str(), state.position.x), ("B", 0.2));
        assert_eq!(identity.kind, Kind::default());
        let (identity, _) = find(&frame("A", [0.0; 3], [0.0; 3]), None, None).unwrap();
        assert_eq!(identity.kind.profile(None).name, "inverse3");
        assert!(matches!(find(text, Some("C"), None), Err(Fault::Lost(why)) if why.contains("\"C\"")));
        assert!(matches!(find(r#"{"session_id":1,"inverse3":[]}"#, None, None), Err(Fault::Lost(_))));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let good = frame("A", [0.1, 0.2, 0.3], [0.0; 3]);
        assert!(state(&good).is_ok());
        let spoiled =
            ["\"NaN\"", "NaN", "1e999", "1e30", "1.5", "null", "[0.1]", "true"].map(|x| good.replace("0.1", x));
        let deep = "[".repeat(30_000);
        let others = [
            String::from("hello"),
            String::new(),
            String::from("[]"),
            String::from(r#"{"inverse3":{}}"#),
            String::from(r#"{"inverse3":[{"device_id":"A"}]}"#),
            String::from(r#"{"inverse3":[{"device_id":7,"state":{}}]}"#),
            String::from(r#"{"inverse3":[{"device_id":"A","state":{"cursor_position":{"x":0,"y":0,"z":0}}}]}"#),
            frame("A", [0.0; 3], [0.0, 51.0, 0.0]),
            deep.clone(),
            format!(r#"{{"inverse3":{deep}"#),
            format!(r#"{{"other":{deep}"#),
            format!(r#"{{"inverse3":[{{"device_id":"A","config":{deep}"#),
        ];
        for text in spoiled.iter().chain(&others) {
            assert!(
                matches!(state(text), Err(Fault::Garbled(_))),
                "this text must be refused as garbled: {}",
                &text[..text.len().min(200)]
            );
        }
    }

    #[test]
    fn versions_have_their_dialect() {
        let cases = [("3.5.0", Dialect::Vector), ("3.4.1.0", Dialect::Values), ("4.0.0", Dialect::Vector)];
        for (version, dialect) in cases {
            assert_eq!(dialect_of(version), Some(dialect), "version {version}");
        }
        assert_eq!(dialect_of("latest"), None);
        assert!(command("A", Dialect::Values, DVec3::ZERO).contains("values"));
    }
}
