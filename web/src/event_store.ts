// The packed events of each window; the layout is that of pack_events() in src/idol/report/event_log.hpp.
import {nearest} from "./maths";
import type {EventIndex} from "./types";

/** Events of one line, or of none. */
export interface EventGroup {
  id: number;
  /** Index into the palette; -1: of no line. */
  colour: number;
  begin: number;
  end: number;
}

export interface WindowEvents {
  groups: EventGroup[];
  /** Pixels of the sensor; integers are pixel centres. */
  x: Float32Array;
  y: Float32Array;
  positive: Uint8Array;
}

const kNoLine = 0xffffffff, kNoColour = 15;

export function unpackEvents(bytes: Uint8Array): WindowEvents {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const count = view.getUint16(0, true), groups: EventGroup[] = [];
  let at = 2, total = 0;
  for (let k = 0; k < count; ++k, at += 6) {
    const id = view.getUint32(at, true), word = view.getUint16(at + 4, true), events = word & 0xfff, colour = word >> 12;
    groups.push({id: id === kNoLine ? -1 : id, colour: colour === kNoColour ? -1 : colour, begin: total, end: total + events});
    total += events;
  }
  const x = new Float32Array(total), y = new Float32Array(total), positive = new Uint8Array(total);
  for (let i = 0; i < total; ++i) {
    const word = view.getUint16(at + 2 * i, true);
    positive[i] = word >> 15;
    x[i] = (word & 0x7fff) / 8 - 0.5 + 0.0625;
    y[i] = view.getUint16(at + 2 * (total + i), true) / 8 - 0.5 + 0.0625;
  }
  return {groups, x, y, positive};
}

export function bytesOfBase64(text: string): Uint8Array {
  return Uint8Array.from(atob(text), c => c.charCodeAt(0));
}

/** Where the bytes come from: the page itself, or the server. Each window begins at a multiple of three. */
export type PackedBytes = (offset: number, size: number) => Uint8Array;

export const fromBase64 = (text: string): PackedBytes => (offset, size) => {
  const begin = offset / 3 * 4;
  return bytesOfBase64(text.slice(begin, begin + 4 * Math.ceil(size / 3))).subarray(0, size);
};

export const fromBuffer = (buffer: ArrayBuffer): PackedBytes => (offset, size) => new Uint8Array(buffer, offset, size);

/** Unpacks one window at a time: the page opens at once, however long the run. */
export class EventStore {
  private last: {row: number; events: WindowEvents} | null = null;

  constructor(readonly index: EventIndex, private readonly bytes: PackedBytes) {}

  get size(): number { return this.index.t.length; }

  /** Row of the window nearest to a time; -1 without any. */
  row(time: number): number { return nearest(this.index.t, time); }

  events(row: number): WindowEvents {
    if (this.last?.row !== row)
      this.last = {row, events: unpackEvents(this.bytes(this.index.offset[row]!, this.index.size[row]!))};
    return this.last.events;
  }
}
