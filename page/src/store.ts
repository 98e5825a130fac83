/** The state of the page with its history: what is dragged is one step back. */

import { change, type State, same } from "./state";

const DEPTH = 200;

export type Listener = (state: State) => void;

export class Store {
  private past: State[] = [];
  private future: State[] = [];
  private before: State | undefined;
  private readonly listeners: Listener[] = [];

  constructor(private now: State) {}

  get state(): State {
    return this.now;
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  subscribe(listener: Listener): void {
    this.listeners.push(listener);
  }

  /** Change the state while something moves; `settle` ends the step. */
  move(patch: Partial<State>): void {
    this.before ??= this.now;
    this.show(change(this.now, patch));
  }

  settle(): void {
    const before = this.before;
    this.before = undefined;
    if (before === undefined || same(before, this.now)) return;
    this.past = [...this.past, before].slice(-DEPTH);
    this.future = [];
    this.tell();
  }

  /** Take back what moved since the step began. */
  cancel(): void {
    const before = this.before;
    this.before = undefined;
    if (before !== undefined) this.show(before);
  }

  set(patch: Partial<State>): void {
    this.move(patch);
    this.settle();
  }

  replace(state: State): void {
    this.before ??= this.now;
    this.show(state);
    this.settle();
  }

  undo(): void {
    this.settle();
    const last = this.past.pop();
    if (last === undefined) return;
    this.future.push(this.now);
    this.show(last);
  }

  redo(): void {
    const next = this.future.pop();
    if (next === undefined) return;
    this.past.push(this.now);
    this.show(next);
  }

  private show(state: State): void {
    this.now = state;
    this.tell();
  }

  private tell(): void {
    for (const listener of this.listeners) listener(this.now);
  }
}
