//! What tests of failing Vulkan calls share: devices whose validation layer is heard, and what a failure must come to.

use std::sync::{Arc, Mutex};

use palpate::internal::gpu::{FAULTS, Level, Log};
use palpate::{Error, Options};

/// Most errors that a function may return.
pub const KINDS: usize = 3;
/// A sphere pressed into a block, with friction.
pub const PRESSED: &str = "[contact]\nfriction = 0.3\n[[body]]\nname = \"b\"\n\
    layer = { box = [[-0.03, -0.03, -0.03], [0.03, 0.0, 0.03]], cells = [3, 2, 3] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [tool]\nsphere = 0.01\nmass = 0.05\nposition = [0.0, 0.009, 0.0]\n";
/// Functions, or failures of functions, that the engine can do without: it keeps no compiled pipelines for later runs,
/// leaves out times of stages, uses memory of another type, or replaces a swapchain.
const SPARED: [&str; 8] = [
    "vkAcquireNextImageKHR ERROR_OUT_OF_DATE_KHR",
    "vkAllocateMemory",
    "vkCreatePipelineCache",
    "vkGetPipelineCacheData",
    "vkGetQueryPoolResults",
    "vkMapMemory",
    "vkQueuePresentKHR ERROR_OUT_OF_DATE_KHR",
    "vkQueueWaitIdle",
];

/// All that the validation layer said.
#[derive(Clone, Default)]
pub struct Heard(Arc<Mutex<Vec<String>>>);

impl Heard {
    /// Options of devices that are heard.
    pub fn options(&self, validation: bool) -> Options {
        let heard = self.clone();
        let log = Log::new(move |level, message| {
            if level != Level::Note {
                heard.0.lock().unwrap().push(message.into());
            }
        });
        let device = std::env::var("PALPATE_TEST_DEVICE").ok();
        Options { device, validation, log, ..Options::default() }
    }

    /// Requires that nothing was said.
    pub fn assert_silent(&self, after: &str) {
        let said = self.0.lock().unwrap();
        assert!(said.is_empty(), "after {after} the validation layer said: {said:?}");
    }
}

/// Requires that the call which failed last came out as `came`: an error of the right kind, in one line, from the call
/// that failed; or as none, if the engine can do without this call.
pub fn check(came: Option<&Error>) {
    let (name, result) = FAULTS.struck().expect("a call that failed");
    let Some(error) = came else {
        let is_spared = SPARED.contains(&name) || SPARED.contains(&format!("{name} {result}").as_str());
        assert!(is_spared, "{name} failed with {result}, and nobody noticed");
        return;
    };
    let text = error.to_string();
    let is_right = match error {
        Error::Memory(_) => result.contains("MEMORY"),
        // After the device was lost all calls fail. A surface has a function for each kind of window.
        Error::Vulkan { call, stage, .. } => {
            let is_it = *call == name || result.contains("DEVICE_LOST") || *call == "vkCreateSurfaceKHR";
            is_it && !stage.is_empty()
        }
        Error::NoDevice(_) => text.contains(name),
        _ => false,
    };
    assert!(is_right && text.lines().count() == 1, "{name} failed with {result}: {text}");
}
