import { describe, expect, it } from "vitest";
import { DEFAULTS } from "../src/state";
import { Store } from "../src/store";

describe("history", () => {
  it("takes a drag as one step", () => {
    const store = new Store(DEFAULTS);
    for (const kp of [1, 2, 3]) store.move({ kp });
    store.settle();
    store.set({ ki: 9 });
    store.undo();
    expect([store.state.kp, store.state.ki]).toEqual([3, DEFAULTS.ki]);
    store.undo();
    expect(store.state).toEqual(DEFAULTS);
    expect(store.canUndo).toBe(false);
    store.redo();
    store.redo();
    expect([store.state.kp, store.state.ki]).toEqual([3, 9]);
    expect(store.canRedo).toBe(false);
  });

  it("takes a drag back that was cancelled", () => {
    const store = new Store(DEFAULTS);
    store.move({ kp: 9 });
    store.cancel();
    expect(store.state).toEqual(DEFAULTS);
    expect(store.canUndo).toBe(false);
  });

  it("forgets what was undone when something else is done", () => {
    const store = new Store(DEFAULTS);
    store.set({ kp: 5 });
    store.undo();
    store.set({ kp: 6 });
    expect(store.canRedo).toBe(false);
  });

  it("makes no step of nothing", () => {
    const store = new Store(DEFAULTS);
    store.set({ kp: DEFAULTS.kp });
    expect(store.canUndo).toBe(false);
  });
});
