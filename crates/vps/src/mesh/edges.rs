//! Edges and triangles that meet, found by sorting among neighbours in number.
//!
//! Data in: welded triangles. Data out: which of them repeat others, and which edges are not shared
//! by two. Neighbours in number are mostly neighbours in the file, so the pieces are sorted in the
//! cache. Cost: linear, in parallel; the same for any number of threads.

use super::SUM_TRIANGLES;
use super::shards::Shards;
use crate::parallel;

/// Vertices whose items are sorted together: few enough for the cache.
const SHARD_VERTICES: usize = 1 << 12;

/// Items in shards of neighbouring vertices; `vertex_of` an item says where it belongs.
fn by_vertex<T: Copy + Default + Send + Sync, I: Iterator<Item = T>>(
    triangles: &[[u32; 3]],
    n_vertices: usize,
    vertex_of: impl Fn(&T) -> u32 + Sync,
    items_of: impl Fn(usize, [u32; 3]) -> I + Sync,
) -> Shards<T> {
    Shards::new(
        triangles.len().div_ceil(SUM_TRIANGLES),
        n_vertices.div_ceil(SHARD_VERTICES),
        |chunk| {
            let range = chunk * SUM_TRIANGLES..triangles.len().min((chunk + 1) * SUM_TRIANGLES);
            let items =
                range.flat_map(|triangle_idx| items_of(triangle_idx, triangles[triangle_idx]));
            items.map(|item| (vertex_of(&item) as usize / SHARD_VERTICES, item))
        },
    )
}

/// Triangles whose corners, in any order, are those of an earlier one: pairs of a triangle and the
/// next one with the same corners.
pub(crate) fn repeats(triangles: &[[u32; 3]], n_vertices: usize) -> Vec<[u32; 2]> {
    let shards = by_vertex(
        triangles,
        n_vertices,
        |(sorted, _): &([u32; 3], u32)| sorted[0],
        |triangle_idx, mut corners| {
            corners.sort_unstable();
            std::iter::once((corners, triangle_idx as u32))
        },
    );
    let repeated = parallel::map(shards.n_shards, 1, |shard| {
        let first_vertex = shard * SHARD_VERTICES;
        let items = shards.shard(shard).map(|([low, middle, high], triangle_idx)| {
            (low as usize - first_vertex, (middle, high, triangle_idx))
        });
        let mut repeated = Vec::new();
        for bucket in Buckets::new(SHARD_VERTICES.min(n_vertices - first_vertex), items).iter_mut()
        {
            bucket.sort_unstable();
            let pairs =
                bucket.windows(2).filter(|pair| (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1));
            repeated.extend(pairs.map(|pair| [pair[0].2, pair[1].2]));
        }
        repeated
    });
    repeated.concat()
}

/// Removes triangles whose corners, in any order, are those of an earlier one; returns how many.
pub(super) fn drop_duplicates(triangles: &mut Vec<[u32; 3]>, n_vertices: usize) -> usize {
    let repeated = repeats(triangles, n_vertices);
    if !repeated.is_empty() {
        let mut keep = vec![true; triangles.len()];
        repeated.iter().for_each(|[_, triangle_idx]| keep[*triangle_idx as usize] = false);
        let mut keep = keep.into_iter();
        triangles.retain(|_| keep.next().unwrap_or(true));
    }
    repeated.len()
}

/// An edge of two triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EdgePair {
    /// Lower vertex first.
    pub(crate) edge: [u32; 2],
    pub(crate) triangles: [u32; 2],
    /// Both triangles run along it in the same direction.
    pub(crate) same_direction: bool,
}

/// An edge of one triangle, or of three and more.
#[derive(Clone, Debug)]
pub(crate) struct EdgeFan {
    /// Lower vertex first.
    pub(crate) edge: [u32; 2],
    /// The triangles, in rising order, and whether each runs from the lower to the higher vertex.
    pub(crate) triangles: Vec<(u32, bool)>,
}

/// Which triangles use which edges.
#[derive(Debug, Default)]
pub(crate) struct EdgeUses {
    pub(crate) pairs: Vec<EdgePair>,
    pub(crate) fans: Vec<EdgeFan>,
}

/// The triangles of every edge, in the order of the edges' vertices.
pub(crate) fn edge_uses(triangles: &[[u32; 3]], n_vertices: usize) -> EdgeUses {
    let shards = by_vertex(
        triangles,
        n_vertices,
        |([from, to], _): &([u32; 2], u32)| *from.min(to),
        |triangle_idx, [a, b, c]| {
            [[a, b], [b, c], [c, a]].into_iter().map(move |edge| (edge, triangle_idx as u32))
        },
    );
    let uses = parallel::map(shards.n_shards, 1, |shard| {
        let first_vertex = shard * SHARD_VERTICES;
        let items = shards.shard(shard).map(|([from, to], triangle_idx)| {
            (from.min(to) as usize - first_vertex, (from.max(to), triangle_idx, from < to))
        });
        let mut uses = EdgeUses::default();
        for (low, bucket) in (first_vertex as u32..)
            .zip(Buckets::new(SHARD_VERTICES.min(n_vertices - first_vertex), items).iter_mut())
        {
            bucket.sort_unstable();
            for of_edge in bucket.chunk_by(|one, other| one.0 == other.0) {
                let edge = [low, of_edge[0].0];
                if let [(_, one, forward), (_, other, other_forward)] = of_edge {
                    uses.pairs.push(EdgePair {
                        edge,
                        triangles: [*one, *other],
                        same_direction: forward == other_forward,
                    });
                } else {
                    let triangles = of_edge.iter().map(|(_, idx, forward)| (*idx, *forward));
                    uses.fans.push(EdgeFan { edge, triangles: triangles.collect() });
                }
            }
        }
        uses
    });
    uses.into_iter().fold(EdgeUses::default(), |mut sum, mut shard| {
        sum.pairs.append(&mut shard.pairs);
        sum.fans.append(&mut shard.fans);
        sum
    })
}

/// Edges that do not lie between two triangles of the same sense.
#[derive(Default)]
pub(super) struct OddEdges {
    /// Edges of one triangle, in its direction.
    pub(super) open: Vec<[u32; 2]>,
    /// Edges along which two triangles run in the same direction.
    pub(super) inconsistent: usize,
    /// Edges of three triangles or more.
    pub(super) non_manifold: usize,
}

/// Edges that are not those of a sound mesh, in the order of their lower vertex.
pub(super) fn odd_edges(triangles: &[[u32; 3]], n_vertices: usize) -> OddEdges {
    let shards = by_vertex(
        triangles,
        n_vertices,
        |[from, to]: &[u32; 2]| *from.min(to),
        |_, [a, b, c]| [[a, b], [b, c], [c, a]].into_iter(),
    );
    let odd = parallel::map(shards.n_shards, 1, |shard| {
        let first_vertex = shard * SHARD_VERTICES;
        let items = shards
            .shard(shard)
            .map(|[from, to]| (from.min(to) as usize - first_vertex, (from.max(to), from < to)));
        let mut odd = OddEdges::default();
        for (low, bucket) in (first_vertex as u32..)
            .zip(Buckets::new(SHARD_VERTICES.min(n_vertices - first_vertex), items).iter_mut())
        {
            bucket.sort_unstable();
            for edge in bucket.chunk_by(|one, other| one.0 == other.0) {
                match edge {
                    [(high, true)] => odd.open.push([low, *high]),
                    [(high, false)] => odd.open.push([*high, low]),
                    [(_, one), (_, other)] => odd.inconsistent += usize::from(one == other),
                    _ => odd.non_manifold += 1,
                }
            }
        }
        odd
    });
    odd.into_iter().fold(OddEdges::default(), |mut sum, mut shard| {
        sum.open.append(&mut shard.open);
        sum.inconsistent += shard.inconsistent;
        sum.non_manifold += shard.non_manifold;
        sum
    })
}

/// Items sorted into one bucket per vertex: a counting sort.
struct Buckets<T> {
    /// `[n_vertices + 1]`, where each bucket begins.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy + Default> Buckets<T> {
    fn new(n_vertices: usize, items: impl Iterator<Item = (usize, T)> + Clone) -> Self {
        let mut starts = vec![0; n_vertices + 1];
        for (vertex, _) in items.clone() {
            starts[vertex + 1] += 1;
        }
        for vertex in 0..n_vertices {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        let mut sorted = vec![T::default(); starts[n_vertices] as usize];
        for (vertex, item) in items {
            sorted[next[vertex] as usize] = item;
            next[vertex] += 1;
        }
        Self { starts, items: sorted }
    }

    fn iter_mut(&mut self) -> impl Iterator<Item = &mut [T]> {
        let mut rest = &mut self.items[..];
        self.starts.windows(2).map(move |range| {
            let (bucket, later) =
                std::mem::take(&mut rest).split_at_mut((range[1] - range[0]) as usize);
            rest = later;
            bucket
        })
    }
}
