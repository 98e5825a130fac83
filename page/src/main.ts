/** The page: controls on the left, plots of the view, and what is true of it in words. Controls write the store; what follows it asks the server; what is found is drawn. */

import "uplot/dist/uPlot.min.css";
import "./style.css";
import { offerLink, offerSkip, offerStudyFile, offerTheme, offerUndo } from "./actions";
import { followAddress, readAddress } from "./address";
import { changeJob, fetchJson, type Job, Refused, sendFile, startJob } from "./api";
import { Controls } from "./controls";
import { Data, type FileAnswer } from "./data";
import { Following } from "./following";
import { Headline } from "./headline";
import { Jobs } from "./jobs";
import { ERROR_PLOTS, type Look, Looks } from "./look";
import { Numbers } from "./numbers";
import { Offers } from "./offers";
import { need } from "./parts";
import { type Beside, Plots } from "./plots";
import { problemsAt } from "./problems";
import type { State } from "./state";
import { Store } from "./store";
import { Tour } from "./tour";

declare global {
  interface Window {
    /** For whoever looks at the page from outside: what it shows, as values. */
    workbench: { state: () => State; csv: (plot: string) => string };
  }
}

const read = readAddress();
const store = new Store(read.state);
const looks = new Looks(read.look);
const headline = new Headline();
const controls = new Controls(need("controls"), store);
const numbers = new Numbers();
const plots = new Plots((patch, phase) => {
  if (phase === "cancel") store.cancel();
  else store.move(patch);
  if (phase === "end") store.settle();
});
const tour = new Tour(need("guide"), store, (step) => looks.set({ tour: step }));
let beside: Beside = { controllers: [], own: undefined };
window.workbench = { state: () => store.state, csv: (name) => plots.csv(name) };

/** Say of all that is shown that it is no longer true. */
function grey(reason?: string): void {
  plots.grey(reason);
  numbers.grey();
  headline.grey();
}

/** Draw what was found, and tell its problems at their controls. */
function draw(): void {
  const { seen } = following;
  plots.draw(seen, store.state, beside);
  numbers.show(seen.found);
  const { problems, remarks } = problemsAt(seen.found, store.state);
  controls.remarks.tell(problems, remarks);
}

const following = new Following(store, {
  live: (seen) => {
    if (read.faults.length > 0) headline.tell(read.faults.join("; "));
    else headline.hush();
    headline.show(seen);
    if (seen.found.point && "throttle_deg" in seen.found.point) controls.point = seen.found.point;
    draw();
  },
  slow: draw,
  refused: ({ control = "", detail }) => {
    controls.remarks.tell(new Map([[control, detail]]));
    if (!controls.remarks.knows(control)) headline.tell(detail);
    grey();
    headline.refuse("no view: see the problem at its control");
  },
  told: (why) => headline.tell(why),
  lost: (why, wait) => {
    grey();
    headline.tell(`${why}; what is shown is the last it said. Asking again ${wait > 0 ? `in ${wait} s` : "now"}.`);
  },
  broken: (error) => {
    grey();
    headline.refuse("no view: the page failed to show it");
    headline.tell(`The page failed to show what it was given (${error}); what is moved next is asked for anew.`);
    reportError(error);
  },
  back: () => {
    headline.hush();
    offers.ask(store.state.engine);
  },
  stage: (stage) => headline.stage(stage),
});
const offers = new Offers(
  ({ controllers, engines, parameters }) => {
    beside = { ...beside, controllers };
    controls.offer(controllers);
    controls.offerEngines(engines, parameters);
    draw();
  },
  (error) => following.failed(error),
);

offerSkip();
offerUndo(store);
followAddress(store, looks, look);
store.subscribe((state) => {
  plots.tell(state);
  offers.ask(state.engine);
  following.move();
});
need("tour").addEventListener("click", () => tour.start());
offerLink(store, looks, (text) => headline.tell(text));
offerStudyFile(
  store,
  (error) => {
    if (error instanceof Refused) headline.tell(error.problem.detail);
    else following.failed(error);
  },
  (text) => headline.tell(text),
);
offerTheme(() => plots.restyle());
const showErrors = plots.takeTurns(ERROR_PLOTS, (name) => looks.set({ errors: name }));

const data = new Data(need<HTMLDialogElement>("data"), need<HTMLButtonElement>("data-open"), {
  send: (file, kind) => sendFile<FileAnswer>(file, kind, store.state),
  curve: (own) => {
    beside = { ...beside, own };
    draw();
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
const { box } = controls.engine;
box.addEventListener("toggle", () => looks.open("engine", box.open));

/** Show the page as a link wants it looked at. */
function look({ errors, open, tour: step }: Look): void {
  showErrors(errors);
  looks.set({ errors });
  box.open = open.includes("engine");
  if (open.includes("data")) data.open();
  if (open.includes("jobs")) jobs.open();
  if (step > 0) tour.resume(step);
}

need("plots").append(...plots.figures, numbers.figure);
look(read.look);
if (read.faults.length > 0) headline.tell(read.faults.join("; "));
controls.update(store.state);
plots.tell(store.state);
offers.ask(store.state.engine);
following.start();
