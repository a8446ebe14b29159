// Curves against one time axis: zoomed together, with the slider's time in all of them.
import uPlot from "uplot";
import {columnsOf, type Columns} from "./columns";
import {button, el} from "./dom";
import {nearest, quantile} from "./maths";
import {colours, onTheme} from "./theme";
import type {PanelData, SeriesData} from "./types";

const kHeight = 190;
const kStyleNames: Record<string, string> = {"": "smoothed", causal: "causal", truth: "ground truth"};

interface Entry {
  series: SeriesData[];
  value: HTMLElement;
}

class Chart {
  readonly figure: HTMLElement;
  private plot: uPlot | null = null;
  private readonly holder = el("div", {class: "plot"});
  private readonly now = el("div", {class: "now"});
  private readonly entries: Entry[] = [];
  private readonly off = new Set<string>();  // names and styles that are switched off
  private columns: Columns;

  constructor(private panel: PanelData, private readonly charts: Charts) {
    this.columns = columnsOf(panel.series);
    const legend = el("div", {class: "legend"});
    for (const name of new Set(panel.series.map(s => s.name))) {
      const series = panel.series.filter(s => s.name === name), value = el("b");
      const item = this.toggle(name, `var(--series-${series[0]!.colour % 7})`, series[0]!.style);
      item.append(" ", value);
      legend.append(item);
      this.entries.push({series, value});
    }
    const styles = [...new Set(panel.series.map(s => s.style))];
    if (styles.length > 1 && styles.every(style => style in kStyleNames))
      for (const style of styles) {
        const banded = panel.series.some(s => s.style === style && s.band);
        legend.append(this.toggle(kStyleNames[style]! + (banded ? " ±3σ" : ""), "var(--muted)", style, style || "smoothed"));
      }
    else if (panel.series.some(s => s.band)) legend.append(el("span", {class: "note" }, "bands: ±3σ as the estimator says"));
    this.figure = el("figure", {class: "card panel"}, el("div", {class: "panel-head"}, el("span", {}, panel.title), el("span", {class: "unit"}, panel.unit)),
      legend, this.holder);
    this.figure.setAttribute("aria-label", `${panel.title} against time`);
  }

  /** Made when it comes into view. */
  ensure(): void {
    if (this.plot || !this.holder.clientWidth) return;
    const text = (): string => colours().muted, grid = {stroke: () => colours().grid, width: 1}, ticks = {show: false};
    const font = "11.5px system-ui, sans-serif";
    this.plot = new uPlot({
      width: this.holder.clientWidth, height: kHeight, legend: {show: false},
      scales: {x: {time: false}, y: {range: (_, low, high) => yRange(low, high, this.reach())}},
      axes: [{stroke: text, grid, ticks, font, size: 26, values: (_, values) => values.map(v => `${Number(v.toFixed(3))} s`)},
        {stroke: text, grid, ticks, font, size: 56, values: (_, values) => values.map(v => shortNumber(v))}],
      series: [{}, ...this.panel.series.flatMap(s => this.seriesOptions(s))],
      bands: this.columns.places.flatMap(({band}, i) => band ? [{series: band, fill: () => tint(this.colourOf(this.panel.series[i]!), 0.16)}] : []),
      cursor: {sync: {key: this.charts.key, scales: ["x", null]}, drag: {x: true, y: false, setScale: true, dist: 6}, points: {show: false}, y: false},
      hooks: {
        setScale: [(plot, key) => { if (key === "x") this.charts.zoomed(this, plot.scales["x"]!.min!, plot.scales["x"]!.max!); }],
        draw: [() => { this.place(); }],
        setCursor: [plot => { this.tell(plot.cursor.left === undefined || plot.cursor.left < 0 ? null : plot.posToVal(plot.cursor.left, "x")); }],
        ready: [plot => { this.listen(plot); }],
      },
    }, this.columns.data, this.holder);
    this.plot.over.append(this.now);
    for (const name of this.off) this.apply(name);
    const span = this.charts.span;
    if (span) this.plot.setScale("x", {min: span[0], max: span[1]});
    this.place();
    this.tell(null);
  }

  setData(panel: PanelData): void {
    this.panel = panel;
    for (const entry of this.entries) entry.series = panel.series.filter(s => s.name === entry.series[0]?.name);
    this.columns = columnsOf(panel.series);
    this.plot?.setData(this.columns.data);
  }

  setSpan(min: number, max: number): void { this.plot?.setScale("x", {min, max}); }
  setTime(): void { this.place(); this.tell(null); }
  resize(): void { this.plot?.setSize({width: this.holder.clientWidth, height: kHeight}); }
  redraw(): void { this.plot?.redraw(false); }

  private colourOf(s: SeriesData): string { const all = colours().series; return all[s.colour % all.length]!; }

  private seriesOptions(s: SeriesData): uPlot.Series[] {
    const width = {truth: 5, causal: 1, thin: 1, dashed: 1.2}[s.style as string] ?? 1.5;
    const alpha = s.style === "truth" ? 0.3 : 1;
    const line: uPlot.Series = {label: s.name, stroke: () => tint(this.colourOf(s), alpha), width, spanGaps: false, points: {show: false}};
    if (s.style === "dashed") line.dash = [5, 4];
    if (s.style === "causal") line.dash = [2, 2];
    const edge: uPlot.Series = {stroke: "transparent", width: 0, points: {show: false}, auto: false};
    return s.band ? [line, edge, edge] : [line];
  }

  /** How far bands around zero are shown: not to their widest places, which would flatten the curves. */
  private reach(): number {
    const halves = this.panel.series.flatMap(s => s.style === "error" ? s.band ?? [] : []).filter(half => half !== null).sort((a, b) => a - b);
    return halves.length ? quantile(halves, 0.8) : 0;
  }

  private listen(plot: uPlot): void {
    plot.over.addEventListener("dblclick", () => { this.charts.showAll(); });
    plot.over.addEventListener("click", () => {
      const left = plot.cursor.left ?? -1;
      if (left >= 0 && plot.select.width === 0) this.charts.pick(plot.posToVal(left, "x"));
    });
  }

  private toggle(label: string, colour: string, style: string, key = label): HTMLElement {
    const swatch = el("span", {class: `swatch ${style}`});
    swatch.style.color = colour;
    const item = button("", `Show or hide ${label}`, () => {
      if (!this.off.delete(key)) this.off.add(key);
      item.setAttribute("aria-pressed", String(!this.off.has(key)));
      this.apply(key);
    });
    item.className = "key";
    item.setAttribute("aria-pressed", "true");
    item.append(swatch, label);
    return item;
  }

  private apply(key: string): void {
    this.panel.series.forEach((s, i) => {
      if (s.name !== key && (s.style || "smoothed") !== key) return;
      const {y, band} = this.columns.places[i]!;
      const show = !this.off.has(s.name) && !this.off.has(s.style || "smoothed");
      for (const column of [y, ...band ?? []]) this.plot?.setSeries(column, {show});
    });
  }

  /** The slider's time. */
  private place(): void {
    const time = this.charts.time, x = this.plot?.scales["x"];
    const shown = this.plot && time !== null && x?.min !== undefined && x.max !== undefined && time >= x.min - 1e-9 && time <= x.max + 1e-9;
    this.now.hidden = !shown;
    if (shown) this.now.style.transform = `translateX(${this.plot!.valToPos(time, "x")}px)`;
  }

  /** Values at the pointer's time, or else at the slider's. */
  private tell(pointed: number | null): void {
    const time = pointed ?? this.charts.time;
    if (time === null) return;
    for (const {series, value} of this.entries)
      value.textContent = series.filter(s => s.style !== "causal" || series.length === 1).map(s => {
        const y = s.y[nearest(s.t, time)];
        return y === null || y === undefined ? "–" : shortNumber(Number(y.toPrecision(4)));
      }).join(" / ");
  }
}

export class Charts {
  readonly key = `time-${Math.random()}`;
  span: [number, number] | null = null;
  time: number | null = null;
  private readonly charts: Chart[] = [];
  private readonly seen: IntersectionObserver;
  private readonly sizes: ResizeObserver;
  private busy = false;
  private pending = false;

  /** `pick` is called when a time is chosen by a click. */
  constructor(readonly pick: (time: number) => void) {
    this.seen = new IntersectionObserver(entries => {
      for (const entry of entries)
        if (entry.isIntersecting) this.charts.find(chart => chart.figure === entry.target)?.ensure();
    }, {rootMargin: "400px"});
    this.sizes = new ResizeObserver(() => { for (const chart of this.charts) chart.resize(); });
    onTheme(() => { for (const chart of this.charts) chart.redraw(); });
  }

  add(host: HTMLElement, panels: PanelData[]): void {
    for (const panel of panels) {
      const chart = new Chart(panel, this);
      this.charts.push(chart);
      host.append(chart.figure);
      this.seen.observe(chart.figure);
    }
    this.sizes.observe(host);
  }

  /** New values for the panels, in the order in which they were added. */
  update(panels: PanelData[]): void { panels.forEach((panel, i) => { this.charts[i]?.setData(panel); }); }

  setTime(time: number): void {
    this.time = time;
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      for (const chart of this.charts) chart.setTime();
    });
  }

  setSpan(span: [number, number]): void {
    this.span = span;
    this.busy = true;
    for (const chart of this.charts) chart.setSpan(...span);
    this.busy = false;
  }

  zoomed(by: Chart, min: number, max: number): void {
    if (this.busy) return;
    this.span = [min, max];
    this.busy = true;
    for (const chart of this.charts) if (chart !== by) chart.setSpan(min, max);
    this.busy = false;
  }

  private all: [number, number] | null = null;
  /** What a double click goes back to. */
  setAll(from: number, to: number): void {
    this.all = [from, to];
    this.setSpan(this.all);
  }
  showAll(): void { if (this.all) this.setSpan(this.all); }
}

function yRange(low: number | null, high: number | null, reach: number): [number, number] {
  if (low === null || high === null || !(low <= high)) return [0, 1];
  if (reach > 0) {
    low = Math.min(low, -reach);
    high = Math.max(high, reach);
  }
  if (low >= 0 && low < 0.5 * high) low = 0;
  const pad = 0.06 * (high - low) || Math.max(1e-9, Math.abs(high) * 0.1);
  return [low === 0 ? 0 : low - pad, high + pad];
}

/** A CSS colour with less weight. */
function tint(colour: string, alpha: number): string {
  return alpha === 1 ? colour : `${colour}${Math.round(255 * alpha).toString(16).padStart(2, "0")}`;
}

function shortNumber(v: number): string {
  const size = Math.abs(v);
  if (size >= 1e6) return `${Number((v / 1e6).toFixed(2))}M`;
  if (size >= 1e4) return `${Number((v / 1e3).toFixed(2))}k`;
  return size > 0 && size < 1e-3 ? v.toExponential(1) : String(Number(v.toFixed(5)));
}
