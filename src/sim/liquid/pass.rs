//! Passes over neighbour lists, written once for every kernel pair and every form of lanes.

use super::{
    Kernel,
    lanes::{Eight, Lanes},
    pair::{Pair, Poly6Spiky, Wendland},
};

/// The work of one chunk.
pub(super) trait Pass {
    /// What it finds.
    type Out;
    /// Does the work. To be inlined always, so that the form's instructions reach every line of it.
    fn run<L: Lanes, P: Pair>(self) -> Self::Out;
}

/// Does `pass` with the kernel pair, in the fastest form that the processor runs.
pub(super) fn run<W: Pass>(kernel: Kernel, pass: W) -> W::Out {
    match kernel {
        Kernel::Poly6Spiky => run_with::<W, Poly6Spiky>(pass),
        Kernel::Wendland => run_with::<W, Wendland>(pass),
    }
}

fn run_with<W: Pass, P: Pair>(pass: W) -> W::Out {
    #[cfg(target_arch = "x86_64")]
    if super::lanes_avx2::available() {
        return super::lanes_avx2::run::<W, P>(pass);
    }
    pass.run::<Eight, P>()
}
