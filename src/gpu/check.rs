//! What a pass is given, held against what its shader declares: the checks of [`Recorder`], all named by stage, kernel
//! and array.

use ash::vk::{AccessFlags2 as Access, Handle, PipelineStageFlags2 as Stages};

use super::barrier::Use;
use super::buffer::Buffer;
use super::kernel::Interface;
use super::recorder::Recorder;
use super::spirv::{Binding, BindingKind};
use crate::error::Result;

impl Recorder {
    /// What the shader does with each buffer; an error where buffers and bindings do not fit.
    pub(super) fn check_uses(
        &self,
        interface: &Interface,
        buffers: &[&Buffer],
        push: &[u8],
        stages: Stages,
    ) -> Result<Vec<Use>> {
        let (name, bindings) = (&interface.name, &interface.reflection.bindings);
        if bindings.len() != buffers.len() {
            let wants: Vec<_> = bindings.iter().map(|b| b.name.as_str()).collect();
            let given: Vec<_> = buffers.iter().map(|b| b.name()).collect();
            let what = format!("kernel {name} binds ({}), but was given ({})", wants.join(", "), given.join(", "));
            return Err(self.error(what));
        }
        let push_bytes = interface.reflection.push_bytes as usize;
        if push.len() != push_bytes {
            let what = format!("kernel {name} has {push_bytes} bytes of push constants, but was given {}", push.len());
            return Err(self.error(what));
        }
        let mut uses: Vec<Use> = Vec::with_capacity(buffers.len() + 2);
        for (binding, buffer) in bindings.iter().zip(buffers) {
            self.check_binding(name, binding, buffer)?;
            let write_access = if binding.writes { Access::SHADER_STORAGE_WRITE } else { Access::NONE };
            let id = buffer.0.handle.as_raw();
            if uses.iter().any(|u| u.id == id && (u.writes || binding.writes)) {
                let what = format!("kernel {name} writes {} and is also given it as {}", buffer.name(), binding.name);
                return Err(self.error(what));
            }
            uses.push(Use { id, reads: binding.reads, writes: binding.writes, stages, write_access });
        }
        Ok(uses)
    }

    fn check_binding(&self, kernel: &str, binding: &Binding, buffer: &Buffer) -> Result<()> {
        let limits = &self.commands.context.limits;
        let (bytes, slot) = (buffer.bytes(), &binding.name);
        let what = match binding.kind {
            BindingKind::Storage => return Ok(()),
            BindingKind::Uniform if bytes <= u64::from(limits.max_uniform_buffer_range) => return Ok(()),
            BindingKind::Uniform => format!("a uniform block holds at most {}", limits.max_uniform_buffer_range),
            _ if buffer.0.views.is_some() => return Ok(()),
            _ if bytes % 16 != 0 => "a texel buffer is made of elements of 16".into(),
            _ => format!("a texel buffer holds at most {} elements of 16", limits.max_texel_buffer_elements),
        };
        Err(self.error(format!("kernel {kernel}: array {} as {slot}: it has {bytes} bytes, but {what}", buffer.name())))
    }

    pub(super) fn check_args(&self, args: &Buffer, offset: u64, bytes: u64) -> Result<()> {
        if offset + bytes <= args.bytes() {
            return Ok(());
        }
        let (name, size) = (args.name(), args.bytes());
        Err(self.error(format!("indirect arguments at byte {offset} lie outside {name} of {size} bytes")))
    }

    /// Adds the reading of indirect arguments. The pass may write them itself, for later ones: its own are read before
    /// any of its invocations runs.
    pub(super) fn add_args(&mut self, uses: &mut Vec<Use>, args: &Buffer) {
        let id = args.0.handle.as_raw();
        self.keep(args);
        uses.push(Use { id, reads: true, writes: false, stages: Stages::DRAW_INDIRECT, write_access: Access::NONE });
    }
}
