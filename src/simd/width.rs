//! How many numbers are handled at once.

/// Numbers handled at once.
pub const LANES: usize = 8;

/// Eight numbers in memory.
pub type F32x8 = [f32; LANES];
