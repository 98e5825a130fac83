/** The throttle's limits: two numbers in one row; where one is empty, the engine's own holds. */

import { element } from "./parts";
import type { State } from "./state";
import type { Store } from "./store";

type Limit = "low_deg" | "high_deg";

export interface LimitsRow {
  element: HTMLElement;
  /** Show the limits of a state; `own` is the engine's upper one. */
  update: (state: State, own: number | undefined) => void;
}

export function limitsRow(store: Store, fault: (key: string) => HTMLElement): LimitsRow {
  const row = element("div", { className: "control limits" });
  row.setAttribute("role", "group");
  row.setAttribute("aria-label", "Limits of the throttle");
  const reset = element("button", {
    type: "button",
    className: "small",
    textContent: "↺",
    title: "The engine's own limits",
  });
  reset.setAttribute("aria-label", "Reset the limits to the engine's own");
  reset.addEventListener("click", () => {
    store.replace(without(without(store.state, "low_deg"), "high_deg"));
    low.focus();
  });
  const low = field(store, "low_deg", "Lower");
  const high = field(store, "high_deg", "Upper");
  const unit = element("span", { className: "unit", textContent: "deg" });
  row.append(
    element("span", { textContent: "Limits" }),
    low,
    "to",
    high,
    unit,
    reset,
    fault("low_deg"),
    fault("high_deg"),
  );
  const update = (state: State, own: number | undefined) => {
    for (const [input, value] of [[low, state.low_deg] as const, [high, state.high_deg] as const]) {
      const text = value === undefined ? "" : String(value);
      if (input.value !== text && (document.activeElement !== input || input.value !== input.dataset.typed))
        input.value = text;
    }
    low.placeholder = "0";
    high.placeholder = own === undefined ? "" : String(own);
    const changed = state.low_deg !== undefined || state.high_deg !== undefined;
    row.classList.toggle("changed", changed);
    reset.hidden = !changed;
  };
  return { element: row, update };
}

function without(state: State, key: Limit): State {
  const { [key]: _, ...rest } = state;
  return rest;
}

function field(store: Store, key: Limit, which: string): HTMLInputElement {
  const input = element("input", { type: "number", step: "any", min: "0", max: "90", id: `${key}-number` });
  input.setAttribute("aria-label", `${which} limit of the throttle in deg, the engine's own where empty`);
  input.setAttribute("aria-describedby", `${key}-fault`);
  input.addEventListener("input", () => {
    input.dataset.typed = input.value;
  });
  input.addEventListener("change", () => {
    delete input.dataset.typed;
    if (Number.isFinite(input.valueAsNumber)) store.set({ [key]: input.valueAsNumber });
    else store.replace(without(store.state, key));
  });
  return input;
}
