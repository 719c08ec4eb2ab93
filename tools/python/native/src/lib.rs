//! C interface of [`meniscus::mesh::reconstruct`] for the Python package `meniscus_fx` (`tools/python/meniscus_fx/_native.py`).
//!
//! Arrays come in as pointers and are read in place. A call gives an [`Outcome`], which owns the mesh: its columns are pointers into
//! it, valid until [`meniscus_outcome_free`]. No panic leaves a function: an unwinding panic becomes an outcome of its own, and so
//! does memory that the system refuses (`memory.rs`).
//!
//! `docs/decisions/037-python-module.md` has the reasons. Each `unsafe` names the part of the contract that it relies on; the caller
//! keeps the contract in one file, next to [`ABI`].

mod call;
mod memory;
mod outcome;
mod request;

use call::supervised;
use meniscus::{
    control::CancelToken,
    frame::{Column, Columns},
    math::Vec3,
};
use outcome::{Outcome, OutcomeColumn};
use request::{Failure, Request};
use std::{ffi::c_void, path::PathBuf, ptr, slice, str};

/// Version of this interface, which the Python side compares with its own.
const ABI: u32 = 2;

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
    /// Memory that the surface may need [bytes]; 0: what the system grants.
    pub max_memory: u64,
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
/// All pointers of the request are valid for reads of the lengths next to them until the call returns, and nothing writes there. If
/// the status is 6, this holds until the process ends.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_reconstruct(request: *const RawRequest) -> *mut Outcome {
    // SAFETY: the caller's contract.
    let raw = unsafe { *request };
    // SAFETY: likewise.
    let cancel = unsafe { &*raw.cancel }.clone();
    let request = Shared(raw);
    let outcome = supervised(cancel, move |memory| {
        let request = request;
        // SAFETY: the caller's contract.
        let made = unsafe { read_request(&request.0) }.and_then(|request| request.run(memory));
        // Its report is made here, too.
        Some(Outcome::new(made))
    });
    outcome.map_or(ptr::null_mut(), |outcome| Box::into_raw(Box::new(outcome)))
}

/// What belongs to the caller, for the thread of a call.
struct Shared<T>(T);

// SAFETY: the callers of `meniscus_reconstruct` and `meniscus_outcome_write` keep what it points to, and nothing writes there.
unsafe impl<T> Send for Shared<T> {}

/// Whether there is a mesh (0), or why not: 1 a parameter, 2 the particles, 3 cancelled, 4 a bug, 5 the system refused memory, 6 as 5, and
/// threads of the call still use what was passed to it.
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
/// As [`meniscus_outcome_status`]; `path` is valid for reads of its length. If the status of what is returned is 6, `outcome` is not
/// freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn meniscus_outcome_write(outcome: *const Outcome, path: Text) -> *mut Outcome {
    // SAFETY: the caller's contract.
    let path = unsafe { read_text(path) }.map(PathBuf::from);
    // SAFETY: likewise.
    let outcome: Shared<&'static Outcome> = Shared(unsafe { &*outcome });
    let failure = supervised(CancelToken::new(), move |memory| {
        let outcome = outcome;
        let written = path.and_then(|path| outcome.0.write(&path, memory));
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

/// The request, borrowed from its caller.
///
/// # Safety
/// As [`meniscus_reconstruct`].
unsafe fn read_request(raw: &RawRequest) -> Result<Request<'static>, Failure> {
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
        max_memory: raw.max_memory,
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
