// What a running estimate has sent so far, and its curves.
import type {Pose} from "./maths";
import type {CameraModel, LineTable, PanelData, Path} from "./types";

export interface Hello {
  name: string;
  camera: CameraModel;
  palette: string[];
  version: string;
}

/** What came since the message before; the first one brings everything. */
export interface Update {
  /** Begin anew: what the page has is not what follows. */
  reset: boolean;
  path: Path;
  rows: Record<RowName, number[]>;
  lines: LineTable;
  events: {t: number; own: number; around: number; shown: number; packed: string};
  /** Of the camera, when the events were. */
  pose: Pose;
}

const kRows = ["t", "rate", "kept", "segments", "lines", "rms", "front", "solve", "speed", "sigma"] as const;
type RowName = (typeof kRows)[number];

export const kSeconds = 10;  // that the curves show

/** The path so far and the last seconds of figures. */
export class LiveState {
  readonly path: Path = {t: [], p: [], q: []};
  rows: Record<RowName, number[]> = emptyRows();

  take(update: Update): void {
    if (update.reset) {
      this.path.t = [];
      this.path.p = [];
      this.path.q = [];
      this.rows = emptyRows();
    }
    for (const part of ["t", "p", "q"] as const) for (const v of update.path[part]) this.path[part].push(v);
    for (const name of kRows) this.rows[name].push(...update.rows[name]);
    const oldest = (this.rows.t.at(-1) ?? 0) - kSeconds, gone = this.rows.t.findIndex(t => t >= oldest);
    if (gone > 0) for (const name of kRows) this.rows[name].splice(0, gone);
  }

  get newest(): Pose | null {
    const n = this.path.t.length, {p, q} = this.path;
    if (!n) return null;
    return {p: [p[3 * n - 3]!, p[3 * n - 2]!, p[3 * n - 1]!], q: [q[4 * n - 4]!, q[4 * n - 3]!, q[4 * n - 2]!, q[4 * n - 1]!]};
  }
}

function emptyRows(): Record<RowName, number[]> {
  return Object.fromEntries(kRows.map(name => [name, []])) as unknown as Record<RowName, number[]>;
}

export function livePanels(rows: Record<RowName, number[]>): PanelData[] {
  const panel = (title: string, unit: string, curves: [RowName, string][]): PanelData => ({group: "state", title, unit,
    series: curves.map(([row, name], i) => ({name, colour: i, style: "", t: [...rows.t], y: rows[row].map(v => Number.isFinite(v) ? v : null)}))});
  return [panel("Event rate", "thousand/s", [["rate", "events"]]), panel("Kept: events in segments", "%", [["kept", "kept"]]),
    panel("Tracks in the window", "", [["segments", "segments"], ["lines", "of these mapped lines"]]), panel("Distance of events to their lines, RMS", "px", [["rms", "rms"]]),
    panel("Computing time per window", "ms", [["solve", "solver"], ["front", "front-end"]]), panel("Speed", "m/s", [["speed", "speed"], ["sigma", "3σ of the velocity"]])];
}
