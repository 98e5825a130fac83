import { describe, expect, it } from "vitest";
import { PLAIN, readLook } from "../src/look";
import { change, DEFAULTS, fromAddress, type State, same, toAddress } from "../src/state";

describe("the address", () => {
  it("is empty for the defaults and reads back", () => {
    expect(toAddress(DEFAULTS)).toBe("");
    expect(fromAddress("").state).toEqual(DEFAULTS);
  });

  it("makes any state again", () => {
    const state: State = change(
      { ...DEFAULTS, parameters: { "rotation.inertia": 0.2 }, kp: 1e-7, step: "load" },
      { speed_rad_s: 333.25 },
    );
    const read = fromAddress(toAddress(state));
    expect(read.faults).toEqual([]);
    expect(same(read.state, state)).toBe(true);
    expect(read.state.throttle_deg).toBeUndefined();
    expect(read.state.parameters).toEqual({ "rotation.inertia": 0.2 });
  });

  it("holds how the page is looked at", () => {
    const look = { errors: "distortion", open: ["engine", "jobs"], tour: 5 };
    const address = toAddress(DEFAULTS, look);
    expect(readLook(new URLSearchParams(address.slice(1)), 8)).toEqual({ look, faults: [] });
    expect(fromAddress(address)).toEqual({ state: DEFAULTS, faults: [] });
    expect(toAddress(DEFAULTS, PLAIN)).toBe("");
    const wrong = readLook(new URLSearchParams("errors=all&open=engine attic&tour=9"), 8);
    expect(wrong.look).toEqual({ ...PLAIN, open: ["engine"] });
    expect(wrong.faults).toHaveLength(3);
  });

  it("tells what it cannot read and shows the default there", () => {
    const read = fromAddress("#v=2&kp=NaN&ki=&nonsense=4&step=jump&kd=0.3");
    expect(read.faults).toHaveLength(5);
    expect(read.faults[0]).toContain("version 2");
    expect(read.state).toEqual({ ...DEFAULTS, kd: 0.3 });
  });
});

describe("a change", () => {
  it("keeps one of throttle and speed", () => {
    const fast = change(DEFAULTS, { speed_rad_s: 300 });
    expect(fast.throttle_deg).toBeUndefined();
    expect(change(fast, { throttle_deg: 30 }).speed_rad_s).toBeUndefined();
  });
});
