/** The server's view of a state: one request in flight, the newest state next, stale answers dropped. */

import type { State } from "./state";

export interface Problem {
  type?: string;
  title: string;
  detail: string;
  status: number;
  control?: string;
}

export interface Curve {
  frequency_rad_s: number[];
  magnitude_db: number[];
  phase_deg: number[];
}

export interface Trace {
  time_s: number[];
  speed_rad_s: number[];
  throttle_deg: number[];
  stable?: boolean;
  overshoot?: number;
}

export interface Promise_ {
  stable: boolean;
  gain_margin_db?: number;
  phase_margin_deg?: number;
  delay_margin_s?: number;
  ms?: number;
}

type OrProblem<T> = T | { problem: Problem | string };
export type Pair = [number, number];
export type PerModel<T> = Record<string, OrProblem<T>>;

export interface Parts {
  point: OrProblem<{
    throttle_deg: number;
    speed_rad_s: number;
    speed_rpm: number;
    pressure_kpa: number;
    stable: boolean;
    gain_rad_s_per_deg: number;
    rightmost_roots_rad_s: Pair[];
    lags_s: Record<string, number>;
  }>;
  response: OrProblem<{
    exact: OrProblem<Curve>;
    harmonic_balance: OrProblem<Curve & { distortion: number[]; notes: string[] }>;
  }>;
  models: OrProblem<
    Record<
      string,
      {
        numerator: number[];
        denominator: number[];
        delay_s: number;
        accepted: boolean;
        verdict: string;
        /** Why the data do not determine it; empty where they do. */
        undetermined: string[];
        curve: Curve;
        errors: { frequency_rad_s: number[]; magnitude_db: number[]; phase_deg: number[] };
      }
    >
  >;
  roots: OrProblem<{ plant: Pair[]; models: Record<string, { poles: Pair[]; closed?: Pair[] }> }>;
  gains: OrProblem<{
    kd: number;
    window: { kp_low: number; kp_high: number; ki_high: number };
    boundary: { kp: number[]; ki: number[] }[];
    shade: string[];
  }>;
  margins: OrProblem<
    Promise_ & {
      no_control?: boolean;
      gain_crossovers: { frequency_rad_s: number; phase_margin_deg: number }[];
      gain_reduction_margin_db?: number;
      mt: number;
      disk_margin: number;
    }
  >;
  loop_roots: OrProblem<{ roots_rad_s: Pair[] }>;
  promises: OrProblem<PerModel<Promise_>>;
  loop: OrProblem<
    Trace & {
      outcome?: string;
      summary?: string;
      undecided?: string;
      ended?: string;
      still_moving?: boolean;
      limits_deg?: Pair;
      settling_time_s?: number;
      saturated_share?: number;
      droop_rad_s?: number;
      droop_at_s?: number;
      iae_rad?: number;
      limit_cycle?: { low_rad_s: number; high_rad_s: number; period_s: number };
    }
  >;
  answers: OrProblem<PerModel<Trace>>;
  map: OrProblem<{
    throttle_deg: number[];
    speed_rad_s: number[];
    stable: boolean[];
    no_line?: string;
    line?: {
      low_deg: number;
      high_deg: number;
      slope_rad_s_per_deg: number;
      intercept_rad_s: number;
      max_error_rad_s: number;
    };
  }>;
  contours: OrProblem<{ contours: { ms: number; pieces?: { kp: number[]; ki: number[] }[]; none?: string }[] }>;
  peaks: OrProblem<Curve & { distortion: number[]; missing?: string }>;
  cycle: OrProblem<Record<string, unknown>>;
  validity: OrProblem<{ warnings: string[] }>;
  words: { verdict: string; lines: string[] };
}

export interface Job {
  id: string;
  kind: "study" | "sinestream";
  status: "queued" | "running" | "done" | "failed" | "cancelled" | "interrupted";
  created: string;
  revision: number;
  progress: number;
  stage: string;
  seconds: number;
  remaining_s?: number;
  files: string[];
  error?: { detail: string };
}

export type PartName = keyof Parts;
export type Found = Partial<Parts>;

export const LIVE: PartName[] = [
  "point",
  "response",
  "models",
  "roots",
  "gains",
  "margins",
  "loop_roots",
  "promises",
  "loop",
  "answers",
  "words",
];

/** No answer, or none that can be read; `soon` where asking again at once may help. */
export class Lost extends Error {
  constructor(
    message: string,
    readonly soon = false,
  ) {
    super(message);
  }
}
export class Refused extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
  }
}

const CLIENT = Array.from(crypto.getRandomValues(new Uint8Array(9)), (n) => n.toString(36)).join("");

/** Parts of a view, and the names of those that the server left for later because many ask at once. */
export interface View {
  parts: Found;
  later: PartName[];
}

/** Ask for parts of a view; `line` names what the newest of displaces what waits, on this page alone. */
export async function fetchView(state: State, parts: PartName[], line = ""): Promise<View> {
  const answer = await post("/api/v1/view", { state, parts, whole: false }, CLIENT + line);
  const view = await read<Partial<View> | null>(answer.json());
  if (!view?.parts) throw cutOff();
  return { parts: view.parts, later: view.later ?? [] };
}

/** Ask for a text, such as a study file. */
export async function fetchText(path: string, state: State): Promise<string> {
  return read((await post(path, { state }, CLIENT)).text());
}

/** Send a file of the user's own. */
export async function sendFile<T>(file: File, kind: string, state: State): Promise<T> {
  const query = new URLSearchParams({ name: file.name.slice(0, 80), state: JSON.stringify(state) });
  const headers = { "content-type": kind === "engine" ? "application/toml" : "text/csv" };
  const answer = await send(`/api/v1/files/${kind}?${query}`, { method: "POST", headers, body: file });
  return read(answer.json());
}

/** Ask for a job. */
export async function startJob(kind: Job["kind"], state: State): Promise<Job> {
  return read((await post("/api/v1/jobs", { kind, state }, CLIENT)).json());
}

/** Change a job, as it was when it was listed: the server refuses where another page changed it since. */
export async function changeJob(job: Job, what: "cancel" | "resume" | "delete"): Promise<void> {
  const path = `/api/v1/jobs/${encodeURIComponent(job.id)}`;
  const headers = { "if-match": `"${job.revision}"` };
  if (what === "delete") await send(path, { method: "DELETE", headers });
  else await send(`${path}/${what}`, { method: "POST", headers });
}

export async function fetchJson<T>(path: string): Promise<T> {
  return read((await send(path, {})).json());
}

/** Read what an answer holds; one that ends before its end is lost. */
async function read<T>(content: Promise<T>): Promise<T> {
  try {
    return await content;
  } catch {
    throw cutOff();
  }
}

function cutOff(): Lost {
  return new Lost("The server's answer was cut off", true);
}

function post(path: string, body: unknown, client: string): Promise<Response> {
  const headers = { "content-type": "application/json", "x-client": client };
  return send(path, { method: "POST", headers, body: JSON.stringify(body) });
}

async function send(path: string, options: RequestInit): Promise<Response> {
  let answer: Response;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Lost("The server does not answer");
  }
  if (answer.ok) return answer;
  let problem: Problem;
  try {
    problem = (await answer.json()) as Problem;
  } catch {
    throw new Lost(`The server answers ${answer.status}`);
  }
  throw new Refused(problem);
}

export function isProblem(part: unknown): part is { problem: Problem | string } {
  return typeof part === "object" && part !== null && "problem" in part;
}

/** Keeps one request in flight, and sends the newest state when it returns; an answer to an older state is still newer than what is shown. */
export class Follower<Asked, Answer> {
  private waiting: Asked | undefined;
  private running = false;

  constructor(
    private readonly ask: (asked: Asked) => Promise<Answer>,
    private readonly show: (answer: Answer, asked: Asked) => void,
    private readonly fail: (error: unknown, asked: Asked) => void,
  ) {}

  get busy(): boolean {
    return this.running;
  }

  follow(asked: Asked): void {
    this.waiting = asked;
    if (!this.running) void this.run();
  }

  private async run(): Promise<void> {
    this.running = true;
    while (this.waiting !== undefined) {
      const asked = this.waiting;
      this.waiting = undefined;
      try {
        this.show(await this.ask(asked), asked);
      } catch (error) {
        try {
          this.fail(error, asked);
        } catch (fault) {
          reportError(fault); // what follows is asked for all the same
        }
      }
    }
    this.running = false;
  }
}
