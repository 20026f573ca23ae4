//! A window's Vulkan surface and swapchain, for the viewer. Images are rendered elsewhere and copied into the
//! swapchain, which follows the window's size; in a window of size zero nothing is shown.
#![allow(unsafe_code)]

mod chain;
mod commands;

use std::any::Any;
use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};

use super::context::Context;
use super::image::Image;
use super::{failed, loader};
use crate::error::{Error, Result};
use chain::Chain;
use commands::Commands;

/// Longest wait for a swapchain image, ns: a compositor may give none to a window that is not visible.
const LONGEST_WAIT: u64 = 100_000_000;
/// Greatest number of attempts to acquire one image; an outdated swapchain is replaced before the next attempt.
const ATTEMPTS: u32 = 3;
/// Names this part of the program in errors.
const STAGE: &str = "the window";

/// The instance extensions that [`Options::display`](super::Options::display) must name to show images on a display.
///
/// # Errors
/// Fails if Vulkan does not support this kind of display.
pub fn display_extensions(display: &impl HasDisplayHandle) -> Result<Vec<&'static CStr>> {
    let unknown = |why: String| Error::NoDevice(format!("Vulkan cannot present images on this display: {why}"));
    let handle = display.display_handle().map_err(|error| unknown(error.to_string()))?;
    let names = ash_window::enumerate_required_extensions(handle.as_raw()).map_err(|e| unknown(e.to_string()))?;
    // SAFETY: these are ash's own names, of static lifetime and NUL-terminated.
    Ok(names.iter().map(|name| unsafe { CStr::from_ptr(*name) }).collect())
}

/// The content to show in a window.
#[derive(Clone, Copy)]
pub enum Content<'a> {
    /// One colour: red, green, blue, opacity.
    Colour([f32; 4]),
    /// An image with one sample per pixel, rendered by GPU work that has ended; the image is stretched if the window
    /// has another size.
    Picture(&'a Image),
}

/// A window in which images are shown. One thread at a time may use it.
pub struct Window {
    // After `Drop::drop`, Rust drops the fields in the order of their declaration: `context` and `_window` last.
    commands: Commands,
    chain: Option<Chain>,
    surface: vk::SurfaceKHR,
    surfaces: ash::khr::surface::Instance,
    swapchains: ash::khr::swapchain::Device,
    format: vk::SurfaceFormatKHR,
    mode: vk::PresentModeKHR,
    /// Index of the swapchain image that was acquired and is shown next; `None` if no image is acquired.
    acquired: Option<u32>,
    context: Arc<Context>,
    /// Keeps the window alive as long as its surface.
    _window: Arc<dyn Any + Send + Sync>,
}

impl Window {
    /// Makes the surface of a window on the display that the context was opened for.
    ///
    /// # Errors
    /// Fails if the context was opened for no display, or if its device cannot show images in this window.
    pub fn new<W>(context: &Arc<Context>, window: Arc<W>) -> Result<Window>
    where
        W: HasWindowHandle + HasDisplayHandle + Send + Sync + 'static,
    {
        let name = context.device_name();
        let cannot = |why: String| Error::NoDevice(format!("{name} cannot present images in a window: {why}"));
        if !context.presents {
            return Err(cannot("it was not opened with a display".into()));
        }
        let of_window = window.window_handle().map_err(|error| cannot(error.to_string()))?.as_raw();
        let of_display = window.display_handle().map_err(|error| cannot(error.to_string()))?.as_raw();
        let (entry, instance) = (&context.entry, &context.instance);
        let commands = Commands::new(context)?;
        let guard = loader::reads_devices();
        let swapchains = ash::khr::swapchain::Device::new(instance, &context.device);
        drop(guard);
        // The surface comes last: from then on, dropping `Window` destroys it.
        // SAFETY: the context enabled the display's extensions; the window outlives the surface, see `_window`.
        let surface = unsafe { ash_window::create_surface(entry, instance, of_display, of_window, None) };
        let mut this = Window {
            commands,
            chain: None,
            surface: surface.map_err(failed("vkCreateSurfaceKHR", STAGE))?,
            surfaces: ash::khr::surface::Instance::new(entry, instance),
            swapchains,
            format: vk::SurfaceFormatKHR::default(),
            mode: vk::PresentModeKHR::FIFO,
            acquired: None,
            context: context.clone(),
            _window: window,
        };
        this.choose().map_err(|error| match error {
            Error::Simulation(why) => cannot(why),
            other => other,
        })?;
        Ok(this)
    }

    /// Acquires a swapchain image for a window of this size, pixels. Returns whether an image can be shown now. An
    /// attempt waits a tenth of a second at most for an image, and does not lock the queue meanwhile.
    pub fn acquire(&mut self, width: u32, height: u32) -> Result<bool> {
        for _ in 0..ATTEMPTS {
            if self.acquired.is_some() {
                return Ok(true);
            }
            if self.chain.as_ref().is_none_or(|chain| chain.is_stale || chain.asked != [width, height]) {
                self.remake(width, height)?;
            }
            let Some(chain) = &mut self.chain else { return Ok(false) };
            // The semaphore `acquired` is free once the last copy into a swapchain image has ended.
            self.commands.wait()?;
            // SAFETY: the swapchain is alive; nothing waits for the semaphore, since the last copy has ended.
            let acquired = unsafe {
                let semaphore = self.commands.acquired;
                self.swapchains.acquire_next_image(chain.handle, LONGEST_WAIT, semaphore, vk::Fence::null())
            };
            match acquired {
                // A swapchain that no longer quite fits the window is still used for this image.
                Ok((index, is_stale)) => (self.acquired, chain.is_stale) = (Some(index), is_stale),
                Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(false),
                Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => chain.is_stale = true,
                Err(error) => return Err(failed("vkAcquireNextImageKHR", STAGE)(error)),
            }
        }
        Ok(self.acquired.is_some())
    }

    /// Shows `content` in the swapchain image that was acquired; does nothing if none was acquired.
    pub fn present(&mut self, content: Content) -> Result<()> {
        let (Some(chain), Some(index)) = (&mut self.chain, self.acquired.take()) else { return Ok(()) };
        let image = &chain.images[index as usize];
        self.commands.copy(content, image.image, chain.extent, image.drawn)?;
        let (semaphores, handles, indices) = ([image.drawn], [chain.handle], [index]);
        let info =
            vk::PresentInfoKHR::default().wait_semaphores(&semaphores).swapchains(&handles).image_indices(&indices);
        let queue = self.context.queue();
        // SAFETY: the image was acquired, and the semaphore is signalled when its content is complete; the queue is
        // locked.
        match unsafe { self.swapchains.queue_present(queue.queue(), &info) } {
            Ok(is_stale) => chain.is_stale |= is_stale,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => chain.is_stale = true,
            Err(error) => return Err(failed("vkQueuePresentKHR", STAGE)(error)),
        }
        Ok(())
    }

    /// Chooses surface format and present mode. Fails with an [`Error::Simulation`] that names what the surface lacks.
    fn choose(&mut self) -> Result<()> {
        let (surfaces, context) = (&self.surfaces, &self.context);
        let (physical, surface) = (context.physical, self.surface);
        // SAFETY (of the three calls below): they only query a live surface.
        let (can, formats, modes) = unsafe {
            let can = surfaces.get_physical_device_surface_support(physical, context.queue_family, surface);
            let formats = surfaces.get_physical_device_surface_formats(physical, surface);
            let modes = surfaces.get_physical_device_surface_present_modes(physical, surface);
            (can, formats, modes)
        };
        if !can.map_err(failed("vkGetPhysicalDeviceSurfaceSupportKHR", STAGE))? {
            return Err(Error::Simulation(
                "the device's queue cannot present to this window; choose another device".into(),
            ));
        }
        let formats = formats.map_err(failed("vkGetPhysicalDeviceSurfaceFormatsKHR", STAGE))?;
        let modes = modes.map_err(failed("vkGetPhysicalDeviceSurfacePresentModesKHR", STAGE))?;
        // Rendered images already hold the values that a screen shows: an sRGB format would convert them again and
        // brighten them.
        let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
        let format = formats.iter().find(|format| plain.contains(&format.format)).or(formats.first());
        self.format = *format.ok_or_else(|| Error::Simulation("the window's surface offers no image format".into()))?;
        // In these two present modes no thread waits for the screen while it holds the queue's lock.
        let wanted = [vk::PresentModeKHR::MAILBOX, vk::PresentModeKHR::IMMEDIATE];
        self.mode = wanted.into_iter().find(|mode| modes.contains(mode)).unwrap_or(vk::PresentModeKHR::FIFO);
        Ok(())
    }

    /// Replaces the swapchain by one for a window of this size, pixels; for a size of zero none is made.
    fn remake(&mut self, width: u32, height: u32) -> Result<()> {
        // The last copy into a swapchain image may not have ended yet.
        self.commands.wait()?;
        if self.chain.is_some() {
            self.context.wait_idle();
        }
        let old = self.chain.take();
        // SAFETY: the call only queries a live surface.
        let can =
            unsafe { self.surfaces.get_physical_device_surface_capabilities(self.context.physical, self.surface) };
        let can = can.map_err(failed("vkGetPhysicalDeviceSurfaceCapabilitiesKHR", STAGE))?;
        // If the surface has no size of its own (`u32::MAX`), the swapchain gets the window's size.
        let extent = match can.current_extent {
            vk::Extent2D { width: u32::MAX, .. } => vk::Extent2D {
                width: width.clamp(can.min_image_extent.width, can.max_image_extent.width),
                height: height.clamp(can.min_image_extent.height, can.max_image_extent.height),
            },
            extent => extent,
        };
        if width == 0 || height == 0 || extent.width == 0 || extent.height == 0 {
            drop(old);
            return Ok(());
        }
        let retired = old.as_ref().map_or(vk::SwapchainKHR::null(), |old| old.handle);
        let mut info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface)
            .min_image_count(Chain::images_of(&can))
            .image_format(self.format.format)
            .image_color_space(self.format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(can.current_transform)
            .present_mode(self.mode)
            .clipped(true)
            .old_swapchain(retired);
        info.composite_alpha = match can.supported_composite_alpha {
            all if all.contains(vk::CompositeAlphaFlagsKHR::OPAQUE) => vk::CompositeAlphaFlagsKHR::OPAQUE,
            _ => vk::CompositeAlphaFlagsKHR::INHERIT,
        };
        if !can.supported_usage_flags.contains(info.image_usage) {
            let name = self.context.device_name();
            return Err(Error::NoDevice(format!(
                "{name} cannot present images in a window: nothing can be copied into the window's images"
            )));
        }
        self.chain = Some(Chain::new(&self.context, &self.swapchains, &info, [width, height])?);
        drop(old);
        Ok(())
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // The last copy may not have ended yet, and presenting may still wait for its semaphore.
        let _ = self.commands.wait();
        self.context.wait_idle();
        self.chain = None;
        // SAFETY: the surface's swapchain is destroyed and no work is pending; the window still exists.
        unsafe { self.surfaces.destroy_surface(self.surface, None) };
    }
}
