// The 3D view: orbit camera over world axes (z up), drawn on a plain canvas.
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];

// Columns of the rotation matrix of a unit quaternion (x, y, z, w).
function axesOf([x, y, z, w]) {
  return [[1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)]];
}

// Pose of a trajectory at a time, between its two neighbours; null where there is none.
function poseAt({t, p, q}, time) {
  if (!t.length) return null;
  let low = 0, high = t.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle] <= time) low = middle; else high = middle;
  }
  const s = t[high] > t[low] ? Math.min(1, Math.max(0, (time - t[low]) / (t[high] - t[low]))) : 0;
  const mix = (values, n, sign) => Array.from({length: n}, (_, k) =>
    (1 - s) * values[low * n + k] + s * sign * values[high * n + k]);
  let same = 0;
  for (let k = 0; k < 4; ++k) same += q[low * 4 + k] * q[high * 4 + k];
  const rotation = mix(q, 4, same < 0 ? -1 : 1), norm = Math.hypot(...rotation) || 1;
  return {p: mix(p, 3, 1), q: rotation.map(v => v / norm)};
}

const kViridis = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
// Share s in [0, 1] of the colours that can be told from the page's ground.
function timeColour(s, dark) {
  const at = 4 * (dark ? 0.25 + 0.75 * s : 0.87 * s), k = Math.min(3, Math.floor(at)), f = at - k;
  return `rgb(${kViridis[k].map((v, i) => Math.round(v + f * (kViridis[k + 1][i] - v))).join(",")})`;
}

// 1, 2 or 5 times a power of ten, at least x.
function niceStep(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return [1, 2, 5, 10].map(m => m * power).find(step => step >= x * (1 - 1e-9));
}

function quantile(sorted, s) { return sorted[Math.round(s * (sorted.length - 1))]; }

class View3D {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.context = canvas.getContext("2d");
    this.show = {smoothed: true, causal: false, truth: true, lines: true, active: false};
    this.lineColour = "windows";
    this.azimuth = -2.2;
    this.elevation = 0.55;
    this.throughCamera = false;
    this.measure();
    const end = scene.smoothed.t.length ? scene.smoothed.t.at(-1) : 0;
    this.time = end;
    this.endTime = end || 1;
    this.mostWindows = Math.max(2, ...scene.lines.map(line => line.windows));
    this.listen();
    new ResizeObserver(() => { this.fitOnce(); this.draw(); }).observe(canvas);
  }

  // Box of everything but stray lines, and the grid beneath it.
  measure() {
    const low = [], high = [], often = this.scene.lines.filter(line => line.windows > 2);
    const lines = often.length > 10 ? often : this.scene.lines;
    for (let k = 0; k < 3; ++k) {
      const ends = lines.flatMap(line => [line.a[k], line.b[k]]).sort((a, b) => a - b);
      const path = ["smoothed", "truth"].flatMap(name => this.scene[name].p.filter((_, i) => i % 3 === k));
      const values = ends.length ? [quantile(ends, 0.05), quantile(ends, 0.95)] : [];
      for (const v of path) values.push(v);
      low[k] = values.reduce((a, b) => Math.min(a, b), Infinity);
      high[k] = values.reduce((a, b) => Math.max(a, b), -Infinity);
      if (!(low[k] <= high[k])) { low[k] = -1; high[k] = 1; }
    }
    this.low = low;
    this.high = high;
    this.radius = Math.max(0.05, 0.5 * Math.hypot(...sub(high, low)));
    this.step = niceStep(this.radius / 6);
  }

  fitOnce() { if (!this.distance) this.fit(); }

  fit([low, high] = [this.low, this.high]) {
    this.target = low.map((v, k) => 0.5 * (v + high[k]));
    const {clientWidth: w, clientHeight: h} = this.canvas;
    this.distance = Math.max(0.03, 0.5 * Math.hypot(...sub(high, low))) * 1.7 * Math.max(1, h / Math.max(1, w) * 1.7);
    this.throughCamera = false;
  }

  look(name) {
    if (name === "fit") { this.azimuth = -2.2; this.elevation = 0.55; }
    if (name === "top") { this.azimuth = -Math.PI / 2; this.elevation = Math.PI / 2 - 1e-3; }
    if (name === "side") { this.azimuth = -Math.PI / 2; this.elevation = 0; }
    this.fit(name === "path" ? this.pathBox() : undefined);
    this.throughCamera = name === "camera" && this.scene.smoothed.t.length > 0;
    this.draw();
  }

  pathBox() {
    const {t, p} = this.scene.smoothed, low = [Infinity, Infinity, Infinity], high = low.map(v => -v);
    p.forEach((v, i) => { low[i % 3] = Math.min(low[i % 3], v); high[i % 3] = Math.max(high[i % 3], v); });
    return t.length ? [low, high] : undefined;
  }

  setTime(time) { this.time = time; this.draw(); }

  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => { this.pending = false; this.paint(); });
  }

  // Eye, axes of sight and focal length, for the orbit or through the estimated camera.
  setUpSight() {
    const w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    this.centre = [w / 2, h / 2];
    const pose = this.throughCamera ? poseAt(this.scene.smoothed, this.time) : null;
    if (pose) {
      const [x, y, z] = axesOf(pose.q);
      Object.assign(this, {eye: pose.p, right: x, up: y.map(v => -v), ahead: z, near: 0.02});
      const [left, top, right, bottom] = this.scene.frustum;
      this.focal = 0.94 * Math.min(w / (right - left), h / (bottom - top));
      this.centre = [w / 2 - this.focal * (left + right) / 2, h / 2 - this.focal * (top + bottom) / 2];
      return;
    }
    const ce = Math.cos(this.elevation);
    const back = [ce * Math.cos(this.azimuth), ce * Math.sin(this.azimuth), Math.sin(this.elevation)];
    this.eye = along(this.target, this.distance, back);
    this.ahead = back.map(v => -v);
    this.right = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    this.up = cross(this.right, this.ahead);
    this.near = 0.02 * this.distance;
    this.focal = h;
  }

  // Point in the axes of sight: right, up, ahead.
  seen(x) {
    const d = sub(x, this.eye);
    return [dot(this.right, d), dot(this.up, d), dot(this.ahead, d)];
  }
  onScreen(s) {
    return [this.centre[0] + this.focal * s[0] / s[2], this.centre[1] - this.focal * s[1] / s[2]];
  }
  // Adds the part of a segment in front of the eye to the current path.
  trace(sa, sb) {
    if (sa[2] < this.near && sb[2] < this.near) return;
    const cut = (s, other) => s[2] >= this.near ? s
      : along(s, (this.near - s[2]) / (other[2] - s[2]), sub(other, s));
    const a = this.onScreen(cut(sa, sb)), b = this.onScreen(cut(sb, sa));
    this.context.moveTo(a[0], a[1]);
    this.context.lineTo(b[0], b[1]);
  }
  strokeSegments(segments, style, width, alpha = 1) {
    const c = this.context;
    c.beginPath();
    for (const [a, b] of segments) this.trace(this.seen(a), this.seen(b));
    c.strokeStyle = style;
    c.lineWidth = width;
    c.globalAlpha = alpha;
    c.stroke();
    c.globalAlpha = 1;
  }

  paint() {
    const c = this.context, w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    if (!w || !h) return;
    this.fitOnce();
    sizeCanvas(this.canvas);
    c.clearRect(0, 0, w, h);
    c.lineCap = c.lineJoin = "round";
    this.colours = pageColours();
    this.setUpSight();
    this.paintGround();
    if (this.show.lines) this.paintLines();
    if (this.show.truth) this.paintPath(this.scene.truth, {colour: this.colours.truth, width: 1.6, dash: [6, 4]});
    if (this.show.causal) this.paintPath(this.scene.causal, {colour: this.colours.causal, width: 1.2});
    if (this.show.smoothed) this.paintPath(this.scene.smoothed, {width: 2.6});
    this.paintFrustum();
  }

  paintGround() {
    const {low, high, step} = this;
    const from = [0, 1].map(k => Math.floor(low[k] / step - 0.5)), to = [0, 1].map(k => Math.ceil(high[k] / step + 0.5));
    const z = low[2], segments = [];
    // In pieces, so that what lies behind the eye is cut finely.
    for (let i = from[0]; i <= to[0]; ++i)
      for (let j = from[1]; j <= to[1]; ++j) {
        const x = i * step, y = j * step;
        if (i < to[0]) segments.push([[x, y, z], [x + step, y, z]]);
        if (j < to[1]) segments.push([[x, y, z], [x, y + step, z]]);
      }
    this.strokeSegments(segments, this.colours.grid, 1);
    const c = this.context;
    ["x", "y", "z"].forEach((name, k) => {
      const end = [0, 0, 0];
      end[k] = step;
      this.strokeSegments([[[0, 0, 0], end]], this.colours.series[k], 2);
      const s = this.seen(end.map(v => 1.15 * v));
      if (s[2] < this.near) return;
      c.fillStyle = this.colours.series[k];
      c.font = "12px system-ui, sans-serif";
      c.fillText(name, ...this.onScreen(s));
    });
  }

  paintLines() {
    const groups = new Map();
    for (const line of this.scene.lines) {
      if (this.show.active && !(line.first <= this.time && this.time <= line.last)) continue;
      const style = this.styleOf(line);
      if (!groups.has(style)) groups.set(style, []);
      groups.get(style).push([line.a, line.b]);
    }
    for (const [style, segments] of [...groups].sort()) {
      const [, alpha, colour] = style.split("|");
      this.strokeSegments(segments, colour, 1.5, Number(alpha));
    }
  }
  // "order|alpha|colour": few enough styles to draw each in one stroke.
  styleOf(line) {
    if (this.lineColour === "id") return `0|0.95|${line.colour}`;
    if (this.lineColour === "age")
      return `0|0.9|${timeColour(Math.round(16 * Math.min(1, Math.max(0, line.first / this.endTime))) / 16, this.colours.dark)}`;
    const share = Math.round(10 * Math.log(Math.max(1, line.windows)) / Math.log(this.mostWindows));
    return `${String(share).padStart(2, "0")}|${(0.25 + 0.065 * share).toFixed(3)}|${this.colours.ink}`;
  }

  // Colour by time unless one is given; paler after the slider's time.
  paintPath({t, p}, {colour, width, dash = []}) {
    const c = this.context, bins = colour ? 1 : 48;
    const points = t.map((_, i) => this.seen([p[3 * i], p[3 * i + 1], p[3 * i + 2]]));
    c.lineWidth = width;
    c.setLineDash(dash);
    for (const past of [false, true])
      for (let bin = 0; bin < bins; ++bin) {
        const from = Math.floor(bin * (t.length - 1) / bins), to = Math.floor((bin + 1) * (t.length - 1) / bins);
        c.beginPath();
        let last = null;
        for (let i = from; i < to; ++i) {
          if ((t[i + 1] <= this.time + 1e-4) !== past) continue;
          if (last === i && points[i][2] >= this.near && points[i + 1][2] >= this.near)
            c.lineTo(...this.onScreen(points[i + 1]));
          else this.trace(points[i], points[i + 1]);
          last = i + 1;
        }
        c.strokeStyle = colour || timeColour((bin + 0.5) / bins, this.colours.dark);
        c.globalAlpha = past ? 1 : 0.28;
        c.stroke();
      }
    c.globalAlpha = 1;
    c.setLineDash([]);
  }

  paintFrustum() {
    const pose = poseAt(this.scene.smoothed, this.time);
    if (!pose) return;
    const [x, y, z] = axesOf(pose.q), [left, top, right, bottom] = this.scene.frustum, depth = Math.min(0.12 * this.radius, 0.09 * this.distance);
    if (this.throughCamera) {
      const [u, v] = this.centre, f = this.focal;
      this.context.strokeStyle = this.colours.accent;
      this.context.lineWidth = 1.5;
      this.context.strokeRect(u + f * left, v + f * top, f * (right - left), f * (bottom - top));
      return;
    }
    const corner = (sx, sy) => along(along(along(pose.p, depth, z), sx * depth, x), sy * depth, y);
    const corners = [corner(left, top), corner(right, top), corner(right, bottom), corner(left, bottom)];
    const edges = corners.flatMap((a, i) => [[pose.p, a], [a, corners[(i + 1) % 4]]]);
    // A roof over the upper edge tells up from down.
    const roof = corner(0.5 * (left + right), 1.35 * top);
    edges.push([corners[0], roof], [roof, corners[1]]);
    this.strokeSegments(edges, this.colours.ground, 4);
    this.strokeSegments(edges, this.colours.accent, 2);
  }

  listen() {
    const canvas = this.canvas, fingers = new Map();
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    const release = event => fingers.delete(event.pointerId);
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("pointermove", event => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
      if (fingers.size > 1) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const spread = a => Math.hypot(a[0] - other[0], a[1] - other[1]) || 1;
        this.zoom(spread(before) / spread(now));
        this.pan(0.5 * dx, 0.5 * dy);
      } else if (event.shiftKey || event.buttons & 6) this.pan(dx, dy);
      else this.orbit(dx, dy);
      fingers.set(event.pointerId, now);
    });
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      this.zoom(Math.exp(Math.max(-0.5, Math.min(0.5, event.deltaY * 0.0015))));
    }, {passive: false});
    canvas.addEventListener("keydown", event => {
      const arrows = {ArrowLeft: [-24, 0], ArrowRight: [24, 0], ArrowUp: [0, -24], ArrowDown: [0, 24]};
      if (event.key in arrows) this[event.shiftKey ? "pan" : "orbit"](...arrows[event.key]);
      else if (event.key === "+" || event.key === "=") this.zoom(1 / 1.15);
      else if (event.key === "-") this.zoom(1.15);
      else if (event.key === "Home") this.look("fit");
      else return;
      event.preventDefault();
    });
  }
  orbit(dx, dy) {
    this.throughCamera = false;
    this.azimuth -= 0.008 * dx;
    this.elevation = Math.max(-1.57, Math.min(1.57, this.elevation + 0.008 * dy));
    this.draw();
  }
  pan(dx, dy) {
    if (this.throughCamera) return;
    const metres = this.distance / this.focal;
    this.target = along(along(this.target, -dx * metres, this.right), dy * metres, this.up);
    this.draw();
  }
  zoom(factor) {
    if (this.throughCamera) return;
    this.distance = Math.max(1e-3 * this.radius, Math.min(50 * this.radius, this.distance * factor));
    this.draw();
  }
}
