/** The controls: numbers with sliders, choices, presets and the engine's parameters; a problem stands at the control that caused it. */

import type { Named } from "./drawings";
import { limitsRow } from "./limits";
import { DEFAULTS, type NumberKey, type State, type StepKind } from "./state";
import type { Store } from "./store";

interface Spec {
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

const POINT: Spec[] = [
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
const GAINS: Spec[] = [
  { key: "kp", label: "kp", unit: "deg/(rad/s)", low: 0, high: 30, step: 0.001, least: 0.01 },
  { key: "ki", label: "ki", unit: "deg/(rad/s)/s", low: 0, high: 300, step: 0.001, least: 0.05 },
  { key: "kd", label: "kd", unit: "deg/(rad/s²)", low: 0, high: 1, step: 0.0001, least: 0.001 },
];
const STEP: Spec[] = [
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

const POSITIONS = 1000;

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

const ENGINES: Record<string, string> = {
  lee1995: "Lee (1995)",
  "lee1995-generic": "generic efficiency",
};

/** A value some steps further: by the control's step, or where its way is divided by powers of ten by a hundredth of its size. */
export function stepped(value: number, steps: number, spec: Pick<Spec, "step" | "least">): number {
  const size = spec.least ? 10 ** Math.floor(Math.log10(Math.max(Math.abs(value), 10 * spec.least)) - 1) : spec.step;
  return Number((value + steps * size).toPrecision(6));
}

export interface Parameter {
  key: string;
  section: string;
  name: string;
  unit: string;
  meaning: string;
  source: string;
  value: number;
  low: number;
  high: number;
}

interface Row {
  element: HTMLElement;
  update: (state: State) => void;
}

export class Controls {
  private readonly rows: Row[] = [];
  private readonly faults = new Map<string, HTMLElement>();

  constructor(
    private readonly form: HTMLElement,
    private readonly store: Store,
  ) {
    form.addEventListener("submit", (event) => event.preventDefault());
    const point = this.group("Operating point");
    point.append(this.known());
    for (const spec of POINT) point.append(this.number(spec));
    const gains = this.group("Controller");
    gains.append(this.presets());
    for (const spec of GAINS) gains.append(this.number(spec));
    const limits = limitsRow(store, (key) => this.fault(key));
    gains.append(limits.element);
    this.rows.push({ element: limits.element, update: (state) => limits.update(state, this.ownLimit(state)) });
    const step = this.group("Step at time 0");
    step.append(this.kinds());
    for (const spec of STEP) step.append(this.number(spec));
    store.subscribe((state) => this.update(state));
  }

  /** The operating point found last. */
  point: { throttle_deg: number; speed_rad_s: number } | undefined;
  private readonly presetBox = document.createElement("p");
  /** The engine's parameters, which can be opened and closed. */
  readonly engineBox = document.createElement("details");
  private engineRows: Row[] = [];
  private saturation: Parameter | undefined;

  update(state: State): void {
    for (const row of [...this.rows, ...this.engineRows]) row.update(state);
  }

  /** Where the engine itself limits its throttle, in deg. */
  private ownLimit(state: State): number | undefined {
    return this.saturation && (state.parameters[this.saturation.key] ?? this.saturation.value);
  }

  /** Put problems at the controls that caused them, and remarks where there is no problem; an empty key is no control's. */
  tell(problems: ReadonlyMap<string, string>, remarks: ReadonlyMap<string, string> = new Map()): void {
    for (const [key, element] of this.faults) {
      const problem = problems.get(key) ?? "";
      const text = problem || (remarks.get(key) ?? "");
      if (element.textContent !== text) element.textContent = text;
      element.hidden = text === "";
      element.classList.toggle("remark", problem === "");
      const input = document.getElementById(`${key}-number`);
      if (problem) input?.setAttribute("aria-invalid", "true");
      else input?.removeAttribute("aria-invalid");
    }
  }

  knows(key: string): boolean {
    return this.faults.has(key);
  }

  offer(controllers: readonly (Named & { what: string })[]): void {
    this.presetBox.replaceChildren(
      ...controllers.map((one) => {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = one.name;
        button.title = one.what;
        button.addEventListener("click", () => this.store.set({ kp: one.kp, ki: one.ki, kd: one.kd, step: "command" }));
        return button;
      }),
    );
  }

  /** Offer the engines and the parameters of the one shown. */
  engine(names: readonly string[], parameters: readonly Parameter[]): void {
    const box = this.engineBox;
    this.engineRows = [];
    this.saturation = parameters.find(({ name }) => name === "saturation angle");
    const title = document.createElement("summary");
    title.textContent = "Engine";
    const count = document.createElement("span");
    count.className = "count";
    title.append(" ", count);
    const reset = document.createElement("button");
    reset.type = "button";
    reset.textContent = "Reset the engine";
    reset.addEventListener("click", () => this.store.set({ parameters: {} }));
    box.replaceChildren(title, this.engines(names), reset);
    let section = "";
    for (const parameter of parameters) {
      if (parameter.section !== section) {
        section = parameter.section;
        const heading = document.createElement("h3");
        heading.textContent = section;
        box.append(heading);
      }
      box.append(this.parameter(parameter));
    }
    this.engineRows.push({
      element: box,
      update: (state) => {
        const changed = Object.keys(state.parameters).length;
        const which = state.engine === DEFAULTS.engine ? "" : `${ENGINES[state.engine] ?? state.engine}, `;
        count.textContent = which + (changed ? `${changed} changed` : "as published");
        reset.hidden = changed === 0;
      },
    });
    if (!box.isConnected) this.form.append(box);
    this.update(this.store.state);
  }

  private engines(names: readonly string[]): HTMLElement {
    const row = document.createElement("p");
    row.className = "kinds";
    const label = document.createElement("label");
    const select = document.createElement("select");
    select.id = "engine-choice";
    for (const name of names) select.append(new Option(ENGINES[name] ?? name, name));
    select.addEventListener("change", () => this.store.set({ engine: select.value, parameters: {} }));
    label.append("Built-in ", select);
    row.append(label);
    this.engineRows.push({
      element: row,
      update: (state) => {
        select.value = state.engine;
      },
    });
    return row;
  }

  private group(title: string): HTMLElement {
    const set = document.createElement("fieldset");
    const legend = document.createElement("legend");
    legend.textContent = title;
    set.append(legend);
    this.form.append(set);
    return set;
  }

  private number(spec: Spec): HTMLElement {
    const { row, slider, field } = this.pair(spec.key, spec.label, spec.unit);
    const set = (value: number, done: boolean) => {
      this.store.move({ [spec.key]: value });
      if (done) this.store.settle();
    };
    slider.max = String(POSITIONS);
    slider.addEventListener("input", () => set(fromPosition(slider.valueAsNumber, spec), false));
    slider.addEventListener("change", () => this.store.settle());
    stepByKeys(field, (steps) => set(stepped(this.store.state[spec.key] ?? 0, steps, spec), true));
    field.addEventListener("change", () => {
      if (Number.isFinite(field.valueAsNumber)) set(field.valueAsNumber, true);
      else this.update(this.store.state);
    });
    const update = (state: State) => {
      const value = state[spec.key];
      row.hidden = spec.hidden?.(state) ?? false;
      if (value === undefined) return;
      show(slider, String(toPosition(value, spec)));
      slider.setAttribute("aria-valuetext", `${value} ${spec.unit}`);
      show(field, String(value));
      row.classList.toggle("changed", value !== DEFAULTS[spec.key]);
    };
    this.rows.push({ element: row, update });
    return row;
  }

  private parameter(parameter: Parameter): HTMLElement {
    const key = `parameters.${parameter.key}`;
    const { row, slider, field } = this.pair(key, parameter.name, parameter.unit);
    row.title = `${parameter.meaning}. ${parameter.source}`;
    slider.max = String(POSITIONS);
    const span = parameter.high - parameter.low;
    const set = (value: number, done: boolean) => {
      const { [parameter.key]: _, ...others } = this.store.state.parameters;
      this.store.move({ parameters: value === parameter.value ? others : { ...others, [parameter.key]: value } });
      if (done) this.store.settle();
    };
    slider.addEventListener("input", () => {
      const value = parameter.low + (span * slider.valueAsNumber) / POSITIONS;
      set(Number(value.toPrecision(4)), false);
    });
    slider.addEventListener("change", () => this.store.settle());
    stepByKeys(field, (steps) => {
      const value = this.store.state.parameters[parameter.key] ?? parameter.value;
      set(Number((value + (5 * steps * span) / POSITIONS).toPrecision(6)), true);
    });
    field.addEventListener("change", () => {
      if (Number.isFinite(field.valueAsNumber)) set(field.valueAsNumber, true);
      else this.update(this.store.state);
    });
    const reset = document.createElement("button");
    reset.type = "button";
    reset.textContent = "↺";
    reset.setAttribute("aria-label", `Reset ${parameter.name} to ${parameter.value}`);
    reset.addEventListener("click", () => set(parameter.value, true));
    row.append(reset);
    const update = (state: State) => {
      const value = state.parameters[parameter.key] ?? parameter.value;
      show(slider, String(Math.round((POSITIONS * (value - parameter.low)) / span)));
      slider.setAttribute("aria-valuetext", `${value} ${parameter.unit}`);
      show(field, String(Number(value.toPrecision(8))));
      const changed = parameter.key in state.parameters;
      row.classList.toggle("changed", changed);
      reset.hidden = !changed;
    };
    this.engineRows.push({ element: row, update });
    return row;
  }

  private fault(key: string): HTMLElement {
    const fault = document.createElement("p");
    fault.id = `${key}-fault`;
    fault.className = "fault";
    fault.setAttribute("role", "alert");
    fault.hidden = true;
    this.faults.set(key, fault);
    return fault;
  }

  private pair(key: string, label: string, unit: string) {
    const row = document.createElement("div");
    row.className = "control";
    const text = document.createElement("label");
    text.htmlFor = `${key}-number`;
    text.textContent = label;
    const units = document.createElement("span");
    units.className = "unit";
    units.id = `${key}-unit`;
    units.textContent = unit === "1" ? "" : unit;
    const slider = document.createElement("input");
    slider.type = "range";
    slider.min = "0";
    slider.id = `${key}-slider`;
    slider.setAttribute("aria-label", `${label}, slider`);
    const field = document.createElement("input");
    field.type = "number";
    field.step = "any";
    watchTyping(field);
    field.id = `${key}-number`;
    field.setAttribute("aria-describedby", `${key}-unit ${key}-fault`);
    row.append(text, field, units, slider, this.fault(key));
    return { row, slider, field };
  }

  /** The choice between a throttle angle and a speed; the other one of the same point takes its place. */
  private known(): HTMLElement {
    const row = document.createElement("p");
    row.className = "kinds";
    const kinds: [string, boolean][] = [
      ["throttle", false],
      ["speed", true],
    ];
    for (const [text, speed] of kinds) {
      const label = document.createElement("label");
      const input = document.createElement("input");
      input.type = "radio";
      input.name = "known";
      input.value = text;
      input.addEventListener("change", () => {
        const { throttle_deg = DEFAULTS.throttle_deg ?? 25, speed_rad_s = 240 } = this.point ?? {};
        if (speed) this.store.set({ speed_rad_s: Number(speed_rad_s.toFixed(1)) });
        else this.store.set({ throttle_deg: Number(throttle_deg.toFixed(1)) });
      });
      label.append(input, `by ${text}`);
      row.append(label);
      this.rows.push({
        element: label,
        update: (state) => {
          input.checked = (state.speed_rad_s !== undefined) === speed;
        },
      });
    }
    return row;
  }

  private kinds(): HTMLElement {
    const row = document.createElement("p");
    row.className = "kinds";
    const kinds: [StepKind, string][] = [
      ["command", "command"],
      ["load", "load"],
      ["throttle", "throttle, open loop"],
    ];
    for (const [kind, text] of kinds) {
      const label = document.createElement("label");
      const input = document.createElement("input");
      input.type = "radio";
      input.name = "step";
      input.value = kind;
      input.addEventListener("change", () => this.store.set({ step: kind }));
      label.append(input, text);
      row.append(label);
      this.rows.push({
        element: label,
        update: (state) => {
          input.checked = state.step === kind;
        },
      });
    }
    return row;
  }

  private presets(): HTMLElement {
    this.presetBox.className = "presets";
    return this.presetBox;
  }
}

/** Show a value in a field, but never in place of what is being typed. */
function show(input: HTMLInputElement, text: string): void {
  if (input.value !== text && !input.dataset.typing) input.value = text;
}

/** Note while something is typed, until it is taken or left. */
function watchTyping(field: HTMLInputElement): void {
  field.addEventListener("input", () => {
    field.dataset.typing = "yes";
  });
  for (const end of ["change", "blur"]) {
    field.addEventListener(end, () => {
      delete field.dataset.typing;
    });
  }
}

/** Let the arrow keys move a field as they move its slider: by the same small share of the way, ten times as much with Shift. */
function stepByKeys(field: HTMLInputElement, next: (steps: number) => void): void {
  field.addEventListener("keydown", (event) => {
    if (event.key !== "ArrowUp" && event.key !== "ArrowDown") return;
    event.preventDefault();
    delete field.dataset.typing;
    next((event.key === "ArrowUp" ? 1 : -1) * (event.shiftKey ? 10 : 1));
  });
}
