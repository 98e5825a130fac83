/** What all drawings of a view share: how fitted models look, and the room that curves need. */

import { type Found, isProblem } from "./api";
import { COLORS } from "./colors";
import type { Line } from "./drawing";
import { doubtOf } from "./notes";

export const NAMES: Record<string, string> = { g1: "1st order", g2: "2nd order", g2d: "2nd order + delay" };
export const MODELS = ["g1", "g2", "g2d"] as const;
export const DASHES: Record<(typeof MODELS)[number], number[]> = { g1: [2, 3], g2: [6, 3], g2d: [9, 3, 2, 3] };
const UNSURE = [1.5, 4];

/** A part of a view, where it is there and no problem. */
export function whole<T>(part: T | undefined): Exclude<T, { problem: unknown }> | undefined {
  return part === undefined || isProblem(part) ? undefined : (part as Exclude<T, { problem: unknown }>);
}

/** A range that holds all values, with room; as wide as a smallest one. */
export function rangeOf(values: Iterable<number>, least: number, share = 0.06): [number, number] {
  let low = Number.POSITIVE_INFINITY;
  let high = Number.NEGATIVE_INFINITY;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) return [0, 1];
  const room = Math.max((high - low) * share, (least - (high - low)) / 2, 0);
  return [low - room, high + room];
}

type Model = (typeof MODELS)[number];

/** A curve of a fitted model; one that its data do not determine is faint, and says so. */
export function model(found: Found, name: Model, x: readonly number[], y: readonly number[]): Line {
  const doubt = doubtOf(found, name);
  const label = NAMES[name] ?? name;
  if (doubt === undefined) return { label, color: COLORS[name], x, y, dash: DASHES[name] };
  const look = { color: COLORS[`${name}_faint`], dash: UNSURE, width: 1.5 };
  return { ...look, label: `${label}, undetermined`, title: `Its data do not determine it: ${doubt}`, x, y };
}
