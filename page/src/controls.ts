/** The controls: operating point, controller and step, and the engine below them; each writes into the store and shows what stands there. */

import { EngineControls, type Parameter } from "./engine";
import { fieldRow } from "./fields";
import { limitsRow } from "./limits";
import { element } from "./parts";
import { Remarks } from "./remarks";
import { fromPosition, GAINS, POINT, type Spec, STEP, stepped, toPosition } from "./scales";
import type { Named } from "./stability";
import { DEFAULTS, type State, type StepKind } from "./state";
import type { Store } from "./store";

export class Controls {
  readonly remarks = new Remarks();
  readonly engine: EngineControls;
  /** The operating point found last. */
  point: { throttle_deg: number; speed_rad_s: number } | undefined;
  private readonly updates: ((state: State) => void)[] = [];
  private readonly presets = element("p", { className: "presets" });

  constructor(
    private readonly form: HTMLElement,
    private readonly store: Store,
  ) {
    form.addEventListener("submit", (event) => event.preventDefault());
    this.engine = new EngineControls(store, this.remarks);
    const limits = limitsRow(store, (key) => this.remarks.place(key));
    this.updates.push((state) => limits.update(state, this.engine.ownLimit(state)));
    form.append(
      group("Operating point", this.known(), ...POINT.map((spec) => this.number(spec))),
      group("Controller", this.presets, ...Object.values(GAINS).map((spec) => this.number(spec)), limits.element),
      group("Step at time 0", this.kinds(), ...STEP.map((spec) => this.number(spec))),
    );
    store.subscribe((state) => this.update(state));
  }

  update(state: State): void {
    for (const update of this.updates) update(state);
    this.engine.update(state);
  }

  /** Offer controllers to choose from. */
  offer(controllers: readonly (Named & { what: string })[]): void {
    this.presets.replaceChildren(
      ...controllers.map(({ name, what, kp, ki, kd }) => {
        const button = element("button", { type: "button", textContent: name, title: what });
        button.addEventListener("click", () => this.store.set({ kp, ki, kd, step: "command" }));
        return button;
      }),
    );
  }

  /** Offer the engines and the parameters of the one shown. */
  offerEngines(names: readonly string[], parameters: readonly Parameter[]): void {
    this.engine.offer(names, parameters);
    if (!this.engine.box.isConnected) this.form.append(this.engine.box);
    this.update(this.store.state);
  }

  private number(spec: Spec): HTMLElement {
    const { key, label, unit } = spec;
    const { store } = this;
    const { row, show } = fieldRow(
      {
        key,
        label,
        unit,
        now: () => store.state[key],
        position: (value) => toPosition(value, spec),
        at: (position) => fromPosition(position, spec),
        text: String,
        step: (value, steps) => stepped(value, steps, spec),
        move: (value) => store.move({ [key]: value }),
        settle: () => store.settle(),
      },
      this.remarks.place(key),
    );
    this.updates.push((state) => {
      const value = state[key];
      row.hidden = spec.hidden?.(state) ?? false;
      if (value === undefined) return;
      show(value);
      row.classList.toggle("changed", value !== DEFAULTS[key]);
    });
    return row;
  }

  /** The choice between a throttle angle and a speed; the other one of the same point takes its place. */
  private known(): HTMLElement {
    return this.choice("known", [
      {
        value: "throttle",
        text: "by throttle",
        chosen: (state) => state.speed_rad_s === undefined,
        choose: () => {
          const { throttle_deg = DEFAULTS.throttle_deg ?? 25 } = this.point ?? {};
          this.store.set({ throttle_deg: Number(throttle_deg.toFixed(1)) });
        },
      },
      {
        value: "speed",
        text: "by speed",
        chosen: (state) => state.speed_rad_s !== undefined,
        choose: () => {
          const { speed_rad_s = 240 } = this.point ?? {};
          this.store.set({ speed_rad_s: Number(speed_rad_s.toFixed(1)) });
        },
      },
    ]);
  }

  private kinds(): HTMLElement {
    const kinds: [StepKind, string][] = [
      ["command", "command"],
      ["load", "load"],
      ["throttle", "throttle, open loop"],
    ];
    const choices = kinds.map(([value, text]) => ({
      value,
      text,
      chosen: (state: State) => state.step === value,
      choose: () => this.store.set({ step: value }),
    }));
    return this.choice("step", choices);
  }

  private choice(name: string, choices: readonly Choice[]): HTMLElement {
    const row = element("p", { className: "kinds" });
    for (const { value, text, chosen, choose } of choices) {
      const input = element("input", { type: "radio", name, value });
      input.addEventListener("change", choose);
      const label = element("label");
      label.append(input, text);
      row.append(label);
      this.updates.push((state) => {
        input.checked = chosen(state);
      });
    }
    return row;
  }
}

interface Choice {
  value: string;
  text: string;
  chosen: (state: State) => boolean;
  choose: () => void;
}

function group(title: string, ...rows: readonly HTMLElement[]): HTMLElement {
  const set = element("fieldset");
  set.append(element("legend", { textContent: title }), ...rows);
  return set;
}
