//! A window's surface and its swapchain: pictures are drawn elsewhere and copied in. The swapchain follows the window's size;
//! of a window without any, nothing is shown.
#![allow(unsafe_code)]

mod chain;
mod commands;

use std::any::Any;
use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};

use super::context::Context;
use super::failed;
use super::image::Image;
use crate::error::{Error, Result};
use chain::Chain;
use commands::Commands;

/// For an image to be shown in nobody waits longer than this, ns: a compositor gives none to a window that is not seen.
const LONGEST_WAIT: u64 = 100_000_000;
/// A swapchain that is out of date is made anew so often before a picture is left out.
const ATTEMPTS: u32 = 3;
/// Names this room in errors.
const STAGE: &str = "the window";

/// What [`Options::display`](super::Options::display) must hold to show in windows of a display.
///
/// # Errors
/// The display is of a kind that Vulkan knows nothing of.
pub fn display_extensions(display: &impl HasDisplayHandle) -> Result<Vec<&'static CStr>> {
    let unknown = |why: String| Error::NoDevice(format!("Vulkan cannot show on this display: {why}"));
    let handle = display.display_handle().map_err(|error| unknown(error.to_string()))?;
    let names = ash_window::enumerate_required_extensions(handle.as_raw()).map_err(|e| unknown(e.to_string()))?;
    // SAFETY: ash's own names, of static lifetime and with a zero at the end.
    Ok(names.iter().map(|name| unsafe { CStr::from_ptr(*name) }).collect())
}

/// What is shown.
#[derive(Clone, Copy)]
pub enum Content<'a> {
    /// One colour: red, green, blue, opacity.
    Colour([f32; 4]),
    /// A picture with one sample a pixel, drawn by work that is done; stretched where the window is of another size.
    Picture(&'a Image),
}

/// A window that pictures are shown in. One thread at a time uses it.
pub struct Window {
    // In the order of `Drop`.
    commands: Commands,
    chain: Option<Chain>,
    surface: vk::SurfaceKHR,
    surfaces: ash::khr::surface::Instance,
    swapchains: ash::khr::swapchain::Device,
    format: vk::SurfaceFormatKHR,
    mode: vk::PresentModeKHR,
    /// The image to be shown next.
    acquired: Option<u32>,
    context: Arc<Context>,
    /// The window itself stays as long as its surface.
    _window: Arc<dyn Any + Send + Sync>,
}

impl Window {
    /// For a window of the display that the context was opened for.
    ///
    /// # Errors
    /// The context was opened for none, or its device cannot show in this window.
    pub fn new<W>(context: &Arc<Context>, window: Arc<W>) -> Result<Window>
    where
        W: HasWindowHandle + HasDisplayHandle + Send + Sync + 'static,
    {
        let name = context.device_name();
        let cannot = |why: String| Error::NoDevice(format!("{name} cannot show in a window: {why}"));
        if !context.presents {
            return Err(cannot("it was not opened for a display".into()));
        }
        let of_window = window.window_handle().map_err(|error| cannot(error.to_string()))?.as_raw();
        let of_display = window.display_handle().map_err(|error| cannot(error.to_string()))?.as_raw();
        let (entry, instance) = (&context.entry, &context.instance);
        // SAFETY: the extensions were enabled with the context; the window outlives the surface, see `_window`.
        let surface = unsafe { ash_window::create_surface(entry, instance, of_display, of_window, None) };
        let mut this = Window {
            commands: Commands::new(context)?,
            chain: None,
            surface: surface.map_err(failed("vkCreateSurfaceKHR", STAGE))?,
            surfaces: ash::khr::surface::Instance::new(entry, instance),
            swapchains: ash::khr::swapchain::Device::new(instance, &context.device),
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

    /// Makes ready to show a picture in a window of this size, in pixels; whether one can be shown now. Waits for a tenth of
    /// a second at most, and not on the queue.
    pub fn acquire(&mut self, width: u32, height: u32) -> Result<bool> {
        for _ in 0..ATTEMPTS {
            if self.acquired.is_some() {
                return Ok(true);
            }
            if self.chain.as_ref().is_none_or(|chain| chain.is_stale || chain.asked != [width, height]) {
                self.remake(width, height)?;
            }
            let Some(chain) = &mut self.chain else { return Ok(false) };
            // Its semaphore is free once the last picture is copied.
            self.commands.wait()?;
            // SAFETY: the swapchain is alive; nobody waits for the semaphore, see above.
            let acquired = unsafe {
                let semaphore = self.commands.acquired;
                self.swapchains.acquire_next_image(chain.handle, LONGEST_WAIT, semaphore, vk::Fence::null())
            };
            match acquired {
                // One that does not quite fit is shown once.
                Ok((index, is_stale)) => (self.acquired, chain.is_stale) = (Some(index), is_stale),
                Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(false),
                Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => chain.is_stale = true,
                Err(error) => return Err(failed("vkAcquireNextImageKHR", STAGE)(error)),
            }
        }
        Ok(self.acquired.is_some())
    }

    /// Shows something in the image that was acquired; nothing where none was.
    pub fn present(&mut self, content: Content) -> Result<()> {
        let (Some(chain), Some(index)) = (&mut self.chain, self.acquired.take()) else { return Ok(()) };
        let image = &chain.images[index as usize];
        self.commands.copy(content, image.image, chain.extent, image.drawn)?;
        let (semaphores, handles, indices) = ([image.drawn], [chain.handle], [index]);
        let info =
            vk::PresentInfoKHR::default().wait_semaphores(&semaphores).swapchains(&handles).image_indices(&indices);
        let queue = self.context.queue();
        // SAFETY: the image was acquired and is drawn once the semaphore says so; the queue is locked.
        match unsafe { self.swapchains.queue_present(queue.queue(), &info) } {
            Ok(is_stale) => chain.is_stale |= is_stale,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => chain.is_stale = true,
            Err(error) => return Err(failed("vkQueuePresentKHR", STAGE)(error)),
        }
        Ok(())
    }

    /// Format and mode; what the surface cannot do is an [`Error::Simulation`].
    fn choose(&mut self) -> Result<()> {
        let (surfaces, context) = (&self.surfaces, &self.context);
        let (physical, surface) = (context.physical, self.surface);
        // SAFETY (all here): plain queries of a live surface.
        let (can, formats, modes) = unsafe {
            let can = surfaces.get_physical_device_surface_support(physical, context.queue_family, surface);
            let formats = surfaces.get_physical_device_surface_formats(physical, surface);
            let modes = surfaces.get_physical_device_surface_present_modes(physical, surface);
            (can, formats, modes)
        };
        if !can.map_err(failed("vkGetPhysicalDeviceSurfaceSupportKHR", STAGE))? {
            return Err(Error::Simulation("its queue does not present there; name another".into()));
        }
        let formats = formats.map_err(failed("vkGetPhysicalDeviceSurfaceFormatsKHR", STAGE))?;
        let modes = modes.map_err(failed("vkGetPhysicalDeviceSurfacePresentModesKHR", STAGE))?;
        // Pictures are made as screens show them: a format that converts once more would brighten them.
        let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
        let format = formats.iter().find(|format| plain.contains(&format.format)).or(formats.first());
        self.format = *format.ok_or_else(|| Error::Simulation("no format is offered".into()))?;
        // In the first two nobody waits for the screen, with the queue held.
        let wanted = [vk::PresentModeKHR::MAILBOX, vk::PresentModeKHR::IMMEDIATE];
        self.mode = wanted.into_iter().find(|mode| modes.contains(mode)).unwrap_or(vk::PresentModeKHR::FIFO);
        Ok(())
    }

    /// A swapchain for a window of this size, in place of the last; none where there is nothing to show in.
    fn remake(&mut self, width: u32, height: u32) -> Result<()> {
        // What was shown last may still wait for its semaphore.
        self.commands.wait()?;
        if self.chain.is_some() {
            self.context.wait_idle();
        }
        let old = self.chain.take();
        // SAFETY: a plain query of a live surface.
        let can =
            unsafe { self.surfaces.get_physical_device_surface_capabilities(self.context.physical, self.surface) };
        let can = can.map_err(failed("vkGetPhysicalDeviceSurfaceCapabilitiesKHR", STAGE))?;
        // Where the surface has no size of its own, it takes the window's.
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
            return Err(Error::NoDevice(format!("{name} cannot show in a window: nothing can be copied into it")));
        }
        self.chain = Some(Chain::new(&self.context, &self.swapchains, &info, [width, height])?);
        drop(old);
        Ok(())
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // Shown pictures may still wait for their semaphores.
        let _ = self.commands.wait();
        self.context.wait_idle();
        self.chain = None;
        // SAFETY: its swapchain is gone and nothing is under way; the window is still there.
        unsafe { self.surfaces.destroy_surface(self.surface, None) };
    }
}
