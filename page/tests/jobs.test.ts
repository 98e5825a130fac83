import { describe, expect, it } from "vitest";
import type { Job } from "../src/api";
import { choicesOf, linksOf, wordsOf } from "../src/jobs";
import { clock } from "../src/parts";

const job: Job = {
  id: "a1",
  kind: "study",
  status: "running",
  created: "2026-01-01T10:00:00Z",
  revision: 3,
  progress: 0.42,
  stage: "spectra",
  seconds: 20,
  remaining_s: 75,
  files: [],
};

describe("jobs", () => {
  it("say how far they are and what is left", () => {
    expect(wordsOf(job)).toBe("running, 42 %, spectra, about 1 min 15 s left");
    expect(wordsOf({ ...job, status: "failed", error: { detail: "no trim" } })).toBe("failed, after 20 s, no trim");
  });

  it("offer what their status allows", () => {
    expect(choicesOf(job)).toEqual(["cancel"]);
    expect(choicesOf({ ...job, status: "queued" })).toEqual(["cancel"]);
    expect(choicesOf({ ...job, status: "interrupted" })).toEqual(["resume", "delete"]);
    expect(choicesOf({ ...job, status: "done" })).toEqual(["delete"]);
  });

  it("offer the result page first, and no pictures", () => {
    const files = ["results.json", "figures/4.1.png", "report.html"];
    expect(linksOf({ ...job, files })).toEqual(["report.html", "results.json"]);
  });

  it("write durations in words", () => {
    expect([0.4, 59.6, 120, 200].map(clock)).toEqual(["0 s", "1 min", "2 min", "3 min 20 s"]);
  });
});
