/** How the page is looked at, beside its state: which error plot stands there, what is open, where the tour is. It stands in the address too. */

export interface Look {
  /** The plot shown where errors and distortion take turns. */
  errors: string;
  /** What is open: the engine's parameters, the panel of own data, that of jobs. */
  open: readonly string[];
  /** Step of the tour, from 1; 0 where none is taken. */
  tour: number;
}

export const ERROR_PLOTS = ["magnitude-error", "phase-error", "distortion"] as const;
export const OPEN = ["engine", "data", "jobs"] as const;
export const PLAIN: Look = { errors: "phase-error", open: [], tour: 0 };

const KEYS: readonly string[] = ["errors", "open", "tour"];

/** Give its entries of the address: what differs from a plain look. */
export function lookEntries(look: Look): [string, string][] {
  const entries: [string, string][] = [];
  if (look.errors !== PLAIN.errors) entries.push(["errors", look.errors]);
  if (look.open.length > 0) entries.push(["open", OPEN.filter((name) => look.open.includes(name)).join(" ")]);
  if (look.tour > 0) entries.push(["tour", String(look.tour)]);
  return entries;
}

export function isOfLook(key: string): boolean {
  return KEYS.includes(key);
}

/** Read it from the entries of an address; what cannot be read is told. */
export function readLook(entries: URLSearchParams, stops: number): { look: Look; faults: string[] } {
  const faults: string[] = [];
  const look = { ...PLAIN };
  const tell = (key: string) =>
    faults.push(`${key} = ${entries.get(key)} in the link means nothing here; it is left out`);
  const errors = entries.get("errors");
  if (errors !== null) {
    if ((ERROR_PLOTS as readonly string[]).includes(errors)) look.errors = errors;
    else tell("errors");
  }
  const open = entries.get("open");
  if (open !== null) {
    const names = open.split(" ");
    look.open = OPEN.filter((name) => names.includes(name));
    if (look.open.length < names.length) tell("open");
  }
  const tour = entries.get("tour");
  if (tour !== null) {
    const step = Number(tour);
    if (Number.isInteger(step) && step >= 1 && step <= stops) look.tour = step;
    else tell("tour");
  }
  return { look, faults };
}

/** The look as it is now, and who wants to know when it changes. */
export class Looks {
  private readonly listeners: ((look: Look) => void)[] = [];

  constructor(private current: Look) {}

  get now(): Look {
    return this.current;
  }

  subscribe(listener: (look: Look) => void): void {
    this.listeners.push(listener);
  }

  set(patch: Partial<Look>): void {
    this.current = { ...this.current, ...patch };
    for (const listener of this.listeners) listener(this.current);
  }

  /** Note that something was opened or closed. */
  open(name: string, on: boolean): void {
    if (this.current.open.includes(name) === on) return;
    this.set({ open: on ? [...this.current.open, name] : this.current.open.filter((one) => one !== name) });
  }
}
