/**
 * Clay in the 3-D view: a disc for each sample, across its normal and as large as samples are apart; a thin box around what deforms; the
 * brush as a ring around the tool.
 *
 * @typedef {object} Samples
 * @property {number} version of the piece
 * @property {number} n how many came
 * @property {number} nAll how many the piece has
 * @property {number} spacing between those that came, m
 * @property {Uint8Array} bytes 20 for each: position 3 × f32 (map frame, m), normal 3 × i8 and filling, colour 3 × u8 and filling
 */

import { add, cornersOf, matrixAlong, matrixOfPose, multiply, scale, subtract, transform } from "./math.js";
import { ring } from "./shapes.js";

const HEAD_BYTES = 32;
const SAMPLE_BYTES = 20;
/** Radius of a disc in distances between samples: discs of neighbours overlap, also where samples are not quite even. */
const DISC_SPACINGS = 1;
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
    bytes: new Uint8Array(buffer, HEAD_BYTES, n * SAMPLE_BYTES),
  };
}

export class Splats {
  constructor() {
    this.clear();
  }

  /** Buffers on a graphics card that knows nothing, or nothing any more. @param {WebGL2RenderingContext} gl */
  prepare(gl) {
    this.gl = gl;
    this.vao = gl.createVertexArray();
    gl.bindVertexArray(this.vao);
    this.#fill(new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
    this.#attribute(0, 2, gl.FLOAT, 0, 0);
    this.buffer = this.#fill(new Uint8Array(0));
    [[1, 3, gl.FLOAT, 0], [2, 4, gl.BYTE, 12], [3, 4, gl.UNSIGNED_BYTE, 16]].forEach(([place, size, type, offset]) => {
      this.#attribute(place, size, type, SAMPLE_BYTES, offset);
      gl.vertexAttribDivisor(place, 1);
    });
    [this.box, ...this.rings] = [new Float32Array(CUBE), ...RINGS.map(ring)].map((positions) => {
      const vao = gl.createVertexArray();
      gl.bindVertexArray(vao);
      this.#fill(positions);
      this.#attribute(0, 3, gl.FLOAT, 0, 0);
      return { vao, n: positions.length / 3 };
    });
    if (this.samples) this.#upload();
  }

  #fill(data) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return buffer;
  }

  #attribute(place, size, type, stride, offset) {
    const { gl } = this;
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, type !== gl.FLOAT, stride, offset);
  }

  #upload() {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.samples.bytes, gl.DYNAMIC_DRAW);
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
    this.#upload();
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
  }

  /**
   * @param {(model: Float32Array, opacity: number) => object} use takes the program of discs, and gives the places of its parameters
   * @param {number} opacity below 1: only the nearest surface, blended
   */
  drawDiscs(use, opacity) {
    if (!this.samples?.n) return;
    const { gl } = this;
    const at = use(matrixOfPose(this.pose), opacity);
    gl.uniform1f(at.radius, DISC_SPACINGS * this.samples.spacing);
    gl.bindVertexArray(this.vao);
    const draw = () => gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.samples.n);
    if (opacity < 1) {
      gl.colorMask(false, false, false, false);
      draw();
      gl.colorMask(true, true, true, true);
    }
    draw();
  }

  /** @param {(model: Float32Array, color: number[], opacity: number) => void} use takes the program of lines */
  drawRegion(use, color) {
    if (!this.region || !this.samples) return;
    const { min, max } = this.region;
    const size = subtract(max, min);
    const stretch = new Float32Array([size[0], 0, 0, 0, 0, size[1], 0, 0, 0, 0, size[2], 0, ...min, 1]);
    use(multiply(matrixOfPose(this.pose), stretch), color, 0.5);
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
