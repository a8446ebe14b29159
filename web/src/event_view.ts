// The sensor's image: events in the colour of their line over the frame, if there is one, the projected 3D lines over them.
import type {WindowEvents} from "./event_store";
import {projectSegment, type Pose, type Vec3} from "./maths";
import type {CameraModel, LineTable} from "./types";

const kGround = "#14161b", kNoLine = "#70747c", kLine = "#ffffff", kOutline = "#000000";

/** A colour at three quarters of its light: events of negative polarity. */
function dimmed(colour: string): string {
  return `#${[1, 3, 5].map(i => Math.round(0.75 * parseInt(colour.slice(i, i + 2), 16)).toString(16).padStart(2, "0")).join("")}`;
}

export class EventView {
  readonly canvas: HTMLCanvasElement;
  showLines = true;
  private readonly context: CanvasRenderingContext2D | null;
  private readonly scale: number;
  private readonly colours: [string, string][];

  constructor(private readonly camera: CameraModel, palette: string[]) {
    this.canvas = document.createElement("canvas");
    // Large enough that a pixel of the sensor can be seen, small enough to draw at each move of the slider.
    this.scale = Math.max(1, Math.round(960 / camera.width));
    this.canvas.width = camera.width * this.scale;
    this.canvas.height = camera.height * this.scale;
    this.canvas.className = "events";
    this.canvas.setAttribute("role", "img");
    this.context = this.canvas.getContext("2d");
    this.colours = [...palette, kNoLine].map(colour => [dimmed(colour), colour]);
  }

  /** `lines`: rows of the table that are in sight. Returns how many of them lie in the image. */
  draw(events: WindowEvents | null, table: LineTable, lines: Iterable<number>, pose: Pose | null, frame: CanvasImageSource | null = null): number {
    const c = this.context;
    if (!c) return 0;
    c.fillStyle = kGround;
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (frame) {
      c.globalAlpha = 0.55;
      c.drawImage(frame, 0, 0, this.canvas.width, this.canvas.height);
      c.globalAlpha = 1;
    }
    if (events) this.drawEvents(c, events);
    return pose && this.showLines ? this.drawLines(c, table, lines, pose) : 0;
  }

  private drawEvents(c: CanvasRenderingContext2D, {groups, x, y, positive}: WindowEvents): void {
    // Those of no line first, beneath the others.
    for (const group of [...groups].sort((a, b) => Math.sign(a.colour) - Math.sign(b.colour))) {
      const colour = this.colours[group.colour < 0 ? this.colours.length - 1 : group.colour] ?? [kNoLine, kNoLine];
      for (const polarity of [0, 1]) {
        c.fillStyle = colour[polarity]!;
        for (let i = group.begin; i < group.end; ++i)
          if (positive[i] === polarity) c.fillRect(Math.round(x[i]! * this.scale), Math.round(y[i]! * this.scale), this.scale, this.scale);
      }
    }
  }

  private drawLines(c: CanvasRenderingContext2D, table: LineTable, lines: Iterable<number>, pose: Pose): number {
    const at = (px: number): number => this.scale * (px + 0.5);
    const shown: [number[], string][] = [];
    for (const i of lines) {
      const ends = projectSegment(this.camera, pose, point(table.a, i), point(table.b, i));
      if (ends) shown.push([ends.map(at), this.colours[table.colour[i]!]?.[1] ?? kLine]);
    }
    const unit = this.canvas.width / 720;
    c.lineCap = "round";
    for (const [width, colour] of [[4 * unit, kOutline], [1.8 * unit, kLine]] as const) {
      c.beginPath();
      for (const [[x0, y0, x1, y1]] of shown) { c.moveTo(x0!, y0!); c.lineTo(x1!, y1!); }
      c.lineWidth = width;
      c.strokeStyle = colour;
      c.stroke();
    }
    for (const [[x0, y0, x1, y1], colour] of shown)
      for (const [px, py] of [[x0!, y0!], [x1!, y1!]] as const)
        for (const [radius, fill] of [[4.6, kOutline], [3.8, kLine], [2.6, colour]] as const) {
          c.beginPath();
          c.arc(px, py, radius * unit, 0, 2 * Math.PI);
          c.fillStyle = fill;
          c.fill();
        }
    return shown.length;
  }
}

export function point(values: number[], i: number): Vec3 { return [values[3 * i]!, values[3 * i + 1]!, values[3 * i + 2]!]; }
