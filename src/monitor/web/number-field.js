/**
 * Fields for numbers that read a decimal comma as well as a point, as a field of `type=number` does in one language only: in the others it
 * drops the comma, and 1,5 becomes 15.
 */

import { fixed, short } from "./units.js";

/**
 * A number as people write it: `1.5`, `1,5`, `−3`, `2e-3`. NaN for anything else, also where a separator may be one of thousands.
 * @param {string} text
 */
export function readNumber(text) {
  const plain = text.trim().replace("−", "-").replace(",", ".");
  return /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(plain) ? Number(plain) : Number.NaN;
}

/**
 * Why a field's text is not taken; empty where it is.
 * @param {string} text
 * @param {number} least
 * @param {number} most
 * @param {string=} unit
 */
export function refusal(text, least, most, unit = "") {
  const value = readNumber(text);
  if (Number.isNaN(value)) return `“${text.trim()}” is no number: write one such as ${fixed(Math.min(most, Math.max(least, 1.5)), 1)}`;
  // A bound may be written as it is shown, in three figures.
  const isBound = [least, most].some((bound) => short(bound) === short(value));
  if (isBound || (value >= least && value <= most)) return "";
  return `${text.trim()} is out of range: ${short(least)} to ${short(most)} ${unit}`.trimEnd();
}

/**
 * Makes the arrow keys step a field's number up and down.
 * @param {HTMLInputElement} field
 * @param {number} step
 */
export function stepByKeys(field, step) {
  field.addEventListener("keydown", (event) => {
    const steps = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    const value = readNumber(field.value);
    if (!steps || Number.isNaN(value)) return;
    event.preventDefault();
    field.value = short(value + steps * step);
    field.dispatchEvent(new Event("input"));
    field.dispatchEvent(new Event("change"));
  });
}
