//! What a pass is given: every buffer under the name that the shader has for it. The build script makes a type of each shader's
//! arguments; see `src/shaders.rs`.

use super::Buffer;

/// The arguments of a shader.
pub trait Arguments {
    /// Its name, as in `solve/apply`; of the two shaders of a graphics pipeline the name without an ending.
    fn shader(&self) -> &str;

    /// A buffer for each that the shader declares; `None`: left out, which a variant may that never uses it.
    fn buffers(&self) -> Vec<(&str, Option<&Buffer>)>;

    /// Push constants.
    fn push(&self) -> Vec<u8>;
}

/// Arguments of a shader whose name is known only at run time.
pub struct Named<'a> {
    /// As [`Arguments::shader`].
    pub shader: &'a str,
    /// As [`Arguments::buffers`], in any order.
    pub buffers: &'a [(&'a str, &'a Buffer)],
    /// As [`Arguments::push`].
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
