/** How the clay is drawn: its light, what is drawn of its samples, and the mass points; the browser remembers it. */

import { byId } from "./element.js";
import { FORMS, LOOKS } from "./splat-surface.js";

/** Of each choice: its field, whose name is also the one that the browser keeps it by, and its words. */
const CHOICES = { look: ["clay-look", LOOKS], form: ["clay-form", FORMS] };
const GRID = "clay-grid";

export class Look {
  /** @param {import("./scene.js").SceneView} view */
  constructor(view) {
    for (const [what, [name, known]] of Object.entries(CHOICES)) {
      const choice = byId(name);
      const take = (word) => {
        view.clay.surface[what] = word;
        view.redraw();
      };
      const kept = remembered(name);
      if (known.includes(kept)) {
        choice.value = kept;
        take(kept);
      }
      choice.onchange = () => {
        take(choice.value);
        remember(name, choice.value);
      };
    }
    const grid = byId(GRID);
    const takeGrid = () => {
      view.clay.isGridShown = grid.checked;
      view.redraw();
    };
    grid.checked = remembered(GRID) === "shown";
    takeGrid();
    grid.onchange = () => {
      takeGrid();
      remember(GRID, grid.checked ? "shown" : "hidden");
    };
  }
}

/** A browser may keep nothing, and says so with an error. */
function remembered(name) {
  try {
    return localStorage.getItem(name);
  } catch {
    return null;
  }
}

function remember(name, value) {
  try {
    localStorage.setItem(name, value);
  } catch {
    // It holds until the page is closed.
  }
}
