/** Takes home what is seen: the numbers of the plots, the view as a picture, the view as a film. Nothing of it goes through the server. */

import { css } from "./colors.js";
import { byId, say } from "./element.js";
import { download } from "./download.js";

/** Pictures of a film, per second, and how large it grows. */
const FILM_HZ = 30;
const MOST_FILM_BYTES = 400 << 20;
const FILM_TYPES = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm"];

export class Export {
  /**
   * @param {?import("./scene.js").SceneView} view
   * @param {import("./plots.js").Plots} plots
   * @param {import("./path-plot.js").PathPlot} pathPlot
   * @param {() => {text: string, at: number[], color: string}[]} labels what is written over the view, CSS pixels from its upper left corner
   */
  constructor(view, plots, pathPlot, labels) {
    this.view = view;
    this.writes = labels;
    /** @type {?MediaRecorder} */
    this.film = null;
    byId("export-csv").onclick = () => this.#save("plots.csv", plotsText(plots.history));
    byId("export-path-csv").onclick = () => this.#save("path.csv", pathText(pathPlot.steps));
    byId("export-png").onclick = () => this.#picture();
    byId("export-webm").onclick = () => (this.film ? this.film.stop() : this.#begin());
    byId("export-png").disabled = !view;
    byId("export-webm").disabled = !view || typeof MediaRecorder === "undefined" || !FILM_TYPES.some((type) => MediaRecorder.isTypeSupported(type));
    view?.additions.push(this);
  }

  /** After every picture of the view: the next one of the film. */
  drawn() {
    if (this.film) this.#compose();
  }

  #save(name, text) {
    if (text.indexOf("\n") === text.length - 1) say("There is nothing to save yet.");
    else download(stamped(name), new Blob([text], { type: "text/csv" }));
  }

  #picture() {
    // What was drawn for the screen is gone from the canvas by now.
    this.view.drawNow();
    this.#compose().toBlob((blob) => download(stamped("view.png"), blob), "image/png");
  }

  /** The view with its ground, and what is written over it. @returns {HTMLCanvasElement} the same every time */
  #compose() {
    const { canvas } = this.view;
    const { width, height } = canvas;
    this.sheet ??= document.createElement("canvas");
    const sheet = this.sheet;
    // A film keeps the size that it began with.
    if (!this.film && (sheet.width !== width || sheet.height !== height)) Object.assign(sheet, { width, height });
    const g = sheet.getContext("2d");
    const ground = g.createLinearGradient(0, 0, 0, sheet.height);
    ground.addColorStop(0, css("--view-top"));
    ground.addColorStop(1, css("--view-bottom"));
    g.fillStyle = ground;
    g.fillRect(0, 0, sheet.width, sheet.height);
    g.drawImage(canvas, 0, 0, sheet.width, sheet.height);
    const ratio = sheet.width / Math.max(1, canvas.clientWidth);
    g.font = `600 ${13 * ratio}px ${css("--sans")}`;
    g.textAlign = "center";
    g.textBaseline = "bottom";
    for (const { text, at, color } of this.writes()) {
      const [x, y] = [at[0] * ratio, (at[1] - 8) * ratio];
      const { width: textWidth } = g.measureText(text);
      g.fillStyle = css("--surface");
      g.fillRect(x - textWidth / 2 - 6 * ratio, y - 17 * ratio, textWidth + 12 * ratio, 19 * ratio);
      g.fillStyle = css(color);
      g.fillText(text, x, y);
    }
    return sheet;
  }

  #begin() {
    this.view.drawNow();
    const sheet = this.#compose();
    const stream = sheet.captureStream(FILM_HZ);
    const film = new MediaRecorder(stream, { mimeType: FILM_TYPES.find((type) => MediaRecorder.isTypeSupported(type)), videoBitsPerSecond: 8e6 });
    const pieces = [];
    let bytes = 0;
    film.ondataavailable = ({ data }) => {
      pieces.push(data);
      bytes += data.size;
      if (bytes > MOST_FILM_BYTES && film.state === "recording") {
        film.stop();
        say(`The film ends here: it has ${MOST_FILM_BYTES >> 20} MB.`);
      }
    };
    film.onstop = () => {
      this.film = null;
      this.#show();
      for (const track of stream.getTracks()) track.stop();
      download(stamped("view.webm"), new Blob(pieces, { type: "video/webm" }));
    };
    film.start(1000);
    this.film = film;
    this.#show();
  }

  #show() {
    const isFilming = this.film !== null;
    byId("export-webm").setAttribute("aria-pressed", String(isFilming));
    byId("export-webm").textContent = isFilming ? "End film" : "Film, WebM";
  }
}

/** A name that no other export of this page has: `hapticd-2026-01-31-12-59-59-view.png`, local time. */
function stamped(name) {
  const now = new Date();
  const parts = [now.getMonth() + 1, now.getDate(), now.getHours(), now.getMinutes(), now.getSeconds()].map((part) => String(part).padStart(2, "0"));
  return `hapticd-${now.getFullYear()}-${parts.join("-")}-${name}`;
}

/** Of every row that the plots hold; an empty field where there is no number. @param {import("./history.js").History} history */
export function plotsText(history) {
  const lines = ["time_s,force_n,depth_mm,tick_us,wakeup_us"];
  for (let row = history.first; row < history.n; row += 1) {
    lines.push([0, 1, 2, 3, 4].map((column) => history.at(row, column)).map((value) => (Number.isFinite(value) ? value : "")).join());
  }
  return `${lines.join("\n")}\n`;
}

/** @param {import("./path.js").Step[]} steps */
export function pathText(steps) {
  const lines = steps.map(({ way_mm: way, least_mm: least, most_mm: most }) => [way, least, most].map((value) => Number(value.toFixed(6))).join());
  return `${["path_mm,least_depth_mm,largest_depth_mm", ...lines].join("\n")}\n`;
}
