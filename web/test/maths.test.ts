import assert from "node:assert/strict";
import {test} from "node:test";
import {figure, intoFrame, inverse, lastBefore, movePath, nearest, niceStep, poseAt, projectSegment, quatOf, rotate, type Pose, type Quat, type Vec3} from "../src/maths";
import type {CameraModel, Path} from "../src/types";

const kCamera: CameraModel = {width: 240, height: 180, fx: 200, fy: 200, cx: 120, cy: 90};
const kHere: Pose = {p: [0, 0, 0], q: [0, 0, 0, 1]};
const quarterTurn: Quat = [0, 0, Math.SQRT1_2, Math.SQRT1_2];  // about z

function close(actual: readonly number[], expected: readonly number[]): void {
  assert.equal(actual.length, expected.length);
  actual.forEach((v, i) => { assert.ok(Math.abs(v - expected[i]!) < 1e-9, `${actual.join(" ")} is not ${expected.join(" ")}`); });
}

test("entries by time", () => {
  const t = [1, 2, 4];
  assert.deepEqual([0, 1, 3.9, 9].map(time => lastBefore(t, time)), [-1, 0, 1, 2]);
  assert.deepEqual([0, 1.4, 3.1, 9].map(time => nearest(t, time)), [0, 0, 2, 2]);
  assert.equal(nearest([], 1), -1);
});

test("poses between poses", () => {
  const path: Path = {t: [0, 2], p: [0, 0, 0, 2, 4, 6], q: [0, 0, 0, 1, 0, 0, -Math.SQRT1_2, -Math.SQRT1_2]};
  const half = poseAt(path, 1)!;
  close(half.p, [1, 2, 3]);
  close(half.q, [0, 0, Math.sin(Math.PI / 8), Math.cos(Math.PI / 8)]);  // the same turn, whatever the sign
  close(poseAt(path, 99)!.p, [2, 4, 6]);
  close(poseAt(path, -1)!.p, [0, 0, 0]);
  assert.equal(poseAt({t: [], p: [], q: []}, 0), null);
  close(poseAt({t: [5], p: [1, 2, 3], q: [0, 0, 0, 1]}, 0)!.p, [1, 2, 3]);
});

test("turning", () => {
  close(rotate(quarterTurn, [1, 0, 0]), [0, 1, 0]);
  close(intoFrame({p: [1, 1, 0], q: quarterTurn}, [1, 2, 0]), [1, 0, 0]);
  close(quatOf([0, -1, 0, 1, 0, 0, 0, 0, 1]), quarterTurn);
  for (const R of [[1, 0, 0, 0, -1, 0, 0, 0, -1], [-1, 0, 0, 0, 1, 0, 0, 0, -1], [-1, 0, 0, 0, -1, 0, 0, 0, 1]]) {
    const x: Vec3 = [1, 2, 3];
    close(rotate(quatOf(R), x), [R[0]! * 1, R[4]! * 2, R[8]! * 3]);
  }
});

test("a path moved there and back is the same", () => {
  const path: Path = {t: [0], p: [1, 2, 3], q: [0, 0, 0, 1]}, move = {R: [0, -1, 0, 1, 0, 0, 0, 0, 1], t: [5, 6, 7]};
  const there = movePath(path, move);
  close(there.p, [3, 7, 10]);
  close(there.q, quarterTurn);
  close(movePath(there, inverse(move)).p, path.p);
});

test("segments in the image", () => {
  close(projectSegment(kCamera, kHere, [0, 0, 2], [0.5, 0, 2])!, [120, 90, 170, 90]);
  assert.equal(projectSegment(kCamera, kHere, [0, 0, -1], [1, 0, -1]), null, "behind the camera");
  assert.equal(projectSegment(kCamera, kHere, [9, 0, 1], [9, 1, 1]), null, "beside the image");
  const cut = projectSegment(kCamera, kHere, [0.1, 0, 1], [0.1, 0, -1])!;
  close(cut.slice(0, 2), [140, 90]);
  assert.ok(cut.every(Number.isFinite), "cut off before it passes the camera");
});

test("numbers for people", () => {
  assert.deepEqual([0.012345, 1.5, 12.34, 123.4, 1234567, 7, NaN, null].map(figure), ["0.0123", "1.50", "12.3", "123", "1\u202f234\u202f567", "7", "–", "–"]);
  assert.deepEqual([0.3, 1, 3.2, 70].map(niceStep), [0.5, 1, 5, 100]);
});
