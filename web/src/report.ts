// The page of one run.
import {Color} from "three";
import {Charts} from "./charts";
import {button, check, el, section, select} from "./dom";
import {errorSection} from "./errors";
import {EventStore, type PackedBytes} from "./event_store";
import {EventView} from "./event_view";
import {Frames} from "./frames";
import {header} from "./header";
import {figure, nearest, poseAt} from "./maths";
import {LineMap, type LineColouring} from "./map";
import {boxOf, joinBoxes, Scene, type View} from "./scene";
import {colours, onTheme, ramp, rampCss} from "./theme";
import {Timeline} from "./timeline";
import type {Path, RunData} from "./types";

type PathColouring = "time" | "error";

export function css(colour: string): [number, number, number] {
  const c = new Color(colour);
  return [c.r, c.g, c.b];
}

export function srgb(rgb: [number, number, number]): [number, number, number] {
  const c = new Color().setRGB(...rgb, "srgb");
  return [c.r, c.g, c.b];
}

export function showReport(host: HTMLElement, data: RunData, bytes: PackedBytes): void {
  const times = [...data.smoothed.t, ...data.events.t, ...data.panels.flatMap(panel => panel.series.flatMap(s => [s.t[0] ?? 0, s.t.at(-1) ?? 0]))];
  const from = times.reduce((a, b) => Math.min(a, b), Infinity), to = times.reduce((a, b) => Math.max(a, b), -Infinity);
  const any = from < to;
  const timeline = new Timeline(any ? from : 0, any ? to : 1, data.events.t.length ? data.events.t : data.smoothed.t);
  host.append(header(data));
  const views = el("div", {class: "views"});
  if (data.smoothed.t.length || data.events.t.length) host.append(section("Trajectory, map and events", views));
  const lines = new LineMap(data.lines, data.palette);
  if (data.smoothed.t.length) views.append(sceneCard(data, lines, timeline));
  if (data.camera && data.events.t.length) views.append(eventCard(data, lines, new EventStore(data.events, bytes), timeline));
  const errors = errorSection(data.evaluations);
  if (errors) host.append(errors);
  const charts = new Charts(time => { timeline.set(time); });
  for (const [group, title] of [["error", "Errors"], ["state", "State"], ["front-end", "Front-end"], ["back-end", "Back-end"]] as const) {
    const panels = data.panels.filter(panel => panel.group === group), grid = el("div", {class: "grid"});
    if (!panels.length) continue;
    host.append(section(title, grid));
    charts.add(grid, panels);
  }
  if (any) charts.setAll(from, to);
  timeline.onChange(time => { charts.setTime(time); });
  if (data.trackLengths) host.append(section("How long lines were tracked", histogram(data.trackLengths)));
  host.append(about(data));
  if (any) host.append(timeline.bar);
  timeline.set(any ? from + 0.5 * (to - from) : 0);
}

function errorAtPoses({smoothed, panels}: RunData): ((i: number) => number) | null {
  const errors = panels.find(panel => panel.title.startsWith("Translation error"))?.series.find(s => s.name === "smoothed");
  if (!errors?.t.length) return null;
  const most = errors.y.reduce<number>((a, b) => Math.max(a, b ?? 0), 0);
  return i => (errors.y[nearest(errors.t, smoothed.t[i]!)] ?? 0) / (most || 1);
}

function mostError({panels}: RunData): number {
  const errors = panels.find(panel => panel.title.startsWith("Translation error"))?.series.find(s => s.name === "smoothed");
  return errors?.y.reduce<number>((a, b) => Math.max(a, b ?? 0), 0) ?? 0;
}

export function pathBox(...paths: Path[]): ReturnType<typeof boxOf> {
  const boxes = paths.map(path => boxOf(path.p)).filter(box => box !== null);
  return boxes.length ? joinBoxes(boxes) : null;
}

/** Says so where there is no WebGL. */
export function makeScene(host: HTMLElement, camera: RunData["camera"], label: string): Scene | null {
  try {
    return new Scene(host, camera, label);
  } catch {
    host.append(el("p", {class: "muted no-webgl"}, "The 3D view needs WebGL, which this browser does not offer here."));
    return null;
  }
}

export function viewButtons(scene: Scene, path: boolean): HTMLElement {
  const views: [View, string, string][] = [["all", "All", "Everything in view"], ["path", "Path", "The trajectory in view"], ["top", "Top", "From above"],
    ["side", "Side", "From the side"], ["camera", "Camera", "Through the estimated camera"]];
  return el("div", {class: "buttons"}, ...views.filter(([view]) => path || (view !== "camera" && view !== "path"))
    .map(([view, text, title]) => button(text, title, () => { scene.look(view); })));
}

function sceneCard(data: RunData, lines: LineMap, timeline: Timeline): HTMLElement {
  const stage = el("div", {class: "stage"}), legend = el("div", {class: "corner"}), tools = el("div", {class: "toolbar"});
  const card = el("div", {class: "card view"}, stage, tools,
    el("p", {class: "hint muted"}, "Drag to turn, right-drag or two fingers to move, wheel or pinch to zoom; or arrow keys, + and −, Home."));
  const scene = makeScene(stage, data.camera, "3D view of trajectory and lines.");
  if (!scene) return card;
  stage.append(legend);
  const often = data.lines.windows.flatMap((windows, i) => windows > 2 ? [i] : []);
  const ends = (often.length > 10 ? often : data.lines.id.map((_, i) => i)).flatMap(i => [...data.lines.a.slice(3 * i, 3 * i + 3), ...data.lines.b.slice(3 * i, 3 * i + 3)]);
  const path = pathBox(data.smoothed, data.truth);
  scene.setBox(joinBoxes([boxOf(ends, 0.05), path]), path);
  let pathBy: PathColouring = "time", linesBy: LineColouring = "certainty";
  const error = errorAtPoses(data), shown = {smoothed: true, causal: false, truth: data.truth.t.length > 0};
  const draw = (): void => {
    const theme = colours(), end = data.smoothed.t.at(-1)! || 1;
    const share = pathBy === "error" && error ? error : (i: number): number => data.smoothed.t[i]! / end;
    scene.setPath("truth", data.truth, {width: 1.6, colour: () => css(theme.truth), dashed: true});
    scene.setPath("causal", data.causal, {width: 1.4, colour: () => css(theme.causal)});
    scene.setPath("smoothed", data.smoothed, {width: 3, colour: i => srgb(ramp(share(i), theme.dark)), past: true});
    lines.draw(scene, linesBy);
    scene.setTime(timeline.time);
    const swatch = (kind: string, style: string): HTMLElement => { const s = el("span", {class: `swatch ${kind}`}); s.style.cssText = style; return s; };
    legend.replaceChildren(el("span", {}, swatch("ramp", `background: ${rampCss(theme.dark)}`), pathBy === "error" ? `smoothed, by error: 0 to ${figure(100 * mostError(data))} cm` : "smoothed, by time"),
      ...shown.causal ? [el("span", {}, swatch("thin", `color: ${theme.causal}`), "causal")] : [],
      ...shown.truth ? [el("span", {}, swatch("dashed", `color: ${theme.truth}`), "ground truth")] : [],
      el("span", {}, `grid ${figure(scene.step)} m`));
  };
  const toggle = (name: "smoothed" | "causal" | "truth", text: string): HTMLElement =>
    check([text], shown[name], on => { shown[name] = on; scene.show(name, on); draw(); });
  scene.show("causal", false);
  const toggles = el("div", {class: "toggles"}, toggle("smoothed", "smoothed"));
  if (data.causal.t.length) toggles.append(toggle("causal", "causal"));
  if (data.truth.t.length) toggles.append(toggle("truth", "ground truth"));
  toggles.append(check(["map"], true, on => { scene.show("map", on); }), check(["in sight"], true, on => { scene.show("sight", on); }));
  if (error) toggles.append(select("path by", [["time", "time"], ["error", "error"]], value => { pathBy = value as PathColouring; draw(); }));
  toggles.append(select("lines by", [["certainty", "certainty"], ["age", "age"], ["id", "line"]], value => { linesBy = value as LineColouring; draw(); }));
  tools.append(toggles, viewButtons(scene, true));
  onTheme(draw);
  draw();
  scene.look("all");
  timeline.onChange(time => {
    scene.setTime(time);
    scene.setPose(poseAt(data.smoothed, time));
    lines.drawInSight(scene, lines.inSight(time));
  });
  return card;
}

function eventCard(data: RunData, lines: LineMap, store: EventStore, timeline: Timeline): HTMLElement {
  const view = new EventView(data.camera!, data.palette), caption = el("p", {class: "caption", role: "status", "aria-live": "off"});
  let drawn = -2;
  const frames = new Frames(data.frames, () => { drawn = -2; draw(); });
  const draw = (): void => {
    const row = store.row(timeline.time);
    if (row === drawn) return;
    drawn = row;
    const time = data.events.t[row]!, seen = view.draw(store.events(row), data.lines, lines.inSight(time), poseAt(data.smoothed, time), frames.at(time));
    const {own, around, shown} = data.events;
    const some = around[row]! < own[row]! ? ` (evenly picked of the ${figure(around[row])} within about three pixels of motion around its middle)`
      : shown[row]! < own[row]! ? " (evenly picked)" : "";
    caption.textContent = `At ${time.toFixed(2)} s: ${figure(shown[row])} of the window's ${figure(own[row])} events${some}, ${seen} mapped lines over them.`;
    view.canvas.setAttribute("aria-label", `Events of the camera, coloured by line. ${caption.textContent}`);
  };
  timeline.onChange(draw);
  const toggles = el("div", {class: "toggles"}, check(["projected 3D lines"], true, on => { view.showLines = on; drawn = -2; draw(); }));
  if (data.frames.t.length) toggles.append(check(["frames"], true, on => { frames.on = on; drawn = -2; draw(); }));
  return el("div", {class: "card view"}, view.canvas, el("div", {class: "toolbar"}, toggles), caption,
    el("p", {class: "hint muted"}, "Colours tell lines apart; grey: events of no line; darker: falling brightness. White: the estimated 3D lines, seen by the estimated camera."));
}

function histogram({width, counts}: {width: number; counts: number[]}): HTMLElement {
  const most = Math.max(1, ...counts);
  const bars = counts.map((count, i) => {
    const bar = el("div", {class: "bar", title: `${figure(i * width)} to ${figure((i + 1) * width)} s: ${count} lines`});
    bar.style.height = `${count ? Math.max(1, 100 * count / most) : 0}%`;
    return bar;
  });
  return el("figure", {class: "card"}, el("div", {class: "histogram", role: "img", "aria-label": `Histogram of track lengths, up to ${figure(counts.length * width)} s`}, ...bars),
    el("div", {class: "histogram-axis muted"}, el("span", {}, "0 s"), el("span", {}, `tallest: ${figure(most)} lines`), el("span", {}, `${figure(counts.length * width)} s`)));
}

/** Configuration, rig, and what the page leaves out. */
function about(data: RunData): HTMLElement {
  const out = section("About this run");
  if (data.stats?.version) out.append(el("p", {}, `Made by idol ${data.stats.version}.`));
  for (const {name, text} of data.files) out.append(el("details", {}, el("summary", {}, name), el("pre", {tabindex: "0"}, text)));
  const stages = Object.entries(data.stats?.stages ?? {});
  if (stages.length)
    out.append(el("details", {}, el("summary", {}, "Computing time by stage"), el("pre", {}, stages.map(([name, s]) => `${name.padEnd(12)} ${s.toFixed(3)} s`).join("\n"))));
  if (data.notes.length) out.append(el("h3", {}, "What this page leaves out"), el("ul", {class: "muted"}, ...data.notes.map(note => el("li", {}, note))));
  return out;
}
