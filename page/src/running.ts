/** Drawings of how the engine runs: at rest over its throttle, and in time after a step. */

import type { Found } from "./api";
import { COLORS } from "./colors";
import { MODELS, model, rangeOf, whole } from "./curves";
import type { Drawing, Line } from "./drawing";
import type { State } from "./state";

export function drawMap(found: Found, state: State): Drawing | undefined {
  const map = whole(found.map);
  if (!map) return undefined;
  const lines: Line[] = [];
  const unstable = map.throttle_deg.map((_, k) => (map.stable[k] ? Number.NaN : (map.speed_rad_s[k] ?? Number.NaN)));
  let summary = `steady speed from ${map.throttle_deg[0]} to ${map.throttle_deg.at(-1)} deg`;
  if (map.line) {
    const { low_deg: low, high_deg: high, slope_rad_s_per_deg: slope, intercept_rad_s: start } = map.line;
    const ends = [low, high];
    lines.push({
      label: "linear range",
      color: COLORS.range,
      x: ends,
      y: ends.map((a) => start + slope * a),
      width: 7,
    });
    summary += `; a straight line holds from ${low.toFixed(1)} to ${high.toFixed(1)} deg`;
  }
  // Its place in the legend is kept while it is sought, so that nothing jumps.
  if (!map.line && !map.no_line) lines.push({ label: "linear range", color: COLORS.range, x: [], y: [], width: 7 });
  lines.push({ label: "steady speed", color: COLORS.engine, x: map.throttle_deg, y: map.speed_rad_s });
  if (map.stable.includes(false)) {
    lines.push({ label: "unstable", color: COLORS.unstable, x: map.throttle_deg, y: unstable, marker: "cross" });
  }
  const point = whole(found.point);
  if (point) {
    lines.push({
      label: "operating point",
      color: COLORS.mark,
      x: [point.throttle_deg],
      y: [point.speed_rad_s],
      marker: "dot",
      width: 5,
    });
    const reach = [point.throttle_deg - state.amplitude_deg, point.throttle_deg + state.amplitude_deg];
    lines.push({
      label: "amplitude",
      color: COLORS.mark,
      x: reach,
      y: [point.speed_rad_s, point.speed_rad_s],
      width: 1.5,
    });
    summary += `; operating point ${point.throttle_deg.toFixed(2)} deg, ${point.speed_rad_s.toFixed(1)} rad/s`;
  }
  if (map.no_line) summary += "; no straight line holds about it";
  return { lines, x: [0, 90], y: [0, rangeOf(map.speed_rad_s, 10)[1]], summary };
}

/** What belongs into the picture of the throttle beside its own course: where it was at rest, and limits that it reaches. */
function throttleInSight(found: Found): number[] {
  const [loop, point] = [whole(found.loop), whole(found.point)];
  return [...(point ? [point.throttle_deg] : []), ...(loop?.saturated_share ? (loop.limits_deg ?? []) : [])];
}

export function drawTime(found: Found, state: State, which: "speed_rad_s" | "throttle_deg"): Drawing | undefined {
  const loop = whole(found.loop);
  if (!loop) return undefined;
  const lines: Line[] = [];
  for (const name of MODELS) {
    const trace = whole(whole(found.answers)?.[name]);
    if (trace?.time_s) lines.push(model(found, name, trace.time_s, trace[which]));
  }
  lines.push({ label: "engine", color: COLORS.engine, x: loop.time_s, y: loop[which], width: 2.2 });
  const start = loop[which][0] ?? 0;
  const asked = which === "speed_rad_s" && state.step === "command" ? [start + state.command_rad_s] : [];
  const also = which === "throttle_deg" ? throttleInSight(found) : asked;
  const y = rangeOf([...loop[which], ...also], which === "speed_rad_s" ? 2 : 1, 0.15);
  const level = (value: number, look: Omit<Line, "x" | "y">) =>
    lines.push({ ...look, x: [0, state.until_s], y: [value, value], width: 1 });
  for (const target of asked) level(target, { label: "command", color: COLORS.guide, dash: [3, 3] });
  const limits = which === "throttle_deg" ? (loop.limits_deg ?? []) : [];
  for (const [k, limit] of limits.entries()) {
    const label = k ? "upper limit" : "lower limit";
    level(limit, { label, legend: "limits", quiet: k > 0, color: COLORS.guide, dash: [3, 3] });
  }
  const cycle = which === "speed_rad_s" ? loop.limit_cycle : undefined;
  for (const [k, bound] of (cycle ? [cycle.low_rad_s, cycle.high_rad_s] : []).entries()) {
    const label = `limit cycle, ${k ? "highest" : "lowest"}`;
    level(bound, { label, legend: "limit cycle", quiet: k > 0, color: COLORS.engine, dash: [6, 2] });
  }
  return {
    lines,
    x: [0, state.until_s],
    y,
    ...(state.step === "load" ? { note: "the fitted models know the throttle, not the load" } : {}),
    summary: loop.summary ?? loop.ended ?? loop.undecided ?? `starts at ${start.toFixed(1)}`,
  };
}
