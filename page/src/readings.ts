/** What the cursor reads from curves. */

import type { Line } from "./drawing";
import { showNumber } from "./export";

export interface Reading {
  label: string;
  text: string;
  color: string;
}

/** Read the curves at x: by a straight line between points, or the mark that is near the cursor. */
export function readingsOf(lines: readonly Line[], x: number, near: (line: Line) => number): Reading[] {
  const found: Reading[] = [];
  for (const line of lines) {
    if (line.quiet) continue;
    if (line.marker) {
      const k = near(line);
      if (k < 0) continue;
      const text = `${showNumber(line.x[k] ?? 0, 4)}, ${showNumber(line.y[k] ?? 0, 4)}`;
      found.push({ label: line.label, text, color: line.color });
      continue;
    }
    const value = readAt(line.x, line.y, x);
    if (value !== undefined) found.push({ label: line.label, text: showNumber(value, 4), color: line.color });
  }
  return found;
}

/** The value of a curve at x; nothing outside of it, and where x does not rise along it. */
export function readAt(x: readonly number[], y: readonly number[], at: number): number | undefined {
  let from = 0;
  let to = x.length - 1;
  if (!rising(x) || !(at >= (x[0] ?? Number.NaN) && at <= (x[to] ?? Number.NaN))) return undefined;
  while (to - from > 1) {
    const middle = (from + to) >> 1;
    if ((x[middle] ?? 0) <= at) from = middle;
    else to = middle;
  }
  const [a, b, low, high] = [x[from] ?? 0, x[to] ?? 0, y[from] ?? 0, y[to] ?? 0];
  const value = a === b ? high : low + ((at - a) / (b - a)) * (high - low);
  return Number.isFinite(value) ? value : undefined;
}

function rising(x: readonly number[]): boolean {
  for (let k = 1; k < x.length; k++) if (!((x[k] ?? 0) >= (x[k - 1] ?? 0))) return false;
  return x.length > 1;
}
