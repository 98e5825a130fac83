/** The engine: which built-in one, and its parameters, which can be opened and closed; what differs from the published is marked. */

import { fieldRow } from "./fields";
import { element } from "./parts";
import type { Remarks } from "./remarks";
import { POSITIONS } from "./scales";
import { DEFAULTS, type State } from "./state";
import type { Store } from "./store";

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

const NAMES: Record<string, string> = {
  lee1995: "Lee (1995)",
  "lee1995-generic": "generic efficiency",
};

export class EngineControls {
  readonly box = element("details");
  private updates: ((state: State) => void)[] = [];
  private saturation: Parameter | undefined;

  constructor(
    private readonly store: Store,
    private readonly remarks: Remarks,
  ) {}

  update(state: State): void {
    for (const update of this.updates) update(state);
  }

  /** Where the engine itself limits its throttle, in deg. */
  ownLimit(state: State): number | undefined {
    return this.saturation && (state.parameters[this.saturation.key] ?? this.saturation.value);
  }

  /** Offer the engines and the parameters of the one shown. */
  offer(names: readonly string[], parameters: readonly Parameter[]): void {
    this.updates = [];
    this.saturation = parameters.find(({ name }) => name === "saturation angle");
    const title = element("summary", { textContent: "Engine" });
    const count = element("span", { className: "count" });
    title.append(" ", count);
    const reset = element("button", { type: "button", textContent: "Reset the engine" });
    reset.addEventListener("click", () => {
      this.store.set({ parameters: {} });
      title.focus(); // the button is gone
    });
    this.box.replaceChildren(title, this.choice(names), reset);
    let section = "";
    for (const parameter of parameters) {
      if (parameter.section !== section)
        this.box.append(element("h2", { className: "section", textContent: parameter.section }));
      section = parameter.section;
      this.box.append(this.parameter(parameter));
    }
    this.updates.push((state) => {
      const changed = Object.keys(state.parameters).length;
      const which = state.engine === DEFAULTS.engine ? "" : `${NAMES[state.engine] ?? state.engine}, `;
      count.textContent = which + (changed ? `${changed} changed` : "as published");
      reset.hidden = changed === 0;
    });
  }

  private choice(names: readonly string[]): HTMLElement {
    const row = element("p", { className: "kinds" });
    const label = element("label");
    const select = element("select", { id: "engine-choice" });
    for (const name of names) select.append(new Option(NAMES[name] ?? name, name));
    select.addEventListener("change", () => this.store.set({ engine: select.value, parameters: {} }));
    label.append("Built-in ", select);
    row.append(label);
    this.updates.push((state) => {
      select.value = state.engine;
    });
    return row;
  }

  private parameter(parameter: Parameter): HTMLElement {
    const { key, low, high } = parameter;
    const { store } = this;
    const span = high - low;
    const valueIn = (state: State) => state.parameters[key] ?? parameter.value;
    const move = (value: number) => {
      const { [key]: _, ...others } = store.state.parameters;
      store.move({ parameters: value === parameter.value ? others : { ...others, [key]: value } });
    };
    const id = `parameters.${key}`;
    const { row, show } = fieldRow(
      {
        key: id,
        label: parameter.name,
        unit: parameter.unit,
        now: () => valueIn(store.state),
        position: (value) => Math.round((POSITIONS * (value - low)) / span),
        at: (position) => Number((low + (span * position) / POSITIONS).toPrecision(4)),
        text: (value) => String(Number(value.toPrecision(7))),
        step: (value, steps) => Number((value + (5 * steps * span) / POSITIONS).toPrecision(6)),
        move,
        settle: () => store.settle(),
      },
      this.remarks.place(id),
    );
    row.title = `${parameter.meaning}. ${parameter.source}`;
    const reset = element("button", { type: "button", textContent: "↺" });
    reset.setAttribute("aria-label", `Reset ${parameter.name} to ${parameter.value}`);
    reset.addEventListener("click", () => {
      move(parameter.value);
      store.settle();
      row.querySelector<HTMLInputElement>("input[type=number]")?.focus();
    });
    row.append(reset);
    this.updates.push((state) => {
      show(valueIn(state));
      const changed = key in state.parameters;
      row.classList.toggle("changed", changed);
      reset.hidden = !changed;
    });
    return row;
  }
}
