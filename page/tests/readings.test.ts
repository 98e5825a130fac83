import { describe, expect, it } from "vitest";
import { readAt, readingsOf } from "../src/readings";
import { rowsOfCurve } from "../src/table";

describe("readings", () => {
  it("reads between points by a straight line, and nothing outside", () => {
    expect(readAt([0, 1, 3], [0, 2, 6], 2)).toBeCloseTo(4);
    expect(readAt([0, 1, 3], [0, 2, 6], 3)).toBe(6);
    expect(readAt([0, 1, 3], [0, 2, 6], 3.1)).toBeUndefined();
    expect(readAt([], [], 0)).toBeUndefined();
  });

  it("does not read a curve that turns back", () => {
    expect(readAt([0, 2, 1], [0, 1, 2], 0.5)).toBeUndefined();
  });

  it("does not read a gap", () => {
    expect(readAt([0, 1, 2], [0, Number.NaN, 2], 0.5)).toBeUndefined();
  });

  it("reads marks only near the cursor", () => {
    const mark = { label: "C1", color: "red", x: [2], y: [3], marker: "ring" as const };
    expect(readingsOf([mark], 2, () => -1)).toEqual([]);
    expect(readingsOf([mark], 2, () => 0)).toEqual([{ label: "C1", text: "2, 3", color: "red" }]);
  });
});

describe("tables", () => {
  it("keep first and last rows and leave gaps out", () => {
    const x = Array.from({ length: 1000 }, (_, k) => k);
    const rows = rowsOfCurve(
      x,
      x.map((value) => (value === 0 ? 1 : value)),
      10,
    );
    expect(rows).toHaveLength(10);
    expect(rows[0]).toEqual([0, 1]);
    expect(rows.at(-1)).toEqual([999, 999]);
    expect(rowsOfCurve([1, 2], [Number.NaN, 1])).toEqual([[2, 1]]);
  });
});
