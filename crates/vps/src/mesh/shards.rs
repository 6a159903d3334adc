//! Items sorted into shards, in parallel and in an order that does not depend on the number of
//! threads.
//!
//! A table of millions of entries misses the cache on every look-up. Items that can meet are
//! therefore brought together first, in shards small enough for the cache, and each shard is then
//! worked on by itself. Chunks of the input are sorted apart; a shard is the chain of its pieces of
//! every chunk, so the items of a shard keep the order of the input.

use crate::parallel;

/// Items by shard.
pub(super) struct Shards<T> {
    pub(super) n_shards: usize,
    chunks: Vec<Chunk<T>>,
}

struct Chunk<T> {
    /// `[n_shards + 1]`, where each shard begins.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy + Default + Send + Sync> Shards<T> {
    /// Sorts what `items_of` gives for each chunk: pairs of a shard, below `n_shards`, and an item.
    pub(super) fn new<I: Iterator<Item = (usize, T)>>(
        n_chunks: usize,
        n_shards: usize,
        items_of: impl Fn(usize) -> I + Sync,
    ) -> Self {
        let sort = |unsorted: &mut Vec<(u32, T)>, chunk_idx: usize| {
            unsorted.clear();
            unsorted.extend(items_of(chunk_idx).map(|(shard, item)| (shard as u32, item)));
            let mut starts = vec![0_u32; n_shards + 1];
            for (shard, _) in unsorted.iter() {
                starts[*shard as usize + 1] += 1;
            }
            for shard in 0..n_shards {
                starts[shard + 1] += starts[shard];
            }
            let mut next = starts.clone();
            let mut items = vec![T::default(); unsorted.len()];
            for (shard, item) in unsorted.iter() {
                let place = &mut next[*shard as usize];
                items[*place as usize] = *item;
                *place += 1;
            }
            Chunk { starts, items }
        };
        Self { n_shards, chunks: parallel::map_with(n_chunks, 1, Vec::new, sort) }
    }

    /// The items of one shard, in the order of the input.
    pub(super) fn shard(&self, shard: usize) -> impl Iterator<Item = T> + Clone {
        self.chunks
            .iter()
            .flat_map(move |chunk| {
                &chunk.items[chunk.starts[shard] as usize..chunk.starts[shard + 1] as usize]
            })
            .copied()
    }

    /// How many items a shard has.
    pub(super) fn len_of(&self, shard: usize) -> usize {
        self.chunks
            .iter()
            .map(|chunk| (chunk.starts[shard + 1] - chunk.starts[shard]) as usize)
            .sum()
    }
}

/// A power of two of shards, so that each has a few thousand of `n_items` items.
pub(super) fn shards_for(n_items: usize) -> usize {
    (n_items / 12_288).next_power_of_two().clamp(1, 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_keep_the_order_of_the_input() {
        let items_of = |chunk: usize| {
            (0..1000_usize)
                .map(move |k| (1000 * chunk + k) * 7 % 13)
                .enumerate()
                .map(move |(k, shard)| (shard, 1000 * chunk + k))
        };
        let shards = Shards::new(5, 13, items_of);
        let mut total = 0;
        for shard in 0..13 {
            let items: Vec<usize> = shards.shard(shard).collect();
            assert!(items.is_sorted() && items.iter().all(|item| item * 7 % 13 == shard));
            assert_eq!(items.len(), shards.len_of(shard));
            total += items.len();
        }
        assert_eq!(total, 5000);
    }
}
