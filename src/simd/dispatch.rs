//! The choice between the forms of a pass.

#[cfg(target_arch = "x86_64")]
use super::avx2;
#[cfg(test)]
use super::tests;
use super::{Pass, ScalarLanes};

/// Runs a pass in the fastest form that the processor supports.
pub fn dispatch<P: Pass>(pass: P) -> P::Out {
    #[cfg(test)]
    if tests::SCALAR_ONLY.get() {
        return pass.run::<ScalarLanes>();
    }
    #[cfg(target_arch = "x86_64")]
    let pass = match avx2::run(pass) {
        Ok(out) => return out,
        Err(pass) => pass,
    };
    pass.run::<ScalarLanes>()
}

/// The name of the scalar form.
pub(crate) const SCALAR: &str = "scalar";

/// The instructions with which [`dispatch`] runs a pass here.
pub(crate) fn instructions() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if avx2::is_supported() {
        return "AVX2";
    }
    SCALAR
}
