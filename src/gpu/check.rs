//! Checks the arguments of a pass (dispatch or draw) against the interface that its shader declares: methods of
//! [`Recorder`]. An interface is the declared buffers and push constants. Errors name the stage of the step, the kernel
//! and the array.

use ash::vk::{AccessFlags2 as Access, Handle, PipelineStageFlags2 as Stages};

use super::arguments::Arguments;
use super::barrier::Use;
use super::buffer::Buffer;
use super::kernel::Interface;
use super::recorder::Recorder;
use super::spirv::{Binding, BindingKind};
use crate::error::Result;

impl Recorder {
    /// Returns the buffers of a pass in the order of the shader's bindings, and how the shader uses each buffer. Fails
    /// where the arguments do not fit the shader.
    pub(super) fn check_uses<'a>(
        &self,
        interface: &Interface,
        arguments: &'a dyn Arguments,
        stages: Stages,
    ) -> Result<(Vec<&'a Buffer>, Vec<Use>)> {
        let name = &interface.name;
        if arguments.shader() != name {
            return Err(self.error(format!("kernel {name} was given the arguments of {}", arguments.shader())));
        }
        let given = arguments.buffers();
        if let Some((unknown, _)) = given.iter().find(|(name, _)| !interface.declared.iter().any(|d| d == name)) {
            let declared = interface.declared.join(", ");
            return Err(self.error(format!("kernel {name} has no buffer {unknown}; its buffers are {declared}")));
        }
        // Buffers that this variant of the shader does not use are checked too, so that a wrong array is found with
        // every variant.
        for (slot, buffer) in given.iter().filter_map(|(slot, buffer)| Some((slot, (*buffer)?))) {
            if !buffer.may_be(slot) {
                let what = format!("kernel {name}: array {} may not be bound to its buffer {slot}", buffer.name());
                return Err(self.error(what));
            }
        }
        let (push, wanted) = (arguments.push().len(), interface.reflection.push_bytes as usize);
        if push != wanted {
            return Err(self.error(format!("kernel {name} has {wanted} bytes of push constants, but was given {push}")));
        }
        let (mut buffers, mut uses) = (Vec::new(), Vec::<Use>::new());
        for binding in &interface.reflection.bindings {
            let buffer = given.iter().find(|(given, _)| *given == binding.name).and_then(|(_, buffer)| *buffer);
            let Some(buffer) = buffer else {
                return Err(self.error(format!("kernel {name} uses buffer {}, which was left out", binding.name)));
            };
            self.check_binding(name, binding, buffer)?;
            let write_access = if binding.writes { Access::SHADER_STORAGE_WRITE } else { Access::NONE };
            let id = buffer.inner.handle.as_raw();
            if uses.iter().any(|u| u.id == id && (u.writes || binding.writes)) {
                let what =
                    format!("kernel {name} writes array {} and also binds it to {}", buffer.name(), binding.name);
                return Err(self.error(what));
            }
            uses.push(Use { id, reads: binding.reads, writes: binding.writes, stages, write_access });
            buffers.push(buffer);
        }
        Ok((buffers, uses))
    }

    fn check_binding(&self, kernel: &str, binding: &Binding, buffer: &Buffer) -> Result<()> {
        let limits = &self.commands.context.limits;
        let (bytes, slot) = (buffer.bytes(), &binding.name);
        let what = match binding.kind {
            BindingKind::Storage => return Ok(()),
            BindingKind::Uniform if bytes <= u64::from(limits.max_uniform_buffer_range) => return Ok(()),
            BindingKind::Uniform => format!("a uniform block holds at most {} bytes", limits.max_uniform_buffer_range),
            _ if buffer.inner.views.is_some() => return Ok(()),
            _ if bytes % 16 != 0 => "a texel buffer needs a multiple of 16 bytes".into(),
            _ => format!("a texel buffer holds at most {} elements of 16 bytes", limits.max_texel_buffer_elements),
        };
        Err(self
            .error(format!("kernel {kernel}: array {} for buffer {slot} has {bytes} bytes, but {what}", buffer.name())))
    }

    pub(super) fn check_args(&self, args: &Buffer, offset: u64, bytes: u64) -> Result<()> {
        if offset + bytes <= args.bytes() {
            return Ok(());
        }
        let (name, size) = (args.name(), args.bytes());
        Err(self.error(format!("indirect arguments at byte {offset} lie outside array {name} of {size} bytes")))
    }

    /// Adds the reading of indirect arguments to the uses of a pass. The pass itself may write the buffer `args` for
    /// later passes: its own arguments are read before any of its invocations runs.
    pub(super) fn add_args(&mut self, uses: &mut Vec<Use>, args: &Buffer) {
        let id = args.inner.handle.as_raw();
        self.keep(args);
        uses.push(Use { id, reads: true, writes: false, stages: Stages::DRAW_INDIRECT, write_access: Access::NONE });
    }
}
