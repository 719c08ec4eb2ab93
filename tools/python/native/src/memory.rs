//! Memory that the system refuses ends a call, not the interpreter.
//!
//! Rust's library aborts the process where an allocation fails, and an allocator may not unwind. What a call needs is therefore estimated
//! and requested before its work ([`CallMemory::hold`]), and a reserve is kept. Where the system refuses more all the same, the
//! allocator frees the reserve, cancels the call and requests the memory again: the call ends after the pass that runs, and its memory is
//! freed. Where even that is refused, the thread sleeps for ever, and the call is abandoned: its memory and its threads stay until
//! the process ends.
//!
//! `docs/decisions/037-python-module.md` has the reasons.

use meniscus::{
    control::CancelToken,
    par::{self, ThreadsRefused},
};
use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
    hint::black_box,
    ptr,
    sync::atomic::{AtomicBool, AtomicPtr, AtomicUsize, Ordering},
    thread::{self, Thread},
    time::Duration,
};

/// The system's allocator, which deals with memory that is refused to the threads of a call.
#[derive(Debug)]
struct Allocator;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

// SAFETY: every call goes to `System`, whose contract is that of the trait; what it returns is passed on.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the trait's contract.
        granted(|| unsafe { System.alloc(layout) })
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as above; the memory is of `System`.
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        granted(|| unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above; memory stays as it is where the system refuses more.
        granted(|| unsafe { System.realloc(memory, layout, size) })
    }
}

/// Number of times that refused memory is requested again, a millisecond later each. Under `ulimit -v` the system's allocator
/// takes 128 MiB of addresses for a moment whenever a thread starts to allocate.
const MAX_RETRIES: u32 = 20;

/// Number of times that it is requested after the reserve was freed: other threads of the call need some of it, and free theirs
/// when they are done.
const MAX_RETRIES_OF_CANCELLED: u32 = 200;

thread_local! {
    /// The call that a thread works for; null: none. It needs no memory of its own.
    static CALL: Cell<*const CallMemory> = const { Cell::new(ptr::null()) };
}

/// The memory that `request` gets. A thread of a call does not return without any.
fn granted(request: impl Fn() -> *mut u8) -> *mut u8 {
    let memory = request();
    if memory.is_null() { requested_again(request) } else { memory }
}

#[cold]
fn requested_again(request: impl Fn() -> *mut u8) -> *mut u8 {
    let repeatedly = |count: u32| {
        (0..count).find_map(|_| {
            thread::sleep(Duration::from_millis(1));
            Some(request()).filter(|memory| !memory.is_null())
        })
    };
    if let Some(memory) = repeatedly(MAX_RETRIES) {
        return memory;
    }
    // SAFETY: a call outlives its threads' work for it: `CallMemory::on_threads` and `work_for` set and clear the pointer.
    let Some(call) = (unsafe { CALL.get().as_ref() }) else { return ptr::null_mut() };
    call.end_for_lack_of_memory();
    repeatedly(MAX_RETRIES_OF_CANCELLED).unwrap_or_else(|| call.abandon())
}

/// What the allocator needs to know of a call.
#[derive(Debug)]
pub(crate) struct CallMemory {
    cancel: CancelToken,
    /// Waits for the call.
    owner: Thread,
    /// Memory that the call does not use unless the system refuses more; null: there is none.
    reserve: AtomicPtr<u8>,
    reserved: AtomicUsize,
    was_refused: AtomicBool,
    is_abandoned: AtomicBool,
}

impl CallMemory {
    /// Smallest reserve [bytes].
    const MIN_RESERVE: usize = 4 << 20;

    /// Alignment of reserves [bytes].
    const ALIGNMENT: usize = 16;

    /// The memory of a call that this thread waits for.
    pub(crate) fn new(cancel: CancelToken) -> Self {
        Self {
            cancel,
            owner: thread::current(),
            reserve: AtomicPtr::new(ptr::null_mut()),
            reserved: AtomicUsize::new(0),
            was_refused: AtomicBool::new(false),
            is_abandoned: AtomicBool::new(false),
        }
    }

    pub(crate) fn cancel(&self) -> &CancelToken {
        &self.cancel
    }

    /// Wakes the thread that waits for the call.
    pub(crate) fn wake_owner(&self) {
        self.owner.unpark();
    }

    /// Whether the system refused memory to the call, which was cancelled for it.
    pub(crate) fn was_refused(&self) -> bool {
        self.was_refused.load(Ordering::SeqCst)
    }

    /// Whether a thread of the call waits for ever.
    pub(crate) fn is_abandoned(&self) -> bool {
        self.is_abandoned.load(Ordering::SeqCst)
    }

    /// Whether the system grants `bytes` and a reserve now, of which the reserve is kept: a quarter, the estimate's error.
    pub(crate) fn hold(&self, bytes: u64) -> bool {
        self.free_reserve();
        let reserve = usize::try_from(bytes / 4).unwrap_or(usize::MAX).max(Self::MIN_RESERVE);
        let kept = system_memory(reserve, Self::ALIGNMENT);
        if kept.is_null() {
            return false;
        }
        self.reserved.store(reserve, Ordering::SeqCst);
        self.reserve.store(kept, Ordering::SeqCst);
        is_granted(bytes)
    }

    /// Runs `job` on `threads` threads that work for this call.
    pub(crate) fn on_threads<R: Send>(
        &self,
        threads: usize,
        job: impl FnOnce() -> R + Send,
    ) -> Result<R, ThreadsRefused> {
        let call = Address(self);
        par::try_with_threads(threads, move || {
            // Also where the job panics: a thread may end after the call.
            let _worker = WorksFor::new(call, true);
            job()
        })
    }

    /// Runs `job` on this thread, which works for this call meanwhile.
    pub(crate) fn work_for<R>(&self, job: impl FnOnce() -> R) -> R {
        let _worker = WorksFor::new(Address(self), false);
        job()
    }

    fn end_for_lack_of_memory(&self) {
        self.was_refused.store(true, Ordering::SeqCst);
        self.cancel.cancel();
        self.free_reserve();
    }

    fn free_reserve(&self) {
        let reserve = self.reserve.swap(ptr::null_mut(), Ordering::SeqCst);
        if !reserve.is_null() {
            let size = self.reserved.load(Ordering::SeqCst);
            // SAFETY: `hold` has it from `system_memory` with this size; the swap gives it to one thread alone.
            unsafe { System.dealloc(reserve, Layout::from_size_align_unchecked(size, Self::ALIGNMENT)) };
        }
    }

    /// Leaves the call without an end; allocates nothing.
    fn abandon(&self) -> ! {
        self.is_abandoned.store(true, Ordering::SeqCst);
        self.wake_owner();
        loop {
            thread::sleep(Duration::from_secs(3600));
        }
    }
}

impl Drop for CallMemory {
    fn drop(&mut self) {
        self.free_reserve();
    }
}

/// Whether the system grants so many bytes now; they are freed again.
pub(crate) fn is_granted(bytes: u64) -> bool {
    let Ok(size) = usize::try_from(bytes.max(1)) else { return false };
    let memory = system_memory(size, CallMemory::ALIGNMENT);
    if memory.is_null() {
        return false;
    }
    // SAFETY: it was allocated with this size and alignment, which `system_memory` has checked.
    unsafe { System.dealloc(memory, Layout::from_size_align_unchecked(size, CallMemory::ALIGNMENT)) };
    true
}

/// The largest part of `bytes` that the system grants, to a part in 256.
pub(crate) fn granted_part(bytes: u64) -> u64 {
    let step = bytes / 256;
    (0..8)
        .rev()
        .map(|bit| 1 << bit)
        .fold(0, |part, bit| if is_granted((part | bit) * step) { part | bit } else { part })
        * step
}

/// Memory of the system's allocator, or null.
fn system_memory(size: usize, alignment: usize) -> *mut u8 {
    let Ok(layout) = Layout::from_size_align(size, alignment) else { return ptr::null_mut() };
    // SAFETY: sizes are not zero. The compiler may not leave out an allocation that nothing uses.
    black_box(unsafe { System.alloc(layout) })
}

/// The address of a call for its threads.
#[derive(Clone, Copy)]
struct Address(*const CallMemory);

// SAFETY: everything in a call may be used by all threads.
unsafe impl Send for Address {}
// SAFETY: likewise.
unsafe impl Sync for Address {}

impl Address {
    fn set(self) {
        CALL.set(self.0);
    }

    #[cfg(test)]
    fn is_set(self) -> bool {
        CALL.get() == self.0
    }
}

/// Threads that work for a call until this is dropped.
struct WorksFor {
    whole_pool: bool,
}

impl WorksFor {
    /// The threads of the pool of this thread, or it alone.
    fn new(call: Address, whole_pool: bool) -> Self {
        let worker = Self { whole_pool };
        worker.on_each(|| call.set());
        worker
    }

    fn on_each(&self, f: impl Fn() + Sync) {
        if self.whole_pool { par::on_every_thread(f) } else { f() }
    }
}

impl Drop for WorksFor {
    fn drop(&mut self) {
        self.on_each(|| CALL.set(ptr::null()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reserve_is_freed_once_when_memory_is_refused() {
        let call = CallMemory::new(CancelToken::new());
        assert!(call.hold(1 << 20) && !call.reserve.load(Ordering::SeqCst).is_null());
        assert_eq!(call.reserved.load(Ordering::SeqCst), CallMemory::MIN_RESERVE);
        call.end_for_lack_of_memory();
        assert!(call.reserve.load(Ordering::SeqCst).is_null());
        assert!(call.was_refused() && call.cancel().is_cancelled() && !call.is_abandoned());
        assert!(!call.hold(1 << 60), "no computer has so much memory");
    }

    #[test]
    fn the_largest_part_that_is_granted_is_found() {
        assert_eq!(granted_part(256 << 10), 255 << 10);
        let part = granted_part(1 << 60);
        assert!(part < 1 << 60 && part.is_multiple_of(1 << 52), "{part}");
    }

    #[test]
    fn threads_work_for_a_call_until_its_job_ends() {
        let call = CallMemory::new(CancelToken::new());
        let worked = AtomicUsize::new(0);
        let shared = Address(ptr::from_ref(&call));
        let count = || {
            worked.fetch_add(usize::from(shared.is_set()), Ordering::SeqCst);
        };
        call.work_for(count);
        assert_eq!((worked.load(Ordering::SeqCst), shared.is_set()), (1, false));
        call.on_threads(3, || par::on_every_thread(count)).unwrap();
        assert_eq!((worked.load(Ordering::SeqCst), shared.is_set()), (4, false));
    }
}
