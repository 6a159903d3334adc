/**
 * Makes an element.
 * @param {string} tag
 * @param {object=} properties of the element; `class` and names with a dash are set as attributes
 * @param {...(Node|string)} children
 * @returns {HTMLElement}
 */
export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "class" || name.includes("-")) made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children);
  return made;
}

/** The element of this page with an id. @param {string} id @returns {any} */
export const byId = (id) => document.getElementById(id);

const SHOWN_MS = 5000;

/** Says something for a few seconds at the foot of the page. @param {string} text */
export function say(text) {
  const toasts = byId("toasts");
  const toast = element("p", {}, text);
  toasts.append(toast);
  while (toasts.children.length > 3) toasts.firstChild.remove();
  setTimeout(() => toast.remove(), SHOWN_MS);
}

/** What went wrong in the words of the server, with what would do. @param {Error & {hint?: string}} error */
export const words = (error) => (error.hint ? `${error.message}: ${error.hint}` : error.message);
