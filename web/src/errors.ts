// Error statistics: a table of all protocols, box plots of the relative errors.
import {boxPlot} from "./boxes";
import {el, section, table} from "./dom";
import {figure, fixed, isNumber} from "./maths";
import type {Judged} from "./types";

export function errorSection(judged: Judged[]): HTMLElement | null {
  if (!judged.length) return null;
  const boxes = [boxPlot("Relative translation error (protocol segments)", "% of the piece's length", judged, box => box.translation_percent),
    boxPlot("Relative rotation error (protocol segments)", "deg", judged, box => box.rotation_deg)].filter(plot => plot !== null);
  return section("Against ground truth", ...judged.map(card), el("div", {class: "grid"}, ...boxes),
    ...boxes.length ? [el("p", {class: "hint muted"}, "Boxes: quartiles and median; whiskers: least and most. Pieces are 10 to 50 % of the path long.")] : []);
}

function card({title, data, boxes}: Judged): HTMLElement {
  const protocols = Object.entries(data.protocols ?? {}).filter(([name]) => name !== "segments");
  const facts: string[] = [];
  if (isNumber(data.matched)) facts.push(`${figure(data.matched)} poses matched`);
  if (isNumber(data.coverage)) facts.push(`${(100 * data.coverage).toFixed(1)} % of the ground truth's time covered`);
  if (isNumber(data.distance_m)) facts.push(`${figure(data.distance_m)} m travelled`);
  const out = el("div", {class: "card"}, el("h3", {}, title), el("p", {class: "muted"}, facts.join(" · ")));
  if (protocols.length)
    out.append(table([{name: "Protocol"}, {name: "Alignment", left: true}, {name: "RMSE m"}, {name: "Median m"}, {name: "Max m"},
      {name: "Rotation RMSE °"}, {name: "Yaw RMSE °"}, {name: "MPE %"}, {name: "MYE °/m"}, {name: "Scale"}],
    protocols.map(([name, p]) => [name, p.alignment ? [p.alignment.kind, p.alignment.on].filter(Boolean).join(", ") : "–",
      fixed(p.translation_m?.rmse, 4), fixed(p.translation_m?.median, 4), fixed(p.translation_m?.max, 4), fixed(p.rotation_deg?.rmse, 3),
      fixed(p.yaw_deg?.rmse, 3), fixed(p.mpe_percent, 3), fixed(p.mye_deg_per_m, 4), fixed(p.scale, 4)])));
  if (boxes.length)
    out.append(el("details", {}, el("summary", {}, "Relative errors over pieces of the path"),
      table([{name: "Share of path"}, {name: "Length m"}, {name: "Pieces"}, {name: "Median %"}, {name: "Quartiles %"}, {name: "Worst %"}, {name: "Median rotation °"}, {name: "Worst rotation °"}],
        boxes.map(box => [`${box.percent} %`, fixed(box.length_m, 2), figure(box.samples), fixed(box.translation_percent[2], 2),
          `${fixed(box.translation_percent[1], 2)} – ${fixed(box.translation_percent[3], 2)}`, fixed(box.translation_percent[4], 2),
          fixed(box.rotation_deg[2], 3), fixed(box.rotation_deg[4], 3)]))));
  const notes = protocols.flatMap(([name, p]) => (p.notes ?? []).map(note => `${name}: ${note}`));
  for (const [name, reason] of Object.entries(data.skipped ?? {})) notes.push(`${name}: not computed, ${reason}`);
  for (const note of notes) out.append(el("p", {class: "table-note muted"}, note));
  return out;
}
