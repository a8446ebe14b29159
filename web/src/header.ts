// What stands at the top of a run's page: its name, what to know about it, its figures.
import {el} from "./dom";
import {figure, isNumber, large} from "./maths";
import type {RunData, Stats} from "./types";

export function shortName(stats: Stats | null, otherwise = "Run"): string {
  return stats?.sequence?.replace(/\/+$/, "").split("/").at(-1) ?? otherwise;
}

export function header(data: RunData): HTMLElement {
  const stats = data.stats ?? {}, name = stats.sequence?.replace(/\/+$/, "") ?? "", short = shortName(data.stats);
  document.title = `${short} – idol report`;
  const facts: string[] = [];
  if (stats.preset) facts.push(`preset ${stats.preset}`);
  if (stats.version) facts.push(`idol ${stats.version}`);
  if (data.zero) facts.push(`time zero is stamp ${data.zero} s`);
  if (name && name !== short) facts.push(name);
  return el("header", {}, el("p", {class: "eyebrow"}, "idol · event-camera and IMU odometry with lines"), el("h1", {}, short),
    el("p", {class: "muted"}, facts.join(" · ")), ...banners(stats, data.hints), tiles(stats, data));
}

/** In plain words: how the run ended, what the program warned of, what its figures say about where it is weak. */
function banners(stats: Stats, hints: string[]): HTMLElement[] {
  const banner = (kind: string, ...parts: (Node | string)[]): HTMLElement => el("div", {class: `banner ${kind}`, role: "note"}, ...parts);
  const out: HTMLElement[] = [];
  if (stats.status === "interrupted")
    out.push(banner("warn", el("strong", {}, "The run was interrupted. "), "This is what it had found until then."));
  else if (stats.status && stats.status !== "done")
    out.push(banner("bad", el("strong", {}, "The run ended early. "), stats.status));
  const list = el("ul");
  for (const [kind, {message, count}] of Object.entries(stats.warnings ?? {})) {
    const words = kind.replaceAll("_", " ").replace(/\bimu\b/, "IMU");
    list.append(el("li", {}, el("strong", {}, words.charAt(0).toUpperCase() + words.slice(1)),
      count !== undefined && count > 1 ? ` (${figure(count)} times)` : "", ": ", message ?? ""));
  }
  for (const hint of hints) {
    const colon = hint.indexOf(": ");
    list.append(colon < 0 ? el("li", {}, hint) : el("li", {}, el("strong", {}, hint.slice(0, colon)), hint.slice(colon)));
  }
  const count = list.children.length;
  if (count)
    out.push(banner("warn", el("strong", {}, count === 1 ? "One thing to know about this run" : `${count} things to know about this run`), list));
  return out;
}

function tiles(stats: Stats, data: RunData): HTMLElement {
  const host = el("dl", {class: "tiles"});
  const tile = (name: string, value: string, unit = "", under = ""): void => {
    if (value === "–") return;
    const dd = el("dd", {}, value, el("small", {}, unit ? ` ${unit}` : ""));
    if (under) dd.append(el("p", {class: "under"}, under));
    host.append(el("div", {}, el("dt", {}, name), dd));
  };
  tile("Recording processed", figure(stats.duration_s), "s", isNumber(stats.wall_s) ? `in ${figure(stats.wall_s)} s of computing` : "");
  const factor = stats.realtime_factor;
  if (isNumber(factor) && factor > 0)
    tile("Real-time factor", figure(factor), "×", factor >= 1 ? `${figure(factor)} times faster than real time` : `${figure(1 / factor)} times slower than real time`);
  const [full, causal] = data.evaluations.map(j => j.data.protocols?.["full"]);
  const error = (title: string, unit: string, digits: number, get: (p: NonNullable<typeof full>) => number | null | undefined, scale = 1): void => {
    const value = full && get(full), beside = causal && get(causal);
    if (isNumber(value)) tile(title, (scale * value).toFixed(digits), unit, isNumber(beside) ? `causal ${(scale * beside).toFixed(digits)} ${unit}` : "");
  };
  error("Position error, RMSE", "cm", 2, p => p.translation_m?.rmse, 100);
  error("Mean position error", "% of path", 2, p => p.mpe_percent);
  error("Rotation error, RMSE", "°", 2, p => p.rotation_deg?.rmse);
  const events = stats.events, seconds = stats.duration_s;
  tile("Events", large(events), "", isNumber(events) && isNumber(seconds) && seconds > 0 ? `${large(events / seconds)} per second` : "");
  const windows = stats.windows, iterations = stats.solver_iterations;
  tile("Windows", figure(windows), "", isNumber(iterations) && isNumber(windows) && windows > 0 ? `${figure(iterations / windows)} solver iterations each` : "");
  tile("Lines mapped", figure(stats.lines), "", isNumber(stats.residuals) ? `${large(stats.residuals)} residuals` : "");
  if (stats.latency_s)
    tile("Latency, median", figure(1e3 * stats.latency_s.median), "ms", `99 % below ${figure(1e3 * stats.latency_s.p99)} ms`);
  tile("Peak memory", figure(stats.peak_rss_mb), "MB");
  return host;
}
