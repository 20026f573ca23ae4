//! A game pad, by Linux's input devices (evdev): the tool moves as long as a stick is pushed, and the pad vibrates as
//! the force grows. A device is a game pad if it sends the events of the kernel's gamepad specification and has two
//! sticks.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::Instant;

use evdev::raw_stream::{RawDevice, enumerate};
use evdev::{
    AbsoluteAxisCode as Axis, FFEffect, FFEffectCode, FFEffectData, FFEffectKind, FFReplay, FFTrigger, KeyCode,
};
use glam::DVec3;

use super::{Hardware, Loss, Steering, Vibration, speeds};

/// Sticks: left, then right, each to the right, then towards the user.
const STICKS: [Axis; 4] = [Axis::ABS_X, Axis::ABS_Y, Axis::ABS_RX, Axis::ABS_RY];
/// Share of a stick's way below which it counts as released.
pub(super) const DEAD: f64 = 0.12;
/// Bit of the left shoulder button.
pub(super) const SHOULDER: u32 = 1 << (KeyCode::BTN_TL.0 - KeyCode::BTN_SOUTH.0);

/// A game pad that is open.
struct GamePad {
    device: RawDevice,
    name: String,
    unit: String,
    sticks: Sticks,
    vibration: Vibration,
    /// The effect by which it vibrates, or why it does not.
    effect: Result<FFEffect, String>,
}

/// Which of the axes of the sticks have been released since the pad was opened. Before its first report the kernel
/// gives zero, which is the end of the way of many sticks.
#[derive(Default)]
pub(super) struct Sticks([bool; 4]);

impl Sticks {
    /// The shares by which sticks are pushed; an axis that was not released yet counts as released.
    pub(super) fn released_once(&mut self, shares: [f64; 4]) -> [f64; 4] {
        std::array::from_fn(|k| {
            self.0[k] |= shares[k].abs() < DEAD;
            if self.0[k] { shares[k] } else { 0.0 }
        })
    }
}

/// Share of its way, from -1 to 1, by which a stick is pushed that goes from `least` to `greatest`.
pub(super) fn share(value: i32, least: i32, greatest: i32) -> f64 {
    let [value, least, greatest] = [value, least, greatest].map(f64::from);
    let way = greatest - least;
    if way > 0.0 { ((2.0 * value - least - greatest) / way).clamp(-1.0, 1.0) } else { 0.0 }
}

/// Translation and rotation that the sticks ask for. The left one moves to the right and towards the user, the right
/// one up, and it turns about the upward axis. While the left shoulder button is pressed, the left one turns: to the
/// right, and its top towards the user.
pub(super) fn pushes([x, y, right_x, right_y]: [f64; 4], buttons: u32) -> [DVec3; 2] {
    let [moves, tilts] = if buttons & SHOULDER != 0 { [[0.0; 2], [x, y]] } else { [[x, y], [0.0; 2]] };
    [DVec3::new(moves[0], -right_y, moves[1]), DVec3::new(tilts[1], -right_x, -tilts[0])]
}

/// A vibration of a strength from 0 to 1: the strong motor alone.
fn rumble(strength: f64) -> FFEffectData {
    FFEffectData {
        direction: 0,
        trigger: FFTrigger::default(),
        replay: FFReplay { length: Vibration::LASTS.as_millis() as u16, delay: 0 },
        kind: FFEffectKind::Rumble {
            strong_magnitude: (strength * f64::from(u16::MAX)).round() as u16,
            weak_magnitude: 0,
        },
    }
}

impl GamePad {
    /// How far the sticks are pushed, and the pressed buttons: bit k is the button `BTN_SOUTH` + k of the kernel.
    fn state(&self) -> io::Result<([f64; 4], u32)> {
        let axes = self.device.get_abs_state()?;
        let shares = STICKS.map(|axis| {
            let axis = &axes[usize::from(axis.0)];
            share(axis.value, axis.minimum, axis.maximum)
        });
        let keys = self.device.get_key_state()?;
        let buttons = KeyCode::BTN_SOUTH.0..=KeyCode::BTN_THUMBR.0;
        let bit = |code: u16| u32::from(keys.contains(KeyCode(code))) << (code - KeyCode::BTN_SOUTH.0);
        Ok((shares, buttons.map(bit).sum()))
    }

    fn vibrate(&mut self, strength: f64) -> io::Result<()> {
        let (Ok(effect), Some(strength)) = (&mut self.effect, self.vibration.due(strength, Instant::now())) else {
            return Ok(());
        };
        if strength == 0.0 {
            return effect.stop();
        }
        effect.update(rumble(strength))?;
        effect.play(1)
    }
}

impl Hardware for GamePad {
    fn unit(&self) -> String {
        self.unit.clone()
    }

    fn note(&self) -> String {
        let vibrates = match &self.effect {
            Ok(_) => "vibrates as the force grows".into(),
            Err(why) => format!("does not vibrate ({why})"),
        };
        format!("{}: plays no force, {vibrates}; the tool moves as long as a stick is pushed", self.name)
    }

    fn follow(&mut self, steering: &Steering) -> Result<(), Loss> {
        thread::sleep(Vibration::TICK);
        let (shares, buttons) = self.state().map_err(|e| e.to_string())?;
        steering.ask(speeds(pushes(self.sticks.released_once(shares), buttons), DEAD));
        steering.buttons.store(buttons, Relaxed);
        // A pad that is gone cannot tell its state either; one that does not vibrate any more still steers.
        let _ = self.vibrate(steering.strength());
        Ok(())
    }
}

/// Whether a device is a game pad with two sticks.
fn is_pad(device: &RawDevice) -> bool {
    let has_button = device.supported_keys().is_some_and(|keys| keys.contains(KeyCode::BTN_SOUTH));
    has_button && device.supported_absolute_axes().is_some_and(|axes| STICKS.iter().all(|axis| axes.contains(*axis)))
}

/// Opens the game pad that `unit` names, by its name or a path that leads to it, or the first one.
pub(super) fn open(unit: Option<&str>) -> Result<Box<dyn Hardware>, String> {
    let mut pads: Vec<(PathBuf, RawDevice)> = enumerate().filter(|(_, device)| is_pad(device)).collect();
    // `event9` comes before `event10`.
    pads.sort_by_key(|(path, _)| (path.as_os_str().len(), path.clone()));
    let path = unit.and_then(|unit| Path::new(unit).canonicalize().ok());
    let is_it = |(at, device): &(PathBuf, RawDevice)| {
        unit.is_none_or(|unit| device.name() == Some(unit) || path.as_ref() == Some(at))
    };
    let Some((_, mut device)) = pads.into_iter().find(is_it) else {
        let named = unit.map(|unit| format!(" called {unit}")).unwrap_or_default();
        return Err(format!(
            "no game pad{named} with two sticks is plugged in, or this user may not read it; plug it in, and see that \
             /dev/input/event* can be read (by the group `input`)"
        ));
    };
    let name = device.name().unwrap_or("game pad").to_string();
    let effect = effect(&mut device);
    let unit = unit.map_or_else(|| name.clone(), String::from);
    let (sticks, vibration) = (Sticks::default(), Vibration::none());
    Ok(Box::new(GamePad { device, name, unit, sticks, vibration, effect }))
}

/// The effect by which a pad vibrates.
fn effect(device: &mut RawDevice) -> Result<FFEffect, String> {
    if !device.supported_ff().is_some_and(|effects| effects.contains(FFEffectCode::FF_RUMBLE)) {
        return Err("it has no motor".into());
    }
    let mut effect = device.upload_ff_effect(rumble(0.0)).map_err(|e| e.to_string())?;
    // It can be uploaded by whoever may read the device, and played by whoever may write to it.
    effect.stop().map_err(|e| format!("this user may not write to it: {e}"))?;
    Ok(effect)
}
