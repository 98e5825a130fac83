/** A plot as a picture of its own: the same curves, marks and areas, on white ground. */

import type { Axis, Drawing, Line } from "./drawing";
import { escapeText, showNumber, ticks, unitText } from "./export";
import { KEYS, keyOf, legendText, named } from "./legend";
import { rectanglesOf } from "./paint";

const WIDTH = 640;
const HEIGHT = 420;
const LEFT = 70;
const RIGHT = 16;
const TOP = 34;
const BOTTOM = 52;
const ROW = 17;
const SHADE = 'fill="#0072b2" fill-opacity="0.14"';

type Place = (value: number) => number;

/** Draw the curves: axes with units, the shaded area, every curve and mark as on the page, a legend below. */
export function svgOf(title: string, x: Axis, y: Axis, drawing: Drawing): string {
  const px = placeOf(x, drawing.x, LEFT, WIDTH - RIGHT);
  const py = placeOf(y, drawing.y, HEIGHT - BOTTOM, TOP);
  const { parts: legend, rows } = legendOf(drawing);
  const height = HEIGHT + ROW * rows + 6;
  const middle = (LEFT + WIDTH - RIGHT) / 2;
  const half = (TOP + HEIGHT - BOTTOM) / 2;
  const inside = `x="${LEFT}" y="${TOP}" width="${WIDTH - LEFT - RIGHT}" height="${HEIGHT - TOP - BOTTOM}"`;
  return [
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${WIDTH} ${height}" width="${WIDTH}" height="${height}" font-family="sans-serif" font-size="12">`,
    `<title>${escapeText(title)}</title><desc>${escapeText(drawing.summary)}</desc>`,
    `<defs><clipPath id="inside"><rect ${inside}/></clipPath></defs><rect width="100%" height="100%" fill="#fff"/>`,
    ...gridOf(x, y, drawing, px, py),
    '<g clip-path="url(#inside)">',
    shadeOf(drawing, px, py),
    ...drawing.lines.map((line) => pathOf(line, px, py)),
    `</g><rect ${inside} fill="none" stroke="#999"/>`,
    `<text x="${middle}" y="20" text-anchor="middle" font-size="14" font-weight="bold">${escapeText(title)}</text>`,
    `<text x="${middle}" y="${HEIGHT - 12}" text-anchor="middle">${escapeText(unitText(x))}</text>`,
    `<text transform="translate(16 ${half}) rotate(-90)" text-anchor="middle">${escapeText(unitText(y))}</text>`,
    ...legend,
    "</svg>",
  ].join("");
}

function placeOf(axis: Axis, range: [number, number], from: number, to: number): Place {
  const scale = axis.log ? Math.log10 : (value: number) => value;
  const [low, high] = range.map(scale) as [number, number];
  return (value) => from + ((scale(value) - low) / (high - low)) * (to - from);
}

function gridOf(x: Axis, y: Axis, drawing: Drawing, px: Place, py: Place): string[] {
  const parts: string[] = [];
  const upright = (value: number, color: string) =>
    `<path d="M${px(value).toFixed(1)} ${TOP}V${HEIGHT - BOTTOM}" stroke="${color}"/>`;
  for (const value of ticks(...drawing.x, x.log ?? false)) {
    for (let k = 2; x.log && k < 10; k++) if (k * value < drawing.x[1]) parts.push(upright(k * value, "#f0f0f0"));
    parts.push(upright(value, "#d8d8d8"));
    const at = px(value).toFixed(1);
    parts.push(`<text x="${at}" y="${HEIGHT - BOTTOM + 16}" text-anchor="middle">${showNumber(value)}</text>`);
  }
  for (const value of ticks(...drawing.y, y.log ?? false)) {
    const at = py(value).toFixed(1);
    parts.push(`<path d="M${LEFT} ${at}H${WIDTH - RIGHT}" stroke="#d8d8d8"/>`);
    parts.push(`<text x="${LEFT - 6}" y="${at}" dy="4" text-anchor="end">${showNumber(value)}</text>`);
  }
  return parts;
}

function shadeOf(drawing: Drawing, px: Place, py: Place): string {
  if (!drawing.shade) return "";
  const shapes = rectanglesOf(drawing.shade).map(({ x, y }) => {
    const [left, right, bottom, top] = [px(x[0]), px(x[1]), py(y[0]), py(y[1])].map((value) => value.toFixed(2));
    return `M${left} ${bottom}H${right}V${top}H${left}Z`;
  });
  return shapes.length ? `<path class="shade" d="${shapes.join("")}" ${SHADE} shape-rendering="crispEdges"/>` : "";
}

function pathOf(line: Line, px: Place, py: Place): string {
  const points: string[] = [];
  let down = false;
  for (let k = 0; k < line.x.length; k++) {
    const x = px(line.x[k] ?? Number.NaN);
    const y = py(line.y[k] ?? Number.NaN);
    if (!Number.isFinite(x) || !Number.isFinite(y)) {
      down = false;
      continue;
    }
    const far = Math.min(Math.max(y, -1e4), 1e4);
    if (line.marker) points.push(markOf(line.marker, x, far, line.width ?? 3));
    else points.push(`${down ? "L" : "M"}${x.toFixed(1)} ${far.toFixed(1)}`);
    down = true;
  }
  if (points.length === 0) return "";
  const fill = line.marker === "dot" ? line.color : "none";
  const width = line.marker ? Math.max(1, (line.width ?? 3) / 2) : (line.width ?? 1.6);
  const kind = line.marker ? ` class="${line.marker}"` : "";
  const dash = line.dash ? ` stroke-dasharray="${line.dash.join(" ")}"` : "";
  return `<path${kind} d="${points.join("")}" fill="${fill}" stroke="${line.color}" stroke-width="${width}"${dash} stroke-linejoin="round"/>`;
}

function markOf(kind: "dot" | "ring" | "cross", x: number, y: number, r: number): string {
  if (kind === "cross")
    return `M${(x - r).toFixed(1)} ${(y - r).toFixed(1)}l${2 * r} ${2 * r}m0 ${-2 * r}l${-2 * r} ${2 * r}`;
  return `M${(x - r).toFixed(1)} ${y.toFixed(1)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`;
}

/** Keys and names, as many in a row as there is room for. */
function legendOf(drawing: Drawing): { parts: string[]; rows: number } {
  const parts: string[] = [];
  let [x, row] = [LEFT, 0];
  for (const line of named(drawing)) {
    const text = legendText(line);
    const needed = 42 + 6.4 * text.length;
    if (x + needed > WIDTH && x > LEFT) [x, row] = [LEFT, row + 1];
    const y = HEIGHT + ROW * row + 8;
    const fill = line.marker === "dot" ? line.color : "none";
    const width = line.marker || line.key ? 1.8 : Math.min(line.width ?? 1.8, 5);
    const dash = line.dash ? ` stroke-dasharray="${line.dash.map((d) => d / 1.5).join(" ")}"` : "";
    parts.push(
      `<path transform="translate(${x} ${y - 8})" d="${KEYS[keyOf(line)]}" fill="${fill}" stroke="${line.color}" stroke-width="${width}"${dash}/>`,
    );
    parts.push(`<text x="${x + 23}" y="${y}">${escapeText(text)}</text>`);
    x += needed;
  }
  for (const text of drawing.note ? wrapped(drawing.note) : []) {
    row += 1;
    parts.push(`<text x="${LEFT}" y="${HEIGHT + ROW * row + 8}" fill="#555">${escapeText(text)}</text>`);
  }
  return { parts, rows: row + 1 };
}

const LONGEST = 88;

/** A remark in lines that fit. */
function wrapped(text: string): string[] {
  const lines = [""];
  for (const word of text.split(" ")) {
    const last = lines[lines.length - 1] ?? "";
    if (last !== "" && last.length + word.length >= LONGEST) lines.push(word);
    else lines[lines.length - 1] = last === "" ? word : `${last} ${word}`;
  }
  return lines;
}
