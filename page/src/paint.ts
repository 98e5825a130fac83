/** Curves, marks and shaded areas on a plot's canvas, and the whole of a plot as a picture. */

import type uPlot from "uplot";
import { shown } from "./colors";
import type { Drawing, Line, Shade } from "./drawing";
import { keyOf, legendText, named } from "./legend";

export function paintDrawing(chart: uPlot, drawing: Drawing): void {
  const { ctx, bbox } = chart;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  if (drawing.shade) paintShade(chart, drawing.shade);
  for (const line of drawing.lines) paintLine(chart, line);
  ctx.restore();
}

function paintLine(chart: uPlot, line: Line): void {
  const { ctx } = chart;
  const ratio = devicePixelRatio;
  const color = shown(line.color);
  ctx.strokeStyle = color;
  ctx.fillStyle = color;
  ctx.lineWidth = (line.width ?? 1.6) * ratio;
  ctx.setLineDash((line.dash ?? []).map((d) => d * ratio));
  ctx.lineJoin = "round";
  if (!line.marker) ctx.beginPath();
  let down = false;
  for (let k = 0; k < line.x.length; k++) {
    const x = line.x[k];
    const y = line.y[k];
    if (x === undefined || y === undefined || !Number.isFinite(x) || !Number.isFinite(y)) {
      down = false;
      continue;
    }
    const px = chart.valToPos(x, "x", true);
    const py = Math.min(Math.max(chart.valToPos(y, "y", true), -1e5), 1e5);
    if (line.marker) paintMarker(ctx, line.marker, px, py, (line.width ?? 3) * ratio);
    else if (down) ctx.lineTo(px, py);
    else ctx.moveTo(px, py);
    down = true;
  }
  if (!line.marker) ctx.stroke();
  ctx.setLineDash([]);
}

function paintMarker(ctx: CanvasRenderingContext2D, kind: string, x: number, y: number, r: number): void {
  ctx.beginPath();
  ctx.lineWidth = Math.max(1, r / 2);
  if (kind === "cross") {
    ctx.moveTo(x - r, y - r);
    ctx.lineTo(x + r, y + r);
    ctx.moveTo(x - r, y + r);
    ctx.lineTo(x + r, y - r);
    ctx.stroke();
    return;
  }
  ctx.arc(x, y, r, 0, 2 * Math.PI);
  if (kind === "dot") ctx.fill();
  else ctx.stroke();
}

/** Rectangles of a shaded area in units of the axes, rows that touch but do not overlap. */
export function rectanglesOf(shade: Shade): { x: [number, number]; y: [number, number] }[] {
  const rows = shade.rows.length;
  const high = (shade.y[1] - shade.y[0]) / (rows - 1);
  return shade.rows.flatMap((row, k) => {
    const wide = (shade.x[1] - shade.x[0]) / (row.length - 1);
    return [...row.matchAll(/1+/g)].map((run) => ({
      x: [shade.x[0] + wide * (run.index - 0.5), shade.x[0] + wide * (run.index + run[0].length - 0.5)] as [
        number,
        number,
      ],
      y: [shade.y[0] + high * (k - 0.5), shade.y[0] + high * (k + 0.5)] as [number, number],
    }));
  });
}

function paintShade(chart: uPlot, shade: Shade): void {
  const { ctx } = chart;
  ctx.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--shade").trim();
  for (const { x, y } of rectanglesOf(shade)) {
    const [left, right] = x.map((value) => Math.round(chart.valToPos(value, "x", true))) as [number, number];
    const [bottom, top] = y.map((value) => Math.round(chart.valToPos(value, "y", true))) as [number, number];
    ctx.fillRect(left, top, right - left, bottom - top);
  }
}

const LINE = 18;
const GAP = 14;

/** The plot as a picture: its title, the canvas as it is, and its legend. */
export function pictureOf(title: string, source: HTMLCanvasElement | null, drawing: Drawing): HTMLCanvasElement {
  const ratio = devicePixelRatio;
  const canvas = document.createElement("canvas");
  const width = (source?.width ?? 400) / ratio;
  const measure = canvas.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  const font = "11px system-ui, sans-serif";
  const places: { line: Line; x: number; row: number }[] = [];
  let [x, row] = [8, 0];
  for (const line of named(drawing)) {
    if (measure) measure.font = font;
    const needed = 24 + (measure?.measureText(legendText(line)).width ?? 60) + GAP;
    if (x + needed > width && x > 8) [x, row] = [8, row + 1];
    places.push({ line, x, row });
    x += needed;
  }
  const below = LINE * (row + 1) + (drawing.note ? LINE : 0) + 6;
  const drawn = (source?.height ?? 0) / ratio;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round((26 + drawn + below) * ratio);
  const ctx = canvas.getContext("2d");
  if (!ctx || !source) return canvas;
  ctx.fillStyle = style.getPropertyValue("--panel").trim();
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.drawImage(source, 0, Math.round(26 * ratio));
  ctx.scale(ratio, ratio);
  const ink = style.getPropertyValue("--ink").trim();
  ctx.fillStyle = ink;
  ctx.font = "600 13px system-ui, sans-serif";
  ctx.fillText(title, 8, 18);
  ctx.font = font;
  const height = (at: number) => 26 + drawn + LINE * at + 13;
  for (const { line, x: left, row: at } of places) {
    paintKey(ctx, line, left, height(at) - 4);
    ctx.fillStyle = ink;
    ctx.fillText(legendText(line), left + 24, height(at));
  }
  if (drawing.note) ctx.fillText(drawing.note, 8, height(row + 1), width - 16);
  return canvas;
}

function paintKey(ctx: CanvasRenderingContext2D, line: Line, x: number, y: number): void {
  ctx.strokeStyle = shown(line.color);
  ctx.fillStyle = ctx.strokeStyle;
  const kind = keyOf(line);
  if (kind === "line") {
    ctx.lineWidth = Math.min(line.width ?? 1.8, 5);
    ctx.setLineDash((line.dash ?? []).map((d) => d / 1.5));
    ctx.beginPath();
    ctx.moveTo(x, y);
    ctx.lineTo(x + 18, y);
    ctx.stroke();
    ctx.setLineDash([]);
    return;
  }
  if (kind === "both") paintMarker(ctx, "cross", x + 4, y, 3);
  paintMarker(ctx, kind === "both" ? "ring" : kind, x + (kind === "both" ? 14 : 9), y, 3);
}
