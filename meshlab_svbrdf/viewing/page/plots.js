// The two plots of a point: luminance over the frames, and the density of its material's ρs.
const SVG = "http://www.w3.org/2000/svg";
const LIGHTS = ["#ffb454", "#6fd0a0", "#c79bff", "#ff7d9c", "#66c7ff", "#e3e06a", "#ff9e64", "#9fd356"];
const W = 344, H = 128, LEFT = 34, BOTTOM = 22, TOP = 8, RIGHT = 6;

function element(name, attributes, parent, words) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (words !== undefined) node.textContent = words;
  parent?.append(node);
  return node;
}

export const number = (x, digits = 3) => x === null || x === undefined ? "–" : `${Number(x.toPrecision(digits))}`;

// Round steps, at most `most` of them
function ticks(low, high, most = 5) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw);
  const found = [];
  for (let x = Math.ceil(low / step) * step; x <= high + 1e-9 * step; x += step) found.push(Number(x.toPrecision(6)));
  return found;
}

function axes(x, y, xs, ys, xTitle) {
  const svg = element("svg", { viewBox: `0 0 ${W} ${H}`, role: "img" });
  for (const t of ys) {
    element("line", { x1: LEFT, x2: W - RIGHT, y1: y(t), y2: y(t), stroke: "#33373d" }, svg);
    element("text", { x: LEFT - 5, y: y(t) + 3, "text-anchor": "end" }, svg, number(t));
  }
  for (const t of xs) element("text", { x: x(t), y: H - BOTTOM + 12, "text-anchor": "middle" }, svg, number(t));
  element("text", { x: (LEFT + W) / 2, y: H - 1, "text-anchor": "middle" }, svg, xTitle);
  return svg;
}

function key(box, entries) {
  const row = document.createElement("div");
  row.className = "key";
  for (const [color, words, line] of entries) {
    const item = document.createElement("span"), mark = document.createElement("i");
    if (line) { mark.className = "line"; mark.style.borderColor = color; } else mark.style.background = color;
    item.append(mark, words);
    row.append(item);
  }
  box.append(row);
}

function note(box, words) {
  const p = document.createElement("p");
  p.textContent = words;
  box.append(p);
}

export function drawHistory(box, told) {
  box.replaceChildren();
  if (!told.frame.length) return note(box, "No frame shows this point.");
  const top = Math.max(...told.luminance, told.threshold ?? 0, told.diffuse ?? 0);
  const foot = Math.min(...told.luminance, told.diffuse ?? Infinity), room = Math.max(0.08 * (top - foot), 0.2);
  const [least, most] = [Math.max(0, foot - room), top + room];
  const [first, last] = [told.frame[0], Math.max(told.frame.at(-1), told.frame[0] + 1)];
  const x = (f) => LEFT + (W - LEFT - RIGHT) * (f - first) / (last - first);
  const y = (v) => TOP + (H - TOP - BOTTOM) * (most - v) / (most - least);
  const svg = axes(x, y, ticks(first, last), ticks(least, most), "frame");

  // The film's own line, broken where the point was not seen
  let path = "";
  told.frame.forEach((f, i) => { path += `${i && f - told.frame[i - 1] <= 3 ? "L" : "M"}${x(f).toFixed(1)} ${y(told.luminance[i]).toFixed(1)}`; });
  element("path", { d: path, fill: "none", stroke: "#7f8791", "stroke-width": 1 }, svg);
  for (const [level, color] of [[told.diffuse, "#5aa9ff"], [told.threshold, "#d0d3d8"]])
    if (level !== null)
      element("line", { x1: LEFT, x2: W - RIGHT, y1: y(level), y2: y(level), stroke: color, "stroke-dasharray": color === "#5aa9ff" ? "" : "3 3" }, svg);

  const own = told.frame.map(() => "#7f8791");
  for (const peak of told.peaks) if (peak.light >= 0) for (const j of peak.samples) own[j] = LIGHTS[peak.light % LIGHTS.length];
  told.frame.forEach((f, i) => {
    const dot = element("circle", { cx: x(f), cy: y(told.luminance[i]), r: 2, fill: told.clipped[i] ? "none" : own[i], stroke: told.clipped[i] ? "#ff8d7a" : "none" }, svg);
    element("title", {}, dot, `${told.label[i]}: ${number(told.luminance[i])}, quality ${number(told.quality[i])}${told.clipped[i] ? ", clipped" : ""}`);
  });

  // The two samples of each peak that tells
  const telling = told.peaks.filter((p) => p.alpha !== null);
  for (const peak of telling) {
    const color = LIGHTS[peak.light % LIGHTS.length];
    for (const [name, j] of [["max", peak.c_max], ["min", peak.c_min]]) {
      if (j < 0) continue;
      const [u, v] = [x(told.frame[j]), y(told.luminance[j])];
      element("circle", { cx: u, cy: v, r: 5, fill: "none", stroke: color, "stroke-width": 1.5 }, svg);
      const words = element("text", { x: u + 7, y: v + (name === "max" ? -2 : 10) }, svg, "c");
      element("tspan", { "font-size": 8, dy: 2 }, words, name);
    }
  }
  box.append(svg);
  const lights = [...new Set(told.peaks.filter((p) => p.light >= 0).map((p) => p.light))].sort((a, b) => a - b);
  key(box, [
    ["#5aa9ff", "diffuse level", true], ["#d0d3d8", "threshold", true],
    ...lights.map((k) => [LIGHTS[k % LIGHTS.length], `light ${k}`]),
    ...(told.clipped.some(Boolean) ? [["#ff8d7a", "clipped"]] : []),
  ]);
  const best = telling.reduce((a, b) => (a && a.distance <= b.distance ? a : b), null);
  note(box, best
    ? `Nearest peak: light ${best.light}, ρs ${number(best.rho_s)}, α ${number(best.alpha)}.`
    : told.lights ? "No peak of this point tells ρs and α." : "No lights were found yet.");
}

export function drawDensity(box, told) {
  box.replaceChildren();
  const bell = told.bell;
  if (!bell) return note(box, `Only ${told.known} of ${told.asked} texels show a peak that tells.`);
  const low = Math.log10(bell.x[0]), high = Math.log10(bell.x.at(-1)), top = 1.05 * Math.max(...bell.density);
  const x = (v) => LEFT + (W - LEFT - RIGHT) * (Math.log10(v) - low) / (high - low);
  const y = (d) => TOP + (H - TOP - BOTTOM) * (1 - d / top);
  const marks = [];
  for (let e = Math.floor(low); e <= high; e++) for (const k of [1, 2, 5]) {
    const v = k * 10 ** e;
    if (Math.log10(v) >= low && Math.log10(v) <= high) marks.push(v);
  }
  const shown = marks.length > 7 ? marks.filter((v) => /^(1|0\.0*1)0*$/.test(`${Number(v.toPrecision(1))}`)) : marks;
  const svg = axes(x, y, shown, ticks(0, top, 4), "ρs (density of its logarithm)");
  const point = (i) => `${x(bell.x[i]).toFixed(1)} ${y(bell.density[i]).toFixed(1)}`;
  const inside = bell.x.map((_, i) => i).filter((i) => bell.x[i] >= bell.low && bell.x[i] <= bell.high);
  if (inside.length > 1)
    element("path", { d: `M${x(bell.x[inside[0]]).toFixed(1)} ${y(0)}L${inside.map(point).join("L")}L${x(bell.x[inside.at(-1)]).toFixed(1)} ${y(0)}Z`, fill: "#5aa9ff44" }, svg);
  element("path", { d: `M${bell.x.map((_, i) => point(i)).join("L")}`, fill: "none", stroke: "#5aa9ff", "stroke-width": 1.5 }, svg);
  element("line", { x1: x(bell.rho_s), x2: x(bell.rho_s), y1: TOP, y2: y(0), stroke: "#ffb454", "stroke-dasharray": "3 2" }, svg);
  box.append(svg);
  key(box, [["#5aa9ff", "bell of the highest mode"], ["#ffb454", "its median", true]]);
  note(box, `ρs ${number(bell.rho_s)}, α ${number(bell.alpha)} of the bell's ${bell.texels} texels; ${told.known} of ${told.asked} tell.`);
}
