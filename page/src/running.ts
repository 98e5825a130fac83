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

/** What belongs into the picture beside the engine's own course: where it is to go, where it was at rest, and limits that it reaches. */
function alsoInSight(found: Found, state: State, which: "speed_rad_s" | "throttle_deg", start: number): number[] {
  const loop = whole(found.loop);
  if (which === "speed_rad_s") return state.step === "command" ? [start + state.command_rad_s] : [];
  const rest = whole(found.point)?.throttle_deg;
  const limits = loop?.saturated_share ? (loop.limits_deg ?? []) : [];
  return [...(rest === undefined ? [] : [rest]), ...limits];
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
  const y = rangeOf(
    [...loop[which], ...alsoInSight(found, state, which, start)],
    which === "speed_rad_s" ? 2 : 1,
    0.15,
  );
  if (which === "speed_rad_s" && state.step === "command") {
    const target = start + state.command_rad_s;
    lines.push({
      label: "command",
      color: COLORS.guide,
      x: [0, state.until_s],
      y: [target, target],
      dash: [3, 3],
      width: 1,
    });
  }
  if (which === "throttle_deg") {
    for (const [k, limit] of (loop.limits_deg ?? []).entries()) {
      lines.push({
        label: k ? "upper limit" : "lower limit",
        legend: "limits",
        quiet: k > 0,
        color: COLORS.guide,
        x: [0, state.until_s],
        y: [limit, limit],
        dash: [3, 3],
        width: 1,
      });
    }
  }
  if (which === "speed_rad_s" && loop.limit_cycle) {
    for (const [k, bound] of [loop.limit_cycle.low_rad_s, loop.limit_cycle.high_rad_s].entries()) {
      const label = `limit cycle, ${k ? "highest" : "lowest"}`;
      lines.push({
        label,
        legend: "limit cycle",
        quiet: k > 0,
        color: COLORS.engine,
        x: [0, state.until_s],
        y: [bound, bound],
        dash: [6, 2],
        width: 1,
      });
    }
  }
  return {
    lines,
    x: [0, state.until_s],
    y,
    ...(state.step === "load" ? { note: "the fitted models know the throttle, not the load" } : {}),
    summary: loop.summary ?? loop.undecided ?? `starts at ${start.toFixed(1)}`,
  };
}
