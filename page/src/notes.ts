/** Remarks of the server's, made brief: what is said of many frequencies is said once, with their number. */

import { type Found, isProblem } from "./api";

/** Shorten a list of what is missing to its first entry; give its number of entries too. */
function shortened(text: string): string {
  const [head = "", list] = text.split("; missing: ");
  if (list === undefined) return text;
  const entries = list.split("); ");
  if (entries.length < 2) return text;
  return `${head}; missing: ${entries[0]}) and ${entries.length - 1} more`;
}

/** Say alike remarks once. */
export function brief(notes: readonly string[]): string[] {
  const kinds = new Map<string, string[]>();
  for (const note of notes) {
    const kind = note.replace(/[-+]?\d[\d.]*(e[-+]?\d+)?/g, "#");
    kinds.set(kind, [...(kinds.get(kind) ?? []), note]);
  }
  return [...kinds.values()].map(([first = "", ...others]) => {
    const text = shortened(first);
    return others.length === 0 ? text : `${text}, and alike at ${others.length} more`;
  });
}

/** Remarks on how the response was found; those that tell what is missing first. */
export function responseNotes(found: Found): string[] {
  const { response, peaks } = found;
  const balance = response && !isProblem(response) ? response.harmonic_balance : undefined;
  const notes = balance && !isProblem(balance) ? brief(balance.notes).map((note) => `harmonic balance: ${note}`) : [];
  if (peaks && !isProblem(peaks) && peaks.missing) notes.push(`peaks: ${shortened(peaks.missing)}`);
  return notes.sort((a, b) => Number(lacks(b)) - Number(lacks(a)));
}

export function lacks(note: string): boolean {
  return note.includes("; missing: ");
}

/** How many frequencies were found, where some were not: "15 of 42 frequencies". */
export function shareFound(notes: readonly string[]): string | undefined {
  return notes.find(lacks)?.match(/\d+ of \d+ frequencies/)?.[0];
}

/** Why the data do not determine a fitted model, where they do not. */
export function doubtOf(found: Found, name: string): string | undefined {
  const { models } = found;
  const reasons = models && !isProblem(models) ? (models[name]?.undetermined ?? []) : [];
  return reasons.length > 0 ? reasons.join("; ") : undefined;
}
