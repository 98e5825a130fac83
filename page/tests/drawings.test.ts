import { describe, expect, it } from "vitest";
import type { Found } from "../src/api";
import { COLORS } from "../src/colors";
import { doubtsOf } from "../src/numbers";
import { drawBode, drawErrors } from "../src/responses";
import { drawTime } from "../src/running";
import { drawPlane, drawRoots } from "../src/stability";
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

describe("a model that its data do not determine", () => {
  const curve = { frequency_rad_s: [1], magnitude_db: [0], phase_deg: [0] };
  const fit = { numerator: [1], denominator: [1, 1], delay_s: 0, accepted: true, verdict: "", curve, errors: curve };
  const trace = { time_s: [0, 1], speed_rad_s: [0, 1], throttle_deg: [0, 1] };
  const found = (undetermined: string[]): Found => ({
    response: { exact: curve, harmonic_balance: { problem: "none" } },
    models: { g2: { ...fit, undetermined } },
    roots: { plant: [[-1, 0]], models: { g2: { poles: [[-2, 0]] } } },
    loop: trace,
    answers: { g2: trace },
  });
  const drawn = (it: Found) =>
    [drawBode(it, "phase_deg"), drawErrors(it, "phase_deg"), drawRoots(it), drawTime(it, DEFAULTS, "speed_rad_s")].map(
      (drawing) => drawing?.lines.find((line) => line.label.startsWith("2nd order")),
    );

  it("is faint and says so wherever it is drawn", () => {
    for (const line of drawn(found(["its gain may as well be 0"]))) {
      expect([line?.label, line?.color]).toEqual(["2nd order, undetermined", COLORS.g2_faint]);
    }
    expect(doubtsOf(found(["its gain may as well be 0"]))).toEqual([
      "the data do not determine the model 2nd order: its gain may as well be 0",
    ]);
    expect(drawBode(found(["why"]), "phase_deg")?.summary).toContain("undetermined by their data: 2nd order");
  });

  it("is drawn as ever where they do", () => {
    for (const line of drawn(found([]))) expect([line?.label, line?.color]).toEqual(["2nd order", COLORS.g2]);
    expect(doubtsOf(found([]))).toEqual([]);
  });
});
