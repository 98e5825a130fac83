import { describe, expect, it } from "vitest";
import { rangeOf } from "../src/curves";
import { csvOf, escapeText, ticks } from "../src/export";
import { rectanglesOf } from "../src/paint";
import { fromPosition, stepped, toPosition } from "../src/scales";
import { svgOf } from "../src/svg";

const x = { label: "frequency", unit: "rad/s", log: true };
const y = { label: "gain", unit: "dB" };
const drawing = {
  lines: [
    { label: 'a "b", <c>', color: "#000", x: [1, 10, 100], y: [0, Number.NaN, 20] },
    { label: "mark", color: "#111", x: [10], y: [5], marker: "dot" as const },
    { label: "more", color: "#222", x: [20], y: [5], marker: "cross" as const, quiet: true, width: 2 },
    { label: "Ms 1.4: none", color: "#333", x: [], y: [], dash: [2, 3] },
  ],
  x: [1, 100] as [number, number],
  y: [0, 20] as [number, number],
  shade: { rows: ["010", "011"], x: [10, 20] as [number, number], y: [5, 10] as [number, number] },
  summary: "",
};

describe("files of a plot", () => {
  it("are a table with units and without holes", () => {
    expect(csvOf(x, y, drawing).split("\n")).toEqual([
      "curve,frequency (rad/s),gain (dB)",
      '"a ""b"", <c>",1,0',
      '"a ""b"", <c>",100,20',
      "mark,10,5",
      "more,20,5",
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
    expect(svg).toContain('<path class="dot" d="M344.0 284.5a3 3');
    expect(svg).toContain('fill="#111"');
    expect(svg).toMatch(/<path class="cross" d="M[\d.]+ [\d.]+l4 4m0 -4l-4 4" fill="none" stroke="#222"/);
    expect(svg).toMatch(/class="shade" d="M[^"]*Z"/);
    expect(svg).toContain(">Ms 1.4: none<");
    expect(svg).not.toContain(">more<");
    expect(escapeText("a&b")).toBe("a&amp;b");
  });

  it("shade rows that touch and do not overlap", () => {
    const [first, second] = rectanglesOf(drawing.shade);
    expect(first).toEqual({ x: [12.5, 17.5], y: [2.5, 7.5] });
    expect(second).toEqual({ x: [12.5, 22.5], y: [7.5, 12.5] });
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
    expect([stepped(1.2, 1, gain), stepped(20, -1, gain), stepped(0, 1, gain)]).toEqual([1.3, 19, 0.01]);
    expect(stepped(25, 10, { step: 0.1 })).toBe(26);
  });
});
