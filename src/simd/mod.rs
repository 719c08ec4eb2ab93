//! Eight numbers at a time: the one place for vector instructions, and the only one with `unsafe` but for the allocator's trait.
//!
//! A [`Pass`] is a loop written once. [`dispatch`] compiles it twice, with [`ScalarLanes`] for any processor
//! and with AVX2 for those that have it, and runs the faster form that the processor supports. A pass can use
//! lanes in two ways:
//! - by the operations of [`Lanes`], which become one instruction each;
//! - by plain loops over [`F32x8`], which the compiler vectorises with the instructions of the form.
//!
//! Both forms give the same bits: there are no fused multiply-adds, no reordered sums and no approximate
//! reciprocals, and [`ScalarLanes`] is the readable reference of every operation.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod dispatch;
mod index_row;
mod indices;
mod lanes;
mod scalar;
mod width;

pub use dispatch::dispatch;
pub(crate) use dispatch::{SCALAR, instructions};
pub(crate) use index_row::IndexRow;
pub(crate) use indices::{IndexList, IndexRows};
pub use lanes::{Lanes, Pass, splat, sum};
pub use scalar::ScalarLanes;
pub use width::{F32x8, LANES};

#[cfg(test)]
pub(crate) mod tests;
