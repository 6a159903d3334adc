/**
 * Levels of detail of samples: an octree whose nodes are the means of the samples in them, as QSplat has, cut at each picture by how large it is there.
 *
 * Level 0 has the samples themselves; a cell of each further level is twice as wide, and has a node for each side of the six on which the surface in it looks:
 * the two faces of a thin plate stay apart. Cells of a level stand in the order of a Morton curve, so what is in one block of the piece is one range of each
 * level. A cut chooses a level for every block in the picture, and leaves out the blocks beside it. O(n log n) for a shape, O(blocks) for a cut.
 */

/** Blocks along the longest side of the piece at most: a power of two. */
const BLOCKS = 8;
/** Bits of a Morton code for each axis. */
const BITS = 10;
/** A level with more nodes than this share of the one below saves little: there is none. */
const WORTH = 0.7;
/** Words of 32 bits of a sample: position 3 × f32, normal and spacing, colour. */
const WORDS = 5;
/** Of a node while means are made: sums of position, normal, colour and spacing, and of how many samples. */
const SUMS = 11;

/**
 * @typedef {object} Levels
 * @property {Uint32Array} order of the samples: those of a block are beside each other
 * @property {Uint32Array[]} nodes of level 1 and further, WORDS each
 * @property {{middle: number[], radius: number, ranges: number[][]}[]} blocks ball around the samples of each, their frame, m; first and last + 1 in each level
 */

/** @param {Uint32Array} words of all samples @param {number} n @param {{min: number[], max: number[], spacing: number, unit: number}} facts m @returns {Levels} */
export function levelsOf(words, n, { min, max, spacing, unit }) {
  const numbers = new Float32Array(words.buffer, words.byteOffset, words.length);
  const longest = Math.max(...max.map((x, axis) => x - min[axis]), 1e-9);
  const cell = Math.max(spacing, (1.0001 * longest) / 2 ** BITS, 1e-9);
  const depth = Math.max(0, Math.ceil(Math.log2(longest / cell / BLOCKS)));
  const codes = new Uint32Array(n);
  for (let k = 0; k < n; k += 1) {
    const at = WORDS * k;
    codes[k] = spread((numbers[at] - min[0]) / cell) | (spread((numbers[at + 1] - min[1]) / cell) << 1) | (spread((numbers[at + 2] - min[2]) / cell) << 2);
  }
  const order = sortedBy(codes);
  let level = { codes: new Uint32Array(n), sums: new Float32Array(SUMS * n), n };
  for (let row = 0; row < n; row += 1) {
    level.codes[row] = codes[order[row]];
    takeSample(level.sums, SUMS * row, numbers, words, WORDS * order[row], spacing / unit);
  }
  const levels = [level];
  while (levels.length <= depth) {
    level = coarser(level);
    if (level.n > WORTH * levels.at(-1).n) break;
    levels.push(level);
  }
  return { order, nodes: levels.slice(1).map(packed), blocks: blocksOf(levels, depth) };
}

/**
 * What of a piece is to be drawn: ranges of each level, those beside each other as one.
 * @param {Levels} levels
 * @param {(middle: number[], radius: number) => number} pixelsAt how many pixels a metre has there at most; 0: it is not in the picture
 * @param {number} spacing between samples of level 0, m @param {number} most pixels between those that are drawn
 * @returns {number[][][]} of each level `[first, last + 1]`
 */
export function cutOf({ blocks, nodes }, pixelsAt, spacing, most) {
  const ranges = Array.from({ length: nodes.length + 1 }, () => []);
  for (const block of blocks) {
    const pixels = pixelsAt(block.middle, block.radius);
    if (pixels === 0) continue;
    const level = Math.min(nodes.length, Math.max(0, Math.floor(Math.log2(most / (spacing * pixels)))));
    const [first, end] = block.ranges[level];
    const before = ranges[level].at(-1);
    if (before?.[1] === first) before[1] = end;
    else ranges[level].push([first, end]);
  }
  return ranges;
}

/** The bits of a number below 1024, with two empty ones before each. */
function spread(x) {
  let bits = Math.min(2 ** BITS - 1, Math.max(0, Math.floor(x)));
  bits = (bits | (bits << 16)) & 0x030000ff;
  bits = (bits | (bits << 8)) & 0x0300f00f;
  bits = (bits | (bits << 4)) & 0x030c30c3;
  return (bits | (bits << 2)) & 0x09249249;
}

/** Numbers of codes in the order of these: by their lowest bits first, and then by higher ones. @param {Uint32Array} codes of 3 × BITS */
function sortedBy(codes) {
  const n = codes.length;
  let [from, to] = [Uint32Array.from(codes.keys()), new Uint32Array(n)];
  for (let shift = 0; shift < 3 * BITS; shift += BITS) {
    const ends = new Uint32Array(2 ** BITS + 1);
    for (let k = 0; k < n; k += 1) ends[((codes[k] >>> shift) & (2 ** BITS - 1)) + 1] += 1;
    for (let digit = 0; digit < 2 ** BITS; digit += 1) ends[digit + 1] += ends[digit];
    for (let row = 0; row < n; row += 1) {
      const digit = (codes[from[row]] >>> shift) & (2 ** BITS - 1);
      to[ends[digit]] = from[row];
      ends[digit] += 1;
    }
    [from, to] = [to, from];
  }
  return from;
}

function takeSample(sums, to, numbers, words, at, usual) {
  const packedNormal = words[at + 3];
  const color = words[at + 4];
  sums[to] = numbers[at];
  sums[to + 1] = numbers[at + 1];
  sums[to + 2] = numbers[at + 2];
  sums[to + 3] = (packedNormal << 24) >> 24;
  sums[to + 4] = (packedNormal << 16) >> 24;
  sums[to + 5] = (packedNormal << 8) >> 24;
  sums[to + 6] = color & 255;
  sums[to + 7] = (color >>> 8) & 255;
  sums[to + 8] = (color >>> 16) & 255;
  sums[to + 9] = packedNormal >>> 24 || usual;
  sums[to + 10] = 1;
}

/** The side of a cube that a normal looks at. */
function sideOf(sums, at) {
  const x = sums[at + 3];
  const y = sums[at + 4];
  const z = sums[at + 5];
  const ax = Math.abs(x);
  const ay = Math.abs(y);
  const az = Math.abs(z);
  if (ax >= ay && ax >= az) return x < 0 ? 1 : 0;
  if (ay >= az) return y < 0 ? 3 : 2;
  return z < 0 ? 5 : 4;
}

/** The next level: eight cells are one. */
function coarser({ codes, sums, n }) {
  const next = { codes: new Uint32Array(n), sums: new Float32Array(SUMS * n), n: 0 };
  const places = [0, 0, 0, 0, 0, 0];
  for (let row = 0; row < n; row += 1) {
    const code = codes[row] >>> 3;
    if (row === 0 || code !== codes[row - 1] >>> 3) places.fill(-1);
    const side = sideOf(sums, SUMS * row);
    if (places[side] < 0) {
      places[side] = next.n;
      next.codes[next.n] = code;
      next.n += 1;
    }
    const to = SUMS * places[side];
    for (let part = 0; part < SUMS; part += 1) next.sums[to + part] += sums[SUMS * row + part];
  }
  return next;
}

/** Means, as the graphics card takes them. */
function packed({ sums, n }) {
  const words = new Uint32Array(WORDS * n);
  const numbers = new Float32Array(words.buffer);
  for (let row = 0; row < n; row += 1) {
    const [from, to] = [SUMS * row, WORDS * row];
    const share = 1 / sums[from + 10];
    const size = Math.hypot(sums[from + 3], sums[from + 4], sums[from + 5]) || 1;
    let color = 0;
    let normal = Math.min(255, Math.max(1, Math.round(sums[from + 9] * share)));
    for (let axis = 2; axis >= 0; axis -= 1) {
      numbers[to + axis] = sums[from + axis] * share;
      normal = (normal << 8) | (Math.round((127 * sums[from + 3 + axis]) / size) & 255);
      color = (color << 8) | Math.round(sums[from + 6 + axis] * share);
    }
    words[to + 3] = normal;
    words[to + 4] = color;
  }
  return words;
}

/** Blocks of which each is one range in every level. */
function blocksOf(levels, depth) {
  const blocks = [];
  const { codes, sums, n } = levels[0];
  const firsts = levels.map(() => 0);
  for (let first = 0; first < n; ) {
    const code = codes[first] >>> (3 * depth);
    const ranges = levels.map((level, k) => {
      const begin = firsts[k];
      while (firsts[k] < level.n && level.codes[firsts[k]] >>> (3 * (depth - k)) === code) firsts[k] += 1;
      return [begin, firsts[k]];
    });
    const min = [Infinity, Infinity, Infinity];
    const max = [-Infinity, -Infinity, -Infinity];
    for (let row = first; row < firsts[0]; row += 1) {
      for (let axis = 0; axis < 3; axis += 1) {
        const x = sums[SUMS * row + axis];
        if (x < min[axis]) min[axis] = x;
        if (x > max[axis]) max[axis] = x;
      }
    }
    blocks.push({ middle: min.map((x, axis) => (x + max[axis]) / 2), radius: Math.hypot(...max.map((x, axis) => x - min[axis])) / 2, ranges });
    first = firsts[0];
  }
  return blocks;
}
