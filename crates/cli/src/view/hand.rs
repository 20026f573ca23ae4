//! Input of the window: how mouse and keys move the chosen tool (a rigid body that the user holds) and the camera.

use glam::{DVec2, DVec3};
use palpate_devices::mouse::Goal;
use palpate_view::Camera;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{KeyCode, ModifiersState, PhysicalKey};

/// Turn of the camera per pixel of the cursor's movement, rad.
const ORBIT: f64 = 0.006;
/// Factor on the camera's distance per notch of the wheel.
const ZOOM: f64 = 0.9;
/// Movement of the held tool into the image per notch of the wheel, as a share of the camera's distance.
const DEPTH: f64 = 0.01;
/// Greatest movement per notch, as a share of the radius of a tool that is a sphere: one notch must not push the whole
/// tool through a skin.
const SHALLOW: f64 = 0.25;
/// Number of pixels that count as a notch of the wheel, for touch pads, which report pixels.
const NOTCH: f64 = 40.0;
/// Turn of the tool per key press, rad.
const TURN: f64 = 0.087;

/// Position of the cursor, and what is being dragged.
#[derive(Debug, Default)]
pub struct Hand {
    cursor: DVec2,
    tool: bool,
    orbit: bool,
    pan: bool,
    modifiers: ModifiersState,
}

impl Hand {
    /// Handles an event; `goal` is the tool's goal pose, if the mouse moves the tool. Events over the panel (texts and
    /// sliders), which begins `edge` pixels from the left, belong to the panel, except releases of buttons.
    /// `radius`: that of the tool if it is a sphere, m.
    pub fn hear(
        &mut self,
        event: &WindowEvent,
        edge: f64,
        camera: &mut Camera,
        goal: Option<&Goal>,
        radius: Option<f64>,
        size: [u32; 2],
    ) {
        // The panel itself is not asked whether the cursor is over it: until the panel is laid out again, it knows only
        // an earlier position of the cursor.
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
                    Some(goal) => goal.shift(notches * notch(camera.distance, radius) * camera.axes().forward),
                    None => camera.zoom(ZOOM.powf(notches), self.cursor.x, self.cursor.y, size[0], size[1]),
                }
            }
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                let (PhysicalKey::Code(code), Some(goal)) = (event.physical_key, goal) else { return };
                goal.turn(TURN * turn_of(code, camera));
            }
            // All drags end, as the button may be released outside the window.
            WindowEvent::Focused(false) => {
                self.let_go();
                goal.into_iter().for_each(|goal| goal.press(false));
            }
            _ => {}
        }
    }

    /// Ends all drags.
    pub fn let_go(&mut self) {
        (self.tool, self.orbit, self.pan) = (false, false, false);
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

/// Movement of the held tool per notch of the wheel, m.
fn notch(distance: f64, radius: Option<f64>) -> f64 {
    (DEPTH * distance).min(SHALLOW * radius.unwrap_or(f64::INFINITY))
}

/// The axis about which a key turns the tool, one of the camera's axes; zero if the key does not turn the tool.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_notch_of_the_wheel_moves_no_tool_through_a_skin() {
        assert_eq!(notch(0.8, Some(0.01)), 0.0025);
        assert_eq!(notch(0.1, Some(0.01)), 0.001);
        assert_eq!(notch(0.8, None), 0.008);
    }
}
