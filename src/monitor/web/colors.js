/** Colours of the style sheet for what is drawn rather than laid out: one place for both, light and dark. */

const dark = matchMedia("(prefers-color-scheme: dark)");

/** A custom property as CSS text. @type {(name: string) => string} */
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/**
 * A custom property of the form `#rrggbb` as three numbers from 0 to 1.
 * @type {(name: string) => number[]}
 */
export function rgb(name) {
  const hex = Number.parseInt(css(name).slice(1), 16);
  return [(hex >> 16) & 255, (hex >> 8) & 255, hex & 255].map((byte) => byte / 255);
}

/** Calls back when the person changes between light and dark. @param {() => void} changed */
export const onChange = (changed) => dark.addEventListener("change", changed);
