// One time for the whole page: a slider with play, moved by keys, clicks on curves and playing.
import {button, el, select} from "./dom";
import {lastBefore} from "./maths";

export class Timeline {
  readonly bar: HTMLElement;
  time: number;
  private readonly slider: HTMLInputElement;
  private readonly output = el("output");
  private readonly play: HTMLButtonElement;
  private readonly listeners: ((time: number) => void)[] = [];
  private speed = 1;
  private playing = false;

  /** `steps`: the times that single steps go to, in order. */
  constructor(readonly from: number, readonly to: number, private readonly steps: number[]) {
    this.time = to;
    this.slider = el("input", {type: "range", min: String(from), max: String(to), step: "any", "aria-label": "Time in the recording",
      title: "Arrow keys: one window; with shift: ten; Home, End; space plays"});
    this.play = button("▶", "Play (space)", () => { this.toggle(); });
    this.play.className = "play";
    this.slider.addEventListener("input", () => { this.stop(); this.set(Number(this.slider.value)); });
    const speeds: [string, string][] = [["0.25", "¼×"], ["1", "1×"], ["4", "4×"]];
    const speed = select("", speeds, value => { this.speed = Number(value); });
    const box = speed.querySelector("select")!;
    box.value = "1";
    box.setAttribute("aria-label", "Speed of playing");
    this.bar = el("div", {class: "timeline", role: "group", "aria-label": "Time"}, this.play, this.slider, this.output, speed);
    document.addEventListener("keydown", event => { this.onKey(event); });
  }

  onChange(listener: (time: number) => void): void { this.listeners.push(listener); }

  set(time: number): void {
    this.time = Math.min(this.to, Math.max(this.from, time));
    this.slider.value = String(this.time);
    const text = `${this.time.toFixed(2)} s`;
    this.output.textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
    for (const listener of this.listeners) listener(this.time);
  }

  toggle(): void {
    if (this.playing) { this.stop(); return; }
    if (this.time >= this.to - 1e-9) this.set(this.from);
    this.playing = true;
    this.play.textContent = "❚❚";
    this.play.setAttribute("aria-label", "Pause");
    // Who asked for less motion gets a picture now and then.
    const shortest = matchMedia("(prefers-reduced-motion: reduce)").matches ? 0.25 : 0;
    let before = performance.now();
    const step = (now: number): void => {
      if (!this.playing) return;
      const passed = (now - before) / 1000;
      if (passed >= shortest) {
        before = now;
        this.set(this.time + passed * this.speed);
        if (this.time >= this.to) this.stop();
      }
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  stop(): void {
    this.playing = false;
    this.play.textContent = "▶";
    this.play.setAttribute("aria-label", "Play");
  }

  private onKey(event: KeyboardEvent): void {
    const target = event.target instanceof Element ? event.target : document.body;
    // What has keys of its own keeps them.
    if (event.ctrlKey || event.metaKey || event.altKey || target.closest("select, summary, a, canvas, pre, .table-wrap")) return;
    if (target !== this.slider && target.closest("input")) return;
    const step = event.shiftKey ? 10 : 1;
    if (event.key === "ArrowLeft" || (event.key === "ArrowDown" && target === this.slider)) this.step(-step);
    else if (event.key === "ArrowRight" || (event.key === "ArrowUp" && target === this.slider)) this.step(step);
    else if (event.key === "PageDown" && target === this.slider) this.step(-10);
    else if (event.key === "PageUp" && target === this.slider) this.step(10);
    else if (event.key === "Home") this.jump(this.from);
    else if (event.key === "End") this.jump(this.to);
    else if (event.key === " " && !target.closest("button")) this.toggle();
    else return;
    event.preventDefault();
  }

  private step(count: number): void {
    const at = lastBefore(this.steps, this.time + 1e-6) + count;
    this.jump(this.steps[Math.min(this.steps.length - 1, Math.max(0, at))] ?? this.time);
  }

  private jump(time: number): void { this.stop(); this.set(time); }
}
