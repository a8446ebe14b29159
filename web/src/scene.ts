// The 3D view: paths, lines, the camera's frustum; z is up. Drawn only when something has changed.
import {
  BufferGeometry, Color, Float32BufferAttribute, GridHelper, LineBasicMaterial, LineSegments, MathUtils, PerspectiveCamera,
  Quaternion, Scene as World, Spherical, Vector3, WebGLRenderer,
} from "three";
import {OrbitControls} from "three/examples/jsm/controls/OrbitControls.js";
import {Line2} from "three/examples/jsm/lines/Line2.js";
import {LineGeometry} from "three/examples/jsm/lines/LineGeometry.js";
import {LineMaterial} from "three/examples/jsm/lines/LineMaterial.js";
import {LineSegments2} from "three/examples/jsm/lines/LineSegments2.js";
import {LineSegmentsGeometry} from "three/examples/jsm/lines/LineSegmentsGeometry.js";
import {niceStep, type Pose, type Vec3} from "./maths";
import {colours, onTheme} from "./theme";
import type {CameraModel, Path} from "./types";

export interface Box {
  low: Vec3;
  high: Vec3;
}

export interface PathStyle {
  width: number;
  /** Red, green, blue in [0, 1] of pose i. */
  colour: (i: number) => [number, number, number];
  dashed?: boolean;
  /** What lies after the time that is set is drawn paler. */
  past?: boolean;
}

export type View = "all" | "path" | "top" | "side" | "camera";

interface DrawnPath {
  t: number[];
  line: Line2;
  behind: Line2 | null;
}

const kFov = 45;  // [deg]

export class Scene {
  readonly canvas: HTMLCanvasElement;
  private readonly renderer: WebGLRenderer;
  private readonly world = new World();
  private readonly eye = new PerspectiveCamera(kFov, 1, 0.01, 1000);
  private readonly controls: OrbitControls;
  private readonly paths = new Map<string, DrawnPath>();
  private readonly hidden = new Set<string>();
  private map: LineSegments2 | null = null;
  private sight: LineSegments2 | null = null;
  private frustum: LineSegments2;
  private grid: GridHelper | null = null;
  private axes: LineSegments | null = null;
  private pose: Pose | null = null;
  private throughCamera = false;
  private box: Box = {low: [-1, -1, -1], high: [1, 1, 1]};
  private pathBox: Box | null = null;
  private pending = false;
  /** Side of a square of the grid [m]. */
  step = 1;

  /** Throws where there is no WebGL. */
  constructor(private readonly host: HTMLElement, private readonly model: CameraModel | null, label: string) {
    this.renderer = new WebGLRenderer({antialias: true, alpha: true, preserveDrawingBuffer: true});
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${label} Arrow keys turn, with shift they move; plus and minus zoom; Home shows all.`);
    this.canvas.className = "scene";
    host.append(this.canvas);
    this.eye.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.eye, this.canvas);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("start", () => { this.throughCamera = false; this.eye.up.set(0, 0, 1); });
    this.controls.addEventListener("change", () => { this.render(); });
    this.frustum = segments(2.5, 1);
    this.frustum.renderOrder = 3;
    this.world.add(this.frustum);
    this.canvas.addEventListener("keydown", event => { this.onKey(event); });
    onTheme(() => { this.colour(); });
    new ResizeObserver(() => { this.resize(); }).observe(host);
    this.resize();
  }

  /** Draws a path in place of the one of this name. */
  setPath(name: string, path: Path, style: PathStyle): void {
    this.removePath(name);
    if (path.t.length < 2) return;
    const tints = path.t.flatMap((_, i) => style.colour(i));
    const make = (opacity: number, width: number): Line2 => {
      const geometry = new LineGeometry();
      geometry.setPositions(path.p);
      geometry.setColors(tints);
      const material = new LineMaterial({linewidth: width, vertexColors: true, transparent: opacity < 1, opacity,
        dashed: style.dashed ?? false, dashSize: 0.6 * this.step / 5, gapSize: 0.4 * this.step / 5});
      const line = new Line2(geometry, material);
      if (style.dashed) line.computeLineDistances();
      line.visible = !this.hidden.has(name);
      this.world.add(line);
      return line;
    };
    const behind = style.past ? make(0.3, style.width) : null, line = make(1, style.width);
    line.renderOrder = 2;
    this.paths.set(name, {t: path.t, line, behind});
    this.render();
  }

  removePath(name: string): void {
    const old = this.paths.get(name);
    for (const line of [old?.line, old?.behind]) {
      if (!line) continue;
      this.world.remove(line);
      line.geometry.dispose();
      line.material.dispose();
    }
    this.paths.delete(name);
  }

  /** Segments: six numbers each, and three of colour for each end. */
  setMap(positions: number[], tints: number[]): void { this.map = this.replace(this.map, positions, tints, 1.6, 1); }

  /** The lines in sight, drawn thicker over the others. */
  setSight(positions: number[], tints: number[]): void { this.sight = this.replace(this.sight, positions, tints, 3.5, 2); }

  show(name: string, on: boolean): void {
    if (on) this.hidden.delete(name); else this.hidden.add(name);
    const path = this.paths.get(name);
    for (const line of [path?.line, path?.behind]) if (line) line.visible = on;
    if (name === "map" && this.map) this.map.visible = on;
    if (name === "sight" && this.sight) this.sight.visible = on;
    this.render();
  }

  /** Splits past from future. */
  setTime(time: number): void {
    for (const {t, line, behind} of this.paths.values()) {
      if (!behind) continue;
      let count = 0;
      while (count + 1 < t.length && t[count + 1]! <= time + 1e-4) ++count;
      line.geometry.instanceCount = count;
    }
    this.render();
  }

  setPose(pose: Pose | null): void {
    this.pose = pose;
    this.frustum.visible = pose !== null && !this.throughCamera;
    if (pose) {
      this.frustum.position.set(...pose.p);
      this.frustum.quaternion.set(...pose.q);
      if (this.throughCamera) this.goIntoCamera(pose);
    }
    this.render();
  }

  /** What the views show. The grid lies beneath `all`. */
  setBox(all: Box, path: Box | null): void {
    this.box = all;
    this.pathBox = path;
    this.step = niceStep(radius(all) / 5);
    this.drawFrustum();
    this.colour();
  }

  look(view: View): void {
    this.throughCamera = view === "camera" && this.pose !== null;
    this.frustum.visible = this.pose !== null && !this.throughCamera;
    if (this.throughCamera && this.pose) { this.goIntoCamera(this.pose); this.render(); return; }
    const {low, high} = view === "path" && this.pathBox ? this.pathBox : this.box;
    const centre = new Vector3((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2);
    const reach = Math.max(0.03, radius({low, high}));
    const narrow = Math.min(1, this.eye.aspect);
    const distance = 1.15 * reach / Math.sin(MathUtils.degToRad(kFov / 2)) / narrow ** 0.7;
    const sight = view === "top" ? new Vector3(0, -1e-3, 1) : view === "side" ? new Vector3(0, -1, 0) : new Vector3(-0.55, -0.7, 0.5);
    this.eye.up.set(0, 0, 1);
    this.eye.fov = kFov;
    this.eye.position.copy(centre).addScaledVector(sight.normalize(), distance);
    this.controls.target.copy(centre);
    this.controls.update();
    this.render();
  }

  render(): void {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      const distance = this.throughCamera ? radius(this.box) : this.eye.position.distanceTo(this.controls.target);
      this.eye.near = this.throughCamera ? 0.02 : Math.max(1e-3, distance / 200);
      this.eye.far = 100 * Math.max(distance, radius(this.box));
      this.eye.updateProjectionMatrix();
      this.renderer.render(this.world, this.eye);
    });
  }

  private replace(old: LineSegments2 | null, positions: number[], tints: number[], width: number, order: number): LineSegments2 | null {
    const visible = old?.visible ?? true;
    if (old) {
      this.world.remove(old);
      old.geometry.dispose();
      old.material.dispose();
    }
    this.render();
    if (!positions.length) return null;
    const made = segments(width, 1);
    made.geometry.setPositions(positions);
    made.geometry.setColors(tints);
    made.material.vertexColors = true;
    made.renderOrder = order;
    made.visible = visible;
    this.world.add(made);
    return made;
  }

  private goIntoCamera({p, q}: Pose): void {
    this.eye.position.set(...p);
    // Ours looks along z with y down, three's along -z with y up.
    this.eye.quaternion.set(...q).multiply(new Quaternion(1, 0, 0, 0));
    const {width, height, fx, fy} = this.model ?? kSomeCamera;
    const tangent = Math.max(height / 2 / fy, width / 2 / fx / this.eye.aspect);
    this.eye.fov = 2 * MathUtils.radToDeg(Math.atan(1.04 * tangent));
  }

  private drawFrustum(): void {
    const {width, height, fx, fy, cx, cy} = this.model ?? kSomeCamera;
    const depth = 0.13 * radius(this.pathBox && radius(this.pathBox) > 0.2 * radius(this.box) ? this.pathBox : this.box);
    const corner = (u: number, v: number): Vec3 => [(u - cx) / fx * depth, (v - cy) / fy * depth, depth];
    const corners = [corner(-0.5, -0.5), corner(width - 0.5, -0.5), corner(width - 0.5, height - 0.5), corner(-0.5, height - 0.5)];
    const edges = corners.flatMap((a, i) => [[0, 0, 0], a, a, corners[(i + 1) % 4]!]);
    // A roof over the upper edge tells up from down.
    const roof = corner(width / 2, -0.25 * height);
    edges.push(corners[0]!, roof, roof, corners[1]!);
    this.frustum.geometry.setPositions(edges.flat());
  }

  /** What depends on the theme and on the box: grid and axes. */
  private colour(): void {
    const theme = colours(), {low, high} = this.box;
    for (const old of [this.grid, this.axes]) if (old) { this.world.remove(old); old.geometry.dispose(); }
    const size = 2 * Math.ceil(Math.max(high[0] - low[0], high[1] - low[1]) / this.step / 2 + 0.5);
    this.grid = new GridHelper(size * this.step, size, theme.grid, theme.grid);
    this.grid.rotation.x = Math.PI / 2;
    const middle = (k: 0 | 1): number => Math.round((low[k] + high[k]) / 2 / this.step) * this.step;
    this.grid.position.set(middle(0), middle(1), low[2]);
    const ends = new BufferGeometry(), tints = [0, 1, 2].flatMap(k => { const c = new Color(theme.series[k]); return [c.r, c.g, c.b, c.r, c.g, c.b]; });
    ends.setAttribute("position", new Float32BufferAttribute([0, 0, 0, this.step, 0, 0, 0, 0, 0, 0, this.step, 0, 0, 0, 0, 0, 0, this.step], 3));
    ends.setAttribute("color", new Float32BufferAttribute(tints, 3));
    this.axes = new LineSegments(ends, new LineBasicMaterial({vertexColors: true}));
    this.world.add(this.grid, this.axes);
    this.frustum.material.color.set(theme.accent);
    this.render();
  }

  private resize(): void {
    const {clientWidth: width, clientHeight: height} = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.eye.aspect = width / height;
    if (this.throughCamera && this.pose) this.goIntoCamera(this.pose);
    this.render();
  }

  private onKey(event: KeyboardEvent): void {
    const moves: Record<string, [number, number]> = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]};
    const move = moves[event.key];
    this.eye.up.set(0, 0, 1);
    if (move && event.shiftKey) this.pan(0.05 * move[0], 0.05 * move[1]);
    else if (move) this.orbit(0.12 * move[0], 0.12 * move[1], 1);
    else if (event.key === "+" || event.key === "=") this.orbit(0, 0, 1 / 1.15);
    else if (event.key === "-") this.orbit(0, 0, 1.15);
    else if (event.key === "Home") this.look("all");
    else return;
    event.preventDefault();
  }

  private orbit(azimuth: number, polar: number, factor: number): void {
    this.throughCamera = false;
    // three's spherical coordinates have y up.
    const offset = this.eye.position.clone().sub(this.controls.target);
    const around = new Spherical().setFromVector3(new Vector3(offset.x, offset.z, -offset.y));
    around.theta += azimuth;
    around.phi = Math.min(Math.PI - 0.01, Math.max(0.01, around.phi + polar));
    around.radius *= factor;
    const turned = new Vector3().setFromSpherical(around);
    this.eye.position.set(turned.x, -turned.z, turned.y).add(this.controls.target);
    this.controls.update();
    this.render();
  }

  private pan(dx: number, dy: number): void {
    const distance = this.eye.position.distanceTo(this.controls.target);
    const right = new Vector3().setFromMatrixColumn(this.eye.matrix, 0), up = new Vector3().setFromMatrixColumn(this.eye.matrix, 1);
    const shift = right.multiplyScalar(dx * distance).addScaledVector(up, -dy * distance);
    this.eye.position.add(shift);
    this.controls.target.add(shift);
    this.controls.update();
    this.render();
  }
}

const kSomeCamera: CameraModel = {width: 240, height: 180, fx: 200, fy: 200, cx: 120, cy: 90};

function segments(width: number, opacity: number): LineSegments2 {
  return new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({linewidth: width, transparent: opacity < 1, opacity}));
}

function radius({low, high}: Box): number {
  return 0.5 * Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) || 1;
}

/** Box of points, three numbers each; null without any. Shares of the extremes can be left out. */
export function boxOf(values: readonly number[], leaveOut = 0): Box | null {
  if (!values.length) return null;
  const low: Vec3 = [0, 0, 0], high: Vec3 = [0, 0, 0];
  for (const k of [0, 1, 2] as const) {
    const sorted = values.filter((_, i) => i % 3 === k).sort((a, b) => a - b);
    low[k] = sorted[Math.round(leaveOut * (sorted.length - 1))]!;
    high[k] = sorted[Math.round((1 - leaveOut) * (sorted.length - 1))]!;
  }
  return {low, high};
}

export function joinBoxes(boxes: (Box | null)[]): Box {
  const some = boxes.filter(box => box !== null);
  if (!some.length) return {low: [-1, -1, -1], high: [1, 1, 1]};
  return {low: [0, 1, 2].map(k => Math.min(...some.map(box => box.low[k]!))) as Vec3,
    high: [0, 1, 2].map(k => Math.max(...some.map(box => box.high[k]!))) as Vec3};
}
