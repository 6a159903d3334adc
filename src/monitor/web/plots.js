/** Live plots of the last ten seconds. Every tick counts: a column of pixels shows the least and the most of its ticks. */

import { css, onChange } from "./colors.js";
import { oncePerFrame } from "./frame.js";
import { History } from "./history.js";
import { ceilTo125 } from "./math.js";
import { fixed, short } from "./units.js";

const WINDOW_S = 10;
/** A gap in time that is longer breaks the line. */
const GAP_S = 0.05;
/** Pixels (CSS) left of the plot for its numbers, and below for the time. */
export const PLOT_MARGIN = { left: 42, right: 8, top: 6, bottom: 18 };
const MARGIN = PLOT_MARGIN;

/** Numbers beside an axis, all with as many decimals as the one that needs most. @type {(marks: number[]) => string[]} */
export function axisTexts(marks) {
  const decimals = Math.max(0, ...marks.map((mark) => (short(mark).split(".")[1] ?? "").length));
  return marks.map((mark) => fixed(mark, decimals));
}

/**
 * @typedef {object} Plot
 * @property {string} id of its figure in the page
 * @property {number} column of the history
 * @property {string} color custom property
 * @property {number} decimals of the value
 * @property {number[]=} decades ends of a logarithmic scale, in powers of ten; without it the scale is linear from 0
 * @property {number=} least smallest top of a linear scale
 * @type {Plot[]}
 */
const PLOTS = [
  { id: "plot-force", column: 1, color: "--force", decimals: 2, least: 0.5 },
  { id: "plot-depth", column: 2, color: "--point", decimals: 3, least: 0.01 },
  { id: "plot-compute", column: 3, color: "--series-a", decimals: 0, decades: [0, 3.5] },
  { id: "plot-wakeup", column: 4, color: "--series-b", decimals: 0, decades: [0, 3.5] },
];

export class Plots {
  redraw = oncePerFrame(() => this.figures.forEach((figure) => this.#draw(figure)));

  /** @param {HTMLElement} root holds a `figure` with a `canvas` and an `output` per plot */
  constructor(root) {
    this.live = new History();
    /** @type {?History} what is shown while paused */
    this.paused = null;
    this.deadlineUs = 1000;
    /** Share of the window under the pointer, the same in all plots. @type {?number} */
    this.cursor = null;
    this.figures = PLOTS.map((plot) => {
      const figure = root.querySelector(`#${plot.id}`);
      const canvas = figure.querySelector("canvas");
      canvas.addEventListener("pointermove", ({ offsetX }) => {
        this.cursor = (offsetX - MARGIN.left) / (canvas.clientWidth - MARGIN.left - MARGIN.right);
        this.redraw();
      });
      canvas.addEventListener("pointerleave", () => {
        this.cursor = null;
        this.redraw();
      });
      new ResizeObserver(() => this.redraw()).observe(canvas);
      return { plot, canvas, value: figure.querySelector("output"), top: plot.least };
    });
    this.#readColors();
    onChange(() => {
      this.#readColors();
      this.redraw();
    });
  }

  get history() {
    return this.paused ?? this.live;
  }

  /** @param {number[][]} rows */
  push(rows) {
    this.live.push(rows);
    if (!this.paused) this.redraw();
  }

  /** Stands still, or goes on with what came meanwhile. @param {boolean} isPaused */
  pause(isPaused) {
    this.paused = isPaused ? this.live.freeze() : null;
    this.redraw();
  }

  #readColors() {
    this.colors = { grid: css("--plot-grid"), text: css("--muted"), ground: css("--surface"), deadline: css("--fault"), cursor: css("--text") };
    this.font = `11px ${css("--sans")}`;
    for (const figure of this.figures) figure.color = css(figure.plot.color);
  }

  #draw(figure) {
    const { plot, canvas } = figure;
    const { clientWidth: width, clientHeight: height } = canvas;
    const ratio = Math.min(devicePixelRatio, 2);
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const area = { x: MARGIN.left, y: MARGIN.top, w: width - MARGIN.left - MARGIN.right, h: height - MARGIN.top - MARGIN.bottom };
    if (area.w <= 0 || area.h <= 0) return;

    const columns = this.#columns(plot.column, Math.round(area.w));
    const y = this.#scale(figure, columns.most, area);
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    g.font = this.font;
    this.#drawGrid(g, figure, area, y);
    this.#drawLine(g, figure, area, y, columns);
    this.#drawDeadline(g, figure, area, y);
    this.#drawCursor(g, figure, area, y);
  }

  /** The least, the most and the last value of every column of pixels. */
  #columns(column, n) {
    const history = this.history;
    const begin = history.end - WINDOW_S;
    const out = { least: new Float64Array(n).fill(Infinity), most: new Float64Array(n).fill(-Infinity), last: new Float64Array(n).fill(Number.NaN) };
    for (let row = history.since(begin); row < history.n; row += 1) {
      const value = history.at(row, column);
      if (!Number.isFinite(value)) continue;
      const k = Math.min(n - 1, Math.max(0, Math.floor(((history.at(row, 0) - begin) / WINDOW_S) * n)));
      out.least[k] = Math.min(out.least[k], value);
      out.most[k] = Math.max(out.most[k], value);
      out.last[k] = value;
    }
    return out;
  }

  /** From a value to a height in the picture. */
  #scale(figure, most, area) {
    const { decades, least } = figure.plot;
    if (decades) {
      const [low, high] = decades;
      return (value) => area.y + area.h * (1 - (Math.log10(Math.min(10 ** high, Math.max(value, 10 ** low))) - low) / (high - low));
    }
    const highest = most.reduce((a, b) => Math.max(a, b), 0);
    const fitting = Math.max(least, ceilTo125(1.05 * highest));
    // It grows at once and shrinks late, so that it does not flicker between two scales.
    if (fitting > figure.top || highest < 0.3 * figure.top) figure.top = fitting;
    return (value) => area.y + area.h * (1 - Math.max(0, value) / figure.top);
  }

  #drawGrid(g, figure, area, y) {
    const { decades } = figure.plot;
    const marks = decades ? Array.from({ length: Math.floor(decades[1] - decades[0]) + 1 }, (_, n) => 10 ** (decades[0] + n)) : [0, figure.top / 2, figure.top];
    g.strokeStyle = this.colors.grid;
    g.fillStyle = this.colors.text;
    g.lineWidth = 1;
    g.textAlign = "right";
    g.textBaseline = "middle";
    g.beginPath();
    const texts = decades ? marks.map(short) : axisTexts(marks);
    for (const [n, mark] of marks.entries()) {
      const at = Math.round(y(mark)) + 0.5;
      g.moveTo(area.x, at);
      g.lineTo(area.x + area.w, at);
      g.fillText(texts[n], area.x - 6, at);
    }
    g.textBaseline = "top";
    const step = area.w < 260 ? 5 : 2;
    for (let ago = 0; ago <= WINDOW_S; ago += step) {
      const at = Math.round(area.x + area.w * (1 - ago / WINDOW_S)) + 0.5;
      g.moveTo(at, area.y);
      g.lineTo(at, area.y + area.h);
      g.textAlign = ago === 0 ? "right" : "center";
      g.fillText(ago === 0 ? "now" : `−${ago} s`, at, area.y + area.h + 5);
    }
    g.stroke();
    if (!decades) return;
    const at = Math.round(y(this.deadlineUs)) + 0.5;
    g.strokeStyle = this.colors.deadline;
    g.setLineDash([5, 4]);
    g.beginPath();
    g.moveTo(area.x, at);
    g.lineTo(area.x + area.w, at);
    g.stroke();
    g.setLineDash([]);
  }

  /** Over the line, on ground of its own: a busy plot must not hide it. */
  #drawDeadline(g, figure, area, y) {
    if (!figure.plot.decades) return;
    const text = `deadline ${short(this.deadlineUs)} µs`;
    const [right, bottom] = [area.x + area.w - 4, Math.round(y(this.deadlineUs)) - 2];
    g.fillStyle = this.colors.ground;
    g.globalAlpha = 0.85;
    g.fillRect(right - g.measureText(text).width - 3, bottom - 13, g.measureText(text).width + 6, 14);
    g.globalAlpha = 1;
    g.fillStyle = this.colors.deadline;
    g.textAlign = "right";
    g.textBaseline = "bottom";
    g.fillText(text, right, bottom);
  }

  #drawLine(g, figure, area, y, { least, most, last }) {
    const reach = Math.ceil((GAP_S / WINDOW_S) * least.length) + 1;
    g.strokeStyle = figure.color;
    g.lineWidth = 1.4;
    g.lineJoin = "round";
    g.beginPath();
    let before = -Infinity;
    for (let k = 0; k < least.length; k += 1) {
      if (Number.isNaN(last[k])) continue;
      const x = area.x + k + 0.5;
      if (k - before > reach) g.moveTo(x, y(least[k]));
      else g.lineTo(x, y(least[k]));
      if (most[k] > least[k]) {
        g.lineTo(x, y(most[k]));
        g.lineTo(x, y(last[k]));
      }
      before = k;
    }
    g.stroke();
  }

  /** A line under the pointer; the number above the plot is the value there, else the newest. */
  #drawCursor(g, figure, area, y) {
    const { history, cursor } = this;
    const { plot } = figure;
    let row = history.n - 1;
    if (cursor !== null && cursor >= 0 && cursor <= 1) {
      row = Math.min(row, history.since(history.end - WINDOW_S * (1 - cursor)));
      const x = Math.round(area.x + area.w * cursor) + 0.5;
      g.strokeStyle = this.colors.cursor;
      g.globalAlpha = 0.5;
      g.beginPath();
      g.moveTo(x, area.y);
      g.lineTo(x, area.y + area.h);
      g.stroke();
      g.globalAlpha = 1;
      const value = row >= 0 ? history.at(row, plot.column) : Number.NaN;
      if (Number.isFinite(value)) {
        g.fillStyle = figure.color;
        g.beginPath();
        g.arc(x, y(value), 3, 0, 2 * Math.PI);
        g.fill();
      }
    }
    figure.value.value = fixed(row >= 0 ? history.at(row, plot.column) : null, plot.decimals);
  }
}
