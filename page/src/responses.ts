/** Drawings over frequency: the responses, the models' errors, and the distortion. */

import type { Curve, Found } from "./api";
import { COLORS } from "./colors";
import { MODELS, model, NAMES, rangeOf, whole } from "./curves";
import type { Drawing, Line } from "./drawing";
import { doubtOf, responseNotes, shareFound } from "./notes";

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
