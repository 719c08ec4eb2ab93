//! C interface of [`meniscus::mesh::reconstruct`] for the Python package `meniscus_fx` (`tools/python/meniscus_fx/_native.py`).
//!
//! Arrays come in as pointers and are read in place. A call gives an [`Outcome`], which owns the mesh: its columns are pointers into
//! it, valid until [`meniscus_outcome_free`]. No panic leaves a function: an unwinding panic becomes an outcome of its own.
//!
//! `docs/decisions/037-python-module.md` has the reasons. Each `unsafe` names the part of the contract that it relies on; the caller
//! keeps the contract in one file, next to [`ABI`].

mod outcome;
mod request;

use meniscus::{
    control::CancelToken,
    frame::{Column, Columns},
    math::Vec3,
};
use outcome::{Outcome, OutcomeColumn};
use request::{Failure, Request, panic_text};
use std::{
    ffi::c_void,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    ptr, slice, str,
};

/// Version of this interface, which the Python side compares with its own.
const ABI: u32 = 1;

/// UTF-8 text that belongs to the other side of a call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Text {
    /// First byte; may be null if `len` is 0.
    pub data: *const u8,
    /// Number of bytes.
    pub len: usize,
}

/// A column of particles: aligned, contiguous, unchanged during the call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct InputColumn {
    /// Name, such as `position`.
    pub name: Text,
    /// 1: f32, 2: three f32, 3: u32.
    pub kind: u32,
    /// As many values as there are particles; may be null without particles.
    pub data: *const c_void,
}

/// What [`meniscus_reconstruct`] makes a surface of.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawRequest {
    /// Number of particles.
    pub particles: usize,
    /// Columns of the particles.
    pub columns: *const InputColumn,
    /// Number of columns.
    pub column_count: usize,
    /// Spacing of the particles [m].
    pub spacing: f64,
    /// Quality tier; empty: the defaults of `[surface]`.
    pub quality: Text,
    /// Settings, each `surface.key=value`.
    pub settings: *const Text,
    /// Number of settings.
    pub setting_count: usize,
    /// Threads; 0: one a core.
    pub threads: usize,
    /// Flag from [`meniscus_cancel_new`].
    pub cancel: *const CancelToken,
}

/// The version of this interface.
#[unsafe(no_mangle)]
pub extern "C" fn meniscus_abi() -> u32 {
    ABI
}

/// The version of the library. The text is static.
#[unsafe(no_mangle)]
pub extern "C" fn meniscus_version() -> Text {
    text_of(env!("CARGO_PKG_VERSION"))
}

/// A flag that cancels a call from another thread, to be freed by [`meniscus_cancel_free`].
#[unsafe(no_mangle)]
pub extern "C" fn meniscus_cancel_new() -> *mut CancelToken {
    Box::into_raw(Box::new(CancelToken::new()))
}

/// Sets a flag.
///
/// # Safety
/// `flag` is from [`meniscus_cancel_new`] and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_cancel_set(flag: *const CancelToken) {
    // SAFETY: the caller's contract; tokens are shared between threads.
    unsafe { &*flag }.cancel();
}

/// Frees a flag.
///
/// # Safety
/// `flag` is from [`meniscus_cancel_new`], was not freed, and no call uses it any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_cancel_free(flag: *mut CancelToken) {
    // SAFETY: the caller's contract.
    drop(unsafe { Box::from_raw(flag) });
}

/// Makes the surface of particles. Never null; to be freed by [`meniscus_outcome_free`].
///
/// # Safety
/// All pointers of the request are valid for reads of the lengths next to them until the call returns, and nothing writes there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_reconstruct(request: *const RawRequest) -> *mut Outcome {
    let outcome = without_unwinding(|| {
        // SAFETY: the caller's contract.
        let raw = unsafe { &*request };
        // SAFETY: likewise.
        let made = unsafe { read_request(raw) }.and_then(|request| {
            // SAFETY: likewise.
            let cancel = unsafe { &*raw.cancel };
            request.run(cancel)
        });
        // Its report is made here, too.
        Some(Outcome::new(made))
    });
    outcome.map_or(ptr::null_mut(), |outcome| Box::into_raw(Box::new(outcome)))
}

/// Whether there is a mesh (0), or why not: 1 a parameter, 2 the particles, 3 cancelled, 4 a bug.
///
/// # Safety
/// `outcome` is from [`meniscus_reconstruct`] and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_outcome_status(outcome: *const Outcome) -> u32 {
    // SAFETY: the caller's contract.
    unsafe { &*outcome }.status()
}

/// The report of the surface as JSON, or the message of the failure; valid until the outcome is freed.
///
/// # Safety
/// As [`meniscus_outcome_status`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_outcome_text(outcome: *const Outcome) -> Text {
    // SAFETY: the caller's contract.
    text_of(unsafe { &*outcome }.text())
}

/// Number of columns of the mesh: 0 if there is none.
///
/// # Safety
/// As [`meniscus_outcome_status`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_outcome_column_count(outcome: *const Outcome) -> usize {
    // SAFETY: the caller's contract.
    unsafe { &*outcome }.columns().len()
}

/// A column of the mesh; valid until the outcome is freed.
///
/// # Safety
/// As [`meniscus_outcome_status`]; `column` is below [`meniscus_outcome_column_count`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_outcome_column(outcome: *const Outcome, column: usize) -> OutcomeColumn {
    // SAFETY: the caller's contract.
    unsafe { &*outcome }.columns().get(column).copied().unwrap_or_else(OutcomeColumn::none)
}

/// Writes the mesh to a file, PLY or OBJ by the name's ending. Null if it is written, else an outcome with the reason, to be freed
/// by [`meniscus_outcome_free`].
///
/// # Safety
/// As [`meniscus_outcome_status`]; `path` is valid for reads of its length.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_outcome_write(outcome: *const Outcome, path: Text) -> *mut Outcome {
    let failure = without_unwinding(|| {
        // SAFETY: the caller's contract.
        let (outcome, path) = unsafe { (&*outcome, read_text(path)) };
        let written = path.and_then(|path| outcome.write(Path::new(path)));
        written.err().map(|failure| Outcome::new(Err(failure)))
    });
    failure.map_or(ptr::null_mut(), |failure| Box::into_raw(Box::new(failure)))
}

/// Frees an outcome and its mesh.
///
/// # Safety
/// `outcome` is from this library, was not freed, and its texts and columns are not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_outcome_free(outcome: *mut Outcome) {
    // SAFETY: the caller's contract.
    drop(unsafe { Box::from_raw(outcome) });
}

/// The result of a job, or the outcome of its panic.
fn without_unwinding(job: impl FnOnce() -> Option<Outcome>) -> Option<Outcome> {
    catch_unwind(AssertUnwindSafe(job))
        .unwrap_or_else(|panic| Some(Outcome::new(Err(Failure::Internal(panic_text(&*panic))))))
}

/// The request, borrowed from its caller.
///
/// # Safety
/// As [`meniscus_reconstruct`].
unsafe fn read_request(raw: &RawRequest) -> Result<Request<'_>, Failure> {
    // SAFETY: the caller's contract, also for every line below.
    let columns = unsafe { array(raw.columns, raw.column_count) };
    let mut particles = Columns::new(raw.particles);
    for column in columns {
        // SAFETY: as above.
        let name = unsafe { read_text(column.name) }?;
        if particles.column(name).is_some() {
            return Err(Failure::Particles(format!("column `{}` is there twice", name.escape_debug())));
        }
        // SAFETY: as above: `data` has `particles` values of the kind, and vectors are three numbers.
        let values = unsafe {
            match column.kind {
                1 => Column::F32(array(column.data.cast(), raw.particles)),
                2 => Column::Vec3(bytemuck::cast_slice::<[f32; 3], Vec3>(array(
                    column.data.cast(),
                    raw.particles,
                ))),
                3 => Column::U32(array(column.data.cast(), raw.particles)),
                kind => {
                    let name = name.escape_debug();
                    return Err(Failure::Particles(format!(
                        "column `{name}`: kind {kind}, expected 1, 2 or 3"
                    )));
                }
            }
        };
        particles = particles.with(name, values);
    }
    // SAFETY: as above.
    let settings = unsafe { array(raw.settings, raw.setting_count) };
    // SAFETY: as above.
    let settings = settings.iter().map(|&text| unsafe { read_text(text) }.map(str::to_owned));
    Ok(Request {
        particles,
        spacing: raw.spacing,
        // SAFETY: as above.
        quality: unsafe { read_text(raw.quality) }?,
        settings: settings.collect::<Result<_, _>>()?,
        threads: raw.threads,
    })
}

/// An array of the caller; without entries its pointer is not looked at.
///
/// # Safety
/// `data` is aligned and valid for reads of `len` values during `'a`, or `len` is 0.
unsafe fn array<'a, T>(data: *const T, len: usize) -> &'a [T] {
    if len == 0 {
        return &[];
    }
    // SAFETY: the caller's contract.
    unsafe { slice::from_raw_parts(data, len) }
}

/// A text of the caller.
///
/// # Safety
/// As [`array`].
unsafe fn read_text<'a>(text: Text) -> Result<&'a str, Failure> {
    // SAFETY: the caller's contract.
    let bytes = unsafe { array(text.data, text.len) };
    str::from_utf8(bytes).map_err(|error| Failure::Parameter(format!("a text is not UTF-8: {error}")))
}

/// A text for the caller.
pub(crate) fn text_of(text: &str) -> Text {
    Text { data: text.as_ptr(), len: text.len() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_outcome() {
        let outcome = without_unwinding(|| panic!("planted")).unwrap();
        assert_eq!((outcome.status(), outcome.text()), (4, "planted"));
        assert!(without_unwinding(|| None).is_none());
    }
}
