// The camera's frames beneath its events: decoded when they are first wanted.
import {nearest} from "./maths";
import type {RunData} from "./types";

const kKept = 30;  // decoded at a time
const kFarthest = 0.5;  // from the time that is shown [s]

export class Frames {
  on = true;
  private readonly images = new Map<number, HTMLImageElement>();

  /** `ready` is called when a frame that was wanted has been decoded. */
  constructor(private readonly data: RunData["frames"], private readonly ready: () => void) {}

  /** The frame nearest to a time; null if there is none near, or not yet. */
  at(time: number): HTMLImageElement | null {
    const i = nearest(this.data.t, time);
    if (!this.on || i < 0 || Math.abs(this.data.t[i]! - time) > kFarthest) return null;
    let image = this.images.get(i);
    if (!image) {
      image = new Image();
      image.onload = this.ready;
      image.src = this.data.src[i]!;
      this.images.set(i, image);
      if (this.images.size > kKept) this.images.delete(this.images.keys().next().value!);
    }
    return image.complete && image.naturalWidth > 0 ? image : null;
  }
}
