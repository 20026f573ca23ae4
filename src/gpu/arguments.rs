//! The arguments of a pass (one dispatch or draw): a buffer for each buffer name that the pass's shader declares, and
//! the push constants. The build script generates one struct of arguments per shader; see `src/shaders.rs`.

use super::Buffer;

/// The arguments of one pass.
pub trait Arguments {
    /// The shader's name, as in `solve/element_product`; for the two shaders of a graphics pipeline, the name without
    /// `.vert` and `.frag`.
    fn shader(&self) -> &str;

    /// One entry per buffer that the shader declares: the declared name, and the buffer that is bound to it. `None`
    /// leaves the buffer out, which is allowed for a shader variant that never uses it.
    fn buffers(&self) -> Vec<(&str, Option<&Buffer>)>;

    /// The bytes of the push constants.
    fn push(&self) -> Vec<u8>;
}

/// Arguments of a shader whose name is known only at run time.
pub struct Named<'a> {
    /// Name of the shader; see [`Arguments::shader`].
    pub shader: &'a str,
    /// Buffers by name, in any order; see [`Arguments::buffers`].
    pub buffers: &'a [(&'a str, &'a Buffer)],
    /// Bytes of the push constants; see [`Arguments::push`].
    pub push: &'a [u8],
}

impl Arguments for Named<'_> {
    fn shader(&self) -> &str {
        self.shader
    }

    fn buffers(&self) -> Vec<(&str, Option<&Buffer>)> {
        self.buffers.iter().map(|(name, buffer)| (*name, Some(*buffer))).collect()
    }

    fn push(&self) -> Vec<u8> {
        self.push.to_vec()
    }
}
