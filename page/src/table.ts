/** A plot as a table of numbers, for whoever does not see it or wants them exactly. */

import type { Axis, Drawing } from "./drawing";
import { showNumber, unitText } from "./export";

const ROWS = 60;

/** Rows of a curve, at most about `most` of them, first and last among them. */
export function rowsOfCurve(x: readonly number[], y: readonly number[], most = ROWS): [number, number][] {
  const rows: [number, number][] = [];
  const count = Math.min(most, x.length);
  for (let k = 0; k < count; k++) {
    const at = count === 1 ? 0 : Math.round((k * (x.length - 1)) / (count - 1));
    const [a, b] = [x[at] ?? Number.NaN, y[at] ?? Number.NaN];
    if (Number.isFinite(a) && Number.isFinite(b)) rows.push([a, b]);
  }
  return rows;
}

export function showTable(title: string, x: Axis, y: Axis, drawing: Drawing): void {
  const dialog = document.createElement("dialog");
  const heading = Object.assign(document.createElement("h2"), { textContent: title, id: "table-title" });
  const text = Object.assign(document.createElement("p"), { textContent: drawing.summary });
  dialog.setAttribute("aria-labelledby", heading.id);
  const scroll = document.createElement("div");
  scroll.className = "scroll";
  scroll.tabIndex = 0;
  scroll.setAttribute("role", "region");
  scroll.setAttribute("aria-label", "Numbers");
  for (const line of drawing.lines) {
    if (line.x.length === 0) continue;
    const table = document.createElement("table");
    table.append(Object.assign(document.createElement("caption"), { textContent: line.label }));
    const head = document.createElement("tr");
    for (const axis of [x, y]) {
      head.append(Object.assign(document.createElement("th"), { scope: "col", textContent: unitText(axis) }));
    }
    table.append(head);
    for (const pair of rowsOfCurve(line.x, line.y)) {
      const row = document.createElement("tr");
      for (const value of pair) {
        row.append(Object.assign(document.createElement("td"), { textContent: showNumber(value) }));
      }
      table.append(row);
    }
    scroll.append(table);
  }
  const close = Object.assign(document.createElement("button"), { type: "button", textContent: "Close" });
  close.addEventListener("click", () => dialog.close());
  dialog.addEventListener("close", () => dialog.remove());
  dialog.append(heading, text, scroll, close);
  document.body.append(dialog);
  dialog.showModal();
}
