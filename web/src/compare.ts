// Several runs: their figures side by side, their trajectories in one view, and the page of each.
import {Charts} from "./charts";
import {check, el, section, table} from "./dom";
import {fromBuffer} from "./event_store";
import {shortName} from "./header";
import {figure, fixed, inverse, isNumber, movePath} from "./maths";
import {css, makeScene, pathBox, showReport, viewButtons} from "./report";
import {joinBoxes} from "./scene";
import {colours, onTheme} from "./theme";
import type {Path, PanelData, RunData, RunSource} from "./types";

async function fetched(path: string): Promise<Response> {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${await answer.text()}`);
  return answer;
}

const load = async (i: number): Promise<RunData> => await (await fetched(`runs/${i}/data.json`)).json() as RunData;

/** One run: its page. Several: the comparison, or the page of the one that the address names. */
export async function showRuns(host: HTMLElement, runs: RunSource[]): Promise<void> {
  window.addEventListener("hashchange", () => { location.reload(); });
  const named = /^#run=(\d+)$/.exec(location.hash)?.[1];
  if (runs.length > 1) host.append(tabs(runs, named === undefined ? -1 : Number(named)));
  if (runs.length === 1 || named !== undefined) {
    // The events belong to the data asked for just before.
    const i = Number(named ?? 0), data = await load(i), events = await (await fetched(`runs/${i}/events.bin`)).arrayBuffer();
    showReport(host, data, fromBuffer(events));
    return;
  }
  showComparison(host, runs, await Promise.all(runs.map((_, i) => load(i))));
}

function tabs(runs: RunSource[], chosen: number): HTMLElement {
  const tab = (text: string, to: string, on: boolean): HTMLElement => el("a", {href: to, ...on ? {"aria-current": "page"} : {}}, text);
  return el("nav", {class: "tabs", "aria-label": "Runs"}, tab("Comparison", "#", chosen < 0), ...runs.map((run, i) => tab(run.name, `#run=${i}`, i === chosen)));
}

/** A path in the world of the first run that has one in common with it: that of the ground truth. */
export function commonPath(data: RunData, first: RunData): Path {
  return data.alignment && first.alignment ? movePath(movePath(data.smoothed, data.alignment), inverse(first.alignment)) : data.smoothed;
}

function showComparison(host: HTMLElement, runs: RunSource[], all: RunData[]): void {
  document.title = `${runs.length} runs – idol`;
  host.append(el("header", {}, el("p", {class: "eyebrow"}, "idol · event-camera and IMU odometry with lines"), el("h1", {}, `${runs.length} runs`)));
  const sequences = new Set(all.map(data => shortName(data.stats)));
  if (sequences.size > 1)
    host.append(el("p", {class: "banner warn"}, el("strong", {}, "These runs are of different recordings: "), `${[...sequences].join(", ")}. Their figures and trajectories are side by side, but not of the same thing.`));
  host.append(section("Figures", el("div", {class: "card"}, figures(runs, all),
    el("p", {class: "table-note muted"}, "RMSE, MPE and rotation: protocol full, smoothed; segments: median relative translation error over pieces of 30 % of the path."))));
  host.append(section("Trajectories", overlay(runs, all)));
  const panels = ["Translation error after alignment", "Rotation error after alignment"].map(title => together(title, runs, all)).filter(panel => panel !== null);
  panels.push(...["Velocity", "Accelerometer bias", "Computing time per window"].flatMap(title => {
    const panel = together(title, runs, all);
    return panel ? [panel] : [];
  }));
  const charts = new Charts(() => undefined), grid = el("div", {class: "grid"});
  host.append(section("Curves", grid));
  charts.add(grid, panels);
  const ends = all.flatMap(data => data.smoothed.t.at(-1) ?? []);
  if (ends.length) charts.setAll(0, Math.max(...ends));
}

function figures(runs: RunSource[], all: RunData[]): HTMLElement {
  const columns = ["Run", "Recording", "Preset", "RMSE cm", "causal cm", "MPE %", "Rotation °", "Segments %", "Length s", "× real time", "Lines", "Restarts", "Warnings", "Version", "Status"];
  const row = (run: RunSource, data: RunData, i: number): (Node | string)[] => {
    const stats = data.stats ?? {}, [full, causal] = data.evaluations.map(j => j.data.protocols?.["full"]);
    const boxes = data.evaluations[0]?.boxes ?? [], cm = (v: unknown): string => isNumber(v) ? (100 * v).toFixed(2) : "–";
    const swatch = el("span", {class: "swatch"});
    swatch.style.color = `var(--series-${i % 7})`;
    return [el("a", {href: `#run=${i}`}, swatch, run.name), shortName(data.stats, "–"), stats.preset ?? "–",
      cm(full?.translation_m?.rmse), cm(causal?.translation_m?.rmse), fixed(full?.mpe_percent, 3), fixed(full?.rotation_deg?.rmse, 3),
      fixed(boxes[Math.floor(boxes.length / 2)]?.translation_percent[2], 2), figure(stats.duration_s), figure(stats.realtime_factor), figure(stats.lines),
      figure(stats.restarts), figure(Object.keys(stats.warnings ?? {}).length + data.hints.length), stats.version ?? "–", stats.status ?? "–"];
  };
  return table(columns.map((name, i) => ({name, left: i < 3 || i > 12})), runs.map((run, i) => row(run, all[i]!, i)));
}

function overlay(runs: RunSource[], all: RunData[]): HTMLElement {
  const stage = el("div", {class: "stage wide"}), tools = el("div", {class: "toolbar"}), toggles = el("div", {class: "toggles"});
  const card = el("div", {class: "card view"}, stage, tools);
  const scene = makeScene(stage, null, "3D view of all trajectories.");
  if (!scene) return card;
  const paths = all.map(data => commonPath(data, all[0]!)), truth = all[0]!.truth;
  scene.setBox(joinBoxes([pathBox(...paths, truth)]), null);
  const draw = (): void => {
    const theme = colours();
    scene.setPath("truth", truth, {width: 2, colour: () => css(theme.truth), dashed: true});
    paths.forEach((path, i) => { scene.setPath(`run ${i}`, path, {width: 2.2, colour: () => css(theme.series[i % 7]!)}); });
  };
  const item = (name: string, text: string, colour: string, kind: string): void => {
    const swatch = el("span", {class: `swatch ${kind}`});
    swatch.style.color = colour;
    toggles.append(check([swatch, text], true, on => { scene.show(name, on); }));
  };
  runs.forEach((run, i) => { item(`run ${i}`, run.name, `var(--series-${i % 7})`, ""); });
  if (truth.t.length) item("truth", "ground truth", "var(--truth)", "dashed");
  tools.append(toggles, viewButtons(scene, false));
  if (all.some(data => !data.alignment))
    card.append(el("p", {class: "hint muted"}, "Runs without ground truth are drawn in their own world, which begins at the first pose."));
  onTheme(draw);
  draw();
  scene.look("all");
  return card;
}

/** The curves of one panel for all runs, one colour a run; of three axes, their length. */
export function together(title: string, runs: RunSource[], all: RunData[]): PanelData | null {
  const series: PanelData["series"] = [];
  let unit = "", suffix = "";
  all.forEach((data, i) => {
    const panel = data.panels.find(p => p.title === title), main = panel?.series.filter(s => s.style === "") ?? [];
    if (!panel || !main.length) return;
    unit = panel.unit;
    const axes = main.length === 3 && main.every(s => ["x", "y", "z"].includes(s.name));
    const y = axes ? main[0]!.t.map((_, k) => Math.hypot(...main.map(s => s.y[k] ?? NaN))) : main[0]!.y;
    if (axes) suffix = ", magnitude";
    series.push({name: runs[i]!.name, colour: i, style: "", t: main[0]!.t, y: y.map(v => isNumber(v) ? v : null)});
  });
  return series.length ? {group: "state", title: title + suffix, unit, series} : null;
}
