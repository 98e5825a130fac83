/** Margins and measures in numbers, as a table beside the plots. */

import { type Found, isProblem, type Promise_ } from "./api";
import { NAMES } from "./curves";
import { doubtOf, responseNotes } from "./notes";

type Cell = string;

export function rowsOf(found: Found): [string, Cell, Cell, Cell, Cell][] {
  const exact = found.margins && !isProblem(found.margins) ? found.margins : undefined;
  const promises = found.promises && !isProblem(found.promises) ? found.promises : {};
  const promise = (name: string): Promise_ | undefined => {
    const one = promises[name];
    return one && !isProblem(one) ? (one as Promise_) : undefined;
  };
  const columns = [exact, promise("g1"), promise("g2"), promise("g2d")];
  const row = (title: string, pick: (one: Promise_) => Cell): [string, Cell, Cell, Cell, Cell] => {
    const cells = columns.map((one) => (one ? pick(one) : "–"));
    return [title, cells[0] ?? "", cells[1] ?? "", cells[2] ?? "", cells[3] ?? ""];
  };
  const safe = (one: Promise_, value: number | undefined, digits: number, factor = 1) =>
    one.stable && one.ms !== undefined ? (value === undefined ? "any" : (factor * value).toFixed(digits)) : "–";
  return [
    row("stable", (one) => (one.stable ? "yes" : "no")),
    row("gain (dB)", (one) => safe(one, one.gain_margin_db, 2)),
    row("phase (deg)", (one) => safe(one, one.phase_margin_deg, 1)),
    row("delay (ms)", (one) => safe(one, one.delay_margin_s, 2, 1000)),
    row("Ms", (one) => (one.stable && one.ms !== undefined ? one.ms.toFixed(2) : "–")),
  ];
}

/** Which models promise something that their data do not determine, and why. */
export function doubtsOf(found: Found): string[] {
  return Object.entries(NAMES).flatMap(([name, title]) => {
    const doubt = doubtOf(found, name);
    return doubt === undefined ? [] : [`the data do not determine the model ${title}: ${doubt}`];
  });
}

function sentence(text: string): string {
  return `${text.slice(0, 1).toUpperCase()}${text.slice(1)}.`;
}

export class Numbers {
  readonly figure = document.createElement("figure");
  private readonly body = document.createElement("tbody");
  private readonly lines = document.createElement("ul");

  constructor() {
    const { figure, body, lines } = this;
    figure.id = "numbers";
    figure.className = "plot";
    const caption = document.createElement("figcaption");
    const title = document.createElement("h2");
    title.textContent = "Margins";
    caption.append(title);
    const table = document.createElement("table");
    const head = document.createElement("thead");
    const cells = ["margin", "exact", "1st", "2nd", "2nd + delay"].map((text) => {
      const cell = document.createElement("th");
      cell.scope = "col";
      cell.textContent = text ?? "";
      return cell;
    });
    const line = document.createElement("tr");
    line.append(...cells);
    head.append(line);
    table.append(head, body);
    const box = document.createElement("div");
    box.className = "scroll";
    box.tabIndex = 0;
    box.setAttribute("role", "region");
    box.setAttribute("aria-label", "Margins in numbers");
    box.append(table, lines);
    figure.append(caption, box);
  }

  /** Say that they are no longer true. */
  grey(): void {
    this.figure.classList.add("stale");
  }

  show(found: Found): void {
    this.figure.classList.toggle("stale", found.margins === undefined || isProblem(found.margins));
    if (!this.figure.classList.contains("stale")) {
      this.body.replaceChildren(
        ...rowsOf(found).map(([title, ...cells]) => {
          const row = document.createElement("tr");
          const head = document.createElement("th");
          head.scope = "row";
          head.textContent = title;
          row.append(head, ...cells.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
          return row;
        }),
      );
    }
    const said = found.words?.lines ?? [];
    const limits = found.validity && !isProblem(found.validity) ? found.validity.warnings : [];
    const more = [...limits, ...doubtsOf(found), ...responseNotes(found)].map(sentence);
    this.lines.replaceChildren(
      ...[...said.slice(0, 1), ...more.filter((text) => !said.includes(text)), ...said.slice(1)].map((text) =>
        Object.assign(document.createElement("li"), { textContent: text }),
      ),
    );
  }
}
