/** What a plot shows as files: SVG drawn from the same curves, CSV with units in its header. */

import type { Axis, Drawing, Line } from "./plot";

const WIDTH = 640;
const HEIGHT = 420;
const LEFT = 70;
const RIGHT = 16;
const TOP = 34;
const BOTTOM = 52;

/** Ticks at round numbers: decades where the axis is logarithmic. */
export function ticks(low: number, high: number, log: boolean, about = 6): number[] {
  const found: number[] = [];
  if (log) {
    for (let k = Math.ceil(Math.log10(low) - 1e-9); k <= Math.log10(high) + 1e-9; k++) found.push(10 ** k);
    return found;
  }
  const rough = (high - low) / about;
  const size = 10 ** Math.floor(Math.log10(rough));
  const step = size * ([1, 2, 5, 10].find((m) => m * size >= rough) ?? 10);
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

export function showNumber(value: number, digits = 6): string {
  return String(Number(value.toPrecision(digits)));
}

/** Draw the curves as a picture of its own: white ground, axes with units, a legend beside the curves. */
export function svgOf(title: string, x: Axis, y: Axis, drawing: Drawing): string {
  const place = (axis: Axis, range: [number, number], from: number, to: number) => {
    const scale = axis.log ? Math.log10 : (v: number) => v;
    const [low, high] = range.map(scale) as [number, number];
    return (value: number) => from + ((scale(value) - low) / (high - low)) * (to - from);
  };
  const px = place(x, drawing.x, LEFT, WIDTH - RIGHT);
  const py = place(y, drawing.y, HEIGHT - BOTTOM, TOP);
  const parts: string[] = [];
  for (const value of ticks(...drawing.x, x.log ?? false)) {
    const at = px(value).toFixed(1);
    parts.push(`<path d="M${at} ${TOP}V${HEIGHT - BOTTOM}" stroke="#ddd"/>`);
    parts.push(`<text x="${at}" y="${HEIGHT - BOTTOM + 16}" text-anchor="middle">${showNumber(value)}</text>`);
  }
  for (const value of ticks(...drawing.y, y.log ?? false)) {
    const at = py(value).toFixed(1);
    parts.push(`<path d="M${LEFT} ${at}H${WIDTH - RIGHT}" stroke="#ddd"/>`);
    parts.push(`<text x="${LEFT - 6}" y="${at}" dy="4" text-anchor="end">${showNumber(value)}</text>`);
  }
  parts.push('<g clip-path="url(#inside)">', ...drawing.lines.map((line) => pathOf(line, px, py)), "</g>");
  const named = drawing.lines.filter((line) => line.label !== "");
  for (const [k, line] of named.entries()) {
    const top = TOP + 14 + 15 * k;
    parts.push(`<path d="M${WIDTH - 170} ${top - 4}h18" stroke="${line.color}" stroke-width="2"/>`);
    parts.push(`<text x="${WIDTH - 146}" y="${top}">${escapeText(line.label)}</text>`);
  }
  const middle = (LEFT + WIDTH - RIGHT) / 2;
  const half = (TOP + HEIGHT - BOTTOM) / 2;
  parts.push(`<text x="${middle}" y="20" text-anchor="middle" font-size="14">${escapeText(title)}</text>`);
  parts.push(`<text x="${middle}" y="${HEIGHT - 12}" text-anchor="middle">${escapeText(unitText(x))}</text>`);
  parts.push(
    `<text transform="translate(16 ${half}) rotate(-90)" text-anchor="middle">${escapeText(unitText(y))}</text>`,
  );
  const clip = `<clipPath id="inside"><rect x="${LEFT}" y="${TOP}" width="${WIDTH - LEFT - RIGHT}" height="${HEIGHT - TOP - BOTTOM}"/></clipPath>`;
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${WIDTH} ${HEIGHT}" font-family="sans-serif" font-size="12">` +
    `<defs>${clip}</defs><rect width="100%" height="100%" fill="#fff"/>${parts.join("")}</svg>`
  );
}

function pathOf(line: Line, px: (v: number) => number, py: (v: number) => number): string {
  const points: string[] = [];
  let down = false;
  for (let k = 0; k < line.x.length; k++) {
    const x = px(line.x[k] ?? Number.NaN);
    const y = py(line.y[k] ?? Number.NaN);
    if (!Number.isFinite(x) || !Number.isFinite(y)) {
      down = false;
      continue;
    }
    if (line.marker) points.push(`M${(x - 2).toFixed(1)} ${y.toFixed(1)}a2 2 0 1 0 4 0a2 2 0 1 0 -4 0`);
    else points.push(`${down ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`);
    down = true;
  }
  const dash = line.dash ? ` stroke-dasharray="${line.dash.join(" ")}"` : "";
  return `<path d="${points.join("")}" fill="none" stroke="${line.color}" stroke-width="1.6"${dash}/>`;
}

/** Give the curves as a table of three columns: which curve, and its points. */
export function csvOf(x: Axis, y: Axis, drawing: Drawing): string {
  const rows = [`curve,${unitText(x)},${unitText(y)}`];
  for (const line of drawing.lines) {
    for (let k = 0; k < line.x.length; k++) {
      const [a, b] = [line.x[k], line.y[k]];
      if (a !== undefined && b !== undefined && Number.isFinite(a) && Number.isFinite(b)) {
        rows.push(`${quote(line.label || "unnamed")},${a},${b}`);
      }
    }
  }
  return `${rows.join("\n")}\n`;
}

export function unitText(axis: Axis): string {
  return axis.unit === "" ? axis.label : `${axis.label} (${axis.unit})`;
}

function quote(text: string): string {
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

export function escapeText(text: string): string {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;").replaceAll('"', "&quot;");
}
