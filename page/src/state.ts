/** What a page shows, as the server knows it: keys of `revline.workbench/1`, and how it stands in the address. */

import { isOfLook, type Look, lookEntries, PLAIN } from "./look";

export type StepKind = "command" | "load" | "throttle";

export interface State {
  engine: string;
  parameters: Readonly<Record<string, number>>;
  throttle_deg?: number;
  speed_rad_s?: number;
  load_n_m: number;
  amplitude_deg: number;
  kp: number;
  ki: number;
  kd: number;
  step: StepKind;
  command_rad_s: number;
  load_step_n_m: number;
  throttle_step_deg: number;
  until_s: number;
  low_deg?: number;
  high_deg?: number;
}

export const DEFAULTS: State = {
  engine: "lee1995",
  parameters: {},
  throttle_deg: 25,
  load_n_m: 0,
  amplitude_deg: 5,
  kp: 1.2,
  ki: 2,
  kd: 0.1,
  step: "command",
  command_rad_s: 40,
  load_step_n_m: 5,
  throttle_step_deg: 5,
  until_s: 4,
};

export const NUMBERS = [
  "throttle_deg",
  "speed_rad_s",
  "load_n_m",
  "amplitude_deg",
  "kp",
  "ki",
  "kd",
  "command_rad_s",
  "load_step_n_m",
  "throttle_step_deg",
  "until_s",
  "low_deg",
  "high_deg",
] as const;
export type NumberKey = (typeof NUMBERS)[number];

const STEPS: readonly string[] = ["command", "load", "throttle"];
const VERSION = "1";

/** Give the part of the address that makes a state and a look again: what differs from the defaults. */
export function toAddress(state: State, look: Look = PLAIN): string {
  const entries: [string, string][] = [["v", VERSION]];
  if (state.engine !== DEFAULTS.engine) entries.push(["engine", state.engine]);
  if (state.step !== DEFAULTS.step) entries.push(["step", state.step]);
  for (const key of NUMBERS) {
    const value = state[key];
    if (value !== undefined && value !== DEFAULTS[key]) entries.push([key, String(value)]);
  }
  for (const [key, value] of Object.entries(state.parameters).sort(([a], [b]) => (a < b ? -1 : 1))) {
    entries.push([`parameters.${key}`, String(value)]);
  }
  entries.push(...lookEntries(look));
  return entries.length === 1 ? "" : `#${new URLSearchParams(entries).toString()}`;
}

export interface Read {
  state: State;
  faults: string[];
}

/** Read a state from the address; what cannot be read is told and left at its default. */
export function fromAddress(hash: string): Read {
  const faults: string[] = [];
  const state: State = { ...DEFAULTS, parameters: {} };
  const parameters: Record<string, number> = {};
  const entries = new URLSearchParams(hash.replace(/^#/, ""));
  for (const [key, text] of entries) {
    const value = Number(text);
    const finite = text.trim() !== "" && Number.isFinite(value);
    if (key === "v") {
      if (text !== VERSION) faults.push(`the link is of version ${text}; this page reads version ${VERSION}`);
    } else if (key === "engine") state.engine = text;
    else if (key === "step" && STEPS.includes(text)) state.step = text as StepKind;
    else if (key.startsWith("parameters.") && finite) parameters[key.slice("parameters.".length)] = value;
    else if ((NUMBERS as readonly string[]).includes(key) && finite) state[key as NumberKey] = value;
    else if (!isOfLook(key)) faults.push(`${key} = ${text} in the link means nothing here; its default is shown`);
  }
  if (entries.has("speed_rad_s") && state.speed_rad_s !== undefined) delete state.throttle_deg;
  return { state: { ...state, parameters }, faults };
}

/** Change a state; a speed takes the place of the throttle angle and the other way round. */
export function change(state: State, patch: Partial<State>): State {
  const next: State = { ...state, ...patch };
  if (patch.speed_rad_s !== undefined) delete next.throttle_deg;
  else if (patch.throttle_deg !== undefined) delete next.speed_rad_s;
  return next;
}

export function same(a: State, b: State): boolean {
  return toAddress(a) === toAddress(b);
}
