import { describe, expect, it } from "vitest";
import { brief, responseNotes, shareFound } from "../src/notes";

describe("remarks", () => {
  const missing =
    "2 of 4 frequencies are finished; missing: 0.1 rad/s (stalls; give less); 0.2 rad/s (stalls too; give less)";

  it("are said once for many frequencies", () => {
    expect(brief(["at 0.1 rad/s known to 1e-05", "at 2 rad/s known to 3e-05", missing])).toEqual([
      "at 0.1 rad/s known to 1e-05, and alike at 1 more",
      "2 of 4 frequencies are finished; missing: 0.1 rad/s (stalls; give less) and 1 more",
    ]);
    expect(brief(["1 of 2 frequencies are finished; missing: 3 rad/s (stalls)"])).toEqual([
      "1 of 2 frequencies are finished; missing: 3 rad/s (stalls)",
    ]);
  });

  it("tell first what is missing", () => {
    const curve = { frequency_rad_s: [], magnitude_db: [], phase_deg: [], distortion: [] };
    const found = { response: { exact: curve, harmonic_balance: { ...curve, notes: ["at 1 rad/s unsure", missing] } } };
    const notes = responseNotes({ ...found, peaks: { ...curve, missing: "0 of 7 frequencies are finished" } });
    expect(notes[0]).toMatch(/^harmonic balance: 2 of 4/);
    expect(notes).toHaveLength(3);
    expect(shareFound(notes)).toBe("2 of 4 frequencies");
    expect(responseNotes({})).toEqual([]);
  });
});
