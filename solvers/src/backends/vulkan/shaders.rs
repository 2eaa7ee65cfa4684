//! The shaders: committed SPIR-V and what each kernel is bound to.
//!
//! `shaders/*.comp` is compiled by `cargo xtask shaders`; tests compare hashes with `shaders/MANIFEST` and, where the
//! pinned compiler is there, compile again and compare bytes.

/// How a kernel uses the buffer at a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binding {
    /// Reads four 32-bit words or two f64: a texel buffer of four words, or a storage buffer.
    Words,
    /// Reads single 32-bit words: a texel buffer of one word, or a storage buffer.
    Indices,
    /// Reads f32: a texel buffer of four numbers, or a storage buffer.
    Reals,
    /// Writes, or reads what it writes too: always a storage buffer.
    Storage,
}

/// One kernel: its code for both ways of reading, and its interface.
pub struct Shader {
    /// SPIR-V that reads texel buffers.
    pub texel: &'static [u8],
    /// SPIR-V that reads storage buffers.
    pub storage: &'static [u8],
    /// Bindings 0, 1, ... of set 0.
    pub bindings: &'static [Binding],
    /// 32-bit words of push constants.
    pub push_words: usize,
}

/// Path of a committed variant.
macro_rules! spirv {
    ($name:literal, $real:literal, $read:literal) => {
        concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/src/backends/vulkan/shaders/spv/",
            $name,
            ".",
            $real,
            ".",
            $read,
            ".spv"
        )
    };
}

/// Two shaders from `shaders/NAME.comp` for the numbers REAL: they differ where storage buffers are read, in the second by
/// lanes that hand round what they read.
macro_rules! shader_pair {
    ($name:literal, $real:literal, $bindings:expr, $push_words:expr) => {{
        let plain = shader!($name, $real, $bindings, $push_words);
        let handed = Shader {
            texel: plain.texel,
            storage: include_bytes!(spirv!($name, $real, "shuffle")),
            bindings: plain.bindings,
            push_words: plain.push_words,
        };
        [plain, handed]
    }};
}

/// The shader compiled from `shaders/NAME.comp` for the numbers REAL that reads storage buffers everywhere.
macro_rules! storage_shader {
    ($name:literal, $real:literal, $bindings:expr, $push_words:expr) => {{
        const CODE: &[u8] = include_bytes!(spirv!($name, $real, "storage"));
        Shader { texel: CODE, storage: CODE, bindings: $bindings, push_words: $push_words }
    }};
}

/// The shader compiled from `shaders/NAME.comp` for the numbers REAL.
macro_rules! shader {
    ($name:literal, $real:literal, $bindings:expr, $push_words:expr) => {
        Shader {
            texel: include_bytes!(spirv!($name, $real, "texel")),
            storage: include_bytes!(spirv!($name, $real, "storage")),
            bindings: $bindings,
            push_words: $push_words,
        }
    };
}
