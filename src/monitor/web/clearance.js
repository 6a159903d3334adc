/** The tool in colours: how far its points are from the parts, from touching to as far as the scene knows. Asked for while it is shown. */

import { byId, say, words } from "./element.js";
import { Splats } from "./splats.js";
import { short } from "./units.js";

const EVERY_MS = 150;
const HEAD_BYTES = 32;
const POINT_BYTES = 20;
/** Colours by share of the known distance, as in the legend; the first is that of contact. */
const SCALE = [
  [0, [200, 30, 60]],
  [0.4, [240, 160, 40]],
  [0.7, [245, 230, 122]],
  [1, [77, 143, 209]],
];

export class Clearance {
  /** @param {import("./link.js").Link} link @param {import("./scene.js").SceneView} view */
  constructor(link, view) {
    this.link = link;
    this.view = view;
    this.isOn = false;
    this.splats = new Splats();
    this.splats.prepare(view.draw.gl);
    view.canvas.addEventListener("webglcontextrestored", () => this.splats.prepare(view.draw.gl));
    byId("clearance").onclick = () => this.#turn(!this.isOn);
    view.additions.push(this);
  }

  /** @param {import("./draw.js").Draw} draw */
  among(draw) {
    const part = this.view.parts.find(({ role }) => role === "tool");
    if (!this.isOn || !part || !this.splats.samples) return;
    this.splats.pose = this.view.standing(part);
    draw.cut = this.view.cutOf("tool");
    this.splats.drawDiscs((model, opacity) => draw.use(draw.programs.splat, model, [0, 0, 0], opacity), 1);
    draw.cut = null;
  }

  #turn(isOn) {
    this.isOn = isOn;
    byId("clearance").setAttribute("aria-pressed", String(isOn));
    byId("legend-clearance").hidden = !isOn;
    this.splats.clear();
    this.view.redraw();
    if (isOn) this.#follow();
  }

  async #follow() {
    try {
      while (this.isOn) {
        const { samples, known_m: known } = colored(await this.link.getBytes("clearance"));
        if (!this.isOn) return;
        this.splats.take(samples);
        byId("legend-clearance").textContent = `0 to ${short(known * 1e3)} mm and more`;
        this.view.redraw();
        await new Promise((done) => setTimeout(done, EVERY_MS));
      }
    } catch (error) {
      this.#turn(false);
      say(`The tool has no colours: ${words(error)}`);
    }
  }
}

/**
 * Points with a colour in place of their clearance.
 * @param {ArrayBuffer} buffer `HCLR` of the API
 * @returns {{samples: import("./splats.js").Samples, known_m: number}}
 */
export function colored(buffer) {
  const data = new DataView(buffer);
  const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 4));
  if (magic !== "HCLR" || data.getUint32(4, true) !== 1) throw new Error("not distances of a version that this page reads");
  const n = data.getUint32(8, true);
  const known = data.getFloat32(16, true);
  const bytes = new Uint8Array(buffer, HEAD_BYTES, n * POINT_BYTES);
  for (let at = POINT_BYTES - 4; at < bytes.length; at += POINT_BYTES) {
    bytes.set(colorOf(data.getFloat32(HEAD_BYTES + at, true) / known), at);
  }
  return { samples: { version: 0, n, nAll: n, spacing: data.getFloat32(12, true), bytes }, known_m: known };
}

/** @param {number} share of the known distance @returns {number[]} 0 to 255 */
function colorOf(share) {
  const next = SCALE.findIndex(([end]) => share <= end);
  if (next === 0) return [...SCALE[0][1], 0];
  if (next < 0) return [...SCALE.at(-1)[1], 0];
  const [[begin, from], [end, to]] = [SCALE[next - 1], SCALE[next]];
  return [...from.map((part, n) => Math.round(part + ((to[n] - part) * (share - begin)) / (end - begin))), 0];
}
