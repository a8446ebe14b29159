// Dark and light: as the system says, or as chosen with the switch. Colours for what is drawn on canvases.
import {button} from "./dom";

const kNames = ["auto", "light", "dark"] as const;
type Name = (typeof kNames)[number];
const kKey = "idol-theme";
const listeners: (() => void)[] = [];
const system = matchMedia("(prefers-color-scheme: dark)");

export interface Colours {
  dark: boolean;
  ink: string;
  muted: string;
  grid: string;
  card: string;
  accent: string;
  truth: string;
  causal: string;
  /** Okabe and Ito's, for this ground; the first three are also x, y and z. */
  series: string[];
}

export function colours(): Colours {
  const style = getComputedStyle(document.documentElement), get = (name: string): string => style.getPropertyValue(`--${name}`).trim();
  return {dark: isDark(), ink: get("ink"), muted: get("muted"), grid: get("grid"), card: get("card"), accent: get("accent"),
    truth: get("truth"), causal: get("causal"), series: [0, 1, 2, 3, 4, 5, 6].map(i => get(`series-${i}`))};
}

export function onTheme(listener: () => void): void { listeners.push(listener); }

function chosen(): Name {
  try {
    return kNames.find(name => name === localStorage.getItem(kKey)) ?? "auto";
  } catch {
    return "auto";  // no storage for pages from the disk, in some browsers
  }
}

function isDark(): boolean { return document.documentElement.dataset["theme"] === "dark"; }

function apply(name: Name): void {
  document.documentElement.dataset["theme"] = name === "dark" || (name === "auto" && system.matches) ? "dark" : "light";
  for (const listener of listeners) listener();
}

/** Sets the colours and returns the switch. */
export function themeSwitch(): HTMLElement {
  let name = chosen();
  const text = (): string => ({auto: "◐ auto", light: "☀ light", dark: "☾ dark"})[name];
  const element = button(text(), "Colours: as the system has them, light, or dark", () => {
    name = kNames[(kNames.indexOf(name) + 1) % kNames.length]!;
    element.textContent = text();
    try {
      localStorage.setItem(kKey, name);
    } catch { /* then it holds for this visit */ }
    apply(name);
  });
  element.className = "theme";
  system.addEventListener("change", () => { apply(name); });
  apply(name);
  return element;
}

const kViridis: [number, number, number][] = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

/** Share s in [0, 1] of viridis, of the part that can be told from the page's ground: red, green, blue in [0, 1]. */
export function ramp(s: number, dark: boolean): [number, number, number] {
  const share = Math.min(1, Math.max(0, s)), at = 4 * (dark ? 0.25 + 0.75 * share : 0.87 * share);
  const k = Math.min(3, Math.floor(at)), f = at - k, a = kViridis[k]!, b = kViridis[k + 1]!;
  return [0, 1, 2].map(i => (a[i]! + f * (b[i]! - a[i]!)) / 255) as [number, number, number];
}

/** For a legend. */
export function rampCss(dark: boolean): string {
  const stops = [0, 0.25, 0.5, 0.75, 1].map(s => `rgb(${ramp(s, dark).map(v => Math.round(255 * v)).join(" ")})`);
  return `linear-gradient(90deg, ${stops.join(", ")})`;
}
