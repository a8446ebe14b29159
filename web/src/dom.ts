// Elements. Texts from a run are only ever set as text, never as markup.
type Child = Node | string;

export function el<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Record<string, string> = {}, ...children: Child[]): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

export function svg(tag: string, attributes: Record<string, string | number> = {}, ...children: Child[]): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

export interface Column {
  name: string;
  left?: boolean;
}

export function table(columns: Column[], rows: Child[][]): HTMLElement {
  const cell = (tag: "th" | "td", value: Child, i: number): HTMLElement => el(tag, columns[i]?.left ? {class: "left"} : {}, value);
  return el("div", {class: "table-wrap", tabindex: "0"}, el("table", {},
    el("thead", {}, el("tr", {}, ...columns.map((column, i) => cell("th", column.name, i)))),
    el("tbody", {}, ...rows.map(row => el("tr", {}, ...row.map((value, i) => cell("td", value, i)))))));
}

export function section(title: string, ...children: Child[]): HTMLElement {
  return el("section", {}, el("h2", {}, title), ...children);
}

/** The text of an element that the program filled. */
export function embedded(id: string): string {
  return document.getElementById(id)?.textContent ?? "";
}

export function select(label: string, options: [string, string][], changed: (value: string) => void): HTMLElement {
  const box = el("select", {}, ...options.map(([value, text]) => el("option", {value}, text)));
  box.addEventListener("change", () => { changed(box.value); });
  return el("label", {class: "choice"}, label, box);
}

export function check(label: Child[], on: boolean, changed: (on: boolean) => void): HTMLElement {
  const box = el("input", {type: "checkbox"});
  box.checked = on;
  box.addEventListener("change", () => { changed(box.checked); });
  return el("label", {}, box, ...label);
}

export function button(text: string, title: string, pressed: () => void): HTMLButtonElement {
  const element = el("button", {type: "button", title}, text);
  element.addEventListener("click", pressed);
  return element;
}
