// The page: what was asked for, what is shown, and who does what.
import { array, get, post, text } from "./api.js";
import { Camera } from "./camera.js";
import { Painted } from "./object.js";
import { clusterRow, numberRows, palette } from "./panel.js";
import { drawDensity, drawHistory, number } from "./plots.js";
import { Pointer } from "./pointer.js";
import { ring, Shot } from "./shot.js";

const $ = (id) => document.getElementById(id);
const view = $("view"), overlay = $("overlay");
const camera = new Camera(), shot = new Shot($("shot")), selected = new Set();
let object, scene, state, point = null, previewing = false, tool = "pick", standing = false;
let stroke = [], settled = { count: 0, points: [] }; // a stroke's rays, and what of it lies on the object
let told = { history: 0, preview: 0, map: 0 }; // the newest question of each kind: late answers are dropped

// Messages

let fading;
function say(words, bad = false) {
  const box = $("message");
  box.textContent = words.charAt(0).toUpperCase() + words.slice(1);
  box.classList.toggle("bad", bad);
  box.hidden = !words;
  clearTimeout(fading);
  if (words) fading = setTimeout(() => { box.hidden = true; }, bad ? 12000 : 5000);
}

async function tryTo(work) {
  try {
    return await work();
  } catch (error) {
    say(error.message, true);
    if (error.status === 409) await refresh(await get("state"));
    return undefined;
  }
}

// Drawing

let due = false;
function redraw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    const [w, h] = [view.clientWidth, view.clientHeight], scale = Math.min(devicePixelRatio, 2);
    for (const canvas of [view, overlay])
      if (canvas.width !== Math.round(w * scale) || canvas.height !== Math.round(h * scale))
        Object.assign(canvas, { width: Math.round(w * scale), height: Math.round(h * scale) });
    camera.size = [w, h];
    object?.draw(camera, $("map").value === "materials" || previewing, $("shading").checked);
    drawOverlay(scale);
  });
}

function drawOverlay(scale) {
  const paper = overlay.getContext("2d");
  paper.setTransform(scale, 0, 0, scale, 0, 0);
  paper.clearRect(0, 0, overlay.width, overlay.height);
  if (stroke.length) {
    for (const [color, width] of [["#000a", 5], ["#fff", 2.5]]) {
      Object.assign(paper, { strokeStyle: color, lineWidth: width, lineJoin: "round", lineCap: "round" });
      paper.beginPath();
      const on = stroke.length >= settled.count ? settled : { count: 0, points: [] };
      [...on.points, ...stroke.slice(on.count).map((s) => s.at)].map((at) => camera.project(at)).forEach((p, i) => {
        if (p) paper[i ? "lineTo" : "moveTo"](...p);
      });
      paper.stroke();
    }
  }
  const at = point && camera.project(local(point.point));
  if (at) ring(paper, at, 1, turnedAway(camera));
}

// Whether the picked point is on the side that a camera does not see
function turnedAway({ eye }) {
  const place = local(point.point);
  return point.normal.reduce((sum, n, i) => sum + n * (eye[i] - place[i]), 0) <= 0;
}

function markShot() {
  if (point && standing) shot.mark(local(point.point), turnedAway(shot.camera));
}

// World and radii about the centre
const local = (p) => p.map((x, i) => (x - scene.center[i]) / scene.radius);
const world = ([eye, direction]) => [...eye.map((x, i) => x * scene.radius + scene.center[i]), ...direction];

// State

async function refresh(next, labels = true) {
  const changed = !state || next.revision !== state.revision;
  state = next;
  for (const id of selected) if (!next.clusters.some((c) => c.id === id)) selected.delete(id);
  if (changed && labels && !previewing) object.label((await array("labels", Uint16Array))[0]);
  showClusters();
  if (changed && point) await showPoint(point.texel);
}

function showClusters() {
  object.color(previewing ? palette() : state.clusters, previewing ? new Set() : selected);
  const ids = state.clusters.map((c) => c.id).join();
  const rows = () => state.clusters.map((cluster) => clusterRow(cluster, selected.has(cluster.id), {
    select, rename: (id, name) => edit("rename", { id, name }),
  }));
  if (ids !== $("clusters").ids || !document.activeElement?.closest?.("#clusters input"))
    $("clusters").replaceChildren(...rows());
  $("clusters").ids = ids;
  $("count").textContent = state.clusters.length ? `${state.clusters.length} clusters` : "none yet";
  $("merge").disabled = selected.size < 2;
  $("clear").disabled = !selected.size;
  $("undo").disabled = !state.undo;
  $("redo").disabled = !state.redo;
  $("undo").title = state.undo ? `Undo: ${state.undo} (Ctrl+Z)` : "Nothing to undo";
  $("redo").title = state.redo ? `Redo: ${state.redo} (Ctrl+Shift+Z)` : "Nothing to redo";
  $("save").disabled = !state.dirty;
  $("save").textContent = state.dirty ? "Save" : "Saved";
  document.title = `${state.dirty ? "• " : ""}${scene.project} – materials`;
  redraw();
}

function select(id, more) {
  if (!more) {
    const again = selected.size === 1 && selected.has(id);
    selected.clear();
    if (!again && id >= 0) selected.add(id);
  } else if (id >= 0) {
    if (!selected.delete(id)) selected.add(id);
  }
  showClusters();
}

async function edit(name, given = {}) {
  return tryTo(async () => {
    const next = await post(name, { revision: state.revision, ...given });
    await refresh(next);
    say(next.said ?? (name === "undo" ? `Undone. Redo brings back: ${next.redo}.` : `${next.history.at(-1)}.`));
    return next;
  });
}

// A point

async function pickAt(x, y, more) {
  const found = await tryTo(() => post("pick", { rays: world(camera.ray(x, y)) }));
  if (!found) return;
  select(found.cluster, more);
  if (!more && found.cluster >= 0 && !selected.has(found.cluster)) select(found.cluster, false);
  await showPoint(found.texel, found);
}

async function showPoint(texel, found) {
  const asked = ++told.history;
  found ??= await tryTo(() => get(`point?texel=${texel}`));
  if (!found || asked !== told.history) return;
  point = found;
  redraw();
  markShot();
  const own = state.clusters.find((c) => c.id === found.cluster);
  $("point-empty").hidden = true;
  $("point-cluster").textContent = own ? `material ${own.id}${own.name ? `, ${own.name}` : ""}` : state.clusters.length ? "of no material: unobserved" : "no materials yet";
  $("numbers").replaceChildren(...numberRows(found, own));
  const [history, density] = [$("history"), $("density")];
  const plot = async (box, ask, draw) => {
    const paper = box.querySelector(".plot");
    try {
      const answer = await ask();
      if (asked !== told.history) return;
      draw(paper, answer);
    } catch (error) {
      if (asked === told.history) paper.textContent = error.message;
    }
    box.hidden = false;
  };
  await Promise.all([
    plot(history, () => get(`history?texel=${texel}`), drawHistory),
    own ? plot(density, () => get(`density?cluster=${own.id}`), drawDensity) : (density.hidden = true),
  ]);
}

// Maps

async function showMap() {
  const asked = ++told.map, name = $("map").value;
  $("frame-box").hidden = name !== "frame";
  $("legend").hidden = true;
  if (name !== "frame" && standing) leave();
  if (name === "materials") return redraw();
  const frame = Number($("frame").value);
  $("frame-name").textContent = scene.frames[frame] ?? "";
  const answer = await tryTo(() => array(`map?name=${name}&frame=${frame}`, Uint8Array));
  if (!answer || asked !== told.map) return undefined;
  object.paint(answer[0]);
  if (standing) await standAt(frame);
  const legend = JSON.parse(answer[1].get("X-Legend"));
  $("legend").hidden = legend.low === undefined;
  $("legend-low").textContent = number(legend.low);
  $("legend-high").textContent = `${number(legend.high)}${legend.log ? " (log)" : ""}`;
  return redraw();
}

// A frame's own camera

async function standAt(frame) {
  const lens = await tryTo(() => get(`stand?frame=${frame}`));
  if (!lens || Number($("frame").value) !== frame) return;
  standing = true;
  $("stand").setAttribute("aria-pressed", "true");
  $("stage").classList.add("standing");
  camera.stand(lens);
  redraw();
  await shot.show(frame, scene.frames[frame], lens);
  markShot();
}

function leave() {
  standing = false;
  $("stand").setAttribute("aria-pressed", "false");
  $("stage").classList.remove("standing");
  shot.hide();
  camera.release();
  redraw();
}

// A threshold

async function preview() {
  const asked = ++told.preview, threshold = Number($("threshold").value);
  $("threshold-value").textContent = threshold;
  $("preview-note").textContent = "Looking…";
  const answer = await tryTo(() => array(`preview?threshold=${threshold}`, Uint16Array));
  if (!answer || asked !== told.preview) return;
  previewing = true;
  object.label(answer[0]);
  const count = new Set(answer[0].filter((v) => v !== 65535)).size;
  $("preview-note").textContent = `By colour about ${count} clusters${scene.gloss ? "; gloss then joins and parts them" : ""}.`;
  $("find").disabled = $("cancel").disabled = false;
  showClusters();
}

async function endPreview() {
  told.preview++;
  if (!previewing) return;
  previewing = false;
  $("threshold").value = scene.threshold;
  $("threshold-value").textContent = scene.threshold;
  $("preview-note").textContent = "Move it to see a preview.";
  $("find").disabled = $("cancel").disabled = true;
  object.label((await array("labels", Uint16Array))[0]);
  showClusters();
}

// Strokes

function use(name) {
  tool = name;
  for (const other of ["pick", "stroke"]) $(`tool-${other}`).setAttribute("aria-pressed", `${other === name}`);
  view.classList.toggle("stroke", name === "stroke");
  $("through-box").hidden = name !== "stroke";
  $("hint").textContent = name === "pick"
    ? "Drag to turn, right-drag to shift, wheel to zoom. Click to pick; Ctrl or Shift adds."
    : "Draw across a material, beyond its border on both sides. Right-drag turns; Shift goes on with the stroke afterwards.";
  stroke = [];
  redraw();
}

// What is drawn so far lies on the object, as it is turned to go on
async function settleStroke() {
  const count = stroke.length;
  const told = await tryTo(() => post("hits", { rays: stroke.map((s) => s.ray) }));
  if (!told || stroke.length !== count) return;
  settled = { count, points: told.points.map(local) };
  redraw();
}

async function endStroke(more) {
  if (more) return settleStroke();
  if (stroke.length < 2) return redraw();
  await endPreview();
  const rays = stroke.map((s) => s.ray), one = selected.size === 1 ? [...selected][0] : -1;
  stroke = [];
  say("Cutting…");
  const next = await edit("split", { rays, cluster: one, through: $("through").checked });
  if (next) use("pick");
  return redraw();
}

new Pointer(view, {
  turn(dx, dy) { camera.turn(-0.008 * dx, -0.008 * dy); redraw(); },
  shift(dx, dy) { camera.shift(dx, dy); redraw(); },
  zoom(factor) { camera.zoom(factor); redraw(); },
  click(x, y, more) { if (!previewing) pickAt(x, y, more); else endPreview(); },
  draws() { return tool === "stroke"; },
  draw(x, y, first, more) {
    if (first && !more) [stroke, settled] = [[], { count: 0, points: [] }];
    const [eye, direction] = camera.ray(x, y), length = camera.distance;
    stroke.push({ ray: world([eye, direction]), at: eye.map((e, i) => e + length * direction[i]) });
    redraw();
  },
  drawn: endStroke,
});

// Buttons and keys

$("tool-pick").onclick = () => use("pick");
$("tool-stroke").onclick = () => use("stroke");
$("undo").onclick = () => edit("undo");
$("redo").onclick = () => edit("redo");
$("save").onclick = () => { say("Saving…"); return edit("save"); };
$("clear").onclick = () => { selected.clear(); showClusters(); };
$("merge").onclick = async () => {
  const ids = [...selected];
  if (await edit("merge", { ids })) { selected.clear(); selected.add(Math.min(...ids)); showClusters(); }
};
$("find").onclick = async () => {
  const threshold = Number($("threshold").value);
  say("Finding the clusters: some seconds…");
  previewing = false;
  if (await edit("find", { threshold })) scene.threshold = threshold;
  previewing = true;
  await endPreview();
};
$("cancel").onclick = endPreview;
$("script").onclick = () => tryTo(async () => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([await text("script")], { type: "application/xml" }));
  link.download = `${scene.project}-materials.mlx`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
});
$("map").onchange = showMap;
$("frame").oninput = showMap;
$("stand").onclick = () => standing ? leave() : standAt(Number($("frame").value));
$("shading").onchange = redraw;
$("threshold").oninput = () => { clearTimeout($("threshold").wait); $("threshold").wait = setTimeout(preview, 60); };
addEventListener("resize", redraw);
addEventListener("keydown", (event) => {
  const typing = event.target.closest?.("input[type=text], select");
  const control = event.ctrlKey || event.metaKey, letter = event.key.toLowerCase();
  const does = control && letter === "z" ? (event.shiftKey ? $("redo") : $("undo"))
    : control && letter === "y" ? $("redo") : control && letter === "s" ? $("save")
    : control || typing ? null : { f: $("stand"), m: $("merge"), p: $("tool-pick"), s: $("tool-stroke") }[letter];
  if (does && !(typing && letter !== "s")) { event.preventDefault(); if (!does.disabled && does.offsetParent) does.click(); }
  if (event.key === "Escape") { stroke = []; selected.clear(); endPreview(); showClusters(); }
});

// Begin, and follow what other pages do

async function begin() {
  history.replaceState(null, "", "/");
  object = new Painted(view);
  scene = await get("scene");
  $("project").textContent = scene.project;
  const [[geometry], ...pixels] = await Promise.all([
    array("geometry", Uint8Array),
    ...scene.textures.map(async (_, k) => (await array(`pixels?texture=${k}`, Int32Array))[0]),
  ]);
  object.load(scene.textures, geometry.buffer, pixels);
  $("map").replaceChildren(...scene.maps.map(({ name, title }) => new Option(title, name)));
  $("map").value = "materials";
  $("frame").max = Math.max(0, scene.frames.length - 1);
  $("find-box").hidden = !scene.finds;
  $("threshold").value = scene.threshold;
  $("threshold-value").textContent = scene.threshold;
  use("pick");
  await refresh(await get("state"));
  if (!state.clusters.length) say(scene.finds ? "There are no materials yet: choose a threshold and find them." : "There are no materials yet, and no diffuse colour to find them by: run compute_svbrdf_diffuse_color, or the whole chain, first.", true);
  document.body.dataset.ready = "yes";
  setInterval(follow, 1500);
  addEventListener("visibilitychange", follow);
}

// Take over what another page did; a page in the background waits until it is looked at
async function follow() {
  if (document.hidden) return;
  try {
    const next = await get("state");
    if (next.revision !== state.revision || next.dirty !== state.dirty) await refresh(next);
  } catch { /* said when something is asked for */ }
}

begin().catch((error) => say(error.message, true));
