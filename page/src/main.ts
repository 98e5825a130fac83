/** The page: controls on the left, plots of the view, and what is true of it in words. */

import "uplot/dist/uPlot.min.css";
import "./style.css";
import {
  type Curve,
  changeJob,
  Follower,
  type Found,
  fetchJson,
  fetchText,
  fetchView,
  isProblem,
  type Job,
  LIVE,
  Lost,
  type PartName,
  Refused,
  sendFile,
  startJob,
  type View,
} from "./api";
import { Controls, type Parameter } from "./controls";
import { Data, type FileAnswer } from "./data";
import { drawBode, drawDistortion, drawErrors, drawMap, drawPlane, drawRoots, drawTime, type Named } from "./drawings";
import { Jobs } from "./jobs";
import { ERROR_PLOTS, type Look, Looks, readLook } from "./look";
import { keyOf, Reads } from "./needs";
import { responseNotes, shareFound } from "./notes";
import { Numbers } from "./numbers";
import { type DragPhase, type Drawing, Plot, save } from "./plot";
import { DEFAULTS, fromAddress, type State, same, toAddress } from "./state";
import { Store } from "./store";
import { STOPS, Tour } from "./tour";

const REST = 250;
const SLOW: PartName[] = ["peaks", "contours", "cycle", "validity"];

const need = <T extends HTMLElement = HTMLElement>(id: string): T => {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no ${id}`);
  return element as T;
};

const read = fromAddress(location.hash);
const addressEntries = () => new URLSearchParams(location.hash.replace(/^#/, ""));
const readOfLook = readLook(addressEntries(), STOPS.length);
const faults = [...read.faults, ...readOfLook.faults];
const store = new Store(read.state);
const looks = new Looks(readOfLook.look);
const controls = new Controls(need("controls"), store);
const numbers = new Numbers();
const tour = new Tour(need("guide"), store, (step) => looks.set({ tour: step }));
const verdict = need("verdict");
const said = need("said");
const banner = need("banner");
let controllers: (Named & { what: string })[] = [];
let found: Found = {};
let own: Curve | undefined;
let shown: State | undefined;

declare global {
  interface Window {
    /** For whoever looks at the page from outside: what it shows, as values. */
    workbench: { state: () => State; csv: (plot: string) => string };
  }
}
window.workbench = {
  state: () => store.state,
  csv: (name) => plots.find(({ plot }) => plot.options.id === name)?.plot.csv() ?? "",
};

const frequency = { label: "frequency", unit: "rad/s", log: true };
const seconds = { label: "time", unit: "s" };
interface Shown {
  plot: Plot;
  draw: (found: Found, state: State) => Drawing | undefined;
  parts: PartName[];
  /** What the drawing that is shown was made of. */
  from?: { found: Reads<Found>; state: Reads<State> } | undefined;
}
const plots: Shown[] = [
  {
    plot: new Plot({
      id: "map",
      title: "Steady map",
      x: { label: "throttle", unit: "deg" },
      y: { label: "speed", unit: "rad/s" },
      hint: "Drag to move the operating point",
      drag: (x, _, phase) => {
        dragged({ throttle_deg: Number(Math.min(Math.max(x, 0.1), 90).toFixed(1)) }, phase);
      },
    }),
    draw: drawMap,
    parts: ["map", "point"],
  },
  {
    plot: new Plot({
      id: "magnitude",
      title: "Magnitude",
      x: frequency,
      y: { label: "gain", unit: "dB" },
    }),
    draw: (found) => drawBode(found, "magnitude_db", own),
    parts: ["response"],
  },
  {
    plot: new Plot({ id: "phase", title: "Phase", x: frequency, y: { label: "phase", unit: "deg" } }),
    draw: (found) => drawBode(found, "phase_deg", own),
    parts: ["response"],
  },
  {
    plot: new Plot({
      id: "plane",
      title: "Gains",
      x: { label: "kp", unit: "deg/(rad/s)" },
      y: { label: "ki", unit: "deg/(rad/s)/s" },
      hint: "Click or drag to choose kp and ki",
      drag: (x, y, phase) => {
        dragged({ kp: Number(x.toPrecision(3)), ki: Number(Math.max(y, 0).toPrecision(3)) }, phase);
      },
    }),
    draw: (found, state) => drawPlane(found, state, controllers),
    parts: ["gains"],
  },
  {
    plot: new Plot({
      id: "magnitude-error",
      title: "Magnitude errors",
      x: frequency,
      y: { label: "error", unit: "dB" },
    }),
    draw: (found) => drawErrors(found, "magnitude_db"),
    parts: ["models"],
  },
  {
    plot: new Plot({
      id: "phase-error",
      title: "Phase errors",
      x: frequency,
      y: { label: "error", unit: "deg" },
    }),
    draw: (found) => drawErrors(found, "phase_deg"),
    parts: ["models"],
  },
  {
    plot: new Plot({
      id: "distortion",
      title: "Distortion",
      x: frequency,
      y: { label: "distortion", unit: "%" },
    }),
    draw: drawDistortion,
    parts: ["response"],
  },
  {
    plot: new Plot({
      id: "roots",
      title: "Roots",
      x: { label: "real", unit: "rad/s" },
      y: { label: "imaginary", unit: "rad/s" },
    }),
    draw: drawRoots,
    parts: ["point"],
  },
  {
    plot: new Plot({ id: "speed", title: "Speed", x: seconds, y: { label: "speed", unit: "rad/s" } }),
    draw: (found, state) => drawTime(found, state, "speed_rad_s"),
    parts: ["loop"],
  },
  {
    plot: new Plot({ id: "throttle", title: "Throttle", x: seconds, y: { label: "throttle", unit: "deg" } }),
    draw: (found, state) => drawTime(found, state, "throttle_deg"),
    parts: ["loop"],
  },
];

function dragged(patch: Partial<State>, phase: DragPhase): void {
  if (phase === "cancel") store.cancel();
  else store.move(patch);
  if (phase === "end") store.settle();
}

/** Draw what is made of something new, or all. */
function redraw(all = false): void {
  for (const entry of plots) {
    const { plot, draw, parts } = entry;
    if (!all && entry.from?.found.stand(found) && entry.from.state.stand(store.state)) continue;
    const from = { found: new Reads(found), state: new Reads(store.state) };
    const broken = parts.map((name) => problemOf(from.found.of[name])).find((text) => text !== undefined);
    const drawing = broken === undefined ? draw(from.found.of, from.state.of) : undefined;
    entry.from = drawing && from;
    if (drawing) plot.show(drawing);
    else if (broken !== undefined) plot.grey(broken);
    else if (shown) plot.grey(problemOf(within(found.response)) ?? "");
  }
  numbers.show(found);
  tellProblems();
}

function grey(reason?: string): void {
  for (const entry of plots) {
    entry.plot.grey(reason);
    entry.from = undefined;
  }
}

/** The first part of a response, found or not: of what is drawn from it alone, its problem is the reason. */
function within(part: Found["response"]): unknown {
  if (!part || isProblem(part)) return undefined;
  return isProblem(part.exact) ? part.exact : part.harmonic_balance;
}

function problemOf(part: unknown): string | undefined {
  if (!isProblem(part)) return undefined;
  return typeof part.problem === "string" ? part.problem : part.problem.detail;
}

function tellProblems(): void {
  const texts = new Map<string, string>();
  const { response } = found;
  const inner = response && !isProblem(response) ? [response.exact, response.harmonic_balance] : [];
  const swinging = [response, found.models, ...inner]; // what they have no control for is the amplitude's
  for (const one of [...Object.values(found), ...inner]) {
    if (!isProblem(one) || typeof one.problem === "string") continue;
    const control = one.problem.control ?? (swinging.includes(one) ? "amplitude_deg" : "");
    if (!texts.has(control)) texts.set(control, one.problem.detail);
  }
  const remark = found.validity && !isProblem(found.validity) ? found.validity.warnings[0] : undefined;
  const key = store.state.speed_rad_s === undefined ? "throttle_deg" : "speed_rad_s";
  const remarks = new Map(remark ? [[key, `${remark}; the linear model holds no further`]] : []);
  const share = shareFound(responseNotes(found));
  if (share) {
    remarks.set("amplitude_deg", `only ${share} have an answer at this amplitude; why stands below the margins`);
  }
  controls.tell(texts, remarks);
}

/** What the page waits for, for whoever looks at it from outside: tests, and programs that take pictures. */
function report(view: "busy" | "drawn" | "settled"): void {
  document.documentElement.dataset.view = view;
  // Read aloud when things have come to rest, not at each step of a slider.
  if (view === "settled" && said.textContent !== verdict.textContent) said.textContent = verdict.textContent;
}

/** What the parts that were found were found for. */
const keys = new Map<PartName, string>();
const known = (part: PartName, state: State) => keys.get(part) === keyOf(part, state);

/** Take in what was found; a part with a problem, and one left for later, is asked for again. */
function take(answer: Found, parts: readonly PartName[], state: State): void {
  for (const part of parts) {
    if (answer[part] === undefined || isProblem(answer[part])) keys.delete(part);
    else keys.set(part, keyOf(part, state));
  }
  found = { ...found, ...answer };
}

const slowFollower = new Follower<{ state: State; parts: PartName[] }, View>(
  ({ state, parts }) => fetchView(state, parts, "slow"),
  ({ parts: answer }, asked) => {
    if (!same(asked.state, store.state)) return;
    take(answer, asked.parts, asked.state);
    redraw();
    if (shown && same(shown, store.state)) report("settled");
  },
  (error) => lost(error),
);
let resting: ReturnType<typeof setTimeout> | undefined;

function askSlow(): void {
  clearTimeout(resting);
  resting = setTimeout(() => {
    const state = store.state;
    const hunts = found.loop && !isProblem(found.loop) && found.loop.outcome === "limit-cycle";
    const parts = SLOW.filter((part) => !known(part, state) && (part !== "cycle" || hunts));
    if (parts.length > 0) slowFollower.follow({ state, parts });
    else report("settled");
  }, REST);
}

/** What the server left for later, of the state shown. */
let left: PartName[] = [];

/** The first view does not wait for the steady map, whose process begins last. */
function wanted(state: State): PartName[] {
  const parts = (shown ? [...LIVE, "map" as const] : [...LIVE]).filter((part) => !known(part, state));
  return parts.length > 0 ? parts : ["words"];
}

const follower = new Follower<State, View & { asked: PartName[] }>(
  async (state) => {
    const parts = wanted(state);
    return { ...(await fetchView(state, parts)), asked: parts };
  },
  ({ parts: answer, later, asked: parts }, asked) => {
    for (const part of SLOW) {
      // What no longer belongs to this state must not be shown with it.
      if (!known(part, asked)) delete found[part];
    }
    take(answer, parts, asked);
    for (const part of later) delete found[part];
    left = parts.includes("map") || known("map", asked) ? later : [...later, "map"];
    shown = asked;
    attempts = 0;
    banner.hidden = faults.length === 0;
    verdict.textContent = found.words?.verdict ?? (left.length > 0 ? "many ask at once: the rest follows" : "");
    verdict.title = verdict.textContent;
    verdict.className = toneOf(found);
    if (found.point && !isProblem(found.point)) controls.point = found.point;
    redraw();
    if (!same(asked, store.state)) return;
    if (left.length > 0) {
      follower.follow(asked);
      return;
    }
    report("drawn");
    askSlow();
  },
  (error) => lost(error),
);

function toneOf(answer: Found): string {
  if (left.length > 0 && !answer.margins) return "";
  if (answer.margins && !isProblem(answer.margins)) {
    const hunts = answer.loop && !isProblem(answer.loop) && answer.loop.outcome !== "settled" && answer.loop.outcome;
    return answer.margins.stable && !hunts ? "good" : "bad";
  }
  return "bad";
}

let attempts = 0;
function lost(error: unknown): void {
  const busy = error instanceof Refused && error.problem.status === 503;
  if (error instanceof Refused && !busy) {
    if (error.problem.status === 409) return;
    controls.tell(new Map([[error.problem.control ?? "", error.problem.detail]]));
    if (!controls.knows(error.problem.control ?? "")) say(error.problem.detail);
    grey(error.problem.detail);
    verdict.textContent = "no view: see the problem at its control";
    verdict.className = "bad";
    shown = undefined;
    report("settled");
    return;
  }
  if (!busy && !(error instanceof Lost)) throw error;
  attempts += 1;
  const wait = Math.min(2 ** attempts, 20);
  grey();
  const why = busy ? error.problem.detail : "The server does not answer";
  say(`${why}; what is shown is the last it said. Trying again every ${wait} s.`);
  setTimeout(() => {
    fetchJson("/api/v1/health").then(() => {
      if (!busy) attempts = 0;
      banner.hidden = true;
      start();
      follower.follow(store.state);
    }, lost);
  }, 1000 * wait);
}

function say(text: string): void {
  banner.textContent = text;
  banner.hidden = false;
}

interface Offered {
  engines: string[];
  parameters: Parameter[];
  controllers: (Named & { what: string })[];
}
let offered = "";
/** Ask what can be set of the engine shown, once for each engine. */
function start(): void {
  const { engine } = store.state;
  if (offered === engine) return;
  offered = engine;
  fetchJson<Offered>(`/api/v1/parameters?engine=${encodeURIComponent(engine)}`).then(
    (answer) => {
      if (offered !== engine) return;
      controllers = answer.controllers;
      controls.offer(answer.controllers);
      controls.engine(answer.engines, answer.parameters);
      redraw(true);
    },
    (error) => {
      if (offered === engine) offered = "";
      lost(error);
    },
  );
}

function writeAddress(): void {
  clearTimeout(writing);
  history.replaceState(null, "", toAddress(store.state, looks.now) || location.pathname);
}
let writing: ReturnType<typeof setTimeout> | undefined;
/** The address follows when nothing has moved for a moment: it is slow to change, and browsers allow few changes a second. */
function showAddress(): void {
  clearTimeout(writing);
  writing = setTimeout(writeAddress, 100);
}
window.addEventListener("pagehide", writeAddress);
looks.subscribe(writeAddress);

const undo = need<HTMLButtonElement>("undo");
const redo = need<HTMLButtonElement>("redo");
store.subscribe((state) => {
  undo.disabled = !store.canUndo;
  redo.disabled = !store.canRedo;
  showAddress();
  start();
  if (follower.busy || !shown || !same(shown, state)) {
    clearTimeout(resting);
    report("busy");
    follower.follow(state);
  }
});
undo.addEventListener("click", () => store.undo());
redo.addEventListener("click", () => store.redo());
need("reset").addEventListener("click", () => store.replace(DEFAULTS));
need("tour").addEventListener("click", () => tour.start());
need("link").addEventListener("click", async (event) => {
  const button = event.currentTarget as HTMLButtonElement;
  const link = new URL(toAddress(store.state, looks.now) || "/", location.origin).href;
  try {
    await navigator.clipboard.writeText(link);
    button.textContent = "Copied";
    setTimeout(() => {
      button.textContent = "Copy link";
    }, 1500);
  } catch {
    say(`The link to this view: ${link}`);
  }
});
need("study").addEventListener("click", async () => {
  try {
    save(new Blob([await fetchText("/api/v1/study-file", store.state)], { type: "application/toml" }), "study.toml");
    if (Object.keys(store.state.parameters).length > 0) {
      save(
        new Blob([await fetchText("/api/v1/engine-file", store.state)], { type: "application/toml" }),
        "engine.toml",
      );
    }
  } catch (error) {
    lost(error);
  }
});
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
  event.preventDefault();
  if (event.shiftKey) store.redo();
  else store.undo();
});
window.addEventListener("hashchange", () => {
  const next = fromAddress(location.hash);
  look(readLook(addressEntries(), STOPS.length).look);
  if (!same(next.state, store.state)) store.replace(next.state);
});

const theme = need<HTMLButtonElement>("theme");
const dark = matchMedia("(prefers-color-scheme: dark)");
function setTheme(on: boolean): void {
  document.documentElement.dataset.theme = on ? "dark" : "light";
  theme.setAttribute("aria-pressed", String(on));
  for (const { plot } of plots) plot.restyle();
}
theme.addEventListener("click", () => setTheme(document.documentElement.dataset.theme !== "dark"));
setTheme(dark.matches);

/** Three plots that take turns in one place. */
function takeTurns(names: readonly string[]): (name: string) => void {
  const turning = plots.map(({ plot }) => plot).filter((plot) => names.includes(plot.options.id));
  const show = (name: string) => {
    for (const plot of turning) plot.figure.hidden = plot.options.id !== name;
  };
  for (const plot of turning) {
    const choices = turning.map(({ options }): [string, string] => [options.id, options.title]);
    plot.offer(choices, (name) => {
      show(name);
      looks.set({ errors: name });
      document.querySelector<HTMLSelectElement>(`#${name} select`)?.focus();
    });
  }
  return show;
}
const showErrors = takeTurns(ERROR_PLOTS);

const data = new Data(need<HTMLDialogElement>("data"), need<HTMLButtonElement>("data-open"), {
  send: (file, kind) => sendFile<FileAnswer>(file, kind, store.state),
  curve: (curve) => {
    own = curve;
    redraw(true);
  },
  engine: (state) => store.set(state),
  opened: (on) => looks.open("data", on),
});
const jobs = new Jobs(need<HTMLDialogElement>("jobs"), need<HTMLButtonElement>("jobs-open"), {
  list: () => fetchJson<{ jobs: Job[] }>("/api/v1/jobs"),
  start: (kind) => startJob(kind, store.state),
  change: changeJob,
  opened: (on) => looks.open("jobs", on),
});
controls.engineBox.addEventListener("toggle", () => looks.open("engine", controls.engineBox.open));

/** Show the page as a link wants it looked at. */
function look({ errors, open, tour: step }: Look): void {
  showErrors(errors);
  looks.set({ errors });
  controls.engineBox.open = open.includes("engine");
  if (open.includes("data")) data.open();
  if (open.includes("jobs")) jobs.open();
  if (step > 0) tour.resume(step);
}

need("plots").append(...plots.map(({ plot }) => plot.figure), numbers.figure);
look(readOfLook.look);
if (faults.length > 0) say(faults.join("; "));
controls.update(store.state);
start();
follower.follow(store.state);
