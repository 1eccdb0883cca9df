// What the panel lists: the clusters, and the numbers of a point.
import { number } from "./plots.js";

// Far-apart colours for a preview, whose clusters are not those of the list
export const palette = () => Array.from({ length: 256 }, (_, id) => {
  const hue = (id * 137.508) % 360, channel = (k) => {
    const m = (k + hue / 30) % 12;
    return Math.round(255 * (0.55 - 0.38 * Math.max(-1, Math.min(m - 3, 9 - m, 1))));
  };
  return { id, color: [channel(0), channel(8), channel(4)] };
});

// The gloss of a material in words: microfacets where they describe it better, else Phong's lobe
const MODELS = { ggx: "GGX", beckmann: "Beckmann" };
function glossWords({ observed, rho_s, alpha, reflectance }) {
  if (reflectance) return `${MODELS[reflectance.model]}, roughness ${number(reflectance.roughness)}`;
  return observed ? `ρs ${number(rho_s)}, α ${number(alpha)}` : "unobserved";
}

// A cluster in the list; does: select(id, more), rename(id, name)
export function clusterRow(cluster, selected, does) {
  const row = document.createElement("li"), gloss = cluster.gloss;
  row.classList.toggle("selected", selected);
  row.dataset.id = cluster.id;
  const cell = (name, words = "") => {
    const span = document.createElement("span");
    span.className = name;
    span.textContent = words;
    return span;
  };
  const swatch = cell("swatch"), name = document.createElement("input");
  swatch.style.background = `rgb(${cluster.color})`;
  Object.assign(name, { type: "text", value: cluster.name, placeholder: "unnamed", maxLength: 60, title: "Its name; select the material to change it" });
  name.setAttribute("aria-label", `Name of material ${cluster.id}`);
  name.addEventListener("change", () => does.rename(cluster.id, name.value));
  name.addEventListener("keydown", (event) => { if (event.key === "Enter") name.blur(); });
  name.addEventListener("click", (event) => event.stopPropagation());
  const known = gloss?.observed || gloss?.reflectance;
  const shown = !gloss ? `${(100 * cluster.share).toFixed(1)} %` : known ? glossWords(gloss) : "gloss unobserved";
  const right = cell("gloss", shown);
  right.title = `${cluster.texels.toLocaleString()} texels, ${(100 * cluster.share).toFixed(1)} %${gloss && !known ? `: ${gloss.reason}` : ""}`;
  row.append(swatch, cell("id", cluster.id), name, right);
  row.addEventListener("click", (event) => does.select(cluster.id, event.ctrlKey || event.shiftKey || event.metaKey));
  return row;
}

// Terms and values of a point, and of the cluster `own` that it is of
export function numberRows(found, own) {
  const rows = [];
  const row = (name, words, color) => {
    const [term, value] = [document.createElement("dt"), document.createElement("dd")];
    term.textContent = name;
    if (color) {
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = `rgb(${color})`;
      value.append(swatch);
    }
    value.append(words);
    rows.push(term, value);
  };
  if (own) row("cluster", `${own.texels.toLocaleString()} texels, ${(100 * own.share).toFixed(1)} %`);
  const facets = own?.gloss?.reflectance;
  if (own?.gloss) row("material", glossWords(own.gloss));
  if (facets) {
    row("F₀, strength", `${number(facets.f0)}, ${number(facets.strength)}`);
    row("colour of the highlight", facets.color.map((x) => number(x)).join("  "));
    row("better than Phong's lobe by", `${number(facets.gain_db, 2)} dB`);
    if (own.gloss.observed) row("as Phong's lobe", `ρs ${number(own.gloss.rho_s)}, α ${number(own.gloss.alpha)}`);
  }
  if (own?.gloss?.explained_variance != null) row("variance explained", `${(100 * own.gloss.explained_variance).toFixed(1)} %`);
  if (own?.gloss && !own.gloss.observed && !facets) {
    const why = document.createElement("dd");
    why.className = "wide";
    why.textContent = own.gloss.reason;
    rows.push(why);
  }
  if (found.diffuse) row("diffuse", found.diffuse.map((x) => number(x)).join("  "), found.diffuse_srgb);
  if (found.threshold !== undefined) row("threshold, mean, least", [found.threshold, found.mean, found.minimum].map((x) => number(x)).join("  "));
  if (found.alpha !== undefined) row("own peak", `ρs ${number(found.rho_s)}, α ${number(found.alpha)}`);
  if (found.samples !== undefined) row("samples", `${found.samples} good of ${found.frames ?? "?"}`);
  row("place", found.point.map((x) => number(x, 4)).join("  "));
  return rows;
}
