/** The material that the tool paints: mass, damping and stiffness of mass points, each a number or left as it is. */

import { byId } from "./element.js";

/** Names of the properties in the API; their fields have the same names with dashes. */
const PROPERTIES = ["mass_kg", "damping_n_s_per_m", "stiffness_n_per_m"];

const field = (name) => byId(`clay-${name.replaceAll("_", "-")}`);

export class Material {
  /** @param {(painted: Object<string, ?number>) => Promise<void>} take tells the server what is to be painted from now on */
  constructor(take) {
    for (const name of PROPERTIES) {
      field(name).onchange = ({ target }) => {
        // What is no number the browser says by itself; it is not sent.
        if (target.validity.badInput || !target.checkValidity()) return void target.reportValidity();
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

const written = (input) => (input.value === "" ? null : input.valueAsNumber);
