/** What each plot draws of a view. */

import { type Curve, type Found, isProblem, type Pair } from "./api";
import { COLORS } from "./colors";
import { doubtOf, responseNotes, shareFound } from "./notes";
import type { Drawing, Line } from "./plot";
import type { State } from "./state";

export const NAMES: Record<string, string> = { g1: "1st order", g2: "2nd order", g2d: "2nd order + delay" };
const MODELS = ["g1", "g2", "g2d"] as const;
export const DASHES: Record<(typeof MODELS)[number], number[]> = { g1: [2, 3], g2: [6, 3], g2d: [9, 3, 2, 3] };
const UNSURE = [1.5, 4];

function whole<T>(part: T | undefined): Exclude<T, { problem: unknown }> | undefined {
  return part === undefined || isProblem(part) ? undefined : (part as Exclude<T, { problem: unknown }>);
}

/** A range that holds all values, with room; as wide as a smallest one. */
export function rangeOf(values: Iterable<number>, least: number, share = 0.06): [number, number] {
  let low = Number.POSITIVE_INFINITY;
  let high = Number.NEGATIVE_INFINITY;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) return [0, 1];
  const room = Math.max((high - low) * share, (least - (high - low)) / 2, 0);
  return [low - room, high + room];
}

type Model = (typeof MODELS)[number];

function model(found: Found, name: Model, x: readonly number[], y: readonly number[]): Line {
  const doubt = doubtOf(found, name);
  const label = NAMES[name] ?? name;
  if (doubt === undefined) return { label, color: COLORS[name], x, y, dash: DASHES[name] };
  const look = { color: COLORS[`${name}_faint`], dash: UNSURE, width: 1.5 };
  return { ...look, label: `${label}, undetermined`, title: `Its data do not determine it: ${doubt}`, x, y };
}

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

/** A response of the user's own, and what was assumed to find it. */
export type Own = Curve & { note?: string };

/** As far down as a quick engine needs, so that one sees the phase move; and to what was found at sinusoids, where that is further. */
function phaseRange(found: readonly number[]): [number, number] {
  return [Math.min(-450, ...found.map((phase) => phase - 20)), Math.max(10, ...found.map((phase) => phase + 20))];
}

export function drawBode(found: Found, which: "magnitude_db" | "phase_deg", own?: Own): Drawing | undefined {
  const response = whole(found.response);
  if (!response) return undefined;
  const exact = whole(response.exact);
  const lines: Line[] = [];
  const balance = whole(response.harmonic_balance);
  const models = whole(found.models);
  const peaks = whole(found.peaks);
  const x: [number, number] = [0.1, 200];
  for (const name of MODELS) {
    const curve = models?.[name]?.curve;
    if (curve) lines.push(model(found, name, curve.frequency_rad_s, curve[which]));
  }
  if (exact) {
    lines.push({
      label: "exact, small signals",
      legend: "exact",
      color: COLORS.exact,
      x: exact.frequency_rad_s,
      y: exact[which],
    });
  }
  if (balance) {
    const { frequency_rad_s: w } = balance;
    lines.push({
      label: "harmonic balance",
      color: COLORS.balance,
      x: w,
      y: balance[which],
      marker: "ring",
      width: 2.5,
    });
  }
  if (peaks) {
    lines.push({
      label: "peaks",
      color: COLORS.peaks,
      x: peaks.frequency_rad_s,
      y: peaks[which],
      marker: "cross",
      width: 3,
    });
  }
  if (own) {
    const { frequency_rad_s: w } = own;
    lines.push({ label: "own data", color: COLORS.own, x: w, y: own[which], marker: "dot", width: 3 });
  }
  if (!exact && !balance && !own) return undefined;
  const values = [...(exact?.[which] ?? []), ...(balance?.[which] ?? []), ...(own?.[which] ?? [])];
  const y =
    which === "phase_deg"
      ? phaseRange([...(balance?.phase_deg ?? []), ...(own?.phase_deg ?? [])])
      : rangeOf(values, 20);
  const share = shareFound(responseNotes(found));
  const unsure = MODELS.filter((name) => doubtOf(found, name)).map((name) => NAMES[name]);
  const notes = [
    ...(share ? [`only ${share} found, the models fitted to them`] : []),
    ...(own?.note ? [own.note] : []),
  ];
  return {
    lines,
    x,
    y,
    ...(notes.length > 0 ? { note: notes.join("; ") } : {}),
    summary: `${exact ? "exact response and " : ""}${Object.keys(models ?? {}).length} models from 0.1 to 200 rad/s${unsure.length > 0 ? `; undetermined by their data: ${unsure.join(", ")}` : ""}`,
  };
}

export function drawErrors(found: Found, which: "magnitude_db" | "phase_deg"): Drawing | undefined {
  const models = whole(found.models);
  if (!models) return undefined;
  const unit = which === "phase_deg" ? "deg" : "dB";
  const lines: Line[] = [];
  const sizes: number[] = [0];
  const texts: string[] = [];
  for (const name of MODELS) {
    const errors = models[name]?.errors;
    if (!errors) continue;
    lines.push(model(found, name, errors.frequency_rad_s, errors[which]));
    sizes.push(...errors[which]);
    texts.push(`${NAMES[name]} ${Math.max(...errors[which].map(Math.abs)).toFixed(1)} ${unit}`);
  }
  return { lines, x: [0.1, 200], y: rangeOf(sizes, 1), summary: `largest errors: ${texts.join(", ")}` };
}

export function drawDistortion(found: Found): Drawing | undefined {
  const response = whole(found.response);
  const balance = response && whole(response.harmonic_balance);
  if (!balance) return undefined;
  const percent = balance.distortion.map((share) => 100 * share);
  const most = Math.max(0, ...percent);
  const lines: Line[] = [
    { label: "harmonic balance", color: COLORS.balance, x: balance.frequency_rad_s, y: percent, width: 2 },
  ];
  const peaks = whole(found.peaks);
  if (peaks) {
    const read = peaks.distortion.map((share) => 100 * share);
    lines.push({ label: "peaks", color: COLORS.peaks, x: peaks.frequency_rad_s, y: read, marker: "cross", width: 3 });
  }
  return {
    lines,
    x: [0.1, 200],
    y: [0, Math.max(0.1, 1.1 * most)],
    summary: `harmonics at most ${most.toFixed(2)} % of the fundamental`,
  };
}

export function drawRoots(found: Found): Drawing | undefined {
  const models = whole(found.roots)?.models ?? {};
  const plant = whole(found.roots)?.plant ?? whole(found.point)?.rightmost_roots_rad_s;
  if (!plant) return undefined;
  const split = (pairs: readonly Pair[]) => ({ x: pairs.map((p) => p[0]), y: pairs.map((p) => p[1]) });
  const lines: Line[] = [];
  const slow = plant.slice(0, 2).filter((root, k) => k === 0 || Math.hypot(...root) < 200);
  const reach = REACH * Math.max(20, ...slow.map((root) => Math.hypot(...root)));
  const seen: Pair[] = [...slow];
  const add = (name: string, color: string, alone: readonly Pair[], closed: readonly Pair[] | undefined) => {
    lines.push({
      label: name,
      color,
      ...split(alone),
      marker: "cross",
      width: 3.2,
      ...(closed ? { key: "both" } : {}),
    });
    if (!closed) return;
    lines.push({ label: `${name}, loop`, color, ...split(closed), marker: "ring", width: 3.2, quiet: true });
    seen.push(...closed.filter((root, k) => k < 2 || Math.hypot(...root) < reach));
  };
  for (const name of MODELS) {
    const entry = models[name];
    if (!entry) continue;
    seen.push(...entry.poles);
    const sure = doubtOf(found, name) === undefined;
    const label = `${NAMES[name]}${sure ? "" : ", undetermined"}`;
    add(label, sure ? COLORS[name] : COLORS[`${name}_faint`], entry.poles, entry.closed);
  }
  const loop = whole(found.loop_roots)?.roots_rad_s;
  add("engine, exact", COLORS.exact, plant, loop);
  const x = rangeOf([...seen.map((p) => p[0]), 5], 40);
  const high = Math.max(30, ...seen.map((p) => Math.abs(p[1]))) * 1.15;
  const edge = {
    label: "limit of stability",
    color: COLORS.guide,
    x: [0, 0],
    y: [-high, high],
    width: 1.2,
    quiet: true,
  };
  lines.unshift(edge);
  const texts = [
    `right-most root of the engine ${rootText(plant[0])}`,
    ...(loop ? [`of its loop ${rootText(loop[0])}`] : []),
    ...MODELS.flatMap((name) => {
      const closed = models[name]?.closed;
      return closed ? [`of the loop with ${NAMES[name]} ${rootText(closed[0])}`] : [];
    }),
  ];
  return { lines, x, y: [-high, high], note: "\u00d7 alone, \u25cb with the controller", summary: texts.join("; ") };
}

/** A loop's roots further away than so many times the plant's own are not in sight, the right-most ones excepted. */
const REACH = 5;

function rootText(root: Pair | undefined): string {
  if (!root) return "none";
  const turning = root[1] === 0 ? "" : ` \u00b1 ${Math.abs(root[1]).toFixed(2)}j`;
  return `${root[0].toFixed(2)}${turning} rad/s`;
}

export interface Named {
  name: string;
  kp: number;
  ki: number;
  kd: number;
}

export function drawPlane(found: Found, state: State, controllers: readonly Named[]): Drawing | undefined {
  const gains = whole(found.gains);
  if (!gains) return undefined;
  const { kp_low: low, kp_high: high, ki_high: top } = gains.window;
  const lines: Line[] = gains.boundary.map((piece, k) => ({
    label: `limit of stability, exact${k === 0 ? "" : `, piece ${k + 1}`}`,
    quiet: k > 0,
    color: COLORS.exact,
    x: piece.kp,
    y: piece.ki,
    width: 2,
  }));
  const missing: string[] = [];
  for (const [k, contour] of (whole(found.contours)?.contours ?? []).entries()) {
    const look = { color: COLORS.exact, dash: CONTOURS[k] ?? [2, 2], width: 1.3 };
    const name = `Ms ${contour.ms}`;
    if (contour.none) {
      lines.push({ ...look, label: `${name}: none`, x: [], y: [], title: contour.none });
      missing.push(contour.none);
    }
    for (const [j, piece] of (contour.pieces ?? []).entries()) {
      lines.push({
        ...look,
        label: j === 0 ? name : `${name}, piece ${j + 1}`,
        quiet: j > 0,
        x: piece.kp,
        y: piece.ki,
      });
    }
  }
  const x: [number, number] = [Math.min(low, state.kp), Math.max(high, state.kp * 1.05)];
  const y: [number, number] = [0, Math.max(top, state.ki * 1.05)];
  for (const one of controllers) {
    const color = one.name === "C1" ? COLORS.g1 : one.name === "C2" ? COLORS.g2 : COLORS.g2d;
    const inside = one.kp >= x[0] && one.kp <= x[1] && one.ki <= y[1];
    lines.push({ label: one.name, color, x: [one.kp], y: [one.ki], marker: "ring", width: 4, quiet: !inside });
  }
  lines.push({ label: "these gains", color: COLORS.mark, x: [state.kp], y: [state.ki], marker: "dot", width: 5 });
  const shade = { rows: gains.shade, x: [low, high] as [number, number], y: [0, top] as [number, number] };
  const texts = [`kp ${state.kp}, ki ${state.ki} at kd ${state.kd}; stable gains are shaded`, ...missing];
  if (!gains.shade.some((row) => row.includes("1"))) {
    const bounds = [low, high, top].map((value) => Number(value.toPrecision(3)));
    const note = `none of kp ${bounds[0]} to ${bounds[1]}, ki 0 to ${bounds[2]} is stable with kd ${state.kd}`;
    return { lines, x, y, shade, note, summary: [...texts, note].join("; ") };
  }
  return { lines, x, y, shade, summary: texts.join("; ") };
}

const CONTOURS = [
  [2, 3],
  [5, 3],
  [9, 3],
];

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
  const y = rangeOf([...loop[which], ...asked], which === "speed_rad_s" ? 2 : 1, 0.15);
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
