/** Long work: studies and sinestreams that run on the server while the page does other things, and outlive it. */

import { type Job, Lost, Refused } from "./api";
import { clock, element } from "./parts";

export interface JobCalls {
  list: () => Promise<{ jobs: Job[]; warnings?: string[] }>;
  start: (kind: Job["kind"]) => Promise<unknown>;
  opened: (on: boolean) => void;
  change: (job: Job, what: "cancel" | "resume" | "delete") => Promise<unknown>;
}

const EVERY = 1000;
const REST = 5000;

/** What is said of a job beside its progress. */
export function wordsOf(job: Job): string {
  const parts: string[] = [job.status];
  if (job.status === "running") parts.push(`${Math.round(100 * job.progress)} %`, job.stage);
  if (job.remaining_s !== undefined && job.status === "running") parts.push(`about ${clock(job.remaining_s)} left`);
  if (job.seconds > 0 && job.status !== "running") parts.push(`after ${clock(job.seconds)}`);
  if (job.error) parts.push(job.error.detail);
  return parts.filter((part) => part !== "").join(", ");
}

/** What can be done with a job as it stands. */
export function choicesOf(job: Job): ("cancel" | "resume" | "delete")[] {
  if (job.status === "queued" || job.status === "running") return ["cancel"];
  return job.status === "interrupted" || job.status === "cancelled" ? ["resume", "delete"] : ["delete"];
}

/** The files that are offered: the page of results first, then tables and records; pictures are in the page. */
export function linksOf(job: Job): string[] {
  const first = job.files.filter((name) => name.endsWith(".html"));
  return [...first, ...job.files.filter((name) => !name.includes("/") && !name.endsWith(".html"))].slice(0, 6);
}

export class Jobs {
  private readonly list = element("ul", { className: "jobs" });
  private readonly told = element("p", { className: "fault" });
  private timer: ReturnType<typeof setTimeout> | undefined;
  private drawn = "";

  constructor(
    private readonly panel: HTMLDialogElement,
    private readonly opener: HTMLButtonElement,
    private readonly calls: JobCalls,
  ) {
    this.told.setAttribute("role", "alert");
    const close = element("button", { type: "button", textContent: "Close" });
    close.addEventListener("click", () => this.panel.close());
    const row = element("p", { className: "row" });
    row.append(this.button("Start a study", () => calls.start("study")));
    row.append(
      this.button("Start a sinestream", () => calls.start("sinestream")),
      close,
    );
    const title = element("h2", { textContent: "Jobs", id: "jobs-title" });
    const text = element("p", {
      textContent:
        "A study reproduces the whole chain for the state shown, with report and tables; a sinestream simulates sinusoids at all frequencies. They go on without this page.",
    });
    panel.append(title, text, row, this.told, this.list);
    panel.setAttribute("aria-labelledby", "jobs-title");
    opener.addEventListener("click", () => (panel.open ? panel.close() : this.open()));
    panel.addEventListener("keydown", (event) => {
      if (event.key === "Escape") panel.close();
    });
    panel.addEventListener("close", () => {
      opener.focus();
      calls.opened(false);
    });
    void this.look();
  }

  open(): void {
    if (!this.panel.open) this.panel.show();
    this.calls.opened(true);
    void this.look();
  }

  private button(text: string, act: () => Promise<unknown>): HTMLButtonElement {
    const made = element("button", { type: "button", textContent: text });
    made.addEventListener("click", async () => {
      if (made.ariaDisabled) return;
      made.ariaDisabled = "true"; // not `disabled`, which would lose the focus
      this.told.textContent = "";
      try {
        await act();
      } catch (error) {
        if (!(error instanceof Refused || error instanceof Lost)) throw error;
        this.told.textContent = error.message;
      } finally {
        made.ariaDisabled = null;
      }
      await this.look();
    });
    return made;
  }

  /** Ask how the jobs stand, soon again while one runs. */
  private async look(): Promise<void> {
    clearTimeout(this.timer);
    let wait = this.panel.open ? REST : 0;
    try {
      const { jobs } = await this.calls.list();
      this.opener.hidden = false;
      this.show(jobs);
      const running = jobs.filter((job) => job.status === "running" || job.status === "queued").length;
      this.opener.textContent = running > 0 ? `Jobs (${running})` : "Jobs";
      if (running > 0) wait = EVERY;
    } catch (error) {
      if (error instanceof Refused && error.problem.status === 404) {
        this.opener.hidden = true;
        return;
      }
      if (!(error instanceof Refused || error instanceof Lost)) throw error;
      wait = REST;
    }
    if (wait > 0) this.timer = setTimeout(() => void this.look(), wait);
  }

  private show(jobs: readonly Job[]): void {
    const text = JSON.stringify(jobs);
    if (text === this.drawn) return;
    this.drawn = text;
    const held = this.list.contains(document.activeElement) ? document.activeElement?.id : undefined;
    this.list.replaceChildren(...jobs.map((job) => this.entry(job)));
    if (jobs.length === 0) this.list.append(element("li", { textContent: "none yet" }));
    if (held) this.refocus(held);
  }

  /** Give the focus to what had it; where that is gone, to what can be done with the same job, or with the next. */
  private refocus(id: string): void {
    const job = document.getElementById(id.replace(/^[a-z]+-/, "job-"));
    const next = document.getElementById(id) ?? job?.querySelector("button") ?? this.panel.querySelector("button");
    next?.focus();
  }

  private entry(job: Job): HTMLElement {
    const entry = element("li", { id: `job-${job.id}` });
    entry.dataset.status = job.status;
    const name = `${job.kind} of ${job.created.slice(0, 16).replace("T", " ")}`;
    entry.append(element("strong", { textContent: name }), " ", element("span", { textContent: wordsOf(job) }));
    if (job.status === "running" || job.status === "queued") {
      const bar = element("progress", { max: 1, value: job.progress });
      bar.setAttribute("aria-label", `Progress of the ${name}`);
      entry.append(bar);
    }
    const row = element("p", { className: "row" });
    for (const file of linksOf(job)) {
      const path = file.split("/").map(encodeURIComponent).join("/");
      const link = element("a", { textContent: file.endsWith(".html") ? "Result page" : file, target: "_blank" });
      link.href = `/api/v1/jobs/${encodeURIComponent(job.id)}/files/${path}`;
      link.rel = "noopener";
      row.append(link, " ");
    }
    const words = { cancel: "Cancel", resume: "Go on", delete: "Delete" };
    for (const what of choicesOf(job)) {
      const button = this.button(words[what], () => this.calls.change(job, what));
      button.id = `${what}-${job.id}`;
      button.setAttribute("aria-label", `${words[what]} the ${name}`);
      row.append(button);
    }
    entry.append(row);
    return entry;
  }
}
