// Box plots of relative errors: how they spread, for each length of the pieces.
import {el, svg} from "./dom";
import {figure, niceStep} from "./maths";
import type {FiveNumbers, Judged} from "./types";

const kWidth = 520, kHeight = 220, kLeft = 46, kBottom = 34, kTop = 10;

/** One plot of a figure for all judged trajectories side by side. */
export function boxPlot(title: string, unit: string, judged: Judged[], numbers: (box: Judged["boxes"][number]) => FiveNumbers): HTMLElement | null {
  const shown = judged.filter(j => j.boxes.length > 0);
  const percents = [...new Set(shown.flatMap(j => j.boxes.map(box => box.percent)))];
  const most = Math.max(0, ...shown.flatMap(j => j.boxes.map(box => numbers(box)[4])));
  if (!percents.length || !(most > 0)) return null;
  const y = (value: number): number => kTop + (kHeight - kTop - kBottom) * (1 - value / (1.05 * most));
  const slot = (kWidth - kLeft - 8) / percents.length;
  const picture = svg("svg", {viewBox: `0 0 ${kWidth} ${kHeight}`, class: "boxes", role: "img", "aria-label": `Box plot: ${title}`});
  const step = niceStep(most / 5);
  for (let value = 0; value <= 1.05 * most; value += step)
    picture.append(svg("line", {x1: kLeft, x2: kWidth - 4, y1: y(value), y2: y(value), class: "rule"}),
      svg("text", {x: kLeft - 7, y: y(value) + 4, "text-anchor": "end"}, String(Number(value.toPrecision(3)))));
  percents.forEach((percent, column) => {
    const middle = kLeft + (column + 0.5) * slot;
    const length = shown[0]!.boxes.find(box => box.percent === percent)?.length_m;
    picture.append(svg("text", {x: middle, y: kHeight - 16, "text-anchor": "middle"}, `${percent} %`),
      svg("text", {x: middle, y: kHeight - 2, "text-anchor": "middle", class: "small"}, length === undefined ? "" : `${figure(length)} m`));
    shown.forEach((j, k) => {
      const box = j.boxes.find(b => b.percent === percent);
      if (!box) return;
      const width = Math.min(26, 0.7 * slot / shown.length), x = middle + (k - (shown.length - 1) / 2) * (width + 5);
      picture.append(oneBox(numbers(box), x, width, y, k === 0 ? "smoothed" : "causal", `${j.title}, ${percent} %, ${box.samples} pieces`));
    });
  });
  const legend = el("div", {class: "legend"}, ...shown.map((j, k) => el("span", {}, el("span", {class: `block ${k === 0 ? "smoothed" : "causal"}`}), j.title)));
  return el("figure", {class: "card panel"}, el("div", {class: "panel-head"}, el("span", {}, title), el("span", {class: "unit"}, unit)), legend, picture);
}

function oneBox([least, low, median, high, most]: FiveNumbers, x: number, width: number, y: (v: number) => number, kind: string, title: string): SVGElement {
  const line = (x1: number, x2: number, y1: number, y2: number, name = ""): SVGElement => svg("line", {x1, x2, y1: y(y1), y2: y(y2), class: name});
  return svg("g", {class: `box ${kind}`},
    svg("title", {}, `${title}: least ${figure(least)}, quartiles ${figure(low)} and ${figure(high)}, median ${figure(median)}, most ${figure(most)}`),
    line(x, x, least, low), line(x, x, high, most), line(x - width / 4, x + width / 4, least, least), line(x - width / 4, x + width / 4, most, most),
    svg("rect", {x: x - width / 2, width, y: y(high), height: Math.max(1, y(low) - y(high)), rx: 2}),
    line(x - width / 2, x + width / 2, median, median, "median"));
}
