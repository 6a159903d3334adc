/** What the server says of its arm and its machine, and what happened. */

import { byId, element } from "./element.js";
import { parameterWords, short } from "./units.js";

const AXES = ["x", "y", "z", "rx", "ry", "rz"];
const MOST_EVENTS = 100;
const MARKS = { passed: ["✓", "ok"], failed: ["✗", "bad"], unknown: ["?", "warn"] };

/** @param {object} info */
export function showInfo(info) {
  const { device, realtime } = info;
  byId("version").textContent = `hapticd ${info.version}`;
  byId("device").replaceChildren(
    ...fact("Arm", device.title || device.profile),
    ...fact("Profile", device.profile),
    ...fact("Kind", device.simulated ? "simulated" : `real, link ${device.link}`),
    ...(device.node ? fact("At", device.node) : []),
    ...fact("Senses", axes(device.sensed)),
    ...fact("Drives", axes(device.actuated)),
    ...fact("Loop", `${info.rate_hz} Hz, ${info.clock} clock`),
  );
  const bad = realtime.filter(({ outcome }) => outcome === "failed").length;
  byId("realtime-verdict").textContent = bad === 0 ? "all in order" : `${bad} of ${realtime.length} not as it should be`;
  byId("realtime").replaceChildren(...realtime.map(check));
}

/**
 * Puts an event on top of the list.
 * @param {object} event
 * @param {?number} now_ns time of the loop, for an event of no tick
 */
export function addEvent(event, now_ns) {
  const list = byId("events");
  const time_ns = event.time_ns ?? now_ns;
  const time = time_ns === null ? "" : `${(time_ns / 1e9).toFixed(2)} s`;
  if (event.event === "overrun" && countLate(list.firstChild, event, time)) return;
  const kind = event.event === "fault" || event.event === "overrun" ? "is-fault" : "";
  const late = event.event === "overrun" ? { "data-late": event.names[0], "data-since": time } : {};
  list.prepend(element("li", { class: kind, ...late }, element("time", {}, time), element("span", {}, textOf(event))));
  while (list.children.length > MOST_EVENTS) list.lastChild.remove();
}

/** What happened, a value in the unit that the panel has for it. */
function textOf({ event, text, names }) {
  const value = event === "parameter" && names.length > 1 ? Number(names[1]) : Number.NaN;
  if (Number.isNaN(value)) return text || event;
  const { label, unit, factor } = parameterWords(names[0]);
  return `${label} goes to ${short(value * factor)} ${unit}`.trimEnd();
}

/** Late ticks come in crowds: one line counts them until something else happens. */
function countLate(line, event, time) {
  if (!line?.dataset.late) return false;
  line.dataset.late = String(Number(line.dataset.late) + Number(event.names[0]));
  line.replaceChildren(element("time", {}, time), element("span", {}, `${line.dataset.late} ticks began late since ${line.dataset.since}`));
  return true;
}

const fact = (name, value) => [element("dt", {}, name), element("dd", {}, value)];

function axes(has) {
  const list = element("span", { role: "img", "aria-label": AXES.filter((_, n) => has[n]).join(", ") || "nothing" });
  list.append(...AXES.map((axis, n) => element("span", { class: has[n] ? "dof" : "dof is-absent" }, axis)));
  return list;
}

function check({ name, outcome, found, hint }) {
  const [mark, kind] = MARKS[outcome] ?? MARKS.unknown;
  const line = element("div", {}, `${name}: ${found}`);
  if (hint && outcome !== "passed") line.append(element("small", {}, hint));
  return element("li", {}, element("span", { class: `mark ${kind}`, role: "img", "aria-label": outcome }, mark), line);
}
