import { describe, expect, it } from "vitest";
import { LIVE, type PartName } from "../src/api";
import { keyOf, Reads } from "../src/needs";
import { change, DEFAULTS, type State } from "../src/state";

const moved = (patch: Partial<State>): PartName[] => {
  const next = change(DEFAULTS, patch);
  return LIVE.filter((part) => keyOf(part, next) !== keyOf(part, DEFAULTS));
};

describe("what a move asks for", () => {
  it("asks for all that a new operating point changes", () => {
    expect(moved({ throttle_deg: 26 })).toEqual(LIVE);
    expect(moved({ speed_rad_s: 300 })).toEqual(LIVE);
    expect(moved({ parameters: { "rotation.inertia": 0.2 } })).toEqual(LIVE);
  });

  it("leaves out what a gain, an amplitude or a step does not change", () => {
    expect(moved({ kp: 1.3 })).toEqual(["roots", "margins", "loop_roots", "promises", "loop", "answers", "words"]);
    expect(moved({ kd: 0.2 })).toContain("gains");
    expect(moved({ amplitude_deg: 4 })).toEqual(["response", "models", "roots", "promises", "answers", "words"]);
    expect(moved({ command_rad_s: 50 })).toEqual(["loop", "answers", "words"]);
    expect(moved({ high_deg: 50 })).toEqual(["loop", "answers", "words"]);
    expect(moved({})).toEqual([]);
  });

  it("knows parameters in any order", () => {
    const one = change(DEFAULTS, { parameters: { a: 1, b: 2 } });
    expect(keyOf("point", change(DEFAULTS, { parameters: { b: 2, a: 1 } }))).toBe(keyOf("point", one));
  });
});

describe("what was read", () => {
  it("stands while it is the same, whatever else changes", () => {
    const list = [1];
    const reads = new Reads<{ a?: number[]; b?: number; c?: number }>({ a: list, b: 1 });
    expect([reads.of.a, reads.of.c]).toEqual([list, undefined]);
    expect(reads.stand({ a: list, b: 2 })).toBe(true);
    expect(reads.stand({ a: [1], b: 1 })).toBe(false);
    expect(reads.stand({ a: list, b: 1, c: 3 })).toBe(false);
  });
});
