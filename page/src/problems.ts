/** Which problems of a view stand at which control, and why a part of it is missing. */

import { type Found, isProblem } from "./api";
import { responseNotes, shareFound } from "./notes";
import type { State } from "./state";

/** Why a part is not there, where it is a problem. */
export function problemOf(part: unknown): string | undefined {
  if (!isProblem(part)) return undefined;
  return typeof part.problem === "string" ? part.problem : part.problem.detail;
}

/** The first part of a response, found or not: of what is drawn from it alone, its problem is the reason. */
export function within(part: Found["response"]): unknown {
  if (!part || isProblem(part)) return undefined;
  return isProblem(part.exact) ? part.exact : part.harmonic_balance;
}

/** Problems by the control that caused them, and remarks by the control that they are about. */
export function problemsAt(
  found: Found,
  state: State,
): { problems: Map<string, string>; remarks: Map<string, string> } {
  const problems = new Map<string, string>();
  const { response } = found;
  const inner = response && !isProblem(response) ? [response.exact, response.harmonic_balance] : [];
  const swinging = [response, found.models, ...inner]; // what they have no control for is the amplitude's
  const still = inner.slice(0, 1).some(isProblem); // no sinusoid is to blame where the throttle moves nothing at all
  for (const one of [...Object.values(found), ...inner]) {
    if (!isProblem(one) || typeof one.problem === "string") continue;
    if (still && one !== inner[0] && swinging.includes(one)) continue;
    const control = one.problem.control ?? (swinging.includes(one) ? "amplitude_deg" : "");
    if (!problems.has(control)) problems.set(control, one.problem.detail);
  }
  const remark = found.validity && !isProblem(found.validity) ? found.validity.warnings[0] : undefined;
  const key = state.speed_rad_s === undefined ? "throttle_deg" : "speed_rad_s";
  const remarks = new Map(remark ? [[key, `${remark}; the linear model holds no further`]] : []);
  const share = shareFound(responseNotes(found));
  if (share) {
    remarks.set("amplitude_deg", `only ${share} have an answer at this amplitude; why stands below the margins`);
  }
  return { problems, remarks };
}
