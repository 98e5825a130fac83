/** The head of the page: what is true in one line, read aloud when things rest, and what the user must be told of page and server. */

import { type Found, isProblem } from "./api";
import type { Seen, Stage } from "./following";
import { need } from "./parts";

export class Headline {
  private readonly verdict = need("verdict");
  private readonly said = need("said");
  private readonly banner = need("banner");

  /** Say what is true of a view. */
  show({ found, left }: Seen): void {
    const { verdict } = this;
    verdict.textContent = found.words?.verdict ?? (left.length > 0 ? "many ask at once: the rest follows" : "");
    verdict.title = verdict.textContent;
    verdict.className = left.length > 0 && !found.margins ? "" : toneOf(found);
  }

  /** Say that the line is no longer sure, and neither good nor bad. */
  grey(): void {
    this.verdict.className = "stale";
  }

  /** Say why there is no view. */
  refuse(why: string): void {
    this.verdict.textContent = why;
    this.verdict.className = "bad";
  }

  /** Tell something that is not of the view. */
  tell(text: string): void {
    this.banner.textContent = text;
    this.banner.hidden = false;
  }

  hush(): void {
    this.banner.hidden = true;
  }

  /** What the page waits for, for whoever looks at it from outside: tests, and programs that take pictures. */
  stage(stage: Stage): void {
    document.documentElement.dataset.view = stage;
    const { said, verdict } = this;
    // Read aloud when things have come to rest, not at each step of a slider.
    if (stage === "settled" && said.textContent !== verdict.textContent) said.textContent = verdict.textContent;
  }
}

function toneOf({ margins, loop }: Found): string {
  if (!margins || isProblem(margins)) return "bad";
  const run = loop && !isProblem(loop) ? loop : undefined;
  const fails = run && (run.ended || run.still_moving || (run.outcome && run.outcome !== "settled"));
  return margins.stable && !fails ? "good" : "bad";
}
