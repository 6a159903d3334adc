/**
 * What is done to clay by numbers and files rather than by hand: curves, the region, material that is laid at once, an image and a solid for the tool.
 * Lengths are in mm here and in m in the API, both in the frame of the clay.
 */

import { byId, say, words } from "./element.js";
import { readNumber } from "./number-field.js";

const MM = 1e-3;
/** Files that are larger are refused by the server. */
const MOST_BYTES = { image: 4 << 20, solid: 16 << 20, values: 16 << 20 };
const PROPERTIES = ["stiffness_n_per_m", "damping_n_s_per_m", "mass_kg"];

export class Numbers {
  /**
   * @param {import("./link.js").Link} link
   * @param {(what: string, fields?: object) => Promise<boolean>} order sends an order about the clay, and says why it is refused; whether it was taken
   * @param {() => Promise<void>} refresh asks for the facts
   */
  constructor(link, order, refresh) {
    this.link = link;
    this.order = order;
    this.refresh = refresh;
    byId("clay-draw").onclick = () => this.#curves((curves_m) => this.order("clay_draw", { curves_m, is_free: this.#isFree }));
    byId("clay-undraw").onclick = () => this.order("clay_draw", { curves_m: [] });
    byId("clay-pull").onclick = () => this.#curves((curves_m) => this.#pull(curves_m));
    byId("clay-choose").onclick = () => this.#choose();
    byId("clay-lay").onclick = () => this.#lay();
    // What is being written is not overwritten by the facts.
    for (const field of this.#corners) field.oninput = () => field.setAttribute("data-written", "");
    for (const kind of ["image", "solid"]) {
      byId(`clay-${kind}`).onchange = ({ target }) => this.#upload(kind, target);
      byId(`clay-no-${kind}`).onclick = () => this.#send("DELETE", kind);
    }
    byId("clay-values").onchange = ({ target }) => this.#upload("values", target);
  }

  /** @param {object} facts of the clay */
  show(facts) {
    this.facts = facts;
    const { min, max } = facts.region_map;
    for (const [field, corner] of [[this.#corners[0], min], [this.#corners[1], max]]) {
      if (document.activeElement !== field && !field.hasAttribute("data-written")) field.value = corner.map((x) => (x / MM).toFixed(1)).join("  ");
    }
    const n = facts.curves_map.length;
    const said = n === 0 ? "" : n === 1 ? "One curve is drawn." : `${n} curves are drawn.`;
    if (byId("clay-drawn").textContent !== said) byId("clay-drawn").textContent = said;
    byId("clay-undraw").disabled = n === 0;
    byId("clay-no-image").disabled = !facts.has_image;
    byId("clay-no-solid").disabled = !facts.solid;
    const tool = facts.solid ? `Booleans take the solid: ${facts.solid}.` : "";
    if (byId("clay-tool-files").textContent !== tool) byId("clay-tool-files").textContent = tool;
  }

  get #corners() {
    return [byId("clay-region-least"), byId("clay-region-most")];
  }

  get #isFree() {
    return byId("clay-free").checked;
  }

  #curves(use) {
    const read = readCurves(byId("clay-curves").value);
    return typeof read === "string" ? say(read) : use(read);
  }

  #pull(curves_m) {
    const force_n = readPlace(byId("clay-force").value);
    const time_s = readNumber(byId("clay-time").value);
    if (!force_n || Number.isNaN(time_s)) return say("The force is three numbers in N, such as 0 0 3; the time is one in seconds.");
    return this.order("clay_pull", { curves_m, is_free: this.#isFree, force_n, time_s });
  }

  async #choose() {
    const corners = this.#corners.map((field) => readPlace(field.value)?.map((x) => x * MM));
    if (corners.includes(undefined)) return say("A corner is three numbers in mm, such as -10 -10 0.");
    const isTaken = await this.order("clay_region", { min: corners[0], max: corners[1] });
    // What was refused stays to be mended.
    if (isTaken) for (const field of this.#corners) field.removeAttribute("data-written");
  }

  #lay() {
    const field = (name) => byId(`clay-lay-${name.replaceAll("_", "-")}`);
    const painted = {};
    for (const name of PROPERTIES) {
      const text = field(name).value.trim();
      if (text !== "" && Number.isNaN(readNumber(text))) return say(`“${text}” is no number.`);
      if (text !== "") painted[name] = readNumber(text);
    }
    const { min, max } = this.facts.region_map;
    const middle = [0, 1].map((axis) => (min[axis] + max[axis]) / 2);
    const half = [0, 1, 2].map((axis) => (max[axis] - min[axis]) / 2);
    const places = {
      everywhere: {},
      box: { box: { min, max } },
      ball: { ball: { center: min.map((x, axis) => x + half[axis]), radius_m: Math.min(...half), falloff: "gaussian" } },
      gradient: { gradient: { from: [...middle, min[2]], to: [...middle, max[2]] } },
    };
    return this.order("clay_lay", { painted, ...places[byId("clay-lay-place").value] });
  }

  async #upload(kind, input) {
    const [file] = input.files;
    if (!file) return;
    if (file.size > MOST_BYTES[kind]) say(`${file.name} is larger than ${MOST_BYTES[kind] >> 20} MiB.`);
    else {
      const ending = file.name.split(".").at(-1).toLowerCase();
      const beside = kind === "solid" ? `?format=${encodeURIComponent(ending)}&units=${byId("clay-solid-units").value}` : "";
      await this.#send("PUT", `${kind}${beside}`, file);
    }
    // The same file can be chosen again.
    input.value = "";
  }

  async #send(method, path, file = undefined) {
    try {
      await this.link.sendFile(method, `clay/${path}`, file);
    } catch (error) {
      say(words(error));
    }
    await this.refresh().catch(() => {});
  }
}

/** Three numbers, separated by spaces, commas or semicolons; undefined: not three. @param {string} text @returns {number[]|undefined} */
export function readPlace(text) {
  const numbers = text.trim().split(/[\s;,]+/).map(readNumber);
  return numbers.length === 3 && !numbers.some(Number.isNaN) ? numbers : undefined;
}

/** A place on each line, an empty line between curves, in mm. @param {string} text @returns {number[][][]|string} in m, or what is wrong */
export function readCurves(text) {
  const curves = [[]];
  for (const [index, line] of text.split("\n").entries()) {
    if (line.trim() === "") {
      if (curves.at(-1).length > 0) curves.push([]);
      continue;
    }
    const place = readPlace(line);
    if (!place) return `Line ${index + 1} of the curves, “${line.trim()}”, is not three numbers x y z in mm.`;
    curves.at(-1).push(place.map((x) => x * MM));
  }
  const drawn = curves.filter((curve) => curve.length > 0);
  return drawn.length > 0 ? drawn : "There is no curve: write a place x y z in mm on each line, and an empty line between curves.";
}
