/** A number with its slider, as a row of the controls: typed, dragged, or moved by the arrow keys. */

import { element } from "./parts";
import { POSITIONS } from "./scales";

export interface Field {
  key: string;
  label: string;
  unit: string;
  /** The value as it stands; none where another takes its place. */
  now: () => number | undefined;
  /** Where a value stands on the slider, and the value at a place of it. */
  position: (value: number) => number;
  at: (position: number) => number;
  /** How a value is written. */
  text: (value: number) => string;
  /** A value some steps further, for the arrow keys. */
  step: (value: number, steps: number) => number;
  move: (value: number) => void;
  settle: () => void;
}

export interface FieldRow {
  row: HTMLElement;
  /** Show a value, but never in place of what is being typed. */
  show: (value: number) => void;
}

/** Make the row of a number; `fault` is where its problems are told. */
export function fieldRow(field: Field, fault: HTMLElement): FieldRow {
  const { key, label, unit } = field;
  const row = element("div", { className: "control" });
  const slider = element("input", { type: "range", min: "0", max: String(POSITIONS), id: `${key}-slider` });
  slider.setAttribute("aria-label", `${label}, slider`);
  const input = element("input", { type: "number", step: "any", id: `${key}-number` });
  input.setAttribute("aria-describedby", `${key}-unit ${key}-fault`);
  watchTyping(input);
  row.append(
    element("label", { htmlFor: input.id, textContent: label }),
    input,
    element("span", { className: "unit", id: `${key}-unit`, textContent: unit === "1" ? "" : unit }),
    slider,
    fault,
  );
  const show = (value: number) => {
    write(slider, String(field.position(value)));
    slider.setAttribute("aria-valuetext", `${value} ${unit}`);
    write(input, field.text(value));
  };
  const set = (value: number) => {
    field.move(value);
    field.settle();
  };
  slider.addEventListener("input", () => field.move(field.at(slider.valueAsNumber)));
  slider.addEventListener("change", () => field.settle());
  stepByKeys(input, (steps) => set(field.step(field.now() ?? 0, steps)));
  input.addEventListener("change", () => {
    const now = field.now();
    if (Number.isFinite(input.valueAsNumber)) set(input.valueAsNumber);
    else if (now !== undefined) show(now);
  });
  return { row, show };
}

function write(input: HTMLInputElement, text: string): void {
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
