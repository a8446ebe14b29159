import assert from "node:assert/strict";
import {test} from "node:test";
import {columnsOf} from "../src/columns";
import {LiveState, livePanels, type Update} from "../src/live_state";

/** Windows of 0.1 s from `from` on. */
function update(reset: boolean, from: number, windows: number): Update {
  const t = Array.from({length: windows}, (_, i) => from + 0.1 * i), ones = t.map(() => 1);
  return {reset, path: {t, p: t.flatMap(v => [v, 0, 0]), q: t.flatMap(() => [0, 0, 0, 1])}, pose: {p: [0, 0, 0], q: [0, 0, 0, 1]},
    rows: {t, rate: ones, kept: ones, segments: ones, lines: ones, rms: ones, front: ones, solve: ones, speed: ones, sigma: ones},
    lines: {id: [], a: [], b: [], first: [], last: [], windows: [], colour: []}, events: {t: from, own: 0, around: 0, shown: 0, packed: ""}};
}

test("the live path grows, the curves keep ten seconds", () => {
  const state = new LiveState();
  assert.equal(state.newest, null);
  state.take(update(true, 0, 80));
  state.take(update(false, 8, 80));
  assert.equal(state.path.t.length, 160);
  assert.ok(state.rows.t[0]! >= 5.89 && state.rows.t[0]! < 6, String(state.rows.t[0]));
  assert.equal(state.rows.t.length, state.rows.sigma.length);
  assert.ok(Math.abs(state.newest!.p[0] - 15.9) < 1e-9);
  state.take(update(true, 0, 3));
  assert.equal(state.path.t.length, 3, "a connection made anew begins anew");
  assert.ok(livePanels(state.rows).every(panel => panel.series.every(s => s.t.length === 3)));
});

test("series with stamps of their own share one table, bands beside them", () => {
  const {data, places} = columnsOf([
    {name: "x", colour: 0, style: "causal", t: [1, 2], y: [10, null], band: [3, 3]},
    {name: "x", colour: 0, style: "error", t: [2, 3], y: [5, 6], band: [1, 2]},
  ]);
  assert.deepEqual(data[0], [1, 2, 3]);
  assert.deepEqual(places, [{y: 1, band: [2, 3]}, {y: 4, band: [5, 6]}]);
  assert.deepEqual([data[2]![0], data[3]![0]], [13, 7]);
  assert.deepEqual([data[2]![1], data[3]![1]], [null, null], "no value, no band");
  assert.deepEqual([data[5]![1], data[6]![2]], [1, -2], "bands of errors lie around zero");
});
