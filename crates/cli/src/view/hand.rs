//! What the mouse and the keys do to the tool and to the camera.

use glam::{DVec2, DVec3};
use palpate_devices::mouse::Goal;
use palpate_view::Camera;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{KeyCode, ModifiersState, PhysicalKey};

/// Of a pixel, rad.
const ORBIT: f64 = 0.006;
/// Of the distance, a notch of the wheel.
const ZOOM: f64 = 0.9;
/// Depth of a notch while the tool is held, of the distance.
const DEPTH: f64 = 0.01;
/// Pixels of a notch, where a touch pad counts them.
const NOTCH: f64 = 40.0;
/// Of a key, rad.
const TURN: f64 = 0.087;

/// Where the cursor is and what it holds.
#[derive(Debug, Default)]
pub struct Hand {
    cursor: DVec2,
    tool: bool,
    orbit: bool,
    pan: bool,
    modifiers: ModifiersState,
}

impl Hand {
    /// Does what an event says. What happens over the panel, from `edge` on to the right, is the panel's, but for buttons that
    /// are let go.
    pub fn hear(&mut self, event: &WindowEvent, edge: f64, camera: &mut Camera, goal: Option<&Goal>, size: [u32; 2]) {
        // Not asked of the panel: until it is laid out again it knows only where the cursor was before.
        let over_panel = self.cursor.x >= edge;
        match event {
            WindowEvent::ModifiersChanged(modifiers) => self.modifiers = modifiers.state(),
            WindowEvent::CursorMoved { position, .. } => {
                let to = DVec2::new(position.x, position.y);
                let by = to - std::mem::replace(&mut self.cursor, to);
                self.moved(by, camera, goal, size);
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let down = *state == ElementState::Pressed;
                if down && over_panel {
                    return;
                }
                match (button, goal) {
                    (MouseButton::Left, Some(goal)) => {
                        self.tool = down;
                        goal.press(down);
                    }
                    (MouseButton::Right, _) if down && self.modifiers.shift_key() => self.pan = true,
                    (MouseButton::Left | MouseButton::Right, _) => {
                        self.orbit = down;
                        self.pan &= down;
                    }
                    (MouseButton::Middle, _) => self.pan = down,
                    _ => {}
                }
            }
            WindowEvent::MouseWheel { delta, .. } if !over_panel => {
                let notches = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(*y),
                    MouseScrollDelta::PixelDelta(by) => by.y / NOTCH,
                };
                match goal.filter(|_| self.tool) {
                    Some(goal) => goal.shift(notches * DEPTH * camera.distance * camera.axes().forward),
                    None => camera.zoom(ZOOM.powf(notches), self.cursor.x, self.cursor.y, size[0], size[1]),
                }
            }
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                let (PhysicalKey::Code(code), Some(goal)) = (event.physical_key, goal) else { return };
                goal.turn(TURN * turn_of(code, camera));
            }
            // What was held is let go: the button may come up elsewhere.
            WindowEvent::Focused(false) => {
                (self.tool, self.orbit, self.pan) = (false, false, false);
                goal.into_iter().for_each(|goal| goal.press(false));
            }
            _ => {}
        }
    }

    fn moved(&self, by: DVec2, camera: &mut Camera, goal: Option<&Goal>, size: [u32; 2]) {
        if self.pan {
            camera.pan(by.x, by.y, size[1]);
        } else if self.orbit {
            camera.orbit(-ORBIT * by.x, ORBIT * by.y);
        } else if let Some(goal) = goal.filter(|_| self.tool) {
            goal.shift(camera.drag(goal.pose().0, by.x, by.y, size[1]));
        }
    }
}

/// The axis that a key turns the tool about, as seen.
fn turn_of(code: KeyCode, camera: &Camera) -> DVec3 {
    let axes = camera.axes();
    match code {
        KeyCode::ArrowLeft => -axes.up,
        KeyCode::ArrowRight => axes.up,
        KeyCode::ArrowUp => -axes.right,
        KeyCode::ArrowDown => axes.right,
        KeyCode::KeyQ => -axes.forward,
        KeyCode::KeyE => axes.forward,
        _ => DVec3::ZERO,
    }
}
