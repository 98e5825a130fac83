/** What each part of a view depends on, so that a move asks for that alone, and draws that alone. */

import type { PartName } from "./api";
import { DEFAULTS, type State } from "./state";

type Key = keyof State;

const POINT: readonly Key[] = ["engine", "parameters", "load_n_m", "throttle_deg", "speed_rad_s"];
const GAINS: readonly Key[] = ["kp", "ki", "kd"];
const STEP: readonly Key[] = [
  "step",
  "command_rad_s",
  "load_step_n_m",
  "throttle_step_deg",
  "until_s",
  "low_deg",
  "high_deg",
];

/** One that is not listed depends on all. */
const OF_PART: Partial<Record<PartName, readonly Key[]>> = {
  point: POINT,
  map: POINT,
  validity: POINT,
  response: [...POINT, "amplitude_deg"],
  models: [...POINT, "amplitude_deg"],
  peaks: [...POINT, "amplitude_deg"],
  gains: [...POINT, "kd"],
  contours: [...POINT, "kd"],
  margins: [...POINT, ...GAINS],
  loop_roots: [...POINT, ...GAINS],
  roots: [...POINT, ...GAINS, "amplitude_deg"],
  promises: [...POINT, ...GAINS, "amplitude_deg"],
  loop: [...POINT, ...GAINS, ...STEP],
};
const ALL: readonly Key[] = [...POINT, ...GAINS, ...STEP, "amplitude_deg"];

/** A name for what a part depends on: two states in which it is the same have the same one. */
export function keyOf(part: PartName, state: State): string {
  return JSON.stringify(
    (OF_PART[part] ?? ALL).map((key) =>
      key === "parameters" ? Object.entries(state.parameters).sort(([a], [b]) => (a < b ? -1 : 1)) : state[key],
    ),
  );
}

/** Whether two states have the same steady speeds over the throttle; only the straight line through them is of one point. */
export function sameSpeeds(a: State, b: State): boolean {
  const of = ({ engine, load_n_m, parameters }: State) => keyOf("map", { ...DEFAULTS, engine, load_n_m, parameters });
  return of(a) === of(b);
}

/** What was read of an object, and whether it would be read again. */
export class Reads<T extends object> {
  private readonly seen = new Map<PropertyKey, unknown>();
  readonly of: T;

  constructor(target: T) {
    const { seen } = this;
    this.of = new Proxy(target, {
      get(from, key) {
        const value: unknown = Reflect.get(from, key);
        seen.set(key, value);
        return value;
      },
    });
  }

  /** Whether another object holds the same in all places that were read. */
  stand(now: T): boolean {
    for (const [key, value] of this.seen) if (!Object.is(Reflect.get(now, key), value)) return false;
    return true;
  }
}
