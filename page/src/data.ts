/** A user's own files: a frequency response, a recorded log or an engine; checked by the server, shown here, kept nowhere. */

import { type Curve, isProblem, Lost, type Problem, Refused } from "./api";
import { COLORS } from "./colors";
import { DASHES, NAMES, rangeOf } from "./curves";
import type { Line } from "./drawing";
import { showNumber } from "./export";
import { element } from "./parts";
import { Plot } from "./plot";
import type { Own } from "./responses";
import type { State } from "./state";

export type FileKind = "response" | "log" | "engine";
type OrProblem<T> = T | { problem: Problem };

interface Played {
  time_s: number[];
  speed_rad_s: number[];
  rms_error_rad_s: number;
  max_error_rad_s: number;
}

interface Difference {
  max_magnitude_difference_db: number;
  max_phase_difference_deg: number;
}

type Fitted = Record<
  string,
  OrProblem<{ max_magnitude_error_db: number; max_phase_error_deg: number; delay_s: number; undetermined: string[] }>
>;
type Compared = OrProblem<{ exact: Difference; harmonic_balance: OrProblem<Difference> }>;

export interface ResponseAnswer {
  kind: "response";
  name: string;
  response: Curve;
  notes: string[];
  models: Fitted;
  engine: Compared;
}

export interface LogAnswer {
  kind: "log";
  name: string;
  duration_s: number;
  samples: number;
  log: { time_s: number[]; speed_rad_s: number[]; throttle_deg: number[] };
  engine: OrProblem<Played>;
  exact: OrProblem<Played>;
  models: Record<string, OrProblem<Played>>;
  response: OrProblem<
    Curve & {
      models: Fitted;
      engine: Compared;
      /** Of each value: standard deviation, and a bound of what is not random, as parts of it. */
      relative_deviation: number[];
      relative_bias: number[];
      between_samples: string;
      /** Whether that was said, or to be seen. */
      between_samples_known: boolean;
      /** How many frequencies more were looked at and told nothing that can be trusted. */
      left_out: number;
      remark?: string;
    }
  >;
  notes: string[];
}

type Told = Exclude<LogAnswer["response"], { problem: Problem }>;

export interface EngineAnswer {
  kind: "engine";
  name: string;
  changes: { key: string; unit: string; value: number; built_in: number }[];
  state: { engine: string; parameters: Record<string, number> };
}

export type FileAnswer = ResponseAnswer | LogAnswer | EngineAnswer;

export interface DataCalls {
  send: (file: File, kind: FileKind) => Promise<FileAnswer>;
  curve: (curve: Own | undefined) => void;
  engine: (state: Partial<State>) => void;
  opened: (on: boolean) => void;
}

const LARGEST = 5_000_000;

/** Tell by its name and beginning what a file is. */
export function kindOf(name: string, beginning: string): FileKind | undefined {
  if (/\.toml$/i.test(name)) return "engine";
  const header = beginning.split(/\r?\n/).find((line) => line.trim() !== "" && !line.startsWith("#")) ?? "";
  if (/(^|[,;\t])\s*"?time/i.test(header)) return "log";
  if (/freq|omega|rad_s|hz/i.test(header)) return "response";
  return undefined;
}

function fittedLines(models: Fitted): string[] {
  return Object.entries(models).map(([name, fit]) => {
    const title = NAMES[name] ?? name;
    if (isProblem(fit)) return `${title}: ${(fit as { problem: Problem }).problem.detail}`;
    const delay = fit.delay_s ? `, delay ${showNumber(1000 * fit.delay_s, 4)} ms` : "";
    const doubt = fit.undetermined.length > 0 ? `; the data do not determine it: ${fit.undetermined.join("; ")}` : "";
    return `${title} fitted: off by at most ${showNumber(fit.max_magnitude_error_db, 3)} dB and ${showNumber(fit.max_phase_error_deg, 3)} deg${delay}${doubt}`;
  });
}

function comparedLines(engine: Compared): string[] {
  if (isProblem(engine)) return [`not compared with the engine: ${(engine as { problem: Problem }).problem.detail}`];
  const line = (what: string, one: OrProblem<Difference>) =>
    isProblem(one)
      ? `${what}: ${(one as { problem: Problem }).problem.detail}`
      : `${what}: differs by at most ${showNumber(one.max_magnitude_difference_db, 3)} dB and ${showNumber(one.max_phase_difference_deg, 3)} deg`;
  return [line("exact linear engine", engine.exact), line("engine at this amplitude", engine.harmonic_balance)];
}

/** What is said of the response that a log tells, and of how far it can be trusted. */
function toldLines(told: Told): string[] {
  const most = (parts: number[]) => `${showNumber(100 * Math.max(0, ...parts), 2)} %`;
  const trust = `standard deviation at most ${most(told.relative_deviation)}, not random at most ${most(told.relative_bias)}`;
  const without = "had too little coherence or input, or too large a bound of what is not random";
  return [
    `its response: ${told.frequency_rad_s.length} frequencies; ${trust}`,
    ...(told.left_out > 0 ? [`${told.left_out} more frequencies are left out: they ${without}`] : []),
    `throttle between the samples: ${told.between_samples}`,
    ...(told.remark ? [told.remark] : []),
    ...comparedLines(told.engine),
    ...fittedLines(told.models),
  ];
}

/** The response that a log tells, for drawing, with what was assumed to find it. */
export function ownOf({ response }: LogAnswer): Own | undefined {
  if (isProblem(response)) return undefined;
  const {
    frequency_rad_s,
    magnitude_db,
    phase_deg,
    between_samples: course,
    between_samples_known: known,
  } = response as Told;
  const note = known ? {} : { note: `own data: throttle taken as ${course} between samples` };
  return { frequency_rad_s, magnitude_db, phase_deg, ...note };
}

/** What is said of a file, a line each. */
export function linesOf(answer: FileAnswer): string[] {
  if (answer.kind === "response") {
    const count = `${answer.response.frequency_rad_s.length} frequencies; shown as dots in magnitude and phase`;
    return [count, ...comparedLines(answer.engine), ...fittedLines(answer.models), ...answer.notes];
  }
  if (answer.kind === "engine") {
    if (answer.changes.length === 0) return [`${answer.name}: as published, nothing changed`];
    return answer.changes.map(({ key, value, built_in, unit }) => `${key} = ${value} ${unit} (published: ${built_in})`);
  }
  const played = (what: string, one: OrProblem<Played>) =>
    isProblem(one)
      ? `${what}: ${(one as { problem: Problem }).problem.detail}`
      : `${what}: rms error ${showNumber(one.rms_error_rad_s, 3)}, largest ${showNumber(one.max_error_rad_s, 3)} rad/s`;
  return [
    `${answer.samples} samples over ${showNumber(answer.duration_s, 4)} s`,
    played("nonlinear engine", answer.engine),
    played("exact linear engine", answer.exact),
    ...Object.entries(answer.models).map(([name, one]) => played(NAMES[name] ?? name, one)),
    ...(isProblem(answer.response)
      ? [`no response could be read from it: ${(answer.response as { problem: Problem }).problem.detail}`]
      : toldLines(answer.response)),
    ...answer.notes,
  ];
}

export class Data {
  private readonly told = element("p", { className: "fault" });
  private readonly shown = element("div");

  constructor(
    private readonly panel: HTMLDialogElement,
    opener: HTMLButtonElement,
    private readonly calls: DataCalls,
  ) {
    this.told.setAttribute("role", "alert");
    this.shown.setAttribute("aria-live", "polite");
    const input = element("input", { type: "file", id: "file", accept: ".csv,.toml,.txt" });
    const label = element("label", { htmlFor: "file", textContent: "A file from this machine: " });
    input.addEventListener("change", () => {
      const file = input.files?.[0];
      if (file) void this.take(file);
      input.value = "";
    });
    const close = element("button", { type: "button", textContent: "Close" });
    close.addEventListener("click", () => panel.close());
    const remove = element("button", { type: "button", textContent: "Take it off the plots" });
    remove.addEventListener("click", () => {
      calls.curve(undefined);
      this.shown.replaceChildren();
      this.told.textContent = "";
    });
    const row = element("p", { className: "row" });
    row.append(label, input, remove, close);
    const title = element("h2", { textContent: "Own data", id: "data-title" });
    const text = element("p", {
      textContent:
        "Choose or drop a frequency response (CSV), a recorded log (CSV with time_s, throttle_deg and a speed) or an engine (TOML). It is compared with the state shown and kept nowhere.",
    });
    panel.append(title, text, row, this.told, this.shown);
    panel.setAttribute("aria-labelledby", "data-title");
    opener.addEventListener("click", () => (panel.open ? panel.close() : this.open()));
    panel.addEventListener("keydown", (event) => {
      if (event.key === "Escape") panel.close();
    });
    panel.addEventListener("close", () => {
      opener.focus();
      calls.opened(false);
    });
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      const file = event.dataTransfer?.files[0];
      if (file) void this.take(file);
    });
  }

  open(): void {
    if (!this.panel.open) this.panel.show();
    this.calls.opened(true);
  }

  private async take(file: File): Promise<void> {
    this.open();
    this.told.textContent = "";
    if (file.size > LARGEST) {
      this.told.textContent = `${file.name} has ${(file.size / 1e6).toFixed(1)} MB; give 5 MB at most.`;
      return;
    }
    const kind = kindOf(file.name, await file.slice(0, 4096).text());
    if (!kind) {
      this.told.textContent = `${file.name} is no file known here: its first line names no frequency and no time. Give a CSV file with such a column, or an engine file ending in .toml.`;
      return;
    }
    try {
      this.show(await this.calls.send(file, kind));
    } catch (error) {
      if (!(error instanceof Refused || error instanceof Lost)) throw error;
      this.told.textContent = error.message;
    }
  }

  private show(answer: FileAnswer): void {
    const list = element("ul");
    list.append(...linesOf(answer).map((textContent) => element("li", { textContent })));
    this.shown.replaceChildren(element("h3", { textContent: `${answer.name} (${answer.kind})` }));
    if (answer.kind === "response") this.calls.curve(answer.response);
    if (answer.kind === "engine") this.calls.engine(answer.state);
    if (answer.kind === "log") {
      this.calls.curve(ownOf(answer));
      this.shown.append(logPlot(answer));
    }
    this.shown.append(list);
  }
}

/** All curves of a log, but no further off the record than three times what it moves: a model may run away. */
export function logRange(lines: readonly Line[], recorded: readonly number[]): number[] {
  const [low, high] = rangeOf(recorded, 2, 0);
  const room = 3 * (high - low);
  return lines.flatMap(({ y }) => y.map((value) => Math.min(high + room, Math.max(low - room, value))));
}

function logPlot(answer: LogAnswer): HTMLElement {
  const plot = new Plot({
    id: "log",
    title: "Recorded speed",
    x: { label: "time", unit: "s" },
    y: { label: "speed", unit: "rad/s" },
  });
  const lines: Line[] = [];
  const add = (label: string, color: string, one: OrProblem<Played>, dash?: number[]) => {
    if (isProblem(one)) return;
    lines.push({ label, color, x: one.time_s, y: one.speed_rad_s, ...(dash ? { dash } : {}) });
  };
  for (const [name, one] of Object.entries(answer.models))
    add(NAMES[name] ?? name, COLORS[name as "g1"], one, DASHES[name as "g1"]);
  add("exact", COLORS.exact, answer.exact, [9, 3]);
  add("engine", COLORS.engine, answer.engine);
  const { time_s: x, speed_rad_s: y } = answer.log;
  lines.push({ label: "recorded", color: COLORS.own, x, y, width: 2.2 });
  const drawing = {
    lines,
    x: [0, answer.duration_s] as [number, number],
    y: rangeOf(logRange(lines, y), 2, 0.05),
  };
  requestAnimationFrame(() => plot.show({ ...drawing, summary: linesOf(answer).join("; ") }));
  return plot.figure;
}
