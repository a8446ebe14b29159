// A run while it goes: what the server sends, drawn as it comes.
import {Charts} from "./charts";
import {el, section} from "./dom";
import {bytesOfBase64, unpackEvents} from "./event_store";
import {EventView} from "./event_view";
import {figure} from "./maths";
import {LineMap} from "./map";
import {boxOf, joinBoxes, type Scene} from "./scene";
import {makeScene, srgb, viewButtons} from "./report";
import {colours, ramp} from "./theme";
import {kSeconds, livePanels, LiveState, type Hello, type Update} from "./live_state";
import type {LineTable} from "./types";

export function showLive(host: HTMLElement, name: string): void {
  document.title = `${name} – idol live`;
  const status = el("p", {class: "banner quiet", role: "status"}, "Waiting for the run …"), facts = el("p", {class: "muted facts"});
  host.append(el("header", {}, el("p", {class: "eyebrow"}, "idol · a run while it goes"), el("h1", {}, name), status, facts));
  const stream = new EventSource("stream");
  let page: LivePage | null = null;
  stream.addEventListener("hello", event => {
    page ??= new LivePage(host, JSON.parse(event.data as string) as Hello, facts);
    status.textContent = "Live: the estimate as it is published.";
  });
  stream.addEventListener("update", event => { page?.take(JSON.parse(event.data as string) as Update); });
  stream.addEventListener("end", event => {
    stream.close();
    status.textContent = `The run is over. ${JSON.parse(event.data as string) as string}`;
    document.body.dataset["live"] = "over";
  });
  stream.onerror = () => {
    status.textContent = stream.readyState === EventSource.CLOSED ? "The program is not there any more." : "The connection is lost; trying again …";
  };
}

class LivePage {
  private readonly state = new LiveState();
  private readonly scene: Scene | null;
  private readonly view: EventView;
  private readonly caption = el("p", {class: "caption"});
  private readonly charts = new Charts(() => undefined);
  private latest: Update | null = null;
  private looked = 0;
  private updates = 0;
  private skipped = 0;

  constructor(host: HTMLElement, private readonly hello: Hello, private readonly facts: HTMLElement) {
    const stage = el("div", {class: "stage"}), tools = el("div", {class: "toolbar"});
    this.view = new EventView(hello.camera, hello.palette);
    host.append(section("Trajectory, lines and events", el("div", {class: "views"}, el("div", {class: "card view"}, stage, tools), el("div", {class: "card view"}, this.view.canvas, this.caption))));
    this.scene = makeScene(stage, hello.camera, "3D view of the trajectory so far and the current lines.");
    if (this.scene) tools.append(el("div", {class: "toggles"}), viewButtons(this.scene, true));
    const grid = el("div", {class: "grid"});
    host.append(section(`The last ${kSeconds} seconds`, grid));
    this.charts.add(grid, livePanels(this.state.rows));
  }

  /** Several may come between two pictures of the screen: the newest is drawn. */
  take(update: Update): void {
    this.state.take(update);
    ++this.updates;
    if (this.latest) ++this.skipped;
    else requestAnimationFrame(() => { this.draw(); });
    this.latest = update;
  }

  private draw(): void {
    const update = this.latest, {path, newest, rows} = this.state;
    this.latest = null;
    if (!update) return;
    const map = new LineMap(update.lines, this.hello.palette), all = update.lines.id.map((_, i) => i);
    const {events} = update;
    this.view.draw(events.packed ? unpackEvents(bytesOfBase64(events.packed)) : null, update.lines, all, update.pose);
    this.caption.textContent = `At ${events.t.toFixed(2)} s: ${figure(events.shown)} of the window's ${figure(events.own)} events.`;
    if (this.scene) {
      const end = path.t.at(-1) ?? 1, dark = colours().dark;
      this.scene.setPath("path", path, {width: 3, colour: i => srgb(ramp(path.t[i]! / end, dark))});
      map.drawInSight(this.scene, all);
      this.scene.setPose(newest);
      this.frame(update.lines);
    }
    this.charts.update(livePanels(rows));
    const now = rows.t.at(-1) ?? 0;
    this.charts.setSpan([Math.max(0, now - kSeconds), Math.max(kSeconds, now)]);
    this.facts.textContent = `${now.toFixed(1)} s estimated · ${figure(path.t.length)} poses · ${figure(update.lines.id.length)} lines in sight · idol ${this.hello.version}`;
    document.body.dataset["poses"] = String(path.t.length);
    document.body.dataset["updates"] = String(this.updates);
    document.body.dataset["skipped"] = String(this.skipped);
  }

  /** Shows all, until it has been moved by hand; again each time the path has doubled. */
  private frame(lines: LineTable): void {
    const {path} = this.state;
    if (path.t.length < 2 * this.looked) return;
    this.looked = Math.max(10, path.t.length);
    const own = boxOf(path.p);
    this.scene?.setBox(joinBoxes([own, boxOf([...lines.a, ...lines.b], 0.1)]), own);
    this.scene?.look("all");
  }
}
