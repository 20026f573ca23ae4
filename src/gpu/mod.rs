//! The only module that calls Vulkan. A *step* is one time step of the simulation, which consists of stages.
//!
//! A [`Context`] is a Vulkan device with its queue, a [`Buffer`] is an array in the device's memory, and a [`Kernel`]
//! is an immutable compute pipeline whose interface (buffers, push constants) is read from its SPIR-V. A [`Recorder`]
//! writes passes (dispatches, draws, fills, copies) in order into a [`Recording`], a command buffer that is replayed in
//! every step, and derives barriers from what each kernel declares to read and write. A [`RasterPipeline`] draws
//! triangles, either without attachments (images), where a stage uses the rasterizer to distribute work, or onto the
//! [`Image`]s of a [`Canvas`].

mod arguments;
mod barrier;
mod buffer;
mod cache;
mod canvas;
mod check;
mod context;
mod debug;
mod details;
mod device;
mod draw;
mod faults;
mod host;
mod image;
mod kernel;
mod loader;
mod log;
mod raster;
mod recorder;
mod recording;
mod specialise;
mod spirv;
mod threads;
mod transfer;
#[cfg(feature = "window")]
mod window;

pub use arguments::{Arguments, Named};
pub use buffer::{Buffer, Mapped, MappedMut, Memory};
pub use canvas::{Before, Canvas, Drawn};
pub use context::{Arrays, Context, Options};
pub use device::{DeviceInfo, DeviceKind};
pub use faults::FAULTS;
pub use host::{HostDevice, QueueLock};
pub use image::{Image, Texels};
pub use kernel::{Const, Kernel, Size, shader_names, watched};
pub use log::{Level, Log};
pub use raster::{Onto, RasterPipeline, Side};
pub use recorder::Recorder;
pub use recording::{ArrayUse, Pass, Recording, StagePasses};
pub use spirv::{Binding, BindingKind};
pub use threads::Threads;
pub use transfer::{read_all, write_all};
#[cfg(feature = "window")]
pub use window::{Content, Window, display_extensions};

use crate::error::Error;

/// Turns the failure of a Vulkan call into an error that names the call and `stage`, the work that was under way.
fn failed(call: &'static str, stage: impl Into<String>) -> impl FnOnce(ash::vk::Result) -> Error {
    move |result| match result {
        ash::vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | ash::vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            Error::Memory(format!("{call} failed in {}: {result}", stage.into()))
        }
        // The name that ash gives it is an address of the specification.
        ash::vk::Result::ERROR_DEVICE_LOST => {
            Error::Vulkan { call, stage: stage.into(), result: "the device was lost".into() }
        }
        _ => Error::Vulkan { call, stage: stage.into(), result: result.to_string() },
    }
}
