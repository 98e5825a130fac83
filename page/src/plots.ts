/** The plots of the page: what each is called, what it is drawn from, and which are drawn again when something is new. */

import type { Found, PartName } from "./api";
import type { Drawing } from "./drawing";
import type { Seen } from "./following";
import { Reads } from "./needs";
import { type DragPhase, Plot, type PlotOptions } from "./plot";
import { problemOf, within } from "./problems";
import { drawBode, drawDistortion, drawErrors, type Own } from "./responses";
import { drawMap, drawTime } from "./running";
import { GAINS, stepped } from "./scales";
import { drawPlane, drawRoots, type Named } from "./stability";
import type { State } from "./state";
import { Handle, type Steering } from "./steer";

/** What is drawn beside the view: controllers that are known by name, and a response of the user's own. */
export interface Beside {
  controllers: readonly Named[];
  own: Own | undefined;
}

interface Kind {
  options: PlotOptions;
  draw: (found: Found, state: State, beside: Beside) => Drawing | undefined;
  parts: readonly PartName[];
  steering?: Steering;
}

interface Placed extends Kind {
  plot: Plot;
  handle?: Handle | undefined;
  /** What the drawing that is shown was made of. */
  from?: { found: Reads<Found>; state: Reads<State>; beside: Reads<Beside> } | undefined;
}

export type Drag = (patch: Partial<State>, phase: DragPhase) => void;

const frequency = { label: "frequency", unit: "rad/s", log: true };
const seconds = { label: "time", unit: "s" };

function throttleAt(angle: number): number {
  return Number(Math.min(Math.max(angle, 0.1), 90).toFixed(1));
}

function kinds(drag: Drag): Kind[] {
  return [
    {
      options: {
        id: "map",
        title: "Steady map",
        x: { label: "throttle", unit: "deg" },
        y: { label: "speed", unit: "rad/s" },
        hint: "Drag to move the operating point",
        drag: (x, _, phase) => drag({ throttle_deg: throttleAt(x) }, phase),
      },
      draw: drawMap,
      parts: ["map", "point"],
      steering: {
        label: "Operating point on the steady map, moved by the arrow keys, ten steps at once with Shift",
        tell: ({ throttle_deg: throttle, speed_rad_s: speed = 0 }) =>
          throttle === undefined
            ? { now: speed, low: 0, high: 1000, text: `speed ${speed} rad/s` }
            : { now: throttle, low: 0, high: 90, text: `throttle ${throttle} deg` },
        move: ({ throttle_deg: throttle, speed_rad_s: speed = 0 }, right, up) =>
          throttle === undefined
            ? { speed_rad_s: Number(Math.max(speed + right + up, 1).toFixed(1)) }
            : { throttle_deg: throttleAt(throttle + 0.1 * (right + up)) },
      },
    },
    {
      options: { id: "magnitude", title: "Magnitude", x: frequency, y: { label: "gain", unit: "dB" } },
      draw: (found, _, { own }) => drawBode(found, "magnitude_db", own),
      parts: ["response"],
    },
    {
      options: { id: "phase", title: "Phase", x: frequency, y: { label: "phase", unit: "deg" } },
      draw: (found, _, { own }) => drawBode(found, "phase_deg", own),
      parts: ["response"],
    },
    {
      options: {
        id: "plane",
        title: "Gains",
        x: { label: "kp", unit: "deg/(rad/s)" },
        y: { label: "ki", unit: "deg/(rad/s)/s" },
        hint: "Click or drag to choose kp and ki",
        drag: (x, y, phase) => drag({ kp: Number(x.toPrecision(3)), ki: Number(Math.max(y, 0).toPrecision(3)) }, phase),
      },
      draw: (found, state, { controllers }) => drawPlane(found, state, controllers),
      parts: ["gains"],
      steering: {
        label: "Gains kp (left, right) and ki (up, down), moved by the arrow keys, ten steps at once with Shift",
        tell: ({ kp, ki }) => ({ now: kp, low: 0, high: 30, text: `kp ${kp}, ki ${ki}` }),
        move: ({ kp, ki }, right, up) => ({
          kp: stepped(kp, right, GAINS.kp),
          ki: Math.max(stepped(ki, up, GAINS.ki), 0),
        }),
      },
    },
    {
      options: { id: "magnitude-error", title: "Magnitude errors", x: frequency, y: { label: "error", unit: "dB" } },
      draw: (found) => drawErrors(found, "magnitude_db"),
      parts: ["models"],
    },
    {
      options: { id: "phase-error", title: "Phase errors", x: frequency, y: { label: "error", unit: "deg" } },
      draw: (found) => drawErrors(found, "phase_deg"),
      parts: ["models"],
    },
    {
      options: { id: "distortion", title: "Distortion", x: frequency, y: { label: "distortion", unit: "%" } },
      draw: drawDistortion,
      parts: ["response"],
    },
    {
      options: {
        id: "roots",
        title: "Roots",
        x: { label: "real", unit: "rad/s" },
        y: { label: "imaginary", unit: "rad/s" },
      },
      draw: drawRoots,
      parts: ["point"],
    },
    {
      options: { id: "speed", title: "Speed", x: seconds, y: { label: "speed", unit: "rad/s" } },
      draw: (found, state) => drawTime(found, state, "speed_rad_s"),
      parts: ["loop"],
    },
    {
      options: { id: "throttle", title: "Throttle", x: seconds, y: { label: "throttle", unit: "deg" } },
      draw: (found, state) => drawTime(found, state, "throttle_deg"),
      parts: ["loop"],
    },
  ];
}

export class Plots {
  private readonly placed: readonly Placed[];

  constructor(drag: Drag) {
    this.placed = kinds(drag).map((kind) => ({
      ...kind,
      plot: new Plot(kind.options),
      handle: kind.steering && new Handle(kind.steering, drag),
    }));
    for (const { plot, handle } of this.placed) if (handle) plot.figure.append(handle.element);
  }

  get figures(): HTMLElement[] {
    return this.placed.map(({ plot }) => plot.figure);
  }

  csv(name: string): string {
    return this.placed.find(({ options }) => options.id === name)?.plot.csv() ?? "";
  }

  /** Tell what can be moved where it stands now, before anything is drawn. */
  tell(state: State): void {
    for (const { handle } of this.placed) handle?.show(state);
  }

  /** Draw what is made of something new. */
  draw({ found, shown }: Seen, state: State, beside: Beside): void {
    for (const entry of this.placed) {
      const { from: old, plot } = entry;
      if (old?.found.stand(found) && old.state.stand(state) && old.beside.stand(beside)) continue;
      const from = { found: new Reads(found), state: new Reads(state), beside: new Reads(beside) };
      const broken = entry.parts.map((name) => problemOf(from.found.of[name])).find((text) => text !== undefined);
      const drawing = broken === undefined ? entry.draw(from.found.of, from.state.of, from.beside.of) : undefined;
      entry.from = drawing && from;
      if (drawing) plot.show(drawing);
      else if (broken !== undefined) plot.grey(broken);
      else if (shown) plot.grey(problemOf(within(found.response)) ?? "");
    }
  }

  /** Say of all that they are no longer true. */
  grey(reason?: string): void {
    for (const entry of this.placed) {
      entry.plot.grey(reason);
      entry.from = undefined;
    }
  }

  restyle(): void {
    for (const { plot } of this.placed) plot.restyle();
  }

  /** Let some take turns in one place; gives what shows one of them. */
  takeTurns(names: readonly string[], chosen: (name: string) => void): (name: string) => void {
    const turning = this.placed.map(({ plot }) => plot).filter((plot) => names.includes(plot.options.id));
    const show = (name: string) => {
      for (const plot of turning) plot.figure.hidden = plot.options.id !== name;
    };
    for (const plot of turning) {
      const choices = turning.map(({ options }): [string, string] => [options.id, options.title]);
      plot.offer(choices, (name) => {
        show(name);
        chosen(name);
        document.querySelector<HTMLSelectElement>(`#${name} select`)?.focus();
      });
    }
    return show;
  }
}
