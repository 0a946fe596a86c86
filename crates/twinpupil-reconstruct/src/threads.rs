//! The work of one frame, shared among threads.

use rayon::prelude::*;
use smallvec::SmallVec;

/// Threads that work is worth, of those that there are, if so many items are worth one: to wake it costs some tens of
/// microseconds.
pub(crate) fn worthwhile(items: usize, items_each: usize, threads: usize) -> usize {
    threads.min(items / items_each).max(1)
}

/// Calls `work` with every item and its place, on so many threads at most; on one, in turn.
pub(crate) fn for_each<T: Send>(items: &mut [T], threads: usize, work: impl Fn(usize, &mut T) + Send + Sync) {
    if threads <= 1 {
        items.iter_mut().enumerate().for_each(|(place, item)| work(place, item));
    } else {
        let part = part_length(items.len(), threads);
        items.par_iter_mut().enumerate().with_min_len(part).for_each(|(place, item)| work(place, item));
    }
}

/// Calls `work` with the items that are chosen, on as many threads as those are worth.
pub(crate) fn for_each_chosen<T: Send>(
    items: &mut [T],
    items_each: usize,
    threads: usize,
    is_chosen: impl Fn(&T) -> bool + Send + Sync,
    work: impl Fn(&mut T) + Send + Sync,
) {
    let chosen = || items.iter().filter(|item| is_chosen(item)).count();
    let threads = if threads > 1 { worthwhile(chosen(), items_each, threads) } else { 1 };
    for_each(items, threads, |_, item| {
        if is_chosen(item) {
            work(item);
        }
    });
}

/// Calls `work` with the number of every part, the part, and the desk that is the part's; desks are added until there is one for
/// every part.
pub(crate) fn for_each_part<P: Send, D: Default + Send>(
    parts: impl ExactSizeIterator<Item = P>,
    desks: &mut Vec<D>,
    threads: usize,
    work: impl Fn(usize, &mut P, &mut D) + Send + Sync,
) {
    const PARTS: usize = 16;
    if desks.len() < parts.len() {
        desks.resize_with(parts.len(), D::default);
    }
    let mut parts: SmallVec<[(P, &mut D); PARTS]> = parts.zip(desks).collect();
    for_each(&mut parts, threads, |number, (part, desk)| work(number, part, desk));
}

/// Items in a part, of so many items for so many threads.
pub(crate) fn part_length(items: usize, threads: usize) -> usize {
    items.div_ceil(threads.max(1)).max(1)
}

/// Does work that will be shared, where threads wait for it, so that every share of it is handed over fast.
pub(crate) fn enter<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    if threads <= 1 { work() } else { rayon::scope(|_| work()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_worked_on_once_at_the_desk_of_its_part() {
        for threads in 1..6 {
            for count in 0..20 {
                let mut items = vec![0; count];
                for_each(&mut items, threads, |place, item| *item += place);
                assert!(items.iter().enumerate().all(|(place, item)| *item == place));
                items.fill(1);
                let mut desks: Vec<Vec<usize>> = Vec::new();
                let length = part_length(count, threads);
                for_each_part(items.chunks_mut(length), &mut desks, threads, |number, part, desk| {
                    part.iter_mut().for_each(|item| *item += number);
                    desk.extend_from_slice(part);
                });
                let expected: Vec<usize> = (0..count).map(|item| 1 + item / length).collect();
                assert_eq!((desks.concat(), items), (expected.clone(), expected), "{threads} {count}");
            }
        }
    }
}
