//! Feeds the reader that the environment variable `READER` names with the inputs of libFuzzer, and compares the memory that all threads
//! take with the reader's limit.
#![no_main]

use libfuzzer_sys::fuzz_target;
use meniscus::untrusted::{READERS, Reader, reader};
use std::{
    alloc::{GlobalAlloc, Layout, System},
    sync::{
        LazyLock,
        atomic::{AtomicI64, Ordering::Relaxed},
    },
};

/// Bytes that are allocated now, and the maximum since an input began.
static CURRENT: AtomicI64 = AtomicI64::new(0);
static PEAK: AtomicI64 = AtomicI64::new(0);

/// The system's allocator, counted.
struct Counting;

fn count(bytes: i64) {
    let now = CURRENT.fetch_add(bytes, Relaxed) + bytes;
    PEAK.fetch_max(now, Relaxed);
}

// SAFETY: every call goes to `System`, whose contract is that of the trait.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        // SAFETY: the caller keeps the trait's contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        count(-(layout.size() as i64));
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as i64 - layout.size() as i64);
        // SAFETY: as above.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

static READER: LazyLock<&Reader> = LazyLock::new(|| {
    let name = std::env::var("READER").unwrap_or_default();
    let names = READERS.map(|reader| reader.name).join(", ");
    reader(&name).unwrap_or_else(|| panic!("READER={name:?}: expected one of {names}"))
});

fuzz_target!(|bytes: &[u8]| {
    let reader = *READER;
    let before = CURRENT.load(Relaxed);
    PEAK.store(before, Relaxed);
    (reader.read)(bytes);
    let (taken, max) = (PEAK.load(Relaxed) - before, reader.max_memory(bytes.len()) as i64);
    assert!(taken <= max, "{}: {taken} bytes of memory for {} bytes, at most {max}", reader.name, bytes.len());
});
