/**
 * What contact works with: surface voxels in place of the surfaces of all parts, or points on them. Asked for when it is chosen.
 */

import { byId, say, words } from "./element.js";
import { add, cross, matrixOfPose, normalize, scale } from "./math.js";
import { count, short } from "./units.js";

const HEAD_BYTES = 24;
const FACE_BYTES = 16;
/** Of a voxel, and of the one beside it. */
const COLORS = [
  [205, 160, 96],
  [232, 200, 150],
];
/** A face of a voxel is a square; a point is a disc that leaves room for the next. Corners; their distance from the middle, and that from the surface, voxels. */
const KINDS = {
  voxels: { nCorners: 4, radius: Math.SQRT1_2, raised: 0, word: "surface voxels" },
  points: { nCorners: 6, radius: 0.25, raised: 0.05, word: "points" },
};

/** @typedef {{faces: object, n: number, nDrawn: number, size: number, ownSize: number}} Shown on the graphics card; how many there are; sizes of voxels, m */

export class Structures {
  /** @param {import("./link.js").Link} link @param {import("./scene.js").SceneView} view */
  constructor(link, view) {
    this.link = link;
    this.view = view;
    /** @type {?"voxels"|"points"} */
    this.kind = null;
    /** By part. @type {Map<object, Shown>} */
    this.shown = new Map();
    this.choice = byId("structure");
    this.choice.onchange = () => this.#show(this.choice.value);
    view.canvas.addEventListener("webglcontextrestored", () => this.#show("surfaces"));
    view.additions.push(this);
  }

  /** @param {object} part @returns {?{faces: object}} */
  painted(part) {
    return (this.kind === "voxels" && this.shown.get(part)) || null;
  }

  among(draw) {
    if (this.kind !== "points") return;
    for (const [part, shown] of this.shown) {
      draw.cut = this.view.cutOf(part.role);
      draw.solid(shown, matrixOfPose(this.view.standing(part)), [1, 1, 1]);
    }
    draw.cut = null;
  }

  /** Another scene has parts of its own. */
  cleared() {
    this.#show("surfaces");
  }

  async #show(word) {
    for (const { faces } of this.shown.values()) this.view.draw.free(faces);
    const shown = new Map();
    this.shown = shown;
    this.kind = word in KINDS ? word : null;
    this.choice.value = this.kind ?? "surfaces";
    this.#tell("being baked");
    this.view.redraw();
    if (!this.kind) return;
    for (const part of [...this.view.parts]) {
      try {
        const bytes = await (await this.link.getFile(part[this.kind])).arrayBuffer();
        // Another choice, or another scene.
        if (this.shown !== shown) return;
        const { mesh, tints, ...facts } = unfold(bytes, KINDS[this.kind]);
        const faces = this.view.draw.faces(mesh);
        this.view.draw.tint(faces, tints);
        shown.set(part, { faces, ...facts });
      } catch (error) {
        if (this.shown !== shown) return;
        say(words(error));
      }
      this.#tell(shown.size < this.view.parts.length ? "more are being baked" : "");
      this.view.redraw();
    }
  }

  /** How many there are, of which size, and whether all are drawn as they are. */
  #tell(more) {
    const legend = byId("legend-structure");
    legend.hidden = !this.kind;
    if (!this.kind) return;
    const all = [...this.shown.values()];
    const sizes = all.map(({ ownSize }) => ownSize * 1e3);
    const [least, most] = [Math.min(...sizes), Math.max(...sizes)];
    const n = all.reduce((sum, shown) => sum + shown.n, 0);
    const { word } = KINDS[this.kind];
    const parts = [all.length > 0 ? `${count(n)} ${word}, voxels of ${short(least)}${most > least ? ` to ${short(most)}` : ""} mm` : word];
    if (all.some(({ size, ownSize }) => size > ownSize)) parts.push("drawn from larger voxels");
    if (this.kind === "points" && all.some(({ n, nDrawn }) => nDrawn < n)) parts.push("some left out");
    if (more) parts.push(more);
    legend.textContent = parts.join(", ");
  }
}

/**
 * A polygon for each face.
 * @param {ArrayBuffer} bytes `HVPS` of the API @param {{nCorners: number, radius: number, raised: number}} kind
 */
export function unfold(bytes, { nCorners, radius, raised }) {
  const data = new DataView(bytes);
  const magic = String.fromCharCode(...new Uint8Array(bytes, 0, 4));
  if (magic !== "HVPS" || data.getUint32(4, true) !== 1) throw new Error("not voxels or points of a version that this page reads");
  const nDrawn = data.getUint32(8, true);
  const size = data.getFloat32(16, true);
  const perFace = 3 * (nCorners - 2);
  const positions = new Float32Array(3 * perFace * nDrawn);
  const normals = new Int8Array(4 * perFace * nDrawn);
  const tints = new Uint8Array(4 * perFace * nDrawn);
  // A first corner halfway between the axes: the sides of a square are along them.
  const turns = Array.from({ length: nCorners }, (_, k) => (2 * Math.PI * (k + 0.5)) / nCorners);
  for (let face = 0, corner = 0; face < nDrawn; face += 1) {
    const at = HEAD_BYTES + FACE_BYTES * face;
    const place = [0, 4, 8].map((byte) => data.getFloat32(at + byte, true));
    const sides = [12, 13, 14].map((byte) => data.getInt8(at + byte));
    const outward = normalize(sides);
    const flattest = sides.reduce((least, side, axis) => (Math.abs(side) < Math.abs(sides[least]) ? axis : least), 0);
    const across = normalize(cross(outward, [0, 1, 2].map((axis) => Number(axis === flattest))));
    const along = cross(across, outward);
    const middle = add(place, scale(outward, raised * size));
    const ring = turns.map((turn) => add(middle, add(scale(along, radius * size * Math.cos(turn)), scale(across, radius * size * Math.sin(turn)))));
    const color = COLORS[data.getUint8(at + 15)];
    for (let k = 2; k < nCorners; k += 1) {
      for (const place of [ring[0], ring[k - 1], ring[k]]) {
        positions.set(place, 3 * corner);
        normals.set(sides, 4 * corner);
        tints.set(color, 4 * corner);
        corner += 1;
      }
    }
  }
  return { mesh: { positions, normals }, tints, n: data.getUint32(12, true), nDrawn, size, ownSize: data.getFloat32(20, true) };
}
