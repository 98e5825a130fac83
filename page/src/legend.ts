/** The legend below a plot: each curve's name beside a key drawn as the curve is. */

import { shown } from "./colors";
import type { Drawing, Line } from "./drawing";
import { element } from "./parts";

const CROSS = "M6 1l6 6m0 -6l-6 6";
const RING = "M6 4a3 3 0 1 0 6 0a3 3 0 1 0 -6 0";
export const KEYS = {
  cross: CROSS,
  ring: RING,
  dot: RING,
  line: "M0 4h18",
  both: "M1 1l6 6m0 -6l-6 6M11 4a3 3 0 1 0 6 0a3 3 0 1 0 -6 0",
};

/** The curves that the legend names. */
export function named(drawing: Drawing): Line[] {
  return drawing.lines.filter((line) => !line.quiet);
}

export function legendText(line: Line): string {
  return line.legend ?? line.label;
}

export function keyOf(line: Line): keyof typeof KEYS {
  return line.key ?? line.marker ?? "line";
}

export class Legend {
  readonly list = element("ul", { className: "legend" });
  private drawn = "";

  /** Name what is drawn; the list is made anew only where it differs. */
  show(drawing: Drawing, dark: boolean): void {
    const lines = named(drawing);
    const text = JSON.stringify([
      dark,
      drawing.note,
      lines.map((l) => [legendText(l), l.color, keyOf(l), l.dash, l.title]),
    ]);
    if (text === this.drawn) return;
    this.drawn = text;
    this.list.replaceChildren(...lines.map((line) => entry(line, dark)));
    if (drawing.note) this.list.append(element("li", { className: "said", textContent: drawing.note }));
  }
}

function entry(line: Line, dark: boolean): HTMLElement {
  const found = element("li", { title: line.title ?? "" });
  const key = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  key.setAttribute("viewBox", "0 0 18 8");
  key.setAttribute("aria-hidden", "true");
  const shape = document.createElementNS("http://www.w3.org/2000/svg", "path");
  const color = shown(line.color, dark);
  shape.setAttribute("d", KEYS[keyOf(line)]);
  shape.setAttribute("stroke", color);
  shape.setAttribute("stroke-width", String(Math.min(line.marker || line.key ? 1.8 : (line.width ?? 1.8), 5)));
  shape.setAttribute("fill", line.marker === "dot" ? color : "none");
  if (line.dash) shape.setAttribute("stroke-dasharray", line.dash.map((d) => d / 1.5).join(" "));
  key.append(shape);
  found.append(key, legendText(line));
  return found;
}
