/** What follows the server: asks for what the newest state needs, for slow parts once things rest, and again for what was lost. */

import {
  Follower,
  type Found,
  fetchJson,
  fetchView,
  isProblem,
  LIVE,
  Lost,
  type PartName,
  type Problem,
  Refused,
  type View,
} from "./api";
import { keyOf, sameSpeeds } from "./needs";
import { type State, same } from "./state";
import type { Store } from "./store";

const REST = 250;
/** Slow parts that a server had no time for are asked for again after so many ms. */
const BUSY = 4000;
/** After so many ms without an answer to the first view of an engine its wait is explained. */
const COMPILING = 1500;
const SLOW: readonly PartName[] = ["peaks", "contours", "cycle", "validity"];

/** What was found, the state it was found for, and what the server left for later. */
export interface Seen {
  found: Found;
  shown: State | undefined;
  left: readonly PartName[];
}

/** How far the view of the newest state is: nothing of it yet, its live parts, all of it. */
export type Stage = "busy" | "drawn" | "settled";

export interface Listener {
  /** Live parts of a state were found. */
  live(seen: Seen): void;
  /** Slow parts of the state shown were found. */
  slow(seen: Seen): void;
  /** The state, or what was asked about it, is refused. */
  refused(problem: Problem): void;
  /** Something went wrong that leaves what is shown as true as it was. */
  told(why: string): void;
  /** No answer came, and why; it is asked for again after so many seconds, 0 for at once. */
  lost(why: string, wait: number): void;
  /** It answers again. */
  back(): void;
  /** The page itself failed to show what it was given. */
  broken(error: unknown): void;
  stage(stage: Stage): void;
}

export class Following {
  private found: Found = {};
  private shown: State | undefined;
  /** The state that was asked for last. */
  private newest: State | undefined;
  private left: readonly PartName[] = [];
  /** What the parts that were found were found for. */
  private readonly keys = new Map<PartName, string>();
  private mapped: State | undefined;
  private attempts = 0;
  private retry: ReturnType<typeof setTimeout> | undefined;
  private resting: ReturnType<typeof setTimeout> | undefined;
  private compiling: ReturnType<typeof setTimeout> | undefined;
  private engine = "";

  constructor(
    private readonly store: Store,
    private readonly listener: Listener,
  ) {}

  get seen(): Seen {
    return { found: this.found, shown: this.shown, left: this.left };
  }

  private readonly live = new Follower<State, View & { asked: PartName[] }>(
    async (state) => {
      const parts = this.wanted(state);
      return { ...(await fetchView(state, parts)), asked: parts };
    },
    (view, asked) => this.takeLive(view, asked),
    (error) => this.failed(error),
  );

  private readonly slow = new Follower<{ state: State; parts: PartName[] }, View>(
    ({ state, parts }) => fetchView(state, parts, "slow"),
    ({ parts }, asked) => this.takeSlow(parts, asked),
    (error, { state }) => this.failedSlow(error, state),
  );

  /** Find the view of the state as it is now. */
  start(): void {
    this.newest = this.store.state;
    if (this.newest.engine !== this.engine) {
      this.engine = this.newest.engine;
      clearTimeout(this.compiling);
      this.compiling = setTimeout(
        () =>
          this.listener.told(
            `The first view of ${this.engine} takes longer where the engine is compiled first, which is done once.`,
          ),
        COMPILING,
      );
    }
    this.live.follow(this.newest);
  }

  /** Follow the state where it has moved. */
  move(): void {
    const asked = this.live.busy ? this.newest : this.shown;
    if (asked && same(asked, this.store.state)) return;
    clearTimeout(this.resting);
    this.listener.stage("busy");
    this.start();
  }

  /** Say what went wrong with a question, and ask again where no answer came. */
  failed(error: unknown): void {
    clearTimeout(this.compiling);
    const busy = error instanceof Refused && error.problem.status === 503;
    if (busy || error instanceof Lost) {
      this.askAgain(error);
      return;
    }
    if (error instanceof Refused && error.problem.status === 409) return;
    this.shown = undefined;
    if (error instanceof Refused) this.listener.refused(error.problem);
    else this.listener.broken(error);
    this.listener.stage("settled");
  }

  /** What went wrong with slow parts leaves the live ones true; of another state it does not matter any more. */
  private failedSlow(error: unknown, state: State): void {
    if (!same(state, this.store.state)) return;
    if (!(error instanceof Refused) || error.problem.status === 409) {
      this.failed(error);
      return;
    }
    this.listener.told(error.problem.detail);
    this.listener.stage("settled");
    if (error.problem.type === "/problems/too-busy") this.askSlow(BUSY); // one that took too long would do so again
  }

  /** Ask again later, each time later than before; once for all that was lost meanwhile. */
  private askAgain(error: Refused | Lost): void {
    if (this.retry !== undefined) return;
    const wait =
      error instanceof Lost && error.soon && this.attempts === 0 ? 0 : Math.min(2 ** (this.attempts + 1), 20);
    this.attempts += 1;
    this.listener.lost(error.message, wait);
    const retry = setTimeout(async () => {
      try {
        await fetchJson("/api/v1/health");
      } catch (again) {
        if (this.retry !== retry) return;
        this.retry = undefined;
        this.failed(again);
        return;
      }
      if (this.retry !== retry) return;
      this.retry = undefined;
      this.listener.back();
      this.start();
    }, 1000 * wait);
    this.retry = retry;
  }

  private known(part: PartName, state: State): boolean {
    return this.keys.get(part) === keyOf(part, state);
  }

  /** The first view does not wait for the steady map, whose process begins last. */
  private wanted(state: State): PartName[] {
    const parts = (this.shown ? [...LIVE, "map" as const] : [...LIVE]).filter((part) => !this.known(part, state));
    return parts.length > 0 ? parts : ["words"];
  }

  /** Take in what was found; a part with a problem, and one left for later, is asked for again. What belongs to another state is not kept, but for steady speeds that hold for both. */
  private take(answer: Found, parts: readonly PartName[], state: State): void {
    for (const part of parts) {
      if (answer[part] === undefined || isProblem(answer[part])) this.keys.delete(part);
      else this.keys.set(part, keyOf(part, state));
    }
    if (answer.map && !isProblem(answer.map)) this.mapped = state;
    const found = { ...this.found, ...answer };
    for (const part of Object.keys(found) as PartName[]) {
      if (answer[part] === undefined && !this.known(part, state)) delete found[part];
    }
    const speeds = this.found.map;
    if (!found.map && speeds && !isProblem(speeds) && this.mapped && sameSpeeds(this.mapped, state)) {
      const { line: _line, no_line: _none, ...rest } = speeds; // of another point
      found.map = rest;
    }
    this.found = found;
  }

  private takeLive({ parts: answer, later, asked: parts }: View & { asked: PartName[] }, asked: State): void {
    this.take(answer, parts, asked);
    this.left = parts.includes("map") || this.known("map", asked) ? later : [...later, "map"];
    this.shown = asked;
    clearTimeout(this.compiling);
    this.attempts = 0;
    this.listener.live(this.seen);
    if (this.retry !== undefined) {
      clearTimeout(this.retry);
      this.retry = undefined;
      this.listener.back();
    }
    if (!same(asked, this.store.state)) return;
    if (this.left.length > 0) {
      this.live.follow(asked);
      return;
    }
    this.listener.stage("drawn");
    this.askSlow();
  }

  private takeSlow(answer: Found, asked: { state: State; parts: PartName[] }): void {
    const { shown } = this;
    if (!shown || !same(asked.state, shown) || !same(shown, this.store.state)) return;
    this.take(answer, asked.parts, asked.state);
    this.listener.slow(this.seen);
    this.listener.stage("settled");
  }

  private askSlow(wait = REST): void {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => {
      const { state } = this.store;
      const { loop } = this.found;
      const hunts = loop && !isProblem(loop) && loop.outcome === "limit-cycle";
      const parts = SLOW.filter((part) => !this.known(part, state) && (part !== "cycle" || hunts));
      if (parts.length > 0) this.slow.follow({ state, parts });
      else this.listener.stage("settled");
    }, wait);
  }
}
