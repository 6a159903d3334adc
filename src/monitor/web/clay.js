/**
 * Clay: what the tool does to it, the hold, strokes back and forth, files, and the samples for the picture. A scene without clay shows
 * nothing of this.
 *
 * All of it is disabled, with the reason, where it would do nothing: without a connection, after the end of the run or of the studio. A hold
 * ends with the finger that began it: when the button is let go, when the page loses the focus or is hidden, and, as the server sees
 * to it, when the page falls silent or no force flows.
 */

import { byId, element, say, words } from "./element.js";
import { Look } from "./look.js";
import { Numbers } from "./clay-numbers.js";
import { Material } from "./material.js";
import { Row } from "./parameters.js";
import { parseSamples } from "./splats.js";
import { count, fixed } from "./units.js";

/** The facts are asked for this often, and the samples that often, ms. */
const FACTS_EVERY_MS = 400;
const SAMPLES_EVERY_MS = 100;
/** After the facts could not be had. */
const AGAIN_MS = 2000;
/** While the clay is held, a sign of life goes out this often. */
const BEAT_MS = 200;
/** Writing a large piece takes its time. */
const SAVE_TIMEOUT_MS = 120_000;

/** Of each craft: its word in the menu, what to do, what it can be set in, and whether it acts by being held. */
const CRAFTS = {
  touch: { label: "Touch", hint: "Feel the clay; it stays as it is." },
  push: { label: "Push", hint: "Press the tool into the clay: it dents.", sets: ["brush", "falloff"] },
  pull: { label: "Pull", hint: "Near the clay, hold; move the hand; let go.", sets: ["brush", "falloff"], isHeld: true },
  "pull-curve": { label: "Pull curve", hint: "Hold to draw a curve, and another; hold near one to pull all of them.", sets: ["brush", "falloff"], isHeld: true },
  paint: { label: "Paint", hint: "Press lightly for a fine line, harder for a wide one.", sets: ["brush", "color"] },
  material: { label: "Material", hint: "Press to make the clay harder or softer there, and colour it.", sets: ["brush", "falloff", "color", "material"] },
  emboss: { label: "Emboss", hint: "Hold where the image is to stand out.", sets: ["brush", "depth"], isHeld: true },
  engrave: { label: "Engrave", hint: "Hold where the image is to be sunk in.", sets: ["brush", "depth"], isHeld: true },
  union: { label: "Union", hint: "Hold to add the tool's own shape.", sets: ["sharp"], isHeld: true },
  intersection: { label: "Intersect", hint: "Hold to leave only what the tool's shape covers.", sets: ["sharp"], isHeld: true },
  region: { label: "Region", hint: "Hold at one corner of the box that is to deform; let go at the opposite one.", isHeld: true },
  difference: { label: "Cut out", hint: "Hold to cut the tool's own shape out.", sets: ["sharp"], isHeld: true },
};

/** Phases in which force may flow. */
const FORCE = ["enabling", "enabled", "stopping", "braking"];

export class Clay {
  /** @param {import("./link.js").Link} link @param {?import("./scene.js").SceneView} view */
  constructor(link, view) {
    this.link = link;
    this.view = view;
    /** @type {?object} what the server says of it */
    this.facts = null;
    /** Counts scenes: answers about an earlier one are not taken. */
    this.turn = 0;
    /** Counts questions for the facts, and which of them the newest answer was to. */
    this.asked = 0;
    this.answered = 0;
    this.version = 0;
    /** @type {?{n: number, nAll: number}} samples in the picture, and in the piece as it is there */
    this.drawn = null;
    /** @type {{isOver: boolean, isOpen: boolean, phase: string}} where the run stands */
    this.standing = { isOver: false, isOpen: false, phase: "" };
    /** Where a session went. */
    this.keptIn = "";
    /** @type {?number} timer of the signs of life */
    this.beating = null;
    /** The last question whose answer may still be about a hold of this page; endless until the server has answered to its end. */
    this.heldUntil = -1;
    /** Counts holds: what the server says of the end of an earlier one is not about the next. */
    this.holds = 0;
    this.rows = { brush: this.#row("brush"), depth: this.#row("depth") };
    byId("clay-settings").replaceChildren(this.rows.brush.root, this.rows.depth.root);
    this.material = new Material((painted) => this.#take({ painted }));
    this.numbers = new Numbers(link, (what, fields) => this.#do(what, fields), () => this.refresh());
    byId("clay-falloff").onchange = ({ target }) => this.#take({ falloff: target.value });
    byId("clay-color").onchange = ({ target }) => this.#take({ color: target.value });
    byId("clay-sharp").onchange = ({ target }) => this.#take({ is_sharp: target.checked });
    if (view) new Look(view);
    else for (const name of ["look", "form", "grid"]) byId(`clay-${name}`).disabled = true;
    byId("clay-undo").onclick = () => this.#do("clay_undo");
    byId("clay-redo").onclick = () => this.#do("clay_redo");
    byId("clay-save").onsubmit = (event) => this.#save(event);
    this.#listen();
  }

  /** Another scene is rendered. @param {boolean} hasClay */
  async begin(hasClay) {
    this.turn += 1;
    this.version = 0;
    this.drawn = null;
    this.keptIn = "";
    const { turn } = this;
    this.letGo();
    this.#show(null);
    if (!hasClay) return;
    try {
      const facts = await this.link.get("clay");
      if (turn !== this.turn) return;
      this.scene = facts;
      this.#show(facts);
    } catch (error) {
      if (error.status > 0 && error.status !== 503) say(words(error));
      setTimeout(() => turn === this.turn && this.begin(true), AGAIN_MS);
      return;
    }
    this.#follow(turn, FACTS_EVERY_MS, () => this.refresh());
    this.#follow(turn, SAMPLES_EVERY_MS, () => this.#fetchSamples(turn));
  }

  /** @param {object} event of the server */
  hear({ event, names, text }) {
    if (event !== "clay" || !this.facts) return;
    if (names[0] === "let-go") this.letGo(false);
    if (names[0] === "saved") Object.assign(byId("clay-saved"), { hidden: false, textContent: text });
    if (names[0] === "saved" && names[1].endsWith(".session")) this.keptIn = names[1];
    this.refresh().catch(() => {});
  }

  /** The connection is gone, and the hold with it. */
  lose() {
    this.letGo(false);
  }

  /** Where the run stands, whenever that may have changed. @param {{isOver: boolean, isOpen: boolean, phase: string}} standing */
  stand(standing) {
    const { isOver, isOpen, phase } = this.standing;
    if (standing.isOver === isOver && standing.isOpen === isOpen && standing.phase === phase) return;
    this.standing = { ...standing };
    this.#allow();
  }

  /** Strokes would be lost at the end of the run: no session has them, and none will be written. */
  get isAtRisk() {
    const { facts } = this;
    // Of a studio that has broken the program keeps a session by itself.
    return Boolean(!this.standing.isOver && facts?.is_unsaved && !facts.session_at_end && !facts.is_over);
  }

  /** Where the strokes are kept; nothing where they are not, or where there are none. */
  get keeper() {
    return this.facts?.session_at_end ?? (this.facts?.is_unsaved ? "" : this.keptIn);
  }

  /** Writes a session. @returns {Promise<string>} where it is */
  async keep() {
    const { file } = await this.link.send("clay_save", { kind: "session" }, SAVE_TIMEOUT_MS);
    this.keptIn = file;
    if (this.facts) this.facts.is_unsaved = false;
    return file;
  }

  async refresh() {
    const { turn } = this;
    const number = ++this.asked;
    const facts = await this.link.get("clay");
    // Answers may overtake each other: an older one is not taken any more.
    if (turn !== this.turn || number < this.answered) return;
    this.answered = number;
    this.#show(facts);
  }

  /** Again and again, while it is about the same scene and the tab is visible. */
  async #follow(turn, every_ms, ask) {
    while (turn === this.turn) {
      if (!document.hidden && this.link.isOpen) await ask().catch(() => {});
      await new Promise((done) => setTimeout(done, every_ms));
    }
  }

  async #fetchSamples(turn) {
    const bytes = await this.link.getBytes(`clay/points?since=${this.version}`);
    if (bytes.byteLength === 0 || turn !== this.turn) return;
    const samples = parseSamples(bytes);
    this.version = samples.version;
    this.drawn = samples;
    this.view?.addClay(samples);
    this.#count();
  }

  /** @param {?object} facts */
  #show(facts) {
    this.facts = facts;
    byId("clay-box").hidden = !facts;
    byId("legend-brush").hidden = !facts;
    byId("legend-region").hidden = !facts?.region_map;
    document.body.classList.toggle("has-clay", Boolean(facts));
    if (!facts) return;
    const craft = CRAFTS[facts.craft];
    const buttons = byId("clay-crafts");
    if (buttons.children.length !== facts.crafts.length) buttons.replaceChildren(...facts.crafts.map((name) => this.#button(name)));
    for (const button of buttons.children) button.setAttribute("aria-pressed", String(button.value === facts.craft));
    write(byId("clay-hint"), craft?.hint ?? "");
    this.#allow();
    const [least, most] = facts.brush_range_m;
    this.rows.brush.take({ name: "clay_brush_m", least, most, scene: this.scene.brush_m, value: facts.brush_m });
    this.rows.depth.take({ name: "clay_depth_m", least: 0.05 * least, most, scene: this.scene.depth_m, value: facts.depth_m });
    const sets = craft?.sets ?? [];
    this.rows.brush.root.hidden = !sets.includes("brush");
    this.rows.depth.root.hidden = !sets.includes("depth");
    for (const name of ["falloff", "color", "material", "sharp"]) byId(`clay-${name}-line`).hidden = !sets.includes(name);
    if (document.activeElement !== byId("clay-falloff")) byId("clay-falloff").value = facts.falloff;
    if (document.activeElement !== byId("clay-color")) byId("clay-color").value = facts.color;
    byId("clay-sharp").checked = facts.is_sharp;
    this.material.show(facts);
    this.numbers.show(facts);
    for (const name of ["undo", "redo"]) {
      const button = byId(`clay-${name}`);
      button.disabled = facts[name] === 0;
      write(button, `${name === "undo" ? "Undo" : "Redo"} (${facts[name]})`);
    }
    const unsaved = facts.session_at_end ? "saved at the end" : "not saved";
    write(byId("clay-busy"), facts.is_stroke ? "stroke under way" : facts.is_unsaved ? unsaved : "");
    byId("clay-trouble").hidden = !facts.trouble;
    write(byId("clay-trouble"), facts.trouble);
    this.#count();
    this.#picture(sets);
  }

  /** How many samples there are, and how many of them are drawn: as of the picture, which is what one sees. */
  #count() {
    const { facts } = this;
    if (!facts) return;
    const { n, nAll } = this.drawn ?? { n: facts.samples, nAll: facts.samples };
    const thinned = n < nAll ? `, ${count(n)} shown` : "";
    const leftOut = facts.late > 0 ? `, ${count(facts.late)} left out to keep time` : "";
    write(byId("clay-facts"), `${count(nAll)} samples${thinned}; ${count(facts.updates)} updates of the material, the last took ${fixed(facts.update_s * 1e3, 1)} ms${leftOut}`);
  }

  /** Why nothing can be done to the clay; empty where something can. */
  get #off() {
    const { isOver, isOpen } = this.standing;
    if (isOver) return "The run is over: the clay can neither be worked nor saved from here.";
    if (!isOpen) return "No connection: nothing can be done to the clay until it is back.";
    return this.facts?.is_over ? "The studio has ended: the clay stays as it is until the run ends." : "";
  }

  /** Why a hold would do nothing; empty where it does something. */
  get #idle() {
    if (!CRAFTS[this.facts.craft]?.isHeld) return "This tool works without Hold.";
    if (!FORCE.includes(this.standing.phase)) return "Hold does nothing while no force flows: Enable first.";
    const isOurs = this.isHolding || this.answered <= this.heldUntil;
    return this.facts.is_held && !isOurs ? "Another client holds the clay." : "";
  }

  /** Enables what would do something, and says why the rest would not. */
  #allow() {
    if (!this.facts) return;
    const off = this.#off;
    byId("clay-controls").disabled = off !== "";
    byId("clay-off").hidden = off === "";
    write(byId("clay-off"), off);
    const idle = off ? "" : this.#idle;
    byId("clay-hold").disabled = idle !== "" && !this.isHolding;
    write(byId("clay-idle"), idle);
  }

  /** What the view draws beside the samples. */
  #picture(sets) {
    if (!this.view) return;
    const { world_from_map: pose, region_map: region, brush_m: radius, color } = this.facts;
    const hex = Number.parseInt(color.slice(1), 16);
    const paint = sets.includes("color") ? [16, 8, 0].map((shift) => ((hex >> shift) & 255) / 255) : null;
    this.view.clay.takeCurves(this.facts.curves_map);
    Object.assign(this.view.clay, { pose, region, raster: this.facts.raster, brush: sets.includes("brush") ? { radius, color: paint } : null });
    this.view.redraw();
  }

  #button(name) {
    const { label, hint } = CRAFTS[name] ?? { label: name, hint: "" };
    const button = element("button", { type: "button", value: name, title: hint, "aria-pressed": "false" }, label);
    button.onclick = () => this.#take({ craft: name });
    return button;
  }

  #row(name) {
    return new Row(`clay_${name}_m`, async (value) => {
      await this.link.send("clay_take", { [`${name}_m`]: value });
      await this.refresh();
    });
  }

  #take(settings) {
    return this.#do("clay_take", settings);
  }

  async #do(what, fields = {}, timeoutMs = undefined) {
    let isTaken = true;
    try {
      await this.link.send(what, fields, timeoutMs);
    } catch (error) {
      isTaken = false;
      say(words(error));
    }
    await this.refresh().catch(() => {});
    return isTaken;
  }

  async #save(event) {
    event.preventDefault();
    const file = byId("clay-file").value.trim();
    await this.#do("clay_save", { kind: event.submitter?.value ?? "session", ...(file && { file }) }, SAVE_TIMEOUT_MS);
  }

  #listen() {
    const button = byId("clay-hold");
    button.onpointerdown = (event) => {
      if (event.button !== 0) return;
      button.setPointerCapture(event.pointerId);
      this.hold();
    };
    for (const end of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(end, () => this.letGo());
    button.oncontextmenu = (event) => event.preventDefault();
    button.onkeydown = (event) => {
      if (event.key !== " ") return;
      event.preventDefault();
      if (!event.repeat) this.hold();
    };
    button.onkeyup = (event) => {
      if (event.key !== " ") return;
      event.preventDefault();
      this.letGo();
    };
    addEventListener("blur", () => this.letGo());
    addEventListener("pagehide", () => this.letGo());
    document.addEventListener("visibilitychange", () => document.hidden && this.letGo());
    addEventListener("keydown", (event) => {
      const isStep = (event.ctrlKey || event.metaKey) && !event.altKey && event.key.toLowerCase() === "z";
      // What is being written has an undo of its own.
      if (!isStep || !this.facts || this.#off || event.target.matches?.("input:not([type=range]):not([type=checkbox]):not([type=color]), select, textarea")) return;
      event.preventDefault();
      this.#do(event.shiftKey ? "clay_redo" : "clay_undo");
    });
  }

  /** What the tool does to the clay, it does while it is held. */
  get isHeldCraft() {
    return Boolean(CRAFTS[this.facts?.craft]?.isHeld);
  }

  get isHolding() {
    return this.beating !== null;
  }

  /** As if the arm's first button were held. */
  async hold() {
    if (this.isHolding || byId("clay-hold").matches(":disabled")) return;
    const holds = ++this.holds;
    byId("clay-hold").setAttribute("aria-pressed", "true");
    this.beating = setInterval(() => this.link.send("ping").catch(() => {}), BEAT_MS);
    try {
      await this.link.send("clay_hold", { held: true });
    } catch (error) {
      // A hold whose answer is missing may have been heard.
      if (holds === this.holds) this.letGo(this.link.isOpen);
      say(words(error));
    }
  }

  /** @param {boolean=} isTold whether the server is to hear of it */
  letGo(isTold = true) {
    if (!this.isHolding) return;
    clearInterval(this.beating);
    this.beating = null;
    byId("clay-hold").setAttribute("aria-pressed", "false");
    const { holds } = this;
    const isHeard = () => {
      if (holds === this.holds) this.heldUntil = this.asked;
      this.#allow();
    };
    if (!isTold) return isHeard();
    this.heldUntil = Infinity;
    this.#allow();
    this.link.send("clay_hold", { held: false }).catch((error) => say(words(error))).finally(isHeard);
  }
}

/** Writing the same again would make screen readers repeat it. */
function write(shown, text) {
  if (shown.textContent !== text) shown.textContent = text;
}
