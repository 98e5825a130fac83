/** A plot whose point is moved by the arrow keys, as it is dragged by a pointer; what stands there is told in words. */

import { element } from "./parts";
import type { DragPhase } from "./plot";
import type { State } from "./state";

export interface Steering {
  /** What is moved, and how. */
  label: string;
  /** Its value along the first axis with its limits, and all of it in words. */
  tell: (state: State) => { now: number; low: number; high: number; text: string };
  /** What so many steps to the right and up make of it. */
  move: (state: State, right: number, up: number) => Partial<State>;
}

const KEYS: Record<string, readonly [number, number]> = {
  ArrowRight: [1, 0],
  ArrowLeft: [-1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

export class Handle {
  readonly element = element("div", { className: "handle", tabIndex: 0 });
  private state: State | undefined;

  constructor(
    private readonly steering: Steering,
    drag: (patch: Partial<State>, phase: DragPhase) => void,
  ) {
    const { element: box } = this;
    box.setAttribute("role", "slider");
    box.setAttribute("aria-label", steering.label);
    let held: Partial<State> | undefined;
    box.addEventListener("keydown", (event) => {
      const way = KEYS[event.key];
      if (!way || !this.state || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      const steps = event.shiftKey ? 10 : 1;
      held = steering.move(this.state, steps * way[0], steps * way[1]);
      drag(held, "move");
    });
    // A key that is held makes one step of undo, as a drag does.
    const end = () => {
      if (held) drag(held, "end");
      held = undefined;
    };
    box.addEventListener("keyup", (event) => {
      if (event.key in KEYS) end();
    });
    box.addEventListener("blur", end);
  }

  show(state: State): void {
    this.state = state;
    const { now, low, high, text } = this.steering.tell(state);
    const said = { valuenow: now, valuemin: Math.min(low, now), valuemax: Math.max(high, now), valuetext: text };
    for (const [name, value] of Object.entries(said)) {
      if (this.element.getAttribute(`aria-${name}`) !== String(value)) {
        this.element.setAttribute(`aria-${name}`, String(value));
      }
    }
  }
}
