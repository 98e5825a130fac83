import { describe, expect, it } from "vitest";
import { fromPosition, toPosition } from "../src/controls";
import { rangeOf } from "../src/drawings";
import { csvOf, escapeText, svgOf, ticks } from "../src/export";

const x = { label: "frequency", unit: "rad/s", log: true };
const y = { label: "gain", unit: "dB" };
const drawing = {
  lines: [
    { label: 'a "b", <c>', color: "#000", x: [1, 10, 100], y: [0, Number.NaN, 20] },
    { label: "", color: "#111", x: [10], y: [5], marker: "dot" as const },
  ],
  x: [1, 100] as [number, number],
  y: [0, 20] as [number, number],
  summary: "",
};

describe("files of a plot", () => {
  it("are a table with units and without holes", () => {
    expect(csvOf(x, y, drawing).split("\n")).toEqual([
      "curve,frequency (rad/s),gain (dB)",
      '"a ""b"", <c>",1,0',
      '"a ""b"", <c>",100,20',
      "unnamed,10,5",
      "",
    ]);
  });

  it("are a picture whose points stand where its axes say", () => {
    const svg = svgOf("A title", x, y, drawing);
    expect(svg).toContain(">frequency (rad/s)<");
    expect(svg).toContain("a &quot;b&quot;, &lt;c&gt;");
    expect(svg).not.toContain("NaN");
    // The middle decade of the logarithmic axis is half way between its ends: 70 and 624.
    expect(svg).toContain('x="347.0"');
    expect(svg).toContain("M345.0 284.5a2 2");
    expect(escapeText("a&b")).toBe("a&amp;b");
  });

  it("have round ticks", () => {
    expect(ticks(0.1, 200, true)).toEqual([0.1, 1, 10, 100]);
    expect(ticks(-12, 48, false)).toEqual([-10, 0, 10, 20, 30, 40]);
  });
});

describe("ranges and sliders", () => {
  it("have room, and hold a single value", () => {
    expect(rangeOf([1, 3], 0, 0.5)).toEqual([0, 4]);
    expect(rangeOf([5], 10)).toEqual([0, 10]);
    expect(rangeOf([], 1)).toEqual([0, 1]);
  });

  it("come back from where they stand", () => {
    const gain = { low: 0, high: 30, step: 0.001, least: 0.01 };
    for (const value of [0, 0.1, 1.2, 30]) {
      expect(Math.abs(fromPosition(toPosition(value, gain), gain) - value)).toBeLessThanOrEqual(0.01 * value);
    }
    expect(fromPosition(500, { low: 4, high: 80, step: 0.1 })).toBe(42);
    expect(toPosition(1e9, gain)).toBe(1000);
  });
});
