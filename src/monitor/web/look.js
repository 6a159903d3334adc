/** The light on the clay in the picture, which the browser remembers. */

import { byId } from "./element.js";
import { LOOKS } from "./splat-surface.js";

const KEY = "clay-look";

export class Look {
  /** @param {import("./scene.js").SceneView} view */
  constructor(view) {
    const choice = byId("clay-look");
    const take = (look) => {
      view.clay.surface.look = look;
      view.redraw();
    };
    const kept = remembered();
    if (LOOKS.includes(kept)) {
      choice.value = kept;
      take(kept);
    }
    choice.onchange = () => {
      take(choice.value);
      remember(choice.value);
    };
  }
}

/** A browser may keep nothing, and says so with an error. */
function remembered() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

function remember(look) {
  try {
    localStorage.setItem(KEY, look);
  } catch {
    // It holds until the page is closed.
  }
}
