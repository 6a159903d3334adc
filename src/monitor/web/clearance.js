/**
 * The tool in colours: how far its points are from the parts, from touching to as far as the scene knows. Asked for while it is shown.
 *
 * Faces of the tool are split until they are as fine as its points, and each corner takes the colour of the point that is nearest.
 */

import { byId, say, words } from "./element.js";
import { short } from "./units.js";

const EVERY_MS = 150;
const HEAD_BYTES = 32;
const POINT_BYTES = 20;
/** Longest edge of a face, in distances between points, unless that makes too many corners. */
const EDGE_SPACINGS = 1.2;
const MOST_CORNERS = 240_000;
/** Colours by share of the known distance, as in the legend; the first is that of contact. */
const SCALE = [
  [0, [200, 30, 60]],
  [0.4, [240, 160, 40]],
  [0.7, [245, 230, 122]],
  [1, [77, 143, 209]],
];

/** @typedef {{n: number, spacing: number, known: number, positions: Float32Array, clearances: Float32Array}} Distances m, tool frame */

export class Clearance {
  /** @param {import("./link.js").Link} link @param {import("./scene.js").SceneView} view */
  constructor(link, view) {
    this.link = link;
    this.view = view;
    this.isOn = false;
    /** The tool's faces, fine, and the point of each corner. @type {?{part: object, n: number, faces: object, nearest: Int32Array, colors: Uint8Array}} */
    this.fine = null;
    view.canvas.addEventListener("webglcontextrestored", () => (this.fine = null));
    byId("clearance").onclick = () => this.#turn(!this.isOn);
    view.additions.push(this);
  }

  /** @param {object} part @returns {?{faces: object}} */
  painted(part) {
    return this.isOn && this.fine?.part === part ? this.fine : null;
  }

  #turn(isOn) {
    this.isOn = isOn;
    byId("clearance").setAttribute("aria-pressed", String(isOn));
    byId("legend-clearance").hidden = !isOn;
    if (!isOn) this.#drop();
    this.view.redraw();
    if (isOn) this.#follow();
  }

  #drop() {
    if (this.fine) this.view.draw.free(this.fine.faces);
    this.fine = null;
  }

  async #follow() {
    try {
      while (this.isOn) {
        const distances = parseDistances(await this.link.getBytes("clearance"));
        if (!this.isOn) return;
        this.#paint(distances);
        byId("legend-clearance").textContent = `clearance, 0 to ${short(distances.known * 1e3)} mm and more`;
        this.view.redraw();
        await new Promise((done) => setTimeout(done, EVERY_MS));
      }
    } catch (error) {
      this.#turn(false);
      say(`The tool has no colours: ${words(error)}`);
    }
  }

  /** @param {Distances} distances */
  #paint(distances) {
    const part = this.view.parts.find(({ role }) => role === "tool");
    if (!part) return;
    const { draw } = this.view;
    if (this.fine?.part !== part || this.fine.n !== distances.n) {
      this.#drop();
      const mesh = split(part.mesh, EDGE_SPACINGS * distances.spacing);
      const nearest = nearestPoints(mesh.positions, distances);
      this.fine = { part, n: distances.n, faces: draw.faces(mesh), nearest, colors: new Uint8Array(4 * nearest.length) };
    }
    const { nearest, colors, faces } = this.fine;
    const ofPoints = Array.from(distances.clearances, (clearance) => colorOf(clearance / distances.known));
    const far = colorOf(1);
    nearest.forEach((point, corner) => colors.set(point < 0 ? far : ofPoints[point], 4 * corner));
    draw.tint(faces, colors);
  }
}

/** @param {ArrayBuffer} buffer `HCLR` of the API @returns {Distances} */
export function parseDistances(buffer) {
  const data = new DataView(buffer);
  const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 4));
  if (magic !== "HCLR" || data.getUint32(4, true) !== 1) throw new Error("not distances of a version that this page reads");
  const n = data.getUint32(8, true);
  const positions = new Float32Array(3 * n);
  const clearances = new Float32Array(n);
  for (let point = 0; point < n; point += 1) {
    const at = HEAD_BYTES + POINT_BYTES * point;
    for (let axis = 0; axis < 3; axis += 1) positions[3 * point + axis] = data.getFloat32(at + 4 * axis, true);
    clearances[point] = data.getFloat32(at + 16, true);
  }
  return { n, spacing: data.getFloat32(12, true), known: data.getFloat32(16, true), positions, clearances };
}

/**
 * The same faces, split across their longest edges until none is longer than asked for, or there would be too many.
 * @param {import("./mesh.js").Mesh} mesh @param {number} longest m
 * @returns {{positions: Float32Array, normals: Int8Array}}
 */
export function split({ positions, normals }, longest) {
  let faces = [];
  for (let corner = 0; corner < positions.length / 3; corner += 3) {
    faces.push([0, 1, 2].map((k) => [...positions.subarray(3 * (corner + k), 3 * (corner + k + 1)), ...normals.subarray(4 * (corner + k), 4 * (corner + k) + 3)]));
  }
  const middle = (a, b) => a.map((x, n) => (x + b[n]) / 2);
  for (let isDone = false; !isDone && 3 * faces.length < MOST_CORNERS / 2; ) {
    isDone = true;
    faces = faces.flatMap((face) => {
      const edges = [0, 1, 2].map((k) => Math.hypot(...[0, 1, 2].map((axis) => face[k][axis] - face[(k + 1) % 3][axis])));
      const k = edges.indexOf(Math.max(...edges));
      if (edges[k] <= longest) return [face];
      isDone = false;
      const [a, b, c] = [face[k], face[(k + 1) % 3], face[(k + 2) % 3]];
      const half = middle(a, b);
      return [
        [a, half, c],
        [half, b, c],
      ];
    });
  }
  const corners = faces.flat();
  return {
    positions: new Float32Array(corners.flatMap((corner) => corner.slice(0, 3))),
    normals: Int8Array.from(corners.flatMap((corner) => [...corner.slice(3), 0]), Math.round),
  };
}

/** Of every corner the point that is nearest, −1 where none is near. @param {Float32Array} corners @param {Distances} distances @returns {Int32Array} */
function nearestPoints(corners, { n, spacing, positions }) {
  // Points by cell of a grid: the nearest is in a corner's own cell or in one beside it.
  const size = 2 * spacing;
  const key = (x, y, z) => (x * 73856093) ^ (y * 19349663) ^ (z * 83492791);
  const cells = new Map();
  const cellOf = (from, k) => [0, 1, 2].map((axis) => Math.floor(from[3 * k + axis] / size));
  for (let point = 0; point < n; point += 1) {
    const at = key(...cellOf(positions, point));
    if (cells.has(at)) cells.get(at).push(point);
    else cells.set(at, [point]);
  }
  const nearest = new Int32Array(corners.length / 3).fill(-1);
  for (let corner = 0; corner < nearest.length; corner += 1) {
    const [x, y, z] = cellOf(corners, corner);
    let least = Infinity;
    for (let step = 0; step < 27; step += 1) {
      for (const point of cells.get(key(x + (step % 3) - 1, y + (Math.floor(step / 3) % 3) - 1, z + Math.floor(step / 9) - 1)) ?? []) {
        const off = Math.hypot(...[0, 1, 2].map((axis) => positions[3 * point + axis] - corners[3 * corner + axis]));
        if (off < least) [least, nearest[corner]] = [off, point];
      }
    }
  }
  return nearest;
}

/** @param {number} share of the known distance @returns {number[]} 0 to 255, and one of filling */
function colorOf(share) {
  const next = SCALE.findIndex(([end]) => share <= end);
  if (next === 0) return [...SCALE[0][1], 0];
  if (next < 0) return [...SCALE.at(-1)[1], 0];
  const [[begin, from], [end, to]] = [SCALE[next - 1], SCALE[next]];
  return [...from.map((part, n) => Math.round(part + ((to[n] - part) * (share - begin)) / (end - begin))), 0];
}
