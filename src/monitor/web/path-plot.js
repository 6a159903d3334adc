/** Depth over the path of the tool: the same hole looks the same, however slowly the hand goes. */

import { css, onChange } from "./colors.js";
import { oncePerFrame } from "./frame.js";
import { ceilTo125 } from "./math.js";
import { axisTexts, PLOT_MARGIN as MARGIN } from "./plots.js";
import { fixed } from "./units.js";

/** @typedef {import("./path.js").Step} Step */

/** Shortest and longest stretch of path that is shown, mm; smallest top of the scale, mm. */
const SHORTEST_MM = 5;
const LONGEST_MM = 200;
const LEAST_TOP_MM = 0.01;

export class PathPlot {
  redraw = oncePerFrame(() => this.#draw());

  /** @param {import("./path.js").ToolPath} path */
  constructor(path) {
    this.path = path;
    /** @type {?import("./path.js").Step[]} what is shown while paused */
    this.paused = null;
    const figure = document.querySelector("#plot-path");
    this.canvas = figure.querySelector("canvas");
    this.value = figure.querySelector("output");
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    onChange(() => this.redraw());
  }

  get steps() {
    return this.paused ?? this.path.steps;
  }

  /** @param {boolean} isPaused */
  pause(isPaused) {
    this.paused = isPaused ? this.path.steps.map((step) => ({ ...step })) : null;
    this.redraw();
  }

  #draw() {
    const { canvas, steps } = this;
    const { clientWidth: width, clientHeight: height } = canvas;
    const ratio = Math.min(devicePixelRatio, 2);
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
    const area = { x: MARGIN.left, y: MARGIN.top, w: width - MARGIN.left - MARGIN.right, h: height - MARGIN.top - MARGIN.bottom };
    if (area.w <= 0 || area.h <= 0) return;
    const end = steps.at(-1)?.way_mm ?? 0;
    const span = Math.min(LONGEST_MM, Math.max(SHORTEST_MM, ceilTo125(end)));
    const begin = Math.max(0, end - span);
    const seen = columns(steps, begin, area.w / span);
    const top = Math.max(LEAST_TOP_MM, ceilTo125(1.05 * seen.reduce((most, { most_mm }) => Math.max(most, most_mm), 0)));
    const x = (way) => area.x + (area.w * (way - begin)) / span;
    const y = (depth) => area.y + area.h * (1 - Math.max(0, depth) / top);

    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    g.font = `11px ${css("--sans")}`;
    g.strokeStyle = css("--plot-grid");
    g.fillStyle = css("--muted");
    g.lineWidth = 1;
    g.beginPath();
    const heights = [0, top / 2, top];
    axisTexts(heights).forEach((text, n) => {
      const at = Math.round(y(heights[n])) + 0.5;
      g.moveTo(area.x, at);
      g.lineTo(area.x + area.w, at);
      g.textAlign = "right";
      g.textBaseline = "middle";
      g.fillText(text, area.x - 6, at);
    });
    const step = ceilTo125(span / Math.max(2, Math.floor(area.w / 70)));
    const ways = [];
    for (let n = Math.ceil(begin / step - 1e-9); n * step <= begin + span * (1 + 1e-9); n += 1) ways.push(n * step);
    g.textBaseline = "top";
    const texts = axisTexts(ways);
    // The last one has the unit, and room for it.
    const free = area.x + area.w + MARGIN.right - g.measureText(`${texts.at(-1)} mm`).width - 6;
    texts.forEach((text, n) => {
      const at = Math.round(x(ways[n])) + 0.5;
      g.moveTo(at, area.y);
      g.lineTo(at, area.y + area.h);
      const isLast = n === ways.length - 1;
      g.textAlign = isLast ? "right" : "center";
      if (!isLast && at + g.measureText(text).width / 2 > free) return;
      g.fillText(isLast ? `${text} mm` : text, isLast ? area.x + area.w + MARGIN.right : at, area.y + area.h + 5);
    });
    g.stroke();

    g.strokeStyle = css("--point");
    g.lineWidth = 1.4;
    g.lineJoin = "round";
    g.beginPath();
    for (const { way_mm: way, least_mm: least, most_mm: most } of seen) {
      g.lineTo(x(way), y(least));
      g.lineTo(x(way), y(most));
    }
    g.stroke();
    this.value.value = fixed(end, 1);
  }
}

/** Of the steps from a place on, one for each column of pixels. @param {Step[]} steps @param {number} perMm pixels @returns {Step[]} */
function columns(steps, begin, perMm) {
  const seen = [];
  for (let n = steps.length - 1; n >= 0 && steps[n].way_mm >= begin; n -= 1) {
    const { way_mm: way, least_mm: least, most_mm: most } = steps[n];
    const last = seen.at(-1);
    if (last && (last.way_mm - way) * perMm < 1) {
      Object.assign(last, { least_mm: Math.min(last.least_mm, least), most_mm: Math.max(last.most_mm, most) });
    } else seen.push({ ...steps[n] });
  }
  return seen.reverse();
}
