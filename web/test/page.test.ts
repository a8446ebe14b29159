import assert from "node:assert/strict";
import {test} from "node:test";
import {EventStore, fromBase64, fromBuffer, unpackEvents} from "../src/event_store";

/** As pack_events() of the program writes it: line 7 in colour 3 with two events, and one event of no line. */
function packed(): Uint8Array {
  const bytes = new DataView(new ArrayBuffer(2 + 2 * 6 + 3 * 4));
  let at = 0;
  const u16 = (v: number): void => { bytes.setUint16(at, v, true); at += 2; };
  const u32 = (v: number): void => { bytes.setUint32(at, v, true); at += 4; };
  u16(2);
  u32(0xffffffff);
  u16(15 << 12 | 1);
  u32(7);
  u16(3 << 12 | 2);
  for (const x of [84, 0x8000 | 804, 4]) u16(x);
  for (const y of [164, 12, 20]) u16(y);
  return new Uint8Array(bytes.buffer);
}

test("packed events", () => {
  const {groups, x, y, positive} = unpackEvents(packed());
  assert.deepEqual(groups, [{id: -1, colour: -1, begin: 0, end: 1}, {id: 7, colour: 3, begin: 1, end: 3}]);
  assert.deepEqual([...x].map(Math.round), [10, 100, 0]);
  assert.deepEqual([...y].map(Math.round), [20, 1, 2]);
  assert.deepEqual([...positive], [0, 1, 0]);
});

test("windows are found in either kind of store", () => {
  const one = packed(), padded = one.length + (3 - one.length % 3) % 3, all = new Uint8Array(2 * padded);
  all.set(one, 0);
  all.set(one, padded);
  const index = {t: [1, 2], own: [9, 9], around: [3, 3], shown: [3, 3], offset: [0, padded], size: [one.length, one.length]};
  for (const bytes of [fromBase64(Buffer.from(all).toString("base64")), fromBuffer(all.buffer)]) {
    const store = new EventStore(index, bytes);
    assert.deepEqual([0, 1.4, 1.6, 5].map(time => store.row(time)), [0, 0, 1, 1]);
    assert.equal(store.events(1).groups.length, 2);
    assert.equal(store.events(1), store.events(1), "unpacked once");
  }
});
