/**
 * Asks before a run ends whose clay no session has. The force is off meanwhile: Stop asks for that.
 *
 * It asks beside the buttons about force and never over them.
 */

import { byId, words } from "./element.js";

const TEXT = "The force is off, and the run goes on. What was done to the clay since it was last saved is lost when it ends.";

export class Unsaved {
  /**
   * @param {import("./link.js").Link} link
   * @param {import("./clay.js").Clay} clay
   * @param {() => Promise<void>} stop ends the run, whatever becomes of the clay
   */
  constructor(link, clay, stop) {
    Object.assign(this, { link, clay, stop });
    byId("unsaved-save").onclick = () => this.#save();
    byId("unsaved-stop").onclick = () => this.#stop();
    byId("unsaved-go-on").onclick = () => this.close();
  }

  /** The user asks for the end of the run. @returns {boolean} whether the page asks first; the force goes off at once then */
  ask() {
    if (!this.clay.isAtRisk) return false;
    this.link.order("disable").catch((error) => this.#tell(`The force may still be on: ${words(error)}.`));
    this.#tell(TEXT);
    byId("unsaved").hidden = false;
    byId("unsaved-save").focus();
    return true;
  }

  /** There is nothing to ask any more. */
  close() {
    byId("unsaved").hidden = true;
  }

  async #save() {
    const buttons = byId("unsaved").querySelectorAll("button");
    for (const button of buttons) button.disabled = true;
    this.#tell("Saving …");
    try {
      await this.clay.keep();
      await this.#stop();
    } catch (error) {
      this.#tell(`The session was not saved, and the run goes on: ${words(error)}.`);
    } finally {
      for (const button of buttons) button.disabled = false;
    }
  }

  async #stop() {
    this.close();
    await this.stop();
  }

  #tell(text) {
    byId("unsaved-text").textContent = text;
  }
}
