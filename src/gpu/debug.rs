//! Uses of the Vulkan extension VK_EXT_debug_utils: names of Vulkan objects, labels around the commands of each stage
//! of a time step (tools that capture a run show both), and the messages of Vulkan's validation layer.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_void};
use std::sync::Mutex;

use ash::vk::{self, Handle};

use super::loader;
use super::log::{Level, Log};

/// Receives the validation layer's messages. They are passed on at once to the log's receiver (a function of the
/// embedding program) if the log has one; otherwise they are kept until [`Messages::drain`] fetches them.
#[derive(Default)]
pub(super) struct Messages {
    kept: Mutex<Vec<String>>,
    log: Log,
}

impl Messages {
    /// Makes a `Messages` that passes each message on to `log`, if `log` has a receiver.
    pub fn heard_by(log: Log) -> Messages {
        Messages { log, ..Messages::default() }
    }

    /// Returns and forgets all kept messages.
    pub fn drain(&self) -> Vec<String> {
        std::mem::take(&mut *self.kept.lock().unwrap_or_else(|e| e.into_inner()))
    }

    /// Returns the create info for a debug messenger or an instance, whose messages then arrive in `self`. `self` must
    /// outlive the messenger or instance.
    pub fn create_info(&self) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
        use vk::{DebugUtilsMessageSeverityFlagsEXT as Severity, DebugUtilsMessageTypeFlagsEXT as Type};
        vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(Severity::WARNING | Severity::ERROR)
            .message_type(Type::VALIDATION | Type::PERFORMANCE)
            .pfn_user_callback(Some(callback))
            .user_data(std::ptr::from_ref(self).cast_mut().cast())
    }
}

/// Text of a performance message that is ignored: it recommends another image layout for copies, but images
/// always stay in Vulkan's general layout (see `image.rs`).
const ADVICE: &str = "instead of GENERAL";

unsafe extern "system" fn callback(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `user` is the `Messages` given in `create_info`, which outlives the messenger; the validation layer
    // passes a valid `data` whose message is NUL-terminated.
    let (messages, text) = unsafe { (&*user.cast::<Messages>(), CStr::from_ptr((*data).p_message)) };
    let text = text.to_string_lossy();
    if kind.contains(vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE) && text.contains(ADVICE) {
        return vk::FALSE;
    }
    if messages.log.is_heard() {
        let is_error = severity.contains(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR);
        messages.log.tell(if is_error { Level::Error } else { Level::Warning }, &text);
    } else {
        messages.kept.lock().unwrap_or_else(|e| e.into_inner()).push(text.into_owned());
    }
    vk::FALSE
}

/// The first version of the validation layer that locks its list of command buffers' labels where it forgets a command
/// buffer (Vulkan-ValidationLayers, commit 2a430d9). Older ones, such as Debian 12's 1.3.239, forget it on a thread of
/// their own after it has run; if another command buffer got a label at that moment, the process ended, with a message
/// of the heap or about an exception of C++.
const LOCKS_LABELS: u32 = vk::make_api_version(0, 1, 3, 242);

/// Names objects and labels commands of one device.
pub(super) struct Labels {
    /// `None` where the device lacks VK_EXT_debug_utils: then nothing is named or labelled.
    utils: Option<ash::ext::debug_utils::Device>,
    /// Whether commands are labelled; not with a layer older than [`LOCKS_LABELS`].
    labels_commands: bool,
}

impl Labels {
    /// Labels for a device. `layer`: version of the validation layer that is in use, if one is.
    pub fn new(utils: Option<ash::ext::debug_utils::Device>, layer: Option<u32>) -> Labels {
        Labels { utils, labels_commands: layer.is_none_or(|version| version >= LOCKS_LABELS) }
    }

    /// The functions that label commands, where commands are labelled.
    fn of_commands(&self) -> Option<&ash::ext::debug_utils::Device> {
        self.utils.as_ref().filter(|_| self.labels_commands)
    }

    /// Gives an object the name that validation messages and captures of a run show.
    pub fn name<H: Handle>(&self, handle: H, name: &str) {
        let (Some(utils), Ok(name)) = (&self.utils, CString::new(name)) else { return };
        let _guard = loader::reads_devices();
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
        // SAFETY: the handle belongs to this live device; the info lives through the call. A name only helps debugging,
        // so a failure does not matter.
        let _ = unsafe { utils.set_debug_utils_object_name(&info) };
    }

    /// Opens a label in a command buffer that is being recorded.
    pub fn begin(&self, commands: vk::CommandBuffer, name: &str) {
        let (Some(utils), Ok(name)) = (self.of_commands(), CString::new(name)) else { return };
        // SAFETY: the command buffer is in recording state, and only this thread records it.
        unsafe {
            utils.cmd_begin_debug_utils_label(commands, &vk::DebugUtilsLabelEXT::default().label_name(&name));
        }
    }

    /// Closes the label that was opened last in this command buffer.
    pub fn end(&self, commands: vk::CommandBuffer) {
        if let Some(utils) = self.of_commands() {
            // SAFETY: the command buffer is in recording state; `begin` opened a label before each call of `end`.
            unsafe { utils.cmd_end_debug_utils_label(commands) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_get_no_labels_with_a_layer_that_does_not_lock_them() {
        let labels = |layer| Labels::new(None, layer).labels_commands;
        assert!(!labels(Some(vk::make_api_version(0, 1, 3, 239))) && !labels(Some(vk::make_api_version(0, 1, 3, 241))));
        assert!(labels(Some(vk::make_api_version(0, 1, 3, 242))) && labels(Some(vk::make_api_version(0, 1, 4, 309))));
        assert!(labels(None));
    }
}
