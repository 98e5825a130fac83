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
import { keyOf } from "./needs";
import { type State, same } from "./state";
import type { Store } from "./store";

const REST = 250;
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
  /** The server does not answer, or says why it cannot; it is asked again after so many seconds. */
  lost(why: string | undefined, wait: number): void;
  /** It answers again. */
  back(): void;
  stage(stage: Stage): void;
}

export class Following {
  private found: Found = {};
  private shown: State | undefined;
  private left: readonly PartName[] = [];
  /** What the parts that were found were found for. */
  private readonly keys = new Map<PartName, string>();
  private attempts = 0;
  private resting: ReturnType<typeof setTimeout> | undefined;

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
    (error) => this.failed(error),
  );

  /** Find the view of the state as it is now. */
  start(): void {
    this.live.follow(this.store.state);
  }

  /** Follow a state that has moved. */
  move(state: State): void {
    if (!this.live.busy && this.shown && same(this.shown, state)) return;
    clearTimeout(this.resting);
    this.listener.stage("busy");
    this.live.follow(state);
  }

  /** Say what went wrong with a question, and ask again where no answer came. */
  failed(error: unknown): void {
    const busy = error instanceof Refused && error.problem.status === 503;
    if (error instanceof Refused && !busy) {
      if (error.problem.status === 409) return;
      this.shown = undefined;
      this.listener.refused(error.problem);
      this.listener.stage("settled");
      return;
    }
    if (!busy && !(error instanceof Lost)) throw error;
    this.attempts += 1;
    const wait = Math.min(2 ** this.attempts, 20);
    this.listener.lost(busy ? error.problem.detail : undefined, wait);
    setTimeout(() => {
      fetchJson("/api/v1/health").then(
        () => {
          if (!busy) this.attempts = 0;
          this.listener.back();
          this.start();
        },
        (again) => this.failed(again),
      );
    }, 1000 * wait);
  }

  private known(part: PartName, state: State): boolean {
    return this.keys.get(part) === keyOf(part, state);
  }

  /** The first view does not wait for the steady map, whose process begins last. */
  private wanted(state: State): PartName[] {
    const parts = (this.shown ? [...LIVE, "map" as const] : [...LIVE]).filter((part) => !this.known(part, state));
    return parts.length > 0 ? parts : ["words"];
  }

  /** Take in what was found; a part with a problem, and one left for later, is asked for again. */
  private take(answer: Found, parts: readonly PartName[], state: State): void {
    for (const part of parts) {
      if (answer[part] === undefined || isProblem(answer[part])) this.keys.delete(part);
      else this.keys.set(part, keyOf(part, state));
    }
    this.found = { ...this.found, ...answer };
  }

  private takeLive({ parts: answer, later, asked: parts }: View & { asked: PartName[] }, asked: State): void {
    for (const part of SLOW) {
      // What no longer belongs to this state must not be shown with it.
      if (!this.known(part, asked)) delete this.found[part];
    }
    this.take(answer, parts, asked);
    for (const part of later) delete this.found[part];
    this.left = parts.includes("map") || this.known("map", asked) ? later : [...later, "map"];
    this.shown = asked;
    this.attempts = 0;
    this.listener.live(this.seen);
    if (!same(asked, this.store.state)) return;
    if (this.left.length > 0) {
      this.live.follow(asked);
      return;
    }
    this.listener.stage("drawn");
    this.askSlow();
  }

  private takeSlow(answer: Found, asked: { state: State; parts: PartName[] }): void {
    if (!same(asked.state, this.store.state)) return;
    this.take(answer, asked.parts, asked.state);
    this.listener.slow(this.seen);
    if (this.shown && same(this.shown, this.store.state)) this.listener.stage("settled");
  }

  private askSlow(): void {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => {
      const { state } = this.store;
      const { loop } = this.found;
      const hunts = loop && !isProblem(loop) && loop.outcome === "limit-cycle";
      const parts = SLOW.filter((part) => !this.known(part, state) && (part !== "cycle" || hunts));
      if (parts.length > 0) this.slow.follow({ state, parts });
      else this.listener.stage("settled");
    }, REST);
  }
}
