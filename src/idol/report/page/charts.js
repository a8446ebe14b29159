// Curves against time with one shared time axis and cursor; histogram and bars.
const kFont = "11.5px system-ui, -apple-system, 'DejaVu Sans', sans-serif";
const kMargin = {left: 54, right: 10, top: 8, bottom: 22};

function isDark() { return matchMedia("(prefers-color-scheme: dark)").matches; }

// The style sheet's colours, for canvases.
function pageColours() {
  const style = getComputedStyle(document.documentElement), get = name => style.getPropertyValue("--" + name).trim();
  return {dark: isDark(), ink: get("ink"), muted: get("muted"), grid: get("grid"), rule: get("rule"),
    ground: get("card"), accent: get("accent"), truth: get("truth"), causal: get("causal"),
    series: [0, 1, 2].map(i => get("series-" + i))};
}

// Backing store in device pixels, drawing in CSS pixels.
function sizeCanvas(canvas) {
  const ratio = devicePixelRatio || 1, w = Math.round(canvas.clientWidth * ratio), h = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}

// Round values in [low, high], about `count` of them, and how to print them.
function ticks(low, high, count) {
  const step = niceStep((high - low) / count), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const values = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i) values.push(i * step);
  const large = Math.max(Math.abs(low), Math.abs(high));
  const text = v => large >= 1e6 ? `${+(v / 1e6).toFixed(2)}M` : large >= 1e4 ? `${+(v / 1e3).toFixed(2)}k`
    : large < 1e-3 ? v.toExponential(1) : v.toFixed(Math.min(digits, 6));
  return values.map(value => ({value, text: text(value)}));
}

// Index of the last entry not after `time`.
function before(t, time) {
  let low = 0, high = t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] <= time) low = middle + 1; else high = middle;
  }
  return low - 1;
}

class TimeCharts {
  // `pick(time)` is called when a time is chosen by a click.
  constructor(host, panels, pick) {
    this.pick = pick;
    this.cursor = null;
    this.time = null;
    const times = panels.flatMap(panel => panel.series.map(s => [s.t[0], s.t.at(-1)])).flat();
    this.all = [Math.min(...times), Math.max(...times)];
    if (this.all[0] === this.all[1]) this.all[1] += 1;
    this.span = this.all;
    this.panels = panels.map(panel => this.addPanel(host, panel));
    new ResizeObserver(() => this.redraw()).observe(host);
  }

  addPanel(host, panel) {
    const canvas = el("canvas"), legend = el("div", {class: "legend"}), names = new Map();
    for (const s of panel.series) {
      if (!names.has(s.name)) names.set(s.name, []);
      names.get(s.name).push(s);
    }
    const truth = panel.series.some(s => s.style === "truth");
    const entries = [...names].map(([name, series]) => {
      const value = el("b"), swatch = el("span", {class: `swatch ${series[0].style}`});
      legend.append(el("span", {}, swatch, name + " ", value));
      return {series, value, swatch};
    });
    if (truth) legend.append(el("span", {class: "note"}, "wide and pale: ground truth"));
    host.append(el("figure", {class: "card panel"}, el("div", {class: "panel-head"}, el("span", {}, panel.title),
      el("span", {class: "unit"}, panel.unit)), legend, canvas));
    const view = {...panel, canvas, entries, base: document.createElement("canvas"), note: legend.querySelector(".note")};
    this.listen(view);
    return view;
  }

  timeOf(view, event) {
    const box = view.canvas.getBoundingClientRect(), width = box.width - kMargin.left - kMargin.right;
    const share = (event.clientX - box.left - kMargin.left) / width;
    return this.span[0] + Math.min(1, Math.max(0, share)) * (this.span[1] - this.span[0]);
  }
  listen(view) {
    let start = null;
    view.canvas.addEventListener("pointerdown", event => {
      start = {time: this.timeOf(view, event), x: event.clientX};
      if (event.pointerType === "mouse") view.canvas.setPointerCapture(event.pointerId);
    });
    view.canvas.addEventListener("pointermove", event => {
      this.cursor = this.timeOf(view, event);
      const wide = start && event.pointerType === "mouse" && Math.abs(event.clientX - start.x) > 6;
      this.selection = wide ? [start.time, this.cursor].sort((a, b) => a - b) : null;
      this.refresh();
    });
    view.canvas.addEventListener("pointerup", event => {
      if (this.selection && this.selection[1] > this.selection[0]) this.zoom(this.selection);
      else if (start) this.pick(this.timeOf(view, event));
      start = this.selection = null;
    });
    view.canvas.addEventListener("pointerleave", () => {
      if (start && this.selection) return;
      this.cursor = start = null;
      this.refresh();
    });
    view.canvas.addEventListener("pointercancel", () => { this.cursor = this.selection = start = null; this.refresh(); });
    view.canvas.addEventListener("dblclick", () => this.zoom(this.all));
  }
  zoom(span) { this.span = span; this.selection = null; this.redraw(); }
  setTime(time) { this.time = time; this.refresh(); }

  redraw() {
    const colours = pageColours();
    for (const view of this.panels) this.drawBase(view, colours);
    this.refresh();
  }
  // The cursor on top of what is drawn already, once a frame.
  refresh() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      const colours = pageColours();
      for (const view of this.panels) this.drawCursor(view, colours);
    });
  }

  // Smallest and largest value in the visible span.
  range(view) {
    let low = Infinity, high = -Infinity;
    for (const {t, y} of view.series) {
      const from = Math.max(0, before(t, this.span[0])), to = Math.min(t.length - 1, before(t, this.span[1]) + 1);
      for (let i = from; i <= to; ++i)
        if (y[i] !== null) { low = Math.min(low, y[i]); high = Math.max(high, y[i]); }
    }
    if (!(low <= high)) return [0, 1];
    if (low >= 0 && low < 0.5 * high) low = 0;
    const pad = 0.06 * (high - low) || Math.max(1e-9, Math.abs(high) * 0.1);
    return [low === 0 ? 0 : low - pad, high + pad];
  }

  drawBase(view, colours) {
    const {canvas} = view, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w) return;
    sizeCanvas(canvas);
    view.base.width = canvas.width;
    view.base.height = canvas.height;
    const c = view.base.getContext("2d"), ratio = canvas.width / w;
    c.scale(ratio, ratio);
    const [low, high] = this.range(view), [from, to] = this.span;
    const x = t => kMargin.left + (t - from) / (to - from) * (w - kMargin.left - kMargin.right);
    const y = v => h - kMargin.bottom - (v - low) / (high - low) * (h - kMargin.top - kMargin.bottom);
    Object.assign(view, {x, y});
    drawAxes(c, w, h, {x, y, xs: ticks(from, to, Math.max(2, w / 60)), ys: ticks(low, high, 6), unit: "s", colours});
    c.save();
    c.beginPath();
    c.rect(kMargin.left, 0, w - kMargin.left - kMargin.right, h - kMargin.bottom + 1);
    c.clip();
    c.lineJoin = "round";
    const order = s => s.style === "truth" ? 0 : s.style === "thin" || s.style === "dashed" ? 1 : 2;
    for (const s of [...view.series].sort((a, b) => order(a) - order(b))) this.drawSeries(c, s, view, colours);
    c.restore();
    for (const entry of view.entries) entry.swatch.style.borderTopColor = colours.series[entry.series[0].colour];
  }
  drawSeries(c, {t, y, style, colour}, view, colours) {
    c.beginPath();
    let drawing = false;
    const to = Math.min(t.length - 1, before(t, this.span[1]) + 1);
    for (let i = Math.max(0, before(t, this.span[0])); i <= to; ++i) {
      if (y[i] === null) { drawing = false; continue; }
      if (drawing) c.lineTo(view.x(t[i]), view.y(y[i])); else c.moveTo(view.x(t[i]), view.y(y[i]));
      drawing = true;
    }
    c.strokeStyle = colours.series[colour];
    c.globalAlpha = style === "truth" ? 0.3 : 1;
    c.lineWidth = {truth: 5, thin: 1, dashed: 1.2}[style] || 1.5;
    c.setLineDash(style === "dashed" ? [5, 4] : []);
    c.stroke();
    c.globalAlpha = 1;
    c.setLineDash([]);
  }

  drawCursor(view, colours) {
    const {canvas} = view, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w || !view.x || !view.base.width) return;
    const c = canvas.getContext("2d"), vertical = (time, style, dash) => {
      if (time === null || time < this.span[0] || time > this.span[1]) return;
      c.strokeStyle = style;
      c.setLineDash(dash);
      c.lineWidth = 1;
      c.beginPath();
      c.moveTo(view.x(time), kMargin.top);
      c.lineTo(view.x(time), h - kMargin.bottom);
      c.stroke();
      c.setLineDash([]);
    };
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.drawImage(view.base, 0, 0);
    c.scale(canvas.width / w, canvas.width / w);
    if (this.selection) {
      c.fillStyle = colours.accent;
      c.globalAlpha = 0.15;
      c.fillRect(view.x(this.selection[0]), kMargin.top, view.x(this.selection[1]) - view.x(this.selection[0]), h - kMargin.top - kMargin.bottom);
      c.globalAlpha = 1;
    }
    vertical(this.time, colours.accent, []);
    vertical(this.cursor, colours.muted, [3, 3]);
    for (const {series, value} of view.entries)
      value.textContent = this.cursor === null ? "" : series.map(s => this.valueText(s)).join(" / ");
    if (view.note) view.note.hidden = this.cursor !== null;  // leaves its place to the values
  }
  valueText({t, y}) {
    const i = before(t, this.cursor), next = Math.min(i + 1, t.length - 1);
    const near = i < 0 || Math.abs(t[next] - this.cursor) < Math.abs(t[i] - this.cursor) ? next : i;
    return y[near] === null ? "–" : String(+y[near].toPrecision(4));
  }
}

function drawAxes(c, w, h, {x, y, xs, ys, unit, colours}) {
  c.font = kFont;
  c.fillStyle = colours.muted;
  c.strokeStyle = colours.grid;
  c.lineWidth = 1;
  c.beginPath();
  c.textAlign = "right";
  c.textBaseline = "middle";
  for (const {value, text} of ys) {
    const at = Math.round(y(value)) + 0.5;
    c.moveTo(kMargin.left, at);
    c.lineTo(w - kMargin.right, at);
    c.fillText(text, kMargin.left - 7, at);
  }
  c.textAlign = "center";
  c.textBaseline = "top";
  xs.forEach(({value, text}, i) => {
    const at = Math.round(x(value)) + 0.5;
    c.moveTo(at, kMargin.top);
    c.lineTo(at, h - kMargin.bottom);
    const label = i === xs.length - 1 ? `${text} ${unit}` : text;
    c.fillText(label, Math.min(at, w - 4 - c.measureText(label).width / 2), h - kMargin.bottom + 6);
  });
  c.stroke();
}

function drawHistogram(canvas, {width, counts}) {
  const c = sizeCanvas(canvas), w = canvas.clientWidth, h = canvas.clientHeight, colours = pageColours();
  c.clearRect(0, 0, w, h);
  const most = Math.max(1, ...counts), end = counts.length * width;
  const x = v => kMargin.left + v / end * (w - kMargin.left - kMargin.right);
  const y = v => h - kMargin.bottom - v / (1.08 * most) * (h - kMargin.top - kMargin.bottom);
  const ys = ticks(0, 1.08 * most, 4).filter(tick => Number.isInteger(tick.value));
  drawAxes(c, w, h, {x, y, xs: ticks(0, end, Math.max(2, w / 60)), ys, unit: "s", colours});
  c.fillStyle = colours.series[2];
  counts.forEach((n, i) => {
    if (n) c.fillRect(x(i * width) + 1, y(n), Math.max(1, x((i + 1) * width) - x(i * width) - 2), y(0) - y(n));
  });
}

// Horizontal bars, longest first: [[name, seconds], ...].
function drawBars(canvas, bars) {
  canvas.style.height = `${14 + 30 * bars.length}px`;
  const c = sizeCanvas(canvas), w = canvas.clientWidth, h = canvas.clientHeight, colours = pageColours();
  c.clearRect(0, 0, w, h);
  c.font = kFont;
  const left = 12 + Math.max(...bars.map(([name]) => c.measureText(name).width)), room = Math.max(20, w - left - 118);
  const total = bars.reduce((sum, [, s]) => sum + s, 0) || 1, longest = Math.max(...bars.map(([, s]) => s)) || 1;
  c.textBaseline = "middle";
  bars.forEach(([name, seconds], i) => {
    const y = 8 + 30 * i, length = Math.max(1.5, seconds / longest * room);
    c.fillStyle = colours.muted;
    c.textAlign = "right";
    c.fillText(name, left - 8, y + 11);
    c.fillStyle = colours.series[2];
    c.fillRect(left, y, length, 22);
    c.fillStyle = colours.ink;
    c.textAlign = "left";
    c.fillText(`${figure(seconds)} s · ${(100 * seconds / total).toFixed(seconds / total < 0.1 ? 1 : 0)} %`, left + length + 8, y + 11);
  });
}
