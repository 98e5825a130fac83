/** The guided tour: the thesis of Lee (1995) in eight states of the page. */

import { DEFAULTS, type State } from "./state";
import type { Store } from "./store";

export interface Stop {
  title: string;
  text: string;
  look: string[];
  state: Partial<State>;
}

const C1 = { kp: 2.15361, ki: 16.8546, kd: 0 };
const C2 = { kp: 20, ki: 98.3774, kd: 0.4 };
const C2D = { kp: 1.2, ki: 2.16754, kd: 0.1 };

export const STOPS: readonly Stop[] = [
  {
    title: "An engine answers late",
    text: "Air fills the manifold, and torque appears a crank angle after the intake: 22.8 ms at 25 deg. Here the throttle opens by 5 deg; nothing controls the speed. Move the throttle and watch how the delay and the gain change.",
    look: ["speed", "throttle"],
    state: { step: "throttle", throttle_step_deg: 5, until_s: 3 },
  },
  {
    title: "Where a straight line holds",
    text: "Each throttle angle has its steady speed. The thick line is the widest range about the operating point in which a straight line errs by no more than 1 %. Drag the point along the map.",
    look: ["map"],
    state: { step: "throttle", throttle_step_deg: 5, until_s: 3 },
  },
  {
    title: "The frequency response",
    text: "Sinusoids on the throttle, 5 deg about 25 deg. Harmonic balance answers on the nonlinear engine, with its distortion; the exact linear model, delay included, lies on top of it. The phase falls without end: that is the delay.",
    look: ["magnitude", "phase", "phase-error"],
    state: { ...C2D },
  },
  {
    title: "One lag is a poor model",
    text: "The first-order model meets the magnitude at low frequency and misses the phase. A controller designed on it, C1, settles on its model with 7.7 % overshoot: the dotted line in the answer in time.",
    look: ["phase", "phase-error", "speed"],
    state: { ...C1, command_rad_s: 60 },
  },
  {
    title: "On the engine, C1 hunts",
    text: "The same controller on the nonlinear engine ends in a limit cycle, its throttle swinging by more than 40 deg. The exact loop is unstable: its gain is 4.8 dB too high. No linear model without the delay could tell.",
    look: ["speed", "throttle", "plane"],
    state: { ...C1, command_rad_s: 60, until_s: 5 },
  },
  {
    title: "A second lag promises any gain",
    text: "The second-order model fits better and is believed more: without delay it promises stability at any gain. C2 uses it, with kp = 20, almost five times too high. The engine hunts again, faster.",
    look: ["numbers", "speed"],
    state: { ...C2, command_rad_s: 60, until_s: 3 },
  },
  {
    title: "With the delay, design holds",
    text: "The second-order model with the delay of the phase line, 21.4 ms, sees the limit. C2d is designed on it and settles on model and engine alike. Its gain margin is 3.5 dB: it would not bear much more.",
    look: ["speed", "numbers"],
    state: { ...C2D, command_rad_s: 60, until_s: 3 },
  },
  {
    title: "All gains at once",
    text: "The shaded area holds every kp and ki that stabilise the exact loop at this kd; its edge is exact. C1 is faint here: it has another kd, at which it lies outside. Click or drag in it to choose gains, then move throttle or load: the area changes, and gains must hold everywhere the engine runs.",
    look: ["plane"],
    state: { kp: 0.6, ki: 3, kd: 0.03, command_rad_s: 60, until_s: 3 },
  },
];

export class Tour {
  private at = -1;
  private before: State | undefined;

  constructor(
    private readonly panel: HTMLElement,
    private readonly store: Store,
    private readonly told: (step: number) => void = () => {},
  ) {
    panel.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.leave();
      if (event.key === "ArrowRight") this.go(this.at + 1);
      if (event.key === "ArrowLeft") this.go(this.at - 1);
    });
  }

  start(): void {
    this.before ??= this.store.state;
    this.go(0);
  }

  go(at: number): void {
    const stop = STOPS[at];
    if (at >= STOPS.length) this.leave();
    if (!stop) return;
    this.show(at, stop);
    this.store.replace({ ...DEFAULTS, ...stop.state });
  }

  /** Go on where a link stands, with the state that it shows. */
  resume(step: number): void {
    const stop = STOPS[step - 1];
    if (!stop) return;
    this.before ??= DEFAULTS;
    this.show(step - 1, stop);
  }

  private show(at: number, stop: Stop): void {
    this.at = at;
    this.told(at + 1);
    for (const figure of document.querySelectorAll(".plot")) {
      figure.classList.toggle("looked-at", stop.look.includes(figure.id));
    }
    const title = Object.assign(document.createElement("h2"), {
      textContent: `${at + 1} of ${STOPS.length}: ${stop.title}`,
    });
    title.tabIndex = -1;
    const text = Object.assign(document.createElement("p"), { textContent: stop.text });
    const steps = document.createElement("p");
    const last = at === STOPS.length - 1;
    steps.append(
      button("Back", () => this.go(at - 1), at === 0),
      button(last ? "Finish" : "Next", () => this.go(at + 1)),
      button("Leave the tour", () => this.leave()),
    );
    this.panel.replaceChildren(title, text, steps);
    this.panel.hidden = false;
    title.focus({ preventScroll: true });
  }

  leave(): void {
    this.panel.hidden = true;
    this.at = -1;
    this.told(0);
    for (const figure of document.querySelectorAll(".looked-at")) figure.classList.remove("looked-at");
    if (this.before) this.store.replace(this.before);
    this.before = undefined;
    document.getElementById("tour")?.focus();
  }
}

function button(text: string, act: () => void, disabled = false): HTMLButtonElement {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: text, disabled });
  made.addEventListener("click", act);
  return made;
}
