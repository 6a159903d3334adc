/**
 * The monitor page: puts what the server says to where it is shown.
 *
 * ```text
 *  link ──state──► drive, readouts, view, plots, objects        60 times a second
 *       ──event──► facts; parameters, session, clay and scene ask again
 *       ──open───► info                                         and every two seconds
 *  another scene in the state ► scene and meshes, clay, parameters, names of scenes
 * ```
 */

import { Clay } from "./clay.js";
import { ClayHand } from "./clay-hand.js";
import { Clearance } from "./clearance.js";
import { Drive } from "./drive.js";
import { byId, say, words } from "./element.js";
import { Export } from "./export.js";
import { addEvent, showInfo } from "./facts.js";
import { Hand } from "./hand.js";
import { Link, tokenOfAddress } from "./link.js";
import { MadeFiles } from "./made-files.js";
import { Measure } from "./measure.js";
import { MeshLoader } from "./mesh-loader.js";
import { Objects } from "./objects.js";
import { Parameters } from "./parameters.js";
import { showParts } from "./parts.js";
import { PathPlot } from "./path-plot.js";
import { ToolPath } from "./path.js";
import { Plots } from "./plots.js";
import { Readouts } from "./readouts.js";
import { SceneView } from "./scene.js";
import { Section } from "./section.js";
import { Session } from "./session.js";
import { Structures } from "./structures.js";
import { count, lengthText, short } from "./units.js";
import { Unsaved } from "./unsaved.js";
import { Wrench } from "./wrench.js";

/** Data older than this is greyed out. */
const STALE_MS = 1000;
const INFO_EVERY_MS = 2000;
/** After a scene could not be had. */
const SCENE_AGAIN_MS = 2000;

const link = new Link(tokenOfAddress());
const drive = new Drive(link);
const readouts = new Readouts();
const plots = new Plots(document);
const path = new ToolPath();
const pathPlot = new PathPlot(path);
const wrench = new Wrench(path);
const objects = new Objects(link);
const parameters = new Parameters(link, (all) => {
  readouts.learn(all);
  hand?.learnLimits(all);
});
const session = new Session(link, refreshInfo);
const meshes = new MeshLoader(link);
const recordings = new MadeFiles(link, "recordings", "recordings");
const clayFiles = new MadeFiles(link, "clay/files", "clay-files");
const view = openView();
const hand = view && new Hand(link, view);
new Export(view, plots, pathPlot, () => view.additions.flatMap(({ labels }) => labels ?? []));
const clay = new Clay(link, view);
if (hand) {
  // What is over the clay is for the clay, also where the tool is in between.
  new ClayHand(link, view, hand, clay);
  hand.listen();
}
const unsaved = new Unsaved(link, clay, () => drive.stop());
drive.asksFirst = () => unsaved.ask();

/** What is shown: which scene of which run. A page outlives both. */
const shown = { started: null, idx: null, isAsking: false, askAgainAt: 0 };
/** When the newest state came, ms of this page, and its own time. @type {?number} */
let stateAt = null;
let stateTimeNs = null;

link.addEventListener("open", ({ detail: hello }) => {
  byId("token-form").hidden = true;
  drive.greet(hello.phase);
  stand();
  session.resume();
  refreshInfo();
  recordings.refresh();
});

link.addEventListener("closed", ({ detail: isOver }) => {
  if (stateAt !== null) drive.lose(isOver);
  clay.lose();
  stand();
  showFreshness();
});

link.addEventListener("unauthorized", () => {
  byId("token-form").hidden = false;
  byId("token-label").textContent = link.token ? "Wrong token: this server asks for another one" : "This server asks for its token";
});

link.addEventListener("state", ({ detail: state }) => {
  stateAt = performance.now();
  stateTimeNs = state.time_ns;
  drive.show(state);
  stand();
  readouts.show(state);
  path.push(state);
  wrench.show(state);
  if (!pathPlot.paused) pathPlot.redraw();
  objects.show(state);
  view?.show(state);
  hand?.show(state);
  if (state.history) plots.push(state.history);
  session.beatIfDue();
  if (state.scene_idx !== shown.idx && performance.now() > shown.askAgainAt) loadScene();
});

link.addEventListener("event", ({ detail: event }) => {
  addEvent(event, stateTimeNs);
  if (event.event === "state") {
    drive.hear(event.names[0], stateAt === null);
    stand();
  }
  clay.hear(event);
  if (event.event === "clay" && event.names[0] === "saved") clayFiles.refresh();
  if (event.event === "parameter") parameters.refresh().catch(() => {});
  if (event.event === "recording" && event.names[0] === "ended") session.remember(event.text);
  if (event.event === "recording" || event.event === "link") refreshInfo();
  if (event.event === "recording") recordings.refresh();
  if (event.event === "scene") drive.prepare(event.names[0] === "baking" ? event.names[1] : "");
});

byId("token-form").onsubmit = (event) => {
  event.preventDefault();
  link.token = byId("token").value.trim();
  byId("links").hidden = true;
  sessionStorage.setItem("token", link.token);
  refreshInfo();
};

byId("pause").onclick = ({ currentTarget: button }) => {
  const isPaused = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", String(isPaused));
  button.firstChild.textContent = isPaused ? "▶" : "❚❚";
  plots.pause(isPaused);
  pathPlot.pause(isPaused);
};

/** Passes the state of the run to the panels that show it. */
function stand() {
  clay.stand({ isOver: drive.isOver, isOpen: link.isOpen, phase: drive.phase });
  if (drive.isOver) unsaved.close();
}

setInterval(showFreshness, 250);
setInterval(() => link.isOpen && refreshInfo(), INFO_EVERY_MS);
// A link in the page cannot carry a token, which is to stay out of addresses.
byId("links").hidden = Boolean(link.token);
link.connect();
refreshInfo();

async function refreshInfo() {
  try {
    const info = await link.get("info");
    showInfo(info);
    session.show(info);
    drive.learn(info.faults ?? []);
    plots.deadlineUs = 1e6 / info.rate_hz;
    if (info.started_unix_s !== shown.started) Object.assign(shown, { started: info.started_unix_s, idx: null });
  } catch (error) {
    if (error.status > 0 && error.status !== 401 && error.status !== 503) say(words(error));
  }
}

/** Shows the scene that is rendered. */
async function loadScene() {
  if (shown.isAsking) return;
  shown.isAsking = true;
  try {
    const scene = await link.get("scene");
    if (scene.scene_idx === shown.idx) return;
    shown.idx = scene.scene_idx;
    shown.isAsking = false;
    byId("scene-name").textContent = scene.name;
    document.title = `${scene.name} · hapticd`;
    objects.learn(scene);
    showParts(scene);
    hand?.learn(scene);
    wrench.learn(scene);
    parameters.refresh().catch((error) => say(words(error)));
    link.get("scenes").then((names) => session.offer(names, stemOf(scene.file)), () => {});
    const loading = loadMeshes(scene);
    clay.begin(scene.clay);
    if (scene.clay) clayFiles.refresh();
    await loading;
  } catch (error) {
    shown.askAgainAt = performance.now() + SCENE_AGAIN_MS;
    if (error.status > 0 && error.status !== 503) say(words(error));
  } finally {
    shown.isAsking = false;
  }
}

async function loadMeshes(scene) {
  if (!view) return;
  view.clear();
  view.alsoSeen = scene.hand_bounds ?? null;
  view.pointSpacing = scene.objects.find(({ role }) => role === "tool")?.voxel_size_m ?? scene.voxel_size_m;
  byId("view-note").textContent = "Loading the parts";
  const { started } = shown;
  const isOld = () => scene.scene_idx !== shown.idx || started !== shown.started;
  for (const [idx, { mesh, voxels, pointshell, pose, role, triangles, shown_triangles: nShown }] of scene.objects.entries()) {
    // The file of a mesh may be gone since it was baked.
    if (!mesh) continue;
    const part = await meshes.load(mesh, nShown < triangles).catch((error) => say(words(error)));
    if (isOld()) return;
    if (part) view.add({ idx, role, pose, mesh: part, voxels, pointshell });
    view.fitUntouched();
  }
  byId("view-note").textContent = "";
}

const stemOf = (file) => file.split("/").pop().replace(/\.toml$/, "");

/** Says plainly when what is shown is old. */
function showFreshness() {
  const age_ms = stateAt === null ? null : performance.now() - stateAt;
  const isStale = age_ms === null ? !link.isOpen : age_ms > STALE_MS;
  document.body.classList.toggle("is-stale", isStale);
  const lost = byId("lost");
  lost.hidden = !isStale || age_ms === null;
  if (lost.hidden) return;
  const age = `${Math.floor(age_ms / 1000)} s`;
  if (link.isOpen) lost.textContent = `No data for ${age}: the server is there, the loop sends nothing.`;
  else if (drive.isOver) lost.textContent = `The run is over.${clay.keeper && ` The clay is kept in ${clay.keeper}.`} This page goes on when hapticd is started again.`;
  else lost.textContent = `Connection lost ${age} ago. What is shown is old; trying again.`;
}

/** The 3-D view, or null where the browser has none: all else works without. */
function openView() {
  let opened;
  try {
    opened = new SceneView(byId("view"), ({ grid_m, force_n, torque_nm }) => {
      byId("scale-grid").textContent = lengthText(grid_m);
      byId("scale-force").textContent = `at most ${short(force_n)} N`;
      byId("scale-torque").textContent = `at most ${short(torque_nm * 1e3)} mN·m`;
    });
  } catch (error) {
    byId("view-note").textContent = `No 3-D view: ${error.message}. Everything else on this page works.`;
    return null;
  }
  for (const button of document.querySelectorAll("[data-view]")) {
    const { view: side } = button.dataset;
    button.onclick = () => {
      if (side === "fit") opened.fit();
      else if (side === "tool") opened.lookAtTool();
      else opened.camera.lookFrom(side);
    };
  }
  byId("see-through").onclick = ({ currentTarget: button }) => {
    const isSeeThrough = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(isSeeThrough));
    opened.seeThrough(isSeeThrough);
  };
  opened.counted = (n, nAll) => {
    const text = n < nAll ? `${count(n)} of ${count(nAll)} points shown` : "contacts";
    if (byId("legend-contacts").textContent !== text) byId("legend-contacts").textContent = text;
  };
  new Section(opened);
  new Clearance(link, opened);
  new Structures(meshes, opened);
  new Measure(opened);
  const names = document.querySelectorAll(".axes span");
  opened.onDrawn = () => {
    opened.axisTips.forEach(([left, bottom], n) => Object.assign(names[n].style, { left: `${left}px`, bottom: `${bottom}px` }));
  };
  return opened;
}
