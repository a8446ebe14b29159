// Poses, projection and numbers.
import type {CameraModel, Path} from "./types";

export type Vec3 = [number, number, number];
export type Quat = [number, number, number, number];

export interface Pose {
  p: Vec3;
  q: Quat;
}

/** Index of the last entry not after `time`; -1 before the first. */
export function lastBefore(t: readonly number[], time: number): number {
  let low = 0, high = t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle]! <= time) low = middle + 1; else high = middle;
  }
  return low - 1;
}

/** Index of the entry nearest to `time`; -1 if there is none. */
export function nearest(t: readonly number[], time: number): number {
  const i = lastBefore(t, time);
  if (i + 1 >= t.length) return t.length - 1;
  return i < 0 || t[i + 1]! - time < time - t[i]! ? i + 1 : i;
}

/** Pose at a time, between its two neighbours; the ends hold beyond. Null where there is none. */
export function poseAt({t, p, q}: Path, time: number): Pose | null {
  if (!t.length) return null;
  const low = Math.max(0, Math.min(lastBefore(t, time), t.length - 2)), high = Math.min(low + 1, t.length - 1);
  const s = t[high]! > t[low]! ? Math.min(1, Math.max(0, (time - t[low]!) / (t[high]! - t[low]!))) : 0;
  let same = 0;
  for (let k = 0; k < 4; ++k) same += q[low * 4 + k]! * q[high * 4 + k]!;
  const mix = (values: number[], width: number, k: number, sign: number): number =>
    (1 - s) * values[low * width + k]! + s * sign * values[high * width + k]!;
  const sign = same < 0 ? -1 : 1;
  const turn: Quat = [mix(q, 4, 0, sign), mix(q, 4, 1, sign), mix(q, 4, 2, sign), mix(q, 4, 3, sign)];
  const norm = Math.hypot(...turn) || 1;
  return {p: [mix(p, 3, 0, 1), mix(p, 3, 1, 1), mix(p, 3, 2, 1)],
    q: [turn[0] / norm, turn[1] / norm, turn[2] / norm, turn[3] / norm]};
}

/** q x q^-1. */
export function rotate([qx, qy, qz, qw]: Quat, [x, y, z]: Vec3): Vec3 {
  const tx = 2 * (qy * z - qz * y), ty = 2 * (qz * x - qx * z), tz = 2 * (qx * y - qy * x);
  return [x + qw * tx + qy * tz - qz * ty, y + qw * ty + qz * tx - qx * tz, z + qw * tz + qx * ty - qy * tx];
}

/** A point of the world in the frame of a pose. */
export function intoFrame({p, q}: Pose, x: Vec3): Vec3 {
  return rotate([-q[0], -q[1], -q[2], q[3]], [x[0] - p[0], x[1] - p[1], x[2] - p[2]]);
}

const kNearest = 0.05;  // of what is projected [m]

/** A segment of the world in the image: x y of both ends in pixels, cut off behind the camera; null if not seen. */
export function projectSegment(camera: CameraModel, pose: Pose, a: Vec3, b: Vec3): [number, number, number, number] | null {
  let p = intoFrame(pose, a), q = intoFrame(pose, b);
  if (p[2] < kNearest && q[2] < kNearest) return null;
  const cut = (from: Vec3, to: Vec3): Vec3 => {
    const s = (kNearest - from[2]) / (to[2] - from[2]);
    return [from[0] + s * (to[0] - from[0]), from[1] + s * (to[1] - from[1]), kNearest];
  };
  if (p[2] < kNearest) p = cut(p, q);
  if (q[2] < kNearest) q = cut(q, p);
  const u = (x: Vec3): number => camera.fx * x[0] / x[2] + camera.cx, v = (x: Vec3): number => camera.fy * x[1] / x[2] + camera.cy;
  const ends: [number, number, number, number] = [u(p), v(p), u(q), v(q)];
  const outside = (low: number, high: number, size: number): boolean => Math.max(low, high) < -0.5 || Math.min(low, high) > size - 0.5;
  return outside(ends[0], ends[2], camera.width) || outside(ends[1], ends[3], camera.height) ? null : ends;
}

/** A path moved by x -> R x + t, R by rows. */
export function movePath(path: Path, {R, t}: {R: number[]; t: number[]}): Path {
  const turn = quatOf(R), p: number[] = [], q: number[] = [];
  for (let i = 0; i < path.t.length; ++i) {
    const moved = rotate(turn, [path.p[3 * i]!, path.p[3 * i + 1]!, path.p[3 * i + 2]!]);
    p.push(moved[0] + t[0]!, moved[1] + t[1]!, moved[2] + t[2]!);
    q.push(...multiply(turn, [path.q[4 * i]!, path.q[4 * i + 1]!, path.q[4 * i + 2]!, path.q[4 * i + 3]!]));
  }
  return {t: path.t, p, q};
}

/** x -> R^T (x - t). */
export function inverse({R, t}: {R: number[]; t: number[]}): {R: number[]; t: number[]} {
  const T = [0, 3, 6, 1, 4, 7, 2, 5, 8].map(i => R[i]!);
  return {R: T, t: [0, 1, 2].map(row => -(T[3 * row]! * t[0]! + T[3 * row + 1]! * t[1]! + T[3 * row + 2]! * t[2]!))};
}

function multiply([ax, ay, az, aw]: Quat, [bx, by, bz, bw]: Quat): Quat {
  return [aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz];
}

/** Of a rotation matrix by rows. */
export function quatOf(R: number[]): Quat {
  const [a, b, c, d, e, f, g, h, i] = R as [number, number, number, number, number, number, number, number, number];
  const trace = a + e + i;
  if (trace > 0) {
    const s = 2 * Math.sqrt(1 + trace);
    return [(h - f) / s, (c - g) / s, (d - b) / s, s / 4];
  }
  if (a >= e && a >= i) {
    const s = 2 * Math.sqrt(1 + a - e - i);
    return [s / 4, (b + d) / s, (c + g) / s, (h - f) / s];
  }
  if (e >= i) {
    const s = 2 * Math.sqrt(1 + e - a - i);
    return [(b + d) / s, s / 4, (f + h) / s, (c - g) / s];
  }
  const s = 2 * Math.sqrt(1 + i - a - e);
  return [(c + g) / s, (f + h) / s, s / 4, (d - b) / s];
}

/** 1, 2 or 5 times a power of ten, at least x. */
export function niceStep(x: number): number {
  const power = 10 ** Math.floor(Math.log10(x));
  return [1, 2, 5, 10].map(m => m * power).find(step => step >= x * (1 - 1e-9)) ?? 10 * power;
}

export function quantile(sorted: readonly number[], share: number): number {
  return sorted[Math.round(share * (sorted.length - 1))]!;
}

export const isNumber = (value: unknown): value is number => typeof value === "number" && Number.isFinite(value);

/** Three or four telling digits, thousands in groups. */
export function figure(value: unknown): string {
  if (!isNumber(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1000) return Math.round(value).toLocaleString("en").replaceAll(",", "\u202f");
  if (size >= 100 || Number.isInteger(value)) return String(Math.round(value));
  if (size >= 10) return value.toFixed(1);
  return size >= 1 ? value.toFixed(2) : String(Number(value.toPrecision(3)));
}

export function large(value: unknown): string {
  if (!isNumber(value)) return "–";
  return value >= 1e6 ? `${(value / 1e6).toFixed(2)} M` : value >= 1e4 ? `${(value / 1e3).toFixed(1)} k` : figure(value);
}

export const fixed = (value: unknown, digits: number): string => isNumber(value) ? value.toFixed(digits) : "–";
