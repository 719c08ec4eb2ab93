//! The memory allocator of the program: the system's, with an end in words where the system refuses memory.
#![allow(unsafe_code)] // A trait of the standard library that can only be implemented so; see docs/decisions/025.

use super::exit::OVER_MEMORY;
use crate::control::{frames_under_way, may_fail};
use std::{
    alloc::{GlobalAlloc, Layout, System},
    fmt::{self, Write as _},
    io::{self, Write as _},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

/// The system's allocator. Where the system refuses memory, the program ends with exit code 33 and names the frames that were under
/// way, instead of being aborted by a signal; finished frames are on disk by then. Code that deals with refused memory itself
/// gets the null pointer that it expects.
///
/// Linux refuses memory under `ulimit -v` or where overcommitment is off. A process that it kills for memory (SIGKILL) reports nothing.
#[derive(Debug)]
pub struct Allocator;

// SAFETY: every call goes to `System`, whose contract is that of the trait; what it returns is passed on.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the trait's contract.
        granted(layout.size(), || unsafe { System.alloc(layout) })
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as above; the memory is of `System`.
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        granted(layout.size(), || unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above; memory stays as it is where the system refuses more.
        granted(size, || unsafe { System.realloc(memory, layout, size) })
    }
}

/// Number of times that refused memory is requested again, a millisecond later each. Under `ulimit -v` the system's allocator
/// takes 128 MiB of addresses for a moment whenever a thread starts to allocate, and other threads are then refused a few bytes.
const MAX_RETRIES: u32 = 20;

/// Memory below which a refusal is never taken for an answer at once [bytes]: it is the moment that is short of addresses, not the machine.
const ALWAYS_EXPECTED: usize = 1 << 20;

/// The memory that `request` gets; does not return where there is none and the caller does not expect that.
fn granted(size: usize, request: impl Fn() -> *mut u8) -> *mut u8 {
    let memory = request();
    if memory.is_null() && (size < ALWAYS_EXPECTED || !may_fail()) {
        requested_again(size, request)
    } else {
        memory
    }
}

#[cold]
fn requested_again(size: usize, request: impl Fn() -> *mut u8) -> *mut u8 {
    for _ in 0..MAX_RETRIES {
        thread::sleep(Duration::from_millis(1));
        let memory = request();
        if !memory.is_null() {
            return memory;
        }
    }
    if may_fail() { std::ptr::null_mut() } else { end(size) }
}

/// Ends the program; allocates nothing.
#[cold]
fn end(size: usize) -> ! {
    /// Other threads may come here at the same time; one writes.
    static IS_ENDING: AtomicBool = AtomicBool::new(false);
    if IS_ENDING.swap(true, Ordering::SeqCst) {
        // Also where writing itself was refused memory.
        thread::sleep(Duration::from_secs(1));
    } else {
        let mut text = Text { bytes: [0; 1024], length: 0 };
        // A text that is too long is cut.
        let _ = describe(size, &mut text);
        // There is no other place to report to.
        let _ = io::stderr().write_all(&text.bytes[..text.length]);
    }
    leave()
}

#[cfg(unix)]
fn leave() -> ! {
    // Not the end of `main`: what runs there may wait for other threads or for memory.
    signal_hook::low_level::exit(OVER_MEMORY.into())
}

#[cfg(not(unix))]
fn leave() -> ! {
    std::process::exit(OVER_MEMORY.into())
}

/// Maximum number of frames that the message names.
const MAX_NAMED: usize = 16;

fn describe(size: usize, text: &mut Text) -> fmt::Result {
    write!(text, "\nerror: the system refused {size} bytes of memory")?;
    let count = frames_under_way().count();
    // Without memory of its own, and in the order of frames.
    let (mut named, mut length) = ([0; MAX_NAMED], 0);
    for frame in frames_under_way().take(MAX_NAMED) {
        (named[length], length) = (frame, length + 1);
    }
    named[..length].sort_unstable();
    for (place, frame) in named[..length].iter().enumerate() {
        let before = match (place, count) {
            (0, 1) => ", while frame ",
            (0, _) => ", while frames ",
            _ => ", ",
        };
        write!(text, "{before}{frame}")?;
    }
    match count {
        0 => {}
        1 => write!(text, " was under way")?,
        2..=MAX_NAMED => write!(text, " were under way")?,
        _ => write!(text, " and {} more were under way", count - MAX_NAMED)?,
    }
    writeln!(
        text,
        "\nfinished frames are kept, and the same command continues: allow more memory (`ulimit -v`), end other programs, \
         lower --max-memory so that fewer frames run at once, or choose a coarser resolution (`meniscus plan`)"
    )
}

/// Text in a piece of memory that is there already.
struct Text {
    bytes: [u8; 1024],
    length: usize,
}

impl fmt::Write for Text {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        let free = &mut self.bytes[self.length..];
        let count = part.len().min(free.len());
        free[..count].copy_from_slice(&part.as_bytes()[..count]);
        self.length += count;
        if count == part.len() { Ok(()) } else { Err(fmt::Error) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_is_too_long_is_cut() {
        let mut text = Text { bytes: [0; 1024], length: 0 };
        assert!(text.write_str(&"a".repeat(1000)).is_ok());
        assert!(text.write_str(&"b".repeat(25)).is_err());
        assert_eq!((text.length, text.bytes[1023]), (1024, b'b'));
    }
}
