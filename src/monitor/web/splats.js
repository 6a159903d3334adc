/**
 * Clay in the 3-D view: the surface of its samples; a thin box around what deforms; the brush as a ring around the tool.
 *
 * @typedef {object} Samples
 * @property {number} version of the piece
 * @property {number} n how many came
 * @property {number} nAll how many the piece has
 * @property {number} spacing between those that came, m
 * @property {number} unit of the spacing around each of them, m
 * @property {Uint8Array} bytes 20 for each: position 3 × f32 (map frame, m), normal 3 × i8, spacing around it u8 (0: as `spacing`), colour 3 × u8 and filling
 */

import { levelsOf } from "./lod.js";
import { add, cornersOf, length, matrixAlong, matrixOfPose, multiply, scale, subtract, transform } from "./math.js";
import { Pace } from "./pace.js";
import { ring } from "./shapes.js";
import { SplatSurface } from "./splat-surface.js";

const HEAD_BYTES = 32;
const SAMPLE_BYTES = 20;
/** Words of 32 bits in a row of the texture of samples: 512 of them. */
const ROW = (512 * SAMPLE_BYTES) / 4;
/** A texture has room for so many times the samples that there are: strokes add some. */
const ROOM = 1.25;
/** Widths of the ring as shares of its radius, and how many pixels it has at least. */
const RINGS = [0.01, 0.02, 0.04, 0.08];
const RING_PIXELS = 1.5;
/** The edges of the cube from 0 to 1. */
const CUBE = [0, 1, 2].flatMap((axis) =>
  [[0, 0], [0, 1], [1, 0], [1, 1]].flatMap(([a, b]) =>
    [0, 1].flatMap((along) => {
      const corner = [0, 0, 0];
      [corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3]] = [along, a, b];
      return corner;
    }),
  ),
);

/** @param {ArrayBuffer} buffer `HCLY` of the API @returns {Samples} */
export function parseSamples(buffer) {
  const head = new DataView(buffer);
  const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 4));
  if (magic !== "HCLY" || head.getUint32(4, true) !== 1) throw new Error("not samples of a version that this page reads");
  const n = head.getUint32(16, true);
  return {
    version: Number(head.getBigUint64(8, true)),
    n,
    nAll: head.getUint32(20, true),
    spacing: head.getFloat32(24, true),
    unit: head.getFloat32(28, true),
    bytes: new Uint8Array(buffer, HEAD_BYTES, n * SAMPLE_BYTES),
  };
}

export class Splats {
  /** @param {() => void} redraw called when there is a finer picture of what stands still */
  constructor(redraw) {
    this.surface = new SplatSurface();
    this.pace = new Pace(redraw);
    /** Counts shapes, also of other scenes. */
    this.shapes = 0;
    this.clear();
  }

  /** Buffers on a graphics card that knows nothing, or nothing any more. @param {WebGL2RenderingContext} gl */
  prepare(gl) {
    this.gl = gl;
    this.surface.prepare(gl);
    this.pace.forget();
    this.texture = null;
    this.elements = gl.createVertexArray();
    gl.bindVertexArray(this.elements);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    [this.box, ...this.rings] = [new Float32Array(CUBE), ...RINGS.map(ring)].map((positions) => {
      const vao = gl.createVertexArray();
      gl.bindVertexArray(vao);
      this.#fill(positions);
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
      return { vao, n: positions.length / 3 };
    });
    this.curves = { vao: null, n: 0, key: "" };
    this.grid = { vao: null, n: 0, key: "" };
    if (this.samples) this.#upload();
    this.takeCurves(this.corners_m ?? []);
  }

  /** Curves that were drawn: lines from corner to corner. @param {number[][][]} curves map frame, m */
  takeCurves(curves) {
    this.corners_m = curves;
    const { gl } = this;
    const key = JSON.stringify(curves);
    if (!gl || this.curves?.key === key) return;
    const ends = curves.flatMap((curve) => (curve.length === 1 ? cross(curve[0]) : curve.slice(1).flatMap((at, n) => [...curve[n], ...at])));
    gl.deleteBuffer(this.curves.buffer);
    gl.deleteVertexArray(this.curves.vao);
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const buffer = this.#fill(new Float32Array(ends));
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    this.curves = { vao, buffer, n: ends.length / 3, key };
  }

  /** The springs between mass points, as lines through all of the region: the picture of figure 1 of the paper. */
  drawGrid(use, color) {
    if (!this.isGridShown || !this.region || !this.raster || !this.samples) return;
    const key = this.raster.join();
    if (this.grid.key !== key) this.#layGrid(key);
    use(this.#stretched(), color, GRID_OPACITY);
    this.gl.bindVertexArray(this.grid.vao);
    this.gl.drawArrays(this.gl.LINES, 0, this.grid.n);
  }

  #layGrid(key) {
    const { gl } = this;
    const { raster } = this;
    const ends = [];
    for (let axis = 0; axis < 3; axis += 1) {
      const [one, other] = [(axis + 1) % 3, (axis + 2) % 3];
      for (let n = 0; n < raster[one]; n += 1) {
        for (let m = 0; m < raster[other]; m += 1) {
          for (const along of [0, 1]) {
            const end = [0, 0, 0];
            [end[axis], end[one], end[other]] = [along, n / (raster[one] - 1), m / (raster[other] - 1)];
            ends.push(...end);
          }
        }
      }
    }
    gl.deleteBuffer(this.grid.buffer);
    gl.deleteVertexArray(this.grid.vao);
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const buffer = this.#fill(new Float32Array(ends));
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    this.grid = { vao, buffer, n: ends.length / 3, key };
  }

  /** The cube from 0 to 1, over the region in the world. */
  #stretched() {
    const { min, max } = this.region;
    const size = subtract(max, min);
    const stretch = new Float32Array([size[0], 0, 0, 0, 0, size[1], 0, 0, 0, 0, size[2], 0, ...min, 1]);
    return multiply(matrixOfPose(this.pose), stretch);
  }

  /** Over the surface. @param {(model: Float32Array, color: number[], opacity: number) => void} use takes the program of lines */
  drawCurves(use, color) {
    if (!this.samples || !this.curves?.n) return;
    use(matrixOfPose(this.pose), color, 1);
    this.gl.bindVertexArray(this.curves.vao);
    this.gl.drawArrays(this.gl.LINES, 0, this.curves.n);
  }

  #fill(data) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return buffer;
  }

  /**
   * Sends samples and the nodes above them to the graphics card, in rows of ROW, and in which order they are drawn. Samples of a stroke are few of many, so only rows
   * that differ from what it has.
   */
  #upload() {
    const { gl, levels } = this;
    const all = [words(this.samples), ...levels.nodes];
    const rowsOf = (words) => Math.ceil(words.length / ROW);
    const isAnother = !this.texture || this.firstRows.length < all.length || all.some((words, level) => this.firstRows[level] + rowsOf(words) > (this.firstRows[level + 1] ?? this.nRows));
    if (isAnother) {
      const rooms = all.map((words) => Math.ceil(ROOM * rowsOf(words)));
      this.firstRows = rooms.map((_, level) => rooms.slice(0, level).reduce((sum, rows) => sum + rows, 0));
      this.#allocate(Math.max(1, rooms.reduce((sum, rows) => sum + rows, 0)));
      this.sent = [];
    }
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    all.forEach((now, level) => {
      const old = this.sent[level];
      for (let begin = 0; begin < now.length; begin += ROW) {
        const end = Math.min(begin + ROW, now.length);
        if (old && end <= old.length && !differs(old, now, begin, end)) continue;
        gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, this.firstRows[level] + begin / ROW, end - begin, 1, gl.RED_INTEGER, gl.UNSIGNED_INT, now, begin);
      }
    });
    this.sent = all;
    this.#list(all);
  }

  /** The corners of all triangles, level by level, each in the order of its blocks: three for each sample or node. */
  #list(all) {
    const { gl, levels: { order } } = this;
    const counts = all.map((words) => (words.length * 4) / SAMPLE_BYTES);
    this.starts = counts.map((_, level) => counts.slice(0, level).reduce((sum, n) => sum + n, 0));
    const corners = new Uint32Array(3 * counts.reduce((sum, n) => sum + n, 0));
    let at = 0;
    counts.forEach((n, level) => {
      const first = (this.firstRows[level] * ROW * 4) / SAMPLE_BYTES;
      for (let row = 0; row < n; row += 1) {
        const corner = 3 * (first + (level === 0 ? order[row] : row));
        corners[at] = corner;
        corners[at + 1] = corner + 1;
        corners[at + 2] = corner + 2;
        at += 3;
      }
    });
    gl.bindVertexArray(this.elements);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.DYNAMIC_DRAW);
  }

  #allocate(nRows) {
    const { gl } = this;
    gl.deleteTexture(this.texture);
    this.texture = gl.createTexture();
    this.nRows = nRows;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32UI, ROW, nRows);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  }

  /** There is none. */
  clear() {
    /** @type {?Samples} */
    this.samples = null;
    /** World from the map of the clay. */
    this.pose = { p: [0, 0, 0], q: [0, 0, 0, 1] };
    /** @type {?{min: number[], max: number[]}} what deforms, map */
    this.region = null;
    /** @type {?{radius: number, color: ?number[]}} */
    this.brush = null;
    /** Corners of the box around all samples, world. @type {number[][]} */
    this.corners = [];
  }

  /** @param {Samples} samples */
  take(samples) {
    this.samples = samples;
    this.shapes += 1;
    const min = [Infinity, Infinity, Infinity];
    const max = [-Infinity, -Infinity, -Infinity];
    const numbers = new Float32Array(samples.bytes.buffer, samples.bytes.byteOffset, samples.bytes.byteLength / 4);
    for (let n = 0; n < numbers.length; n += SAMPLE_BYTES / 4) {
      for (let axis = 0; axis < 3; axis += 1) {
        min[axis] = Math.min(min[axis], numbers[n + axis]);
        max[axis] = Math.max(max[axis], numbers[n + axis]);
      }
    }
    this.corners = samples.n > 0 ? cornersOf({ min, max }).map((corner) => transform(this.pose, corner)) : [];
    this.radius = length(subtract(max, min)) / 2;
    this.levels = levelsOf(words(samples), samples.n, { min, max, spacing: samples.spacing, unit: samples.unit });
    this.#upload();
  }

  /** At which share of the full resolution the next picture is due. @param {Float32Array} view of the camera @param {?number[]} cut @param {boolean} isInFull whatever moves */
  shareOfPixels(view, cut, isInFull) {
    const { p, q } = this.pose;
    const key = [this.surface.form, this.shapes, ...view, ...p, ...q, ...(cut ?? [])].join();
    this.share = isInFull || !this.samples?.n ? 1 : this.pace.share(key);
    return this.share;
  }

  /** @param {import("./draw.js").Draw} draw @param {number} opacity below 1: only the nearest surface, blended */
  drawSurface(draw, opacity) {
    if (!this.samples?.n) return;
    const { texture, elements, levels, starts, radius, corners, shapes: version, samples: { spacing, unit } } = this;
    const begun = performance.now();
    const isMade = this.surface.show(draw, { texture, elements, levels, starts, spacing, unit, radius, corners, version }, matrixOfPose(this.pose), opacity, this.share < 1);
    if (isMade && this.share === 1) this.pace.time(this.gl, begun);
  }

  /** @param {(model: Float32Array, color: number[], opacity: number) => void} use takes the program of lines */
  drawRegion(use, color) {
    if (!this.region || !this.samples) return;
    use(this.#stretched(), color, 0.5);
    this.gl.bindVertexArray(this.box.vao);
    this.gl.drawArrays(this.gl.LINES, 0, this.box.n);
  }

  /**
   * A ring that faces the eye: all within it, before and behind, is reached.
   * @param {(model: Float32Array, color: number[], opacity: number) => void} use takes the program of lines
   * @param {number[]} middle @param {number[]} backward @param {number[]} color
   * @param {number} pixels how many a metre has there
   */
  drawBrush(use, middle, backward, color, pixels) {
    if (!this.brush || !this.samples) return;
    const { radius } = this.brush;
    const width = RINGS.findIndex((share) => share * radius * pixels >= RING_PIXELS);
    const ring = this.rings.at(width);
    // In front of what it is around, as seen from here.
    use(matrixAlong(add(middle, scale(backward, 1e-3 * radius)), backward, radius, radius), this.brush.color ?? color, 0.9);
    this.gl.bindVertexArray(ring.vao);
    this.gl.drawArrays(this.gl.TRIANGLE_STRIP, 0, ring.n);
  }
}

/** Lines through so many mass points lie over each other. */
const GRID_OPACITY = 0.12;
/** Half the arms of the mark of a single place, m. */
const MARK_M = 0.5e-3;

/** A place, as three short lines through it. */
const cross = (at) => [0, 1, 2].flatMap((axis) => [-MARK_M, MARK_M].flatMap((off) => at.map((x, n) => (n === axis ? x + off : x))));

const words = ({ bytes }) => new Uint32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4);

function differs(a, b, begin, end) {
  for (let n = begin; n < end; n += 1) if (a[n] !== b[n]) return true;
  return false;
}
