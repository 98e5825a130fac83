/** What a plot shows as numbers and text: CSV with units in its header, ticks at round numbers. */

import type { Axis, Drawing } from "./drawing";

/** Ticks at round numbers: decades where the axis is logarithmic. */
export function ticks(low: number, high: number, log: boolean, about = 6): number[] {
  const found: number[] = [];
  if (log) {
    for (let k = Math.ceil(Math.log10(low) - 1e-9); k <= Math.log10(high) + 1e-9; k++) found.push(10 ** k);
    return found;
  }
  const rough = (high - low) / about;
  const size = 10 ** Math.floor(Math.log10(rough));
  const step = size * ([1, 2, 5, 10].find((m) => m * size >= rough) ?? 10);
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

export function showNumber(value: number, digits = 6): string {
  return String(Number(value.toPrecision(digits)));
}

/** Give the curves as a table of three columns: which curve, and its points. */
export function csvOf(x: Axis, y: Axis, drawing: Drawing): string {
  const rows = [`curve,${unitText(x)},${unitText(y)}`];
  for (const line of drawing.lines) {
    for (let k = 0; k < line.x.length; k++) {
      const [a, b] = [line.x[k], line.y[k]];
      if (a !== undefined && b !== undefined && Number.isFinite(a) && Number.isFinite(b)) {
        rows.push(`${quote(line.label)},${a},${b}`);
      }
    }
  }
  return `${rows.join("\n")}\n`;
}

export function unitText(axis: Axis): string {
  return axis.unit === "" ? axis.label : `${axis.label} (${axis.unit})`;
}

function quote(text: string): string {
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

export function escapeText(text: string): string {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;").replaceAll('"', "&quot;");
}
