// The lines of the map as the 3D view draws them.
import {Color} from "three";
import {point} from "./event_view";
import type {Scene} from "./scene";
import {colours, ramp} from "./theme";
import type {LineTable} from "./types";

export type LineColouring = "certainty" | "age" | "id";

const kSlack = 1e-3;  // stamps are rounded [s]

export class LineMap {
  private readonly mostWindows: number;
  private readonly newest: number;

  constructor(readonly table: LineTable, private readonly palette: string[]) {
    this.mostWindows = table.windows.reduce((a, b) => Math.max(a, b), 2);
    this.newest = table.first.reduce((a, b) => Math.max(a, b), 1e-3);
  }

  /** Rows of the lines that were tracked at a time. */
  inSight(time: number): number[] {
    const {first, last} = this.table;
    return first.flatMap((from, i) => from - kSlack <= time && time <= last[i]! + kSlack ? [i] : []);
  }

  draw(scene: Scene, by: LineColouring): void {
    const rows = this.table.id.map((_, i) => i);
    scene.setMap(this.positions(rows), this.tints(rows, by, 0.75));
  }

  drawInSight(scene: Scene, rows: number[]): void { scene.setSight(this.positions(rows), this.tints(rows, "id", 1)); }

  private positions(rows: number[]): number[] {
    return rows.flatMap(i => [...point(this.table.a, i), ...point(this.table.b, i)]);
  }

  /** Weaker ones nearer to the colour of the ground. */
  private tints(rows: number[], by: LineColouring, weight: number): number[] {
    const theme = colours(), ground = new Color(theme.card), ink = new Color(theme.ink);
    return rows.flatMap(i => {
      const colour = new Color();
      if (by === "id") colour.set(this.palette[this.table.colour[i]!] ?? theme.ink);
      else if (by === "age") colour.setRGB(...ramp(this.table.first[i]! / this.newest, theme.dark), "srgb");
      else colour.copy(ink);
      const share = by === "certainty" ? 0.12 + 0.88 * Math.log(Math.max(1, this.table.windows[i]!)) / Math.log(this.mostWindows) : 1;
      const mixed = ground.clone().lerp(colour, weight * share);
      return [mixed.r, mixed.g, mixed.b, mixed.r, mixed.g, mixed.b];
    });
  }
}
