import { describe, expect, it } from "vitest";
import type { Found } from "../src/api";
import { COLORS } from "../src/colors";
import { logRange } from "../src/data";
import { doubtsOf } from "../src/numbers";
import { problemsAt } from "../src/problems";
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

describe("gains and courses in sight", () => {
  const state = { ...DEFAULTS, kp: -1, ki: -1, kd: 0.4 };
  const shown = drawPlane(plane(["010"]), state, [
    { name: "C1", kp: 2, ki: 16, kd: 0 },
    { name: "C2", kp: 5, ki: 98, kd: 0.4 },
  ]);
  const line = (label: string) => shown?.lines.find((one) => one.label === label);

  it("says of a controller that another plane is its own", () => {
    expect(line("C1, of kd 0")?.color).toBe(COLORS.g1_faint);
    expect(line("C2")?.color).toBe(COLORS.g2);
  });

  it("leaves room about the gains", () => {
    expect(shown?.x[0]).toBeLessThan(-1);
    expect(shown?.y[0]).toBeLessThan(-1);
    expect(drawPlane(plane(["010"]), DEFAULTS, [])?.y[0]).toBe(0);
  });

  it("shows where the throttle was at rest, and limits that it reaches", () => {
    const trace = { time_s: [0, 1], speed_rad_s: [240, 250], throttle_deg: [30, 30] };
    const point = { throttle_deg: 25 } as Found["point"];
    const course = (loop: Found["loop"]) => drawTime({ point, loop } as Found, DEFAULTS, "throttle_deg")?.y ?? [0, 0];
    expect(course(trace)[0]).toBeLessThan(25);
    expect(course({ ...trace, limits_deg: [0, 79] })[1]).toBeLessThan(32);
    expect(course({ ...trace, limits_deg: [0, 79], saturated_share: 0.2 })[1]).toBeGreaterThan(79);
  });

  it("takes all curves of a log into sight, but none that runs away", () => {
    const lines = [{ label: "model", color: "red", x: [0, 1], y: [90, 1e6] }];
    expect(logRange(lines, [100, 110])).toEqual([90, 140]);
  });

  it("blames no amplitude where the throttle moves nothing", () => {
    const problem = (control?: string) => ({ problem: { detail: `of ${control}`, status: 422, control } });
    const found = (exact: unknown) =>
      ({ response: { exact, harmonic_balance: problem("amplitude_deg") }, models: problem() }) as unknown as Found;
    expect([...problemsAt(found(problem("throttle_deg")), DEFAULTS).problems.keys()]).toEqual(["throttle_deg"]);
    expect([...problemsAt(found({}), DEFAULTS).problems.keys()]).toEqual(["amplitude_deg"]);
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
