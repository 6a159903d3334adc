//! Loops on the current rayon pool, whose threads and queues are compiled once and not once per
//! loop.
//!
//! Data in: how many items there are, and what to do with the number of one. Data out: what that
//! returns, in the order of the items.
//!
//! The iterators of rayon compile all that shares out the work anew for each closure that they get,
//! which is more code than the closures themselves. Here one function, [`for_each_range`], shares
//! out ranges of numbers; a loop over a range is compiled into its caller.
//!
//! # Cost
//! One indirect call per range and no allocation beside the result; ranges are halved as long as
//! threads have nothing to do and no range becomes shorter than `grain` items, as rayon does it.
//!
//! # Determinism
//! Which items make up a range depends on the threads. What is computed does not, as long as an
//! item's result follows from its number alone: scratch memory carries nothing from one item to the
//! next, and what rounds is added up in the order of the items, after the loop.
#![expect(
    unsafe_code,
    reason = "the compiler does not know that ranges without a common item are written by \
        different threads"
)]

use core::ops::Range;

use rayon::prelude::*;

/// Shares out the numbers `0..n`: calls `work` with ranges that hold each of them once, several at
/// a time, and returns when all are done.
///
/// A range has `grain` items or more, unless there are fewer than that in all.
pub fn for_each_range(n: usize, grain: usize, work: &(dyn Fn(Range<usize>) + Sync)) {
    let halve = |range: Range<usize>| {
        let middle = range.start + range.len() / 2;
        if middle - range.start < grain.max(1) {
            (range, None)
        } else {
            (range.start..middle, Some(middle..range.end))
        }
    };
    rayon::iter::split(0..n, halve).for_each(work);
}

/// `[n]`: what `value` gives for each of the numbers `0..n`.
pub fn map<T: Send>(n: usize, grain: usize, value: impl Fn(usize) -> T + Sync) -> Vec<T> {
    map_with(n, grain, || (), |(), idx| value(idx))
}

/// The same with memory that is made once per range.
pub fn map_with<S, T: Send>(
    n: usize,
    grain: usize,
    scratch: impl Fn() -> S + Sync,
    value: impl Fn(&mut S, usize) -> T + Sync,
) -> Vec<T> {
    let mut values: Vec<T> = Vec::with_capacity(n);
    let first = DisjointItems(values.as_mut_ptr());
    for_each_range(n, grain, &|range| {
        let mut scratch = scratch();
        for idx in range {
            // SAFETY: `idx` is below the capacity, and no other range holds it. A panic leaves the
            // vector empty: nothing is dropped twice.
            unsafe { first.at(idx).write(value(&mut scratch, idx)) };
        }
    });
    // SAFETY: the ranges held all numbers below `n`, and every one was written.
    unsafe { values.set_len(n) };
    values
}

/// `[n_items]`: what `value` gives for the number of each item and the item, which it may change.
pub fn map_mut<I: Send, T: Send>(
    items: &mut [I],
    grain: usize,
    value: impl Fn(usize, &mut I) -> T + Sync,
) -> Vec<T> {
    map_mut_with(items, grain, || (), |(), idx, item| value(idx, item))
}

/// The same with memory that is made once per range.
pub fn map_mut_with<I: Send, S, T: Send>(
    items: &mut [I],
    grain: usize,
    scratch: impl Fn() -> S + Sync,
    value: impl Fn(&mut S, usize, &mut I) -> T + Sync,
) -> Vec<T> {
    let first = DisjointItems(items.as_mut_ptr());
    map_with(items.len(), grain, scratch, |scratch, idx| {
        // SAFETY: `idx` is below the length, `map_with` asks for each once, and the slice is
        // borrowed until it returns.
        let item = unsafe { &mut *first.at(idx) };
        value(scratch, idx, item)
    })
}

/// `[n_items / len, rounded up]`: what `value` gives for each run of `len` items; the last may be
/// shorter.
pub fn map_chunks<I: Sync, T: Send>(
    items: &[I],
    len: usize,
    value: impl Fn(&[I]) -> T + Sync,
) -> Vec<T> {
    map(items.len().div_ceil(len), 1, |idx| {
        value(&items[idx * len..items.len().min((idx + 1) * len)])
    })
}

/// Does both, at the same time where a thread has nothing to do.
pub fn join(one: &mut (dyn FnMut() + Send), other: &mut (dyn FnMut() + Send)) {
    rayon::join(one, other);
}

/// Where the first of some items lies, of which each thread reaches others.
struct DisjointItems<T>(*mut T);

// SAFETY: who calls `at` sees to it that no two threads reach the same item.
unsafe impl<T: Send> Sync for DisjointItems<T> {}

impl<T> DisjointItems<T> {
    /// # Safety
    /// `idx` lies within the allocation.
    unsafe fn at(&self, idx: usize) -> *mut T {
        // SAFETY: as the caller promises.
        unsafe { self.0.add(idx) }
    }
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::Arc;

    use super::*;

    fn on_threads(n_threads: usize, run: impl Fn() + Send + Sync) {
        rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap().install(run);
    }

    #[test]
    fn every_item_is_visited_once_and_ranges_are_no_shorter_than_the_grain() {
        for (n, grain) in
            [(0, 0), (0, 5), (1, 1), (1, 64), (63, 64), (64, 16), (1000, 1), (1000, 0), (1001, 17)]
        {
            on_threads(4, || {
                let visits: Vec<AtomicUsize> = (0..n).map(|_| AtomicUsize::new(0)).collect();
                for_each_range(n, grain, &|range| {
                    assert!(range.len() >= grain.min(n), "{range:?} of {n}, grain {grain}");
                    range.for_each(|idx| _ = visits[idx].fetch_add(1, Ordering::Relaxed));
                });
                assert!(visits.iter().all(|visits| visits.load(Ordering::Relaxed) == 1));
            });
        }
    }

    #[test]
    fn results_lie_in_the_order_of_the_items_for_any_number_of_threads() {
        for n_threads in [1, 2, 5] {
            on_threads(n_threads, || {
                let squares: Vec<usize> = (0..2000).map(|idx| idx * idx).collect();
                assert_eq!(map(2000, 3, |idx| idx * idx), squares);
                let with_scratch = map_with(2000, 3, Vec::new, |scratch: &mut Vec<usize>, idx| {
                    scratch.push(idx);
                    scratch.last().map(|last| last * last)
                });
                assert!(with_scratch.into_iter().flatten().eq(squares.iter().copied()));
                let mut items: Vec<String> = (0..2000).map(|idx| idx.to_string()).collect();
                let lens = map_mut(&mut items, 1, |idx, item| {
                    item.push('!');
                    (idx, item.len())
                });
                assert!(lens.into_iter().enumerate().all(|(place, (idx, len))| place == idx && len == idx.to_string().len() + 1));
                assert!(items.iter().enumerate().all(|(idx, item)| *item == format!("{idx}!")));
                let sums = map_chunks(&squares[..7], 3, |chunk| chunk.iter().sum::<usize>());
                assert_eq!(sums, [1 + 4, 9 + 16 + 25, 36]);
                let mut one = 0;
                let mut other = 0;
                join(&mut || one += 1, &mut || other += 2);
                assert_eq!((one, other), (1, 2));
            });
        }
    }

    #[test]
    fn a_panic_reaches_the_caller_and_drops_nothing_twice() {
        let witness = Arc::new(());
        let run = || {
            map(100, 1, |idx| {
                assert!(idx != 50, "the fiftieth");
                witness.clone()
            })
        };
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
        assert!(Arc::strong_count(&witness) >= 1);
        assert_eq!(map(100, 1, |_| witness.clone()).len(), 100);
    }
}
