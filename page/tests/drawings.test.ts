import { describe, expect, it } from "vitest";
import type { Found } from "../src/api";
import { drawPlane } from "../src/drawings";
import { DEFAULTS } from "../src/state";

const plane = (shade: string[]): Found => ({
  gains: { kd: 0.4, window: { kp_low: -0.16625, kp_high: 8.31, ki_high: 831.29 }, boundary: [], shade },
});

describe("the plane of gains", () => {
  it("says where none is stable, and no more than that", () => {
    const state = { ...DEFAULTS, kd: 0.4 };
    const empty = drawPlane(plane(["000", "000"]), state, []);
    expect(empty?.note).toBe("none of kp -0.166 to 8.31, ki 0 to 831 is stable with kd 0.4");
    expect(empty?.summary).toContain(empty?.note);
    expect(drawPlane(plane(["000", "010"]), state, [])?.note).toBeUndefined();
  });
});
