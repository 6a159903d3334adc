/** The material that the tool paints: mass, damping and stiffness of mass points, each a number or left as it is. */

import { byId } from "./element.js";
import { readNumber, refusal } from "./number-field.js";

/** Names of the properties in the API, with the most that they can be and how little a mass can be; their fields have the same names with dashes. */
const RANGES = { mass_kg: [1e-9, 1, "kg"], damping_n_s_per_m: [0, 1e4, "N·s/m"], stiffness_n_per_m: [0, 1e6, "N/m"] };
const PROPERTIES = Object.keys(RANGES);

const field = (name) => byId(`clay-${name.replaceAll("_", "-")}`);

export class Material {
  /** @param {(painted: Object<string, ?number>) => Promise<void>} take tells the server what is to be painted from now on */
  constructor(take) {
    for (const name of PROPERTIES) {
      field(name).onchange = ({ target }) => {
        target.setCustomValidity(target.value.trim() === "" ? "" : refusal(target.value, ...RANGES[name]));
        if (!target.reportValidity()) return;
        take(Object.fromEntries(PROPERTIES.map((property) => [property, written(field(property))])));
      };
    }
  }

  /** What is painted, and beside empty fields what comes of them. @param {object} facts of the clay */
  show({ painted, paints }) {
    for (const name of PROPERTIES) {
      const input = field(name);
      if (document.activeElement !== input) input.value = painted[name] ?? "";
      input.placeholder = paints[name] ?? "as it is";
    }
  }
}

const written = (input) => (input.value.trim() === "" ? null : readNumber(input.value));
