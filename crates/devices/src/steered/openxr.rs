//! A controller of a virtual-reality system, by an OpenXR runtime without graphics (`XR_MND_headless`): the tool moves
//! as the hand does, and the controller vibrates as the force grows. The loader is opened when a controller is asked
//! for. A process has one session, which the controllers of both hands share.

use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use openxr as xr;
use openxr::SessionState as State;

use super::{Hardware, Loss, Steering, Vibration};

/// How long a controller is waited for at first.
const PATIENCE: Duration = Duration::from_secs(5);
/// The hands as `unit` names them, and as the runtime does.
const HANDS: [(&str, &str); 2] = [("left", xr::USER_HAND_LEFT), ("right", xr::USER_HAND_RIGHT)];
/// The simplest profile of a controller, to which runtimes map their own.
const CONTROLLER: &str = "/interaction_profiles/khr/simple_controller";

/// Position (m) and orientation.
pub(super) type Pose = (DVec3, DQuat);

/// How a controller carries the goal: by as much as it moved and turned since it was found.
#[derive(Default)]
pub(super) struct Carrier {
    /// Where the goal and the controller were when the controller was found.
    begin: Option<[Pose; 2]>,
    is_lost: bool,
}

impl Carrier {
    /// Takes over where the controller is. `why`: why that is not known.
    pub(super) fn take(&mut self, pose: Option<Pose>, why: impl FnOnce() -> String, steering: &Steering) {
        let Some(now) = pose else {
            self.begin = None;
            if !std::mem::replace(&mut self.is_lost, true) {
                steering.lose(why());
            }
            return;
        };
        if std::mem::take(&mut self.is_lost) {
            steering.find_again();
        }
        let [goal, first] = *self.begin.get_or_insert_with(|| [steering.goal.pose(), now]);
        let turn = now.1 * first.1.conjugate();
        steering.goal.place(goal.0 + now.0 - first.0, (turn * goal.1).normalize());
    }
}

/// Whether a session in this state runs, once it was begun.
pub(super) fn runs(state: State) -> bool {
    matches!(state, State::READY | State::SYNCHRONIZED | State::VISIBLE | State::FOCUSED)
}

/// Why a controller's place is not known in this state of the session.
pub(super) fn why_unknown(state: State, hand: &str) -> String {
    match state {
        State::FOCUSED => {
            format!("the controller of the {hand} hand is not tracked; switch it on, and hold it in sight")
        }
        state if runs(state) => "another application has the controllers; end it".into(),
        _ => "the OpenXR runtime has not begun the session; connect the headset, and put it on".into(),
    }
}

/// The session of this process.
struct Session {
    instance: xr::Instance,
    session: xr::Session<xr::Headless>,
    actions: xr::ActionSet,
    grip: xr::Action<xr::Posef>,
    select: xr::Action<bool>,
    menu: xr::Action<bool>,
    vibration: xr::Action<xr::Haptic>,
    /// Axes as those of the world: right, up, towards the user.
    base: xr::Space,
    /// A session that a call failed in is at `LOSS_PENDING`, whatever the runtime said.
    state: Mutex<State>,
}

/// The session that controllers share while one of them is open.
static SHARED: Mutex<Weak<Session>> = Mutex::new(Weak::new());

/// An error of a call in words.
fn failed(call: &str) -> impl Fn(xr::sys::Result) -> String {
    move |error| format!("OpenXR, {call}: {error}")
}

impl Session {
    fn shared() -> Result<Arc<Session>, String> {
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        match shared.upgrade() {
            Some(session) if session.is_over() => Err("the last session of OpenXR is still being closed".into()),
            Some(session) => Ok(session),
            // Where another thread is just destroying the last one, the loader refuses a second; the next attempt
            // succeeds.
            None => {
                let session = Arc::new(Session::open()?);
                *shared = Arc::downgrade(&session);
                Ok(session)
            }
        }
    }

    fn open() -> Result<Session, String> {
        // SAFETY: the library that the system finds under the name of the loader is presumed to conform to OpenXR. The
        // entry keeps it loaded as long as its instance lives.
        let entry = unsafe { xr::Entry::load(&()) }.map_err(|error| {
            let why = std::error::Error::source(&error).map(|why| format!(": {why}")).unwrap_or_default();
            format!(
                "{error}{why}; install the loader (on Debian libopenxr-loader1) and a runtime that works without \
                 graphics, such as Monado"
            )
        })?;
        let offered = entry.enumerate_extensions().map_err(|error| {
            format!("no OpenXR runtime can be used: {error}; start one, and see that it is the active one")
        })?;
        if !offered.mnd_headless || !offered.khr_convert_timespec_time {
            return Err("the OpenXR runtime cannot be used without graphics (XR_MND_headless); use Monado".into());
        }
        let mut extensions = xr::ExtensionSet::default();
        (extensions.mnd_headless, extensions.khr_convert_timespec_time) = (true, true);
        let application = xr::ApplicationInfo { application_name: "palpate", ..Default::default() };
        let instance = entry.create_instance(&application, &extensions, &[], &()).map_err(|error| {
            format!("the OpenXR runtime gives no instance: {error}; see that its service is running")
        })?;
        let system = instance.system(xr::FormFactor::HEAD_MOUNTED_DISPLAY).map_err(|error| {
            format!("the OpenXR runtime has no headset: {error}; connect it, and start its service")
        })?;
        // SAFETY: a session without graphics has no graphics device that would have to be valid.
        let (session, _, _) = unsafe { instance.create_session(system, &xr::headless::SessionCreateInfo {}) }
            .map_err(failed("session"))?;
        let path = |path: &str| instance.string_to_path(path).map_err(failed(path));
        let hands = [path(HANDS[0].1)?, path(HANDS[1].1)?];
        let actions = instance.create_action_set("hold", "Hold the tool", 0).map_err(failed("action set"))?;
        let wrong = failed("action");
        let grip = actions.create_action("grip", "Tool", &hands).map_err(&wrong)?;
        let select = actions.create_action("select", "First button", &hands).map_err(&wrong)?;
        let menu = actions.create_action("menu", "Second button", &hands).map_err(&wrong)?;
        let vibration = actions.create_action("vibration", "Force", &hands).map_err(&wrong)?;
        let mut bindings = Vec::new();
        for (_, hand) in HANDS {
            bindings.push(xr::Binding::new(&grip, path(&format!("{hand}/input/grip/pose"))?));
            bindings.push(xr::Binding::new(&select, path(&format!("{hand}/input/select/click"))?));
            bindings.push(xr::Binding::new(&menu, path(&format!("{hand}/input/menu/click"))?));
            bindings.push(xr::Binding::new(&vibration, path(&format!("{hand}/output/haptic"))?));
        }
        instance.suggest_interaction_profile_bindings(path(CONTROLLER)?, &bindings).map_err(failed("bindings"))?;
        session.attach_action_sets(&[&actions]).map_err(failed("action sets"))?;
        let base = session
            .create_reference_space(xr::ReferenceSpaceType::LOCAL, xr::Posef::IDENTITY)
            .map_err(failed("reference space"))?;
        let state = Mutex::new(State::IDLE);
        Ok(Session { instance, session, actions, grip, select, menu, vibration, base, state })
    }

    fn is_over(&self) -> bool {
        matches!(self.state(), State::EXITING | State::LOSS_PENDING)
    }

    fn state(&self) -> State {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes over what the runtime tells, and has it read the controllers. Returns whether the session runs.
    fn poll(&self) -> Result<bool, Loss> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        self.poll_into(&mut state).inspect_err(|_| *state = State::LOSS_PENDING)?;
        match *state {
            State::EXITING => Err(Loss::ForGood("the user has ended the session of OpenXR".into())),
            State::LOSS_PENDING => Err(Loss::ForNow("the OpenXR runtime has ended the session".into())),
            state => Ok(runs(state)),
        }
    }

    fn poll_into(&self, state: &mut State) -> Result<(), String> {
        let mut storage = xr::EventDataBuffer::new();
        while let Some(event) = self.instance.poll_event(&mut storage).map_err(failed("event"))? {
            match event {
                xr::Event::SessionStateChanged(change) => {
                    *state = change.state();
                    match *state {
                        State::READY => {
                            let views = xr::ViewConfigurationType::PRIMARY_STEREO;
                            self.session.begin(views).map_err(failed("begin"))?;
                        }
                        State::STOPPING => {
                            self.session.end().map_err(failed("end"))?;
                        }
                        _ => {}
                    }
                }
                xr::Event::InstanceLossPending(_) => *state = State::LOSS_PENDING,
                _ => {}
            }
        }
        if runs(*state) {
            let active = xr::ActiveActionSet::new(&self.actions);
            self.session.sync_actions(&[active]).map_err(failed("state of the controllers"))?;
        }
        Ok(())
    }
}

/// The controller of a hand.
struct Controller {
    session: Arc<Session>,
    space: xr::Space,
    hand: &'static str,
    path: xr::Path,
    carrier: Carrier,
    vibration: Vibration,
}

impl Controller {
    /// Where the controller is, if the runtime knows.
    fn pose(&self) -> Result<Option<Pose>, Loss> {
        if !self.session.poll()? {
            return Ok(None);
        }
        let now = self.session.instance.now().map_err(failed("time"))?;
        let found = self.space.locate(&self.session.base, now).map_err(failed("place of the controller"))?;
        let required = xr::SpaceLocationFlags::POSITION_VALID
            | xr::SpaceLocationFlags::POSITION_TRACKED
            | xr::SpaceLocationFlags::ORIENTATION_VALID;
        let (p, q) = (found.pose.position, found.pose.orientation);
        let orientation = DQuat::from_xyzw(q.x.into(), q.y.into(), q.z.into(), q.w.into());
        let pose = (DVec3::new(p.x.into(), p.y.into(), p.z.into()), orientation.normalize());
        Ok((found.location_flags.contains(required) && pose.1.is_finite()).then_some(pose))
    }

    fn buttons(&self) -> Result<u32, String> {
        let is_pressed = |action: &xr::Action<bool>| {
            let state = action.state(&self.session.session, self.path).map_err(failed("buttons"))?;
            Ok::<u32, String>(u32::from(state.is_active && state.current_state))
        };
        Ok(is_pressed(&self.session.select)? | is_pressed(&self.session.menu)? << 1)
    }

    fn vibrate(&mut self, strength: f64) -> xr::Result<()> {
        let Some(strength) = self.vibration.due(strength, Instant::now()) else { return Ok(()) };
        let (action, session) = (&self.session.vibration, &self.session.session);
        if strength == 0.0 {
            return action.stop_feedback(session, self.path);
        }
        let lasts = xr::Duration::from_nanos(Vibration::LASTS.as_nanos() as i64);
        let vibration = xr::HapticVibration::new().amplitude(strength as f32).duration(lasts);
        action.apply_feedback(session, self.path, &vibration.frequency(xr::FREQUENCY_UNSPECIFIED))
    }
}

impl Hardware for Controller {
    fn unit(&self) -> String {
        self.hand.into()
    }

    fn note(&self) -> String {
        let hand = self.hand;
        format!(
            "OpenXR, {hand} hand: plays no force, vibrates as the force grows; the tool moves as the controller does"
        )
    }

    fn follow(&mut self, steering: &Steering) -> Result<(), Loss> {
        thread::sleep(Vibration::TICK);
        let pose = self.pose()?;
        let why = || why_unknown(self.session.state(), self.hand);
        self.carrier.take(pose, why, steering);
        if pose.is_some() {
            steering.buttons.store(self.buttons()?, Relaxed);
        }
        // A runtime that has ended the session says so when it is polled; a controller without a motor still steers.
        let _ = self.vibrate(steering.strength());
        Ok(())
    }
}

/// Opens the controller of the hand that `unit` names, or of the right one, and waits until it is tracked.
pub(super) fn open(unit: Option<&str>) -> Result<Box<dyn Hardware>, String> {
    let wanted = unit.unwrap_or("right");
    let Some(&(hand, path)) = HANDS.iter().find(|(hand, _)| *hand == wanted) else {
        return Err(format!("{wanted} is no hand; give left or right"));
    };
    let session = Session::shared()?;
    let path = session.instance.string_to_path(path).map_err(failed(path))?;
    let place = session.grip.create_space(&session.session, path, xr::Posef::IDENTITY);
    let space = place.map_err(failed("place of the controller"))?;
    let (carrier, vibration) = (Carrier::default(), Vibration::none());
    let controller = Controller { session, space, hand, path, carrier, vibration };
    let begun = Instant::now();
    loop {
        match controller.pose() {
            Ok(Some(_)) => return Ok(Box::new(controller)),
            Ok(None) if begun.elapsed() < PATIENCE => thread::sleep(Vibration::TICK),
            Ok(None) => return Err(why_unknown(controller.session.state(), hand)),
            Err(Loss::ForNow(why) | Loss::ForGood(why)) => return Err(why),
        }
    }
}
