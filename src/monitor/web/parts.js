/** What the triangles of each part were taken for, and what to know of it. */

import { byId, element } from "./element.js";
import { areaText, count, short, volumeText } from "./units.js";

/** Warnings of the server that say what the counts say. */
const COUNTED = [/hollows? of .*: empty$/, /lie inside of the solid and were left out$/, /^\d+ skins? beside the solid, /];

/** @param {{objects: {name: string, report: ?object}[]}} scene */
export function showParts({ objects }) {
  const known = objects.filter(({ report }) => report);
  const rows = known.map(({ name, report }) => ({ name, facts: factsOf(report), warnings: warningsOf(report) }));
  byId("parts").replaceChildren(
    ...rows.map(({ name, facts, warnings }) =>
      element(
        "li",
        { class: "part" },
        element("strong", {}, name),
        ...facts.map((text) => element("p", {}, text)),
        ...warnings.map((text) => element("p", { class: "warning" }, text)),
      ),
    ),
  );
  const n = rows.reduce((sum, { warnings }) => sum + warnings.length, 0);
  byId("parts-verdict").textContent = n > 0 ? several(n, "warning", "warnings") : "";
  byId("parts-box").hidden = rows.length === 0;
}

const several = (n, one, many) => `${count(n)} ${n === 1 ? one : many}`;

const warningsOf = ({ warnings }) => warnings.filter((text) => !COUNTED.some((words) => words.test(text)));

/** Lines about a part: one line where it is one body or one skin. @returns {string[]} */
function factsOf({ solid, sides, triangles, voxel_size_m }) {
  const size = `${several(triangles, "triangle", "triangles")}, voxels of ${short(voxel_size_m * 1e3)} mm`;
  // Its triangles were taken as they are.
  if (!solid) return [size];
  const volume = solid.volume_m3 > 0 ? volumeText(solid.volume_m3) : "";
  const kinds = kindsOf(solid);
  if (solid.pieces === 1 && kinds.length === 1 && !(solid.inside_area_m2 > 0)) {
    return [`${kinds[0]}${volume && ` of ${volume}`}, ${size}`];
  }
  const facts = [kinds.length > 0 ? `${piecesOf(solid)}: ${kinds.join(", ")}` : piecesOf(solid)];
  if (solid.skins > 0 && sides !== "thin") facts.push(solid.skins === 1 ? "the skin is felt as a plate of two voxels" : "the skins are felt as plates of two voxels");
  if (solid.inside_area_m2 > 0) facts.push(`${areaText(solid.inside_area_m2)} inside were left out`);
  facts.push([...(volume ? [`volume ${volume}`] : []), size].join(", "));
  return facts;
}

function piecesOf({ pieces, open_pieces: nOpen }) {
  const open = nOpen === pieces ? ", not closed" : `, ${count(nOpen)} not closed`;
  return several(pieces, "piece", "pieces") + (nOpen > 0 ? open : "");
}

function kindsOf({ bodies, cavities_m3, skins, skin_area_m2 }) {
  const kinds = [];
  if (bodies > 0) kinds.push(several(bodies, "body", "bodies"));
  const hollow_m3 = cavities_m3.reduce((sum, volume_m3) => sum + volume_m3, 0);
  if (cavities_m3.length > 0) kinds.push(`${several(cavities_m3.length, "hollow", "hollows")} of ${volumeText(hollow_m3)} (empty)`);
  if (skins > 0) kinds.push(several(skins, "skin", "skins") + (skin_area_m2 > 0 ? ` of ${areaText(skin_area_m2)}` : ""));
  return kinds;
}
