// What the program writes into the page or sends to it; made by src/idol/report and src/idol/view.

/** Poses in time order: seconds, x y z, and x y z w of the unit quaternion. */
export interface Path {
  t: number[];
  p: number[];
  q: number[];
}

/** The undistorted image. */
export interface CameraModel {
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
}

/** Mapped lines by columns; a and b hold three numbers a line. */
export interface LineTable {
  id: number[];
  a: number[];
  b: number[];
  first: number[];
  last: number[];
  windows: number[];
  colour: number[];
}

export interface SeriesData {
  name: string;
  colour: number;
  style: "" | "causal" | "truth" | "error" | "thin" | "dashed";
  t: number[];
  y: (number | null)[];
  /** Half the width of a band: around y, or around zero where the style is "error". */
  band?: (number | null)[];
}

export interface PanelData {
  group: "state" | "error" | "front-end" | "back-end";
  title: string;
  unit: string;
  series: SeriesData[];
}

export interface StatsBox {
  rmse: number | null;
  mean: number | null;
  median: number | null;
  max: number | null;
}

export interface Protocol {
  alignment?: {kind?: string; on?: string};
  translation_m?: StatsBox;
  rotation_deg?: StatsBox;
  yaw_deg?: StatsBox;
  mpe_percent?: number | null;
  mye_deg_per_m?: number | null;
  scale?: number | null;
  notes?: string[];
}

/** Smallest, lower quartile, median, upper quartile, largest. */
export type FiveNumbers = [number, number, number, number, number];

export interface Box {
  percent: number;
  length_m: number;
  samples: number;
  translation_percent: FiveNumbers;
  rotation_deg: FiveNumbers;
}

export interface Judged {
  title: string;
  data: {
    matched?: number;
    coverage?: number;
    distance_m?: number;
    protocols?: Record<string, Protocol>;
    skipped?: Record<string, string>;
  };
  boxes: Box[];
}

export interface Stats {
  version?: string;
  sequence?: string;
  preset?: string;
  status?: string;
  events?: number;
  duration_s?: number;
  wall_s?: number;
  realtime_factor?: number;
  peak_rss_mb?: number;
  stages?: Record<string, number>;
  latency_s?: {median: number; p99: number; worst: number};
  windows?: number;
  lines?: number;
  residuals?: number;
  solver_iterations?: number;
  restarts?: number;
  first_good_pose_s?: number;
  warnings?: Record<string, {message?: string; count?: number}>;
}

/** Of each window: when, how many events it had, near its middle, and shown; where these lie in the packed bytes. */
export interface EventIndex {
  t: number[];
  own: number[];
  around: number[];
  shown: number[];
  offset: number[];
  size: number[];
}

export interface RunData {
  zero: string | null;
  stats: Stats | null;
  hints: string[];
  evaluations: Judged[];
  smoothed: Path;
  causal: Path;
  truth: Path;
  /** Turns the world of the run into that of the ground truth; R by rows. */
  alignment: {R: number[]; t: number[]} | null;
  camera: CameraModel | null;
  palette: string[];
  lines: LineTable;
  panels: PanelData[];
  trackLengths: {width: number; counts: number[]} | null;
  events: EventIndex;
  /** Undistorted frames of the camera, if it takes any: when, and as data URIs. */
  frames: {t: number[]; src: string[]};
  files: {name: string; text: string}[];
  notes: string[];
}

export interface RunSource {
  name: string;
}

export type PageSource = {kind: "report"} | {kind: "runs"; runs: RunSource[]} | {kind: "live"; name: string};
