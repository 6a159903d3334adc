/**
 * All parts as surface voxels, or with the points of their pointshells on them. Asked for when that is chosen.
 */

import { byId, say, words } from "./element.js";
import { matrixOfPose } from "./math.js";
import { count, short } from "./units.js";

/** Where each is asked for, by the field of a part, and what it is called. */
const KINDS = { voxels: { path: "voxels", words: "surface voxels of" }, points: { path: "pointshell", words: "points, voxels of" } };
const GONE = 404;

/** @typedef {{faces: object, n: number, nDrawn: number, size: number, ownSize: number}} Shown on the graphics card; how many there are; sizes of voxels, m */

export class Structures {
  /** @param {import("./mesh-loader.js").MeshLoader} loader @param {import("./scene.js").SceneView} view */
  constructor(loader, view) {
    this.loader = loader;
    this.view = view;
    /** @type {?"voxels"|"points"} */
    this.kind = null;
    /** By part. @type {Map<object, Shown>} */
    this.shown = new Map();
    this.nMissing = 0;
    byId("structure").onchange = ({ currentTarget: choice }) => this.#choose(choice.value in KINDS ? choice.value : null);
    view.canvas.addEventListener("webglcontextrestored", () => {
      // Gone with the context.
      this.shown.clear();
      this.#choose(this.kind);
    });
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

  /** Parts of another scene follow. */
  cleared() {
    this.#drop();
  }

  /** @param {object} part */
  added(part) {
    if (this.kind) this.#load(part);
  }

  #choose(kind) {
    this.#drop();
    this.kind = kind;
    for (const part of this.view.parts) this.added(part);
    this.#tell();
    this.view.redraw();
  }

  #drop() {
    for (const { faces } of this.shown.values()) this.view.draw.free(faces);
    this.shown = new Map();
    this.nMissing = 0;
    this.#tell();
  }

  async #load(part) {
    const { kind, shown } = this;
    let refusal = null;
    const marks = await this.loader.loadMarks(part[KINDS[kind].path], kind).catch((error) => (refusal = error) && null);
    // Another choice, another scene, or another context.
    if (this.shown !== shown) return;
    if (marks) {
      const { mesh, tints, ...facts } = marks;
      const faces = this.view.draw.faces(mesh);
      this.view.draw.tint(faces, tints);
      shown.set(part, { faces, ...facts });
    } else {
      this.nMissing += 1;
      // A scene that has just been exchanged needs no words.
      if (refusal.status !== GONE) say(words(refusal));
    }
    this.#tell();
    this.view.redraw();
  }

  /** How many there are, of which size, and what is not as the scene has it. */
  #tell() {
    const legend = byId("legend-structure");
    legend.hidden = !this.kind;
    if (!this.kind) return;
    const all = [...this.shown.values()];
    const sizes = all.map(({ size }) => size * 1e3);
    const [least, most] = [Math.min(...sizes), Math.max(...sizes)];
    const n = all.reduce((sum, shown) => sum + shown.n, 0);
    const said = [];
    if (all.length > 0) said.push(`${count(n)} ${KINDS[this.kind].words} ${short(least)}${most > least ? ` to ${short(most)}` : ""} mm`);
    if (all.some(({ size, ownSize }) => size > ownSize)) said.push("coarser than the scene");
    if (this.kind === "points" && all.some(({ n, nDrawn }) => nDrawn < n)) said.push("some drawn");
    if (this.nMissing > 0) said.push(`missing for ${this.nMissing} of the parts`);
    if (all.length + this.nMissing < Math.max(1, this.view.parts.length)) said.push("loading");
    legend.textContent = said.join(", ");
  }
}
