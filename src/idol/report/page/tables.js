// Header, figures and tables. Texts from the run are only ever set as text, never as markup.
function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

const isNumber = value => typeof value === "number" && Number.isFinite(value);

// Three or four telling digits, thousands in groups.
function figure(value) {
  if (!isNumber(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1000) return Math.round(value).toLocaleString("en").replaceAll(",", "\u202f");
  if (size >= 100 || Number.isInteger(value)) return String(Math.round(value));
  if (size >= 10) return value.toFixed(1);
  return size >= 1 ? value.toFixed(2) : String(+value.toPrecision(3));
}

function large(value) {
  if (!isNumber(value)) return "–";
  return value >= 1e6 ? `${(value / 1e6).toFixed(2)} M` : value >= 1e4 ? `${(value / 1e3).toFixed(1)} k` : figure(value);
}

function fillHeader(data) {
  const stats = data.stats || {};
  const name = typeof stats.sequence === "string" ? stats.sequence.replace(/\/+$/, "") : "";
  const short = name.split("/").at(-1) || "Run";
  document.title = `${short} – idol report`;
  document.getElementById("title").textContent = short;
  const facts = [];
  if (stats.preset) facts.push(`preset ${stats.preset}`);
  if (stats.version) facts.push(`idol ${stats.version}`);
  if (data.zero) facts.push(`time zero is stamp ${data.zero} s`);
  if (name && name !== short) facts.push(name);
  document.getElementById("subtitle").textContent = facts.join(" · ");
  fillBanners(stats);
  fillTiles(stats, data);
}

function fillBanners(stats) {
  const host = document.getElementById("banners");
  const banner = (kind, ...parts) => host.append(el("div", {class: `banner ${kind}`}, ...parts));
  if (stats.status === "interrupted")
    banner("warn", el("strong", {}, "The run was interrupted. "), "This is what it had found until then.");
  else if (stats.status && stats.status !== "done" && stats.status !== "ok")
    banner("bad", el("strong", {}, "The run ended early. "), String(stats.status));
  const warnings = Object.entries(stats.warnings || {});
  if (!warnings.length) return;
  const list = el("ul");
  for (const [kind, warning] of warnings) {
    const count = warning.count > 1 ? ` (${figure(warning.count)} times)` : "";
    const words = kind.replaceAll("_", " ").replace(/\bimu\b/, "IMU");
    list.append(el("li", {}, el("strong", {}, words.charAt(0).toUpperCase() + words.slice(1)), count, ": ", String(warning.message ?? "")));
  }
  banner("warn", el("strong", {}, warnings.length === 1 ? "One thing to know about this run" : `${warnings.length} things to know about this run`), list);
}

function fillTiles(stats, data) {
  const host = document.getElementById("tiles");
  const tile = (name, value, unit, under) => {
    if (value === null || value === undefined || value === "–") return;
    const dd = el("dd", {}, value, el("small", {}, unit ? ` ${unit}` : ""));
    if (under) dd.append(el("p", {class: "under"}, under));
    host.append(el("div", {}, el("dt", {}, name), dd));
  };
  tile("Recording processed", figure(stats.duration_s), "s", isNumber(stats.wall_s) ? `in ${figure(stats.wall_s)} s of computing` : "");
  if (isNumber(stats.realtime_factor) && stats.realtime_factor > 0) {
    const f = stats.realtime_factor;
    tile("Real-time factor", figure(f), "×", f >= 1 ? `${figure(f)} times faster than real time` : `${figure(1 / f)} times slower than real time`);
  }
  const full = data.evaluations[0]?.data?.protocols?.full;
  const causal = data.evaluations[1]?.data?.protocols?.full;
  const beside = (get, digits, unit) => isNumber(causal && get(causal)) ? `causal ${get(causal).toFixed(digits)} ${unit}` : "";
  if (isNumber(full?.translation_m?.rmse)) {
    const get = p => p.translation_m?.rmse;
    tile("Position error, RMSE", (100 * get(full)).toFixed(2), "cm", isNumber(causal && get(causal)) ? `causal ${(100 * get(causal)).toFixed(2)} cm` : "");
    if (isNumber(full.mpe_percent)) tile("Mean position error", full.mpe_percent.toFixed(2), "% of path", beside(p => p.mpe_percent, 2, "%"));
    if (isNumber(full.rotation_deg?.rmse)) tile("Rotation error, RMSE", full.rotation_deg.rmse.toFixed(2), "°", beside(p => p.rotation_deg?.rmse, 2, "°"));
  }
  tile("Events", large(stats.events), "", isNumber(stats.events) && stats.duration_s > 0 ? `${large(stats.events / stats.duration_s)} per second` : "");
  tile("Windows", figure(stats.windows), "", isNumber(stats.solver_iterations) && stats.windows > 0 ? `${figure(stats.solver_iterations / stats.windows)} solver iterations each` : "");
  tile("Lines mapped", figure(stats.lines), "", isNumber(stats.residuals) ? `${large(stats.residuals)} residuals` : "");
  tile("Peak memory", figure(stats.peak_rss_mb), "MB");
}

function table(columns, rows) {
  const cell = (tag, value, i) => el(tag, columns[i].left ? {class: "left"} : {}, value);
  return el("div", {class: "table-wrap"}, el("table", {},
    el("thead", {}, el("tr", {}, ...columns.map((column, i) => cell("th", column.name, i)))),
    el("tbody", {}, ...rows.map(row => el("tr", {}, ...row.map((value, i) => cell("td", value, i)))))));
}
const fixed = (value, digits) => isNumber(value) ? value.toFixed(digits) : "–";

function evaluationCard({title, data}) {
  const protocols = data.protocols || {}, segments = protocols.segments || data.segments;
  const card = el("div", {class: "card"}, el("h3", {}, title));
  const facts = [];
  if (isNumber(data.matched)) facts.push(`${figure(data.matched)} poses matched`);
  if (isNumber(data.coverage)) facts.push(`${(100 * data.coverage).toFixed(1)} % of the ground truth's time covered`);
  if (isNumber(data.distance_m)) facts.push(`${figure(data.distance_m)} m travelled`);
  card.append(el("p", {class: "muted"}, facts.join(" · ")));
  const rows = Object.entries(protocols).filter(([name]) => name !== "segments").map(([name, p]) => [name,
    p.alignment ? [p.alignment.kind, p.alignment.on].filter(Boolean).join(", ") : "–", fixed(p.translation_m?.rmse, 4), fixed(p.translation_m?.median, 4),
    fixed(p.translation_m?.max, 4), fixed(p.rotation_deg?.rmse, 3), fixed(p.yaw_deg?.rmse, 3), fixed(p.mpe_percent, 3), fixed(p.mye_deg_per_m, 4), fixed(p.scale, 4)]);
  if (rows.length) card.append(table([{name: "Protocol"}, {name: "Alignment", left: true}, {name: "RMSE m"}, {name: "Median m"}, {name: "Max m"},
    {name: "Rotation RMSE °"}, {name: "Yaw RMSE °"}, {name: "MPE %"}, {name: "MYE °/m"}, {name: "Scale"}], rows));
  if (segments && Object.keys(segments).length) {
    card.append(el("details", {}, el("summary", {}, "Relative errors over pieces of the path"), table([{name: "Share of path"}, {name: "Length m"}, {name: "Samples"},
      {name: "Median m"}, {name: "RMSE m"}, {name: "Median %"}, {name: "Median rotation °"}, {name: "Median yaw °"}],
    Object.entries(segments).map(([percent, s]) => [`${percent} %`, fixed(s.length_m, 2), figure(s.samples), fixed(s.translation_m?.median, 4),
      fixed(s.translation_m?.rmse, 4), fixed(s.translation_percent?.median, 2), fixed(s.rotation_deg?.median, 3), fixed(s.yaw_deg?.median, 3)]))));
  }
  const notes = Object.entries(protocols).flatMap(([name, p]) => (p.notes || []).map(note => `${name}: ${note}`));
  for (const [name, reason] of Object.entries(data.skipped || {})) notes.push(`${name}: not computed, ${reason}`);
  for (const note of notes) card.append(el("p", {class: "table-note muted"}, note));
  return card;
}
