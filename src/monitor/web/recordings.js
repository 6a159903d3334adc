/** The recordings that were begun from pages and clients in this run: each with a link to its file and to its report. */

import { download } from "./download.js";
import { byId, element, say, words } from "./element.js";
import { count, fixed } from "./units.js";

export class Recordings {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    this.link = link;
    this.shown = "";
  }

  async refresh() {
    const recordings = await this.link.get("recordings").catch(() => null);
    if (!recordings) return;
    // Writing the same again would take the focus off a link.
    const news = JSON.stringify([recordings, this.link.token]);
    if (news === this.shown) return;
    this.shown = news;
    byId("recordings").replaceChildren(...recordings.map((recording) => this.#line(recording)).reverse());
  }

  #line({ name, records, dropped, bytes, is_under_way: isUnderWay, download: file, report }) {
    const size = bytes === null ? "" : `, ${fixed(bytes / 1e6, 1)} MB`;
    const lost = dropped > 0 ? `, ${count(dropped)} lost` : "";
    const facts = isUnderWay ? "under way" : `${count(records)} ticks${lost}${size}`;
    const links = isUnderWay ? [] : [this.#link("File", file, name), " ", this.#link("Report", report, name.replace(/\.mcap$/, ".html"))];
    return element("li", {}, element("span", {}, name, element("small", {}, facts)), element("span", { class: "links" }, ...links));
  }

  /** A link cannot carry a token, which is to stay out of addresses: with one the page fetches the file and hands it over. */
  #link(text, path, name) {
    const isReport = text === "Report";
    const link = element("a", { href: path, "aria-label": `${text} of ${name}`, ...(isReport ? { target: "_blank", rel: "noopener" } : { download: name }) }, text);
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
