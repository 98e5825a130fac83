/** The numbers that can be set: their units and ranges, and how a slider's way is divided among their values. */

import type { NumberKey, State } from "./state";

export interface Spec {
  key: NumberKey;
  label: string;
  unit: string;
  low: number;
  high: number;
  step: number;
  /** How the slider's way is divided: evenly, or by powers of ten above `least`. */
  least?: number;
  hidden?: (state: State) => boolean;
}

export const POINT: Spec[] = [
  {
    key: "throttle_deg",
    label: "Throttle",
    unit: "deg",
    low: 4,
    high: 80,
    step: 0.1,
    hidden: (s) => s.speed_rad_s !== undefined,
  },
  {
    key: "speed_rad_s",
    label: "Speed",
    unit: "rad/s",
    low: 20,
    high: 800,
    step: 1,
    hidden: (s) => s.speed_rad_s === undefined,
  },
  { key: "load_n_m", label: "Load", unit: "N m", low: -10, high: 80, step: 0.5 },
  { key: "amplitude_deg", label: "Amplitude", unit: "deg", low: 0.1, high: 20, step: 0.1 },
];
export const GAINS = {
  kp: { key: "kp", label: "kp", unit: "deg/(rad/s)", low: 0, high: 30, step: 0.001, least: 0.01 },
  ki: { key: "ki", label: "ki", unit: "deg/(rad/s)/s", low: 0, high: 300, step: 0.001, least: 0.05 },
  kd: { key: "kd", label: "kd", unit: "deg/(rad/s²)", low: 0, high: 1, step: 0.0001, least: 0.001 },
} satisfies Record<string, Spec>;
export const STEP: Spec[] = [
  {
    key: "command_rad_s",
    label: "Command",
    unit: "rad/s",
    low: -100,
    high: 100,
    step: 1,
    hidden: (s) => s.step !== "command",
  },
  {
    key: "load_step_n_m",
    label: "Load step",
    unit: "N m",
    low: -20,
    high: 40,
    step: 0.5,
    hidden: (s) => s.step !== "load",
  },
  {
    key: "throttle_step_deg",
    label: "Throttle step",
    unit: "deg",
    low: -20,
    high: 20,
    step: 0.5,
    hidden: (s) => s.step !== "throttle",
  },
  { key: "until_s", label: "Until", unit: "s", low: 0.5, high: 20, step: 0.5 },
];

export const POSITIONS = 1000;

/** Where a value stands on a slider of `POSITIONS` places. */
export function toPosition(value: number, spec: Pick<Spec, "low" | "high" | "least">): number {
  const { low, high, least } = spec;
  const share = least ? Math.asinh(value / least) / Math.asinh(high / least) : (value - low) / (high - low);
  return Math.round(POSITIONS * Math.min(Math.max(share, 0), 1));
}

/** The value at a place of a slider, rounded to the control's step or to three digits. */
export function fromPosition(position: number, spec: Pick<Spec, "low" | "high" | "step" | "least">): number {
  const share = position / POSITIONS;
  if (spec.least) return Number((spec.least * Math.sinh(share * Math.asinh(spec.high / spec.least))).toPrecision(3));
  const value = spec.low + share * (spec.high - spec.low);
  return Number((Math.round(value / spec.step) * spec.step).toPrecision(12));
}

/** A value some steps further: by the control's step, or where its way is divided by powers of ten by a hundredth of its size. */
export function stepped(value: number, steps: number, spec: Pick<Spec, "step" | "least">): number {
  const size = spec.least ? 10 ** Math.floor(Math.log10(Math.max(Math.abs(value), 10 * spec.least)) - 1) : spec.step;
  return Number((value + steps * size).toPrecision(6));
}
