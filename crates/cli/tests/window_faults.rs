//! Each Vulkan call of a window and of a picture that may fail does so once, with each of its errors. Each failure must
//! come out as an error of the right kind, without a panic and without a leaked object (the validation layer reports
//! these), and what is made afterwards must work as if nothing had happened.
#![cfg(all(unix, feature = "view"))]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use palpate::internal::gpu::{Content, FAULTS, Image, Window, display_extensions};
use palpate::{Context, Options, Result, Scene, Simulation};
use palpate_view::{Overlay, Overlays, Settings, Studio};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::platform::x11::EventLoopBuilderExtX11;
use winit::window::WindowId;

#[allow(dead_code, reason = "shared with other tests")]
#[path = "display/mod.rs"]
mod display;
#[path = "../../../vk-tests/harness/faults.rs"]
mod faults;

use faults::{Heard, KINDS, PRESSED, check};

/// Set for the process that opens windows, which needs the variable `DISPLAY` from its beginning.
const INNER: &str = "PALPATE_TEST_INNER";
const SETTINGS: Settings = Settings { size: [64, 48], samples: 4 };

/// The scene after a step, on a device of its own.
fn pressed(options: &Options) -> Simulation {
    let scene = Scene::parse(Path::new("scene.toml"), PRESSED).unwrap();
    let mut simulation = Simulation::on_device(&Context::open(options).unwrap(), &scene).unwrap();
    simulation.step().unwrap();
    simulation
}

/// Number of failures of each function.
type Tried = BTreeMap<&'static str, u32>;

/// Lets each call of `work` fail, as long as there is a further one; `renew` is called after the device was lost. What
/// `work` returns without a failure must not change.
fn fail_each<T, R: PartialEq + std::fmt::Debug>(
    heard: &Heard,
    mut renew: impl FnMut() -> T,
    mut work: impl FnMut(&mut T) -> Result<R>,
) -> Tried {
    FAULTS.concern_contexts_of_this_thread();
    let mut tried = Tried::new();
    for kind in 0..KINDS {
        FAULTS.arm(None, 0);
        let mut subject = renew();
        // The first time the context makes kernels, which it keeps.
        work(&mut subject).unwrap();
        let expected = work(&mut subject).unwrap();
        heard.assert_silent("work without failures");
        for place in 0.. {
            FAULTS.arm(Some(place), kind);
            let came = work(&mut subject);
            let Some((name, result)) = FAULTS.struck() else { break };
            *tried.entry(name).or_default() += 1;
            check(came.as_ref().err());
            FAULTS.arm(None, 0);
            if result.contains("LOST") {
                drop(subject);
                subject = renew();
                work(&mut subject).unwrap();
            }
            assert_eq!(work(&mut subject).unwrap(), expected, "after call {place}, {name}, failed with {result}");
            heard.assert_silent(name);
        }
        drop(subject);
        heard.assert_silent("the end");
    }
    println!("{} faults tried: {tried:?}", tried.values().sum::<u32>());
    tried
}

/// Fails if one of the functions never failed.
fn assert_tried(tried: &Tried, functions: &[&str]) {
    let untouched: Vec<_> = functions.iter().filter(|name| !tried.contains_key(**name)).collect();
    assert!(untouched.is_empty(), "functions that never failed: {untouched:?}");
}

#[test]
#[ignore = "long: minutes"]
fn lasting_every_vulkan_call_of_a_picture_may_fail() {
    let heard = Heard::default();
    let draw = |simulation: &mut Simulation| {
        let mut studio = Studio::new(simulation, SETTINGS)?;
        studio.shown = Overlays::of(&[Overlay::Pressure, Overlay::Arrows, Overlay::Proxies]);
        studio.shows_time = true;
        Ok(studio.picture(simulation)?.pixels)
    };
    let tried = fail_each(&heard, || pressed(&heard.options(true)), draw);
    assert_tried(&tried, &["vkCreateImage", "vkCreateImageView", "vkBindImageMemory", "vkCreateGraphicsPipelines"]);
}

#[test]
#[ignore = "long: minutes"]
fn lasting_every_vulkan_call_of_a_window_may_fail() {
    if std::env::var_os(INNER).is_some() {
        let mut builder = EventLoop::builder();
        builder.with_any_thread(true).build().unwrap().run_app(&mut Inner).unwrap();
        return;
    }
    let display = display::Display::start();
    let mut inner = Command::new(std::env::current_exe().unwrap());
    inner.args(["--exact", "lasting_every_vulkan_call_of_a_window_may_fail", "--ignored", "--nocapture"]);
    inner.env(INNER, "1").env("DISPLAY", display.name()).env_remove("WAYLAND_DISPLAY").env("XMODIFIERS", "@im=none");
    assert!(inner.status().unwrap().success());
}

/// Acquires an image of the swapchain; a driver may need longer for it than one attempt takes.
fn acquire(window: &mut Window, [width, height]: [u32; 2]) -> Result<()> {
    for _ in 0..50 {
        if window.acquire(width, height)? {
            return Ok(());
        }
    }
    panic!("the window gives no image")
}

struct Inner;

impl ApplicationHandler for Inner {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let attributes = winit::window::Window::default_attributes().with_inner_size(PhysicalSize::new(64, 48));
        let window = Arc::new(events.create_window(attributes).unwrap());
        let heard = Heard::default();
        let display = display_extensions(&window).unwrap();
        let options = || Options { display: display.clone(), ..heard.options(true) };
        let renew = || {
            let mut simulation = pressed(&options());
            let mut studio = Studio::new(&mut simulation, SETTINGS).unwrap();
            studio.picture(&mut simulation).unwrap();
            (simulation.context().clone(), studio.renderer().image().unwrap().clone())
        };
        let show = |(context, picture): &mut (Arc<Context>, Image)| {
            let mut shown = Window::new(context, window.clone())?;
            for (size, content) in [([64, 48], Content::Colour([0.5; 4])), ([60, 40], Content::Picture(picture))] {
                acquire(&mut shown, size)?;
                shown.present(content)?;
            }
            // This waits for the last copy; where dropping the window does that, a failure cannot be told.
            acquire(&mut shown, [60, 40])
        };
        let tried = fail_each(&heard, renew, show);
        assert_tried(
            &tried,
            &[
                "vkAcquireNextImageKHR",
                "vkCreateSemaphore",
                "vkCreateSwapchainKHR",
                "vkGetPhysicalDeviceSurfaceCapabilitiesKHR",
                "vkGetPhysicalDeviceSurfaceFormatsKHR",
                "vkGetPhysicalDeviceSurfacePresentModesKHR",
                "vkGetPhysicalDeviceSurfaceSupportKHR",
                "vkGetSwapchainImagesKHR",
                "vkQueuePresentKHR",
                "vkQueueSubmit2",
                "vkQueueWaitIdle",
                "vkWaitForFences",
            ],
        );
        assert!(tried.keys().any(|name| name.contains("Surface") && name.starts_with("vkCreate")), "{tried:?}");
        events.exit();
    }

    fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, _: WindowEvent) {}
}
