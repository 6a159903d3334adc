/** Files that were made in this run, from this page or by other clients: each with a link to it, a recording with one to its report too. */

import { download } from "./download.js";
import { byId, element, say, words } from "./element.js";
import { count, fixed } from "./units.js";

export class MadeFiles {
  /**
   * @param {import("./link.js").Link} link
   * @param {string} path of their list, below the API's root
   * @param {string} id of the list in the page
   */
  constructor(link, path, id) {
    Object.assign(this, { link, path, id });
    this.shown = "";
  }

  async refresh() {
    const files = await this.link.get(this.path).catch(() => null);
    if (!files) return;
    // Writing the same again would take the focus off a link.
    const news = JSON.stringify(files);
    if (news === this.shown) return;
    this.shown = news;
    byId(this.id).replaceChildren(...files.map((file) => this.#line(file)).reverse());
  }

  #line({ name, records, dropped, bytes, is_under_way: isUnderWay, download: path, report }) {
    const ticks = records === undefined ? [] : [`${count(records)} ticks`];
    const lost = dropped > 0 ? [`${count(dropped)} lost`] : [];
    const size = bytes === null ? [] : [`${fixed(bytes / 1e6, 1)} MB`];
    const facts = isUnderWay ? "under way" : [...ticks, ...lost, ...size].join(", ");
    const links = isUnderWay ? [] : [this.#link("File", path, name, { download: name })];
    if (report && !isUnderWay) links.push(this.#link("Report", report, name.replace(/\.mcap$/, ".html"), { target: "_blank", rel: "noopener" }));
    return element("li", {}, element("span", {}, name, element("small", {}, facts)), element("span", { class: "links" }, ...links));
  }

  /** A link cannot carry a token, which is to stay out of addresses: with one the page fetches the file and hands it over. */
  #link(text, path, name, how) {
    const link = element("a", { href: path, "aria-label": `${text} of ${name}`, ...how }, text);
    link.onclick = async (event) => {
      if (!this.link.token) return;
      event.preventDefault();
      try {
        download(name, await this.link.getFile(path));
      } catch (error) {
        say(`${name} did not come: ${words(error)}`);
      }
    };
    return link;
  }
}
