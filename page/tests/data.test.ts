import { describe, expect, it } from "vitest";
import { kindOf, type LogAnswer, linesOf, ownOf } from "../src/data";
import { drawBode } from "../src/responses";

describe("own files", () => {
  it("are known by name and header", () => {
    expect(kindOf("mine.toml", "")).toBe("engine");
    expect(kindOf("a.csv", "# made by hand\ntime_s,throttle_deg,speed_rpm\n0,1,2")).toBe("log");
    expect(kindOf("a.csv", "frequency_hz;magnitude;phase_deg\n")).toBe("response");
    expect(kindOf("a.csv", "x,y\n1,2")).toBeUndefined();
    expect(kindOf("picture.csv", "\u0089PNG")).toBeUndefined();
  });

  it("say what an engine file changes", () => {
    const changes = [{ key: "rotation.inertia", unit: "kg m2", value: 0.2, built_in: 0.1454 }];
    const state = { engine: "lee1995", parameters: { "rotation.inertia": 0.2 } };
    expect(linesOf({ kind: "engine", name: "mine", changes, state })).toEqual([
      "rotation.inertia = 0.2 kg m2 (published: 0.1454)",
    ]);
  });

  it("say how far the response of a log can be trusted", () => {
    const problem = { problem: { title: "", detail: "too few points", status: 422 } };
    const answer: LogAnswer = {
      kind: "log",
      name: "a",
      duration_s: 10,
      samples: 1000,
      log: { time_s: [], speed_rad_s: [], throttle_deg: [] },
      engine: problem,
      exact: problem,
      models: {},
      response: {
        frequency_rad_s: [1, 2],
        magnitude_db: [0, 0],
        phase_deg: [0, 0],
        models: {},
        engine: problem,
        relative_deviation: [0.01, 0.002],
        relative_bias: [0.03, 0.05],
        between_samples: "straight",
        between_samples_known: false,
        left_out: 3,
        remark: "it was not said",
      },
      notes: [],
    };
    const lines = linesOf(answer);
    expect(lines).toContain("its response: 2 frequencies; standard deviation at most 1 %, not random at most 5 %");
    expect(lines.find((line) => line.startsWith("3 more frequencies are left out"))).toContain("too little coherence");
    expect(lines).toContain("throttle between the samples: straight");
    expect(lines).toContain("it was not said");
    const known = { ...answer, response: { ...answer.response, between_samples_known: true } };
    expect(ownOf(known as LogAnswer)?.note).toBeUndefined();
    const own = ownOf(answer);
    const note = "own data: throttle taken as straight between samples";
    expect(own?.note).toBe(note);
    expect(drawBode({ response: { exact: problem, harmonic_balance: problem } }, "phase_deg", own)?.note).toBe(note);
  });

  it("tell problems in place of numbers", () => {
    const problem = { problem: { title: "", detail: "too few points", status: 422 } };
    const answer = {
      kind: "response",
      name: "a",
      response: { frequency_rad_s: [1], magnitude_db: [0], phase_deg: [0] },
    };
    const lines = linesOf({
      ...answer,
      kind: "response",
      notes: ["assumed"],
      models: { g1: problem },
      engine: problem,
    });
    expect(lines).toContain("1st order: too few points");
    expect(lines).toContain("not compared with the engine: too few points");
    expect(lines.at(-1)).toBe("assumed");
  });
});
