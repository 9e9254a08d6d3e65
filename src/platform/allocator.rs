//! Memory for large things in large pages.
//!
//! A conversion goes through arrays of many megabytes in all directions: records
//! are scattered into runs, items into cells, samples into a grid. In pages of
//! 4 KiB nearly each such step waits for the page table as well as for the
//! memory, and each page is handed out by the kernel one at a time. Where the
//! kernel leaves large pages to who asks for them (`madvise`, the default of most
//! distributions), this asks, for what is large.

// An allocator cannot be had otherwise. All it does itself is to give the kernel
// advice that changes no content.
#![allow(unsafe_code, reason = "GlobalAlloc is an unsafe trait, and advice on memory an unsafe call")]

use std::alloc::{GlobalAlloc, Layout, System};

use rustix::mm::{Advice, madvise};

/// Allocations from here on: a few large pages at least.
const LARGE: usize = 4 << 20;
const PAGE: usize = 4096;

/// The system's allocator, with large pages for large allocations.
pub struct LargePages;

/// Asks for large pages within a fresh allocation. An answer is not needed: on a
/// kernel without them, things are as they were.
fn advise(start: *mut u8, size: usize) {
    if size < LARGE || start.is_null() {
        return;
    }
    let skip = start.align_offset(PAGE);
    let len = (size - skip) / PAGE * PAGE;
    // SAFETY: the range lies within an allocation that was just made, and this
    // advice changes neither what is in it nor whether it can be accessed.
    let _ = unsafe { madvise(start.wrapping_add(skip).cast(), len, Advice::LinuxHugepage) };
}

// SAFETY: every call is handed to the system's allocator as it came.
unsafe impl GlobalAlloc for LargePages {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are those that this call asks for.
        let start = unsafe { System.alloc(layout) };
        advise(start, layout.size());
        start
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        let start = unsafe { System.alloc_zeroed(layout) };
        advise(start, layout.size());
        start
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: as above; all that was allocated here came from there.
        unsafe { System.dealloc(start, layout) }
    }

    unsafe fn realloc(&self, start: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above.
        let start = unsafe { System.realloc(start, layout, size) };
        advise(start, size);
        start
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contents are those of the system's allocator, for sizes and alignments on
    /// both sides of what is large.
    #[test]
    fn advice_changes_no_content() {
        for (size, align) in [(100, 8), (LARGE - 1, 1), (LARGE, 16), (LARGE + 12_345, 1), (3 * LARGE, 8192)] {
            let layout = Layout::from_size_align(size, align).unwrap();
            // SAFETY: of this size, written before it is read where it is not
            // zeroed, and freed with the layout it has.
            unsafe {
                let zeroed = LargePages.alloc_zeroed(layout);
                assert!((0..size).all(|i| *zeroed.add(i) == 0));
                LargePages.dealloc(zeroed, layout);
                let start = LargePages.alloc(layout);
                assert_eq!(start.align_offset(align), 0);
                (0..size).for_each(|i| *start.add(i) = (i % 251) as u8);
                let longer = LargePages.realloc(start, layout, 2 * size);
                assert!((0..size).all(|i| *longer.add(i) == (i % 251) as u8));
                LargePages.dealloc(longer, Layout::from_size_align(2 * size, align).unwrap());
            }
        }
    }
}
