/** Drawings of what is stable: the roots, and the plane of gains. */

import type { Found, Pair } from "./api";
import { COLORS } from "./colors";
import { MODELS, NAMES, rangeOf, whole } from "./curves";
import type { Drawing, Line } from "./drawing";
import { doubtOf } from "./notes";
import type { State } from "./state";

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
  const room = (high - low) * 0.04;
  const x: [number, number] = [state.kp < low + room ? state.kp - room : low, Math.max(high, state.kp + room)];
  const y: [number, number] = [state.ki < 0 ? state.ki - 0.04 * top : 0, Math.max(top, state.ki * 1.05)];
  for (const one of controllers) {
    const model = one.name === "C1" ? "g1" : one.name === "C2" ? "g2" : "g2d";
    const inside = one.kp >= x[0] && one.kp <= x[1] && one.ki <= y[1];
    const here = one.kd === gains.kd; // else another plane's: this one's shade says nothing of it
    const label = here ? one.name : `${one.name}, of kd ${one.kd}`;
    const color = here ? COLORS[model] : COLORS[`${model}_faint`];
    lines.push({ label, color, x: [one.kp], y: [one.ki], marker: "ring", width: 4, quiet: !inside });
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
