import { describe, expect, it } from "vitest";
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
