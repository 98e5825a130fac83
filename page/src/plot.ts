/** A plot: axes by uPlot, any curves over them, a readout, and what was drawn for downloads. */

import uPlot from "uplot";
import { isDark, shown } from "./colors";
import type { Axis, Drawing, Line } from "./drawing";
import { csvOf, showNumber } from "./export";
import { Legend } from "./legend";
import { paintDrawing, pictureOf } from "./paint";
import { element } from "./parts";
import { readingsOf } from "./readings";
import { svgOf } from "./svg";
import { showTable } from "./table";

export type DragPhase = "move" | "end" | "cancel";

export interface PlotOptions {
  id: string;
  title: string;
  x: Axis;
  y: Axis;
  drag?: (x: number, y: number, phase: DragPhase) => void;
  hint?: string;
}

const EMPTY: Drawing = { lines: [], x: [1, 2], y: [1, 2], summary: "nothing yet" };

export function axisText(axis: Axis): string {
  return axis.unit === "" ? axis.label : `${axis.label} (${axis.unit})`;
}

export class Plot {
  readonly figure = document.createElement("figure");
  private readonly frame = document.createElement("div");
  private readonly legend = new Legend();
  private readonly readout = document.createElement("output");
  private readonly tip = document.createElement("div");
  private readonly summary = document.createElement("p");
  private readonly why = element("p", { className: "why", hidden: true });
  private chart: uPlot | undefined;
  private drawing = EMPTY;

  constructor(readonly options: PlotOptions) {
    const { figure, frame, readout, summary } = this;
    figure.id = options.id;
    figure.className = "plot";
    figure.setAttribute("aria-label", options.title);
    const caption = document.createElement("figcaption");
    const title = document.createElement("h2");
    title.textContent = options.title;
    caption.append(title, readout, this.downloads());
    frame.className = "frame";
    this.tip.className = "tip";
    this.tip.hidden = true;
    summary.className = "unseen";
    frame.setAttribute("aria-hidden", "true"); // the text below says what the picture shows
    figure.append(caption, frame, this.tip, this.why, this.legend.list, summary);
    if (options.hint) frame.title = options.hint;
    new ResizeObserver(() => this.fit()).observe(frame);
  }

  /** Draw; what was drawn before is no longer shown as stale. */
  show(drawing: Drawing): void {
    this.drawing = drawing;
    this.figure.classList.remove("stale");
    this.summary.textContent = `${this.options.title}: ${drawing.summary}`;
    this.why.hidden = true;
    this.legend.show(drawing, isDark());
    if (!this.chart) this.fit();
    this.chart?.setData([drawing.x as number[], drawing.y as number[]], true);
  }

  /** Say that what is drawn is no longer true. */
  grey(reason = ""): void {
    this.figure.classList.add("stale");
    const text = this.drawing === EMPTY ? reason : `As it was before. ${reason}`;
    if (this.why.textContent !== text) this.why.textContent = text;
    this.why.hidden = text === "";
  }

  restyle(): void {
    if (this.drawing !== EMPTY) this.legend.show(this.drawing, isDark());
    this.chart?.destroy();
    this.chart = undefined;
    this.fit();
  }

  /** Let another plot be chosen in this one's place. */
  offer(choices: readonly [string, string][], choose: (id: string) => void): void {
    const select = document.createElement("select");
    select.setAttribute("aria-label", "Which plot stands here");
    for (const [id, title] of choices) select.append(new Option(title, id, false, id === this.options.id));
    select.addEventListener("change", () => {
      choose(select.value);
      select.value = this.options.id;
    });
    const heading = this.figure.querySelector("h2");
    heading?.classList.add("unseen");
    heading?.after(select);
  }

  /** What is drawn, as a table. */
  csv(): string {
    return csvOf(this.options.x, this.options.y, this.drawing);
  }

  private fit(): void {
    const { clientWidth: width, clientHeight: height } = this.frame;
    if (width < 40 || height < 40 || this.drawing === EMPTY) return;
    if (this.chart) {
      this.chart.setSize({ width, height });
      return;
    }
    this.chart = this.make(width, height);
  }

  private make(width: number, height: number): uPlot {
    const { x, y } = this.options;
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim();
    const grid = style.getPropertyValue("--grid").trim();
    const axis = (text: string): uPlot.Axis => ({
      label: text,
      labelSize: 18,
      labelGap: 0,
      labelFont: "11px system-ui, sans-serif",
      font: "11px system-ui, sans-serif",
      stroke: ink,
      gap: 3,
      grid: { stroke: grid, width: 1 },
      ticks: { stroke: grid, size: 4 },
    });
    const chart = new uPlot(
      {
        width,
        height,
        padding: [6, 10, 0, 0],
        legend: { show: false },
        cursor: { drag: { x: false, y: false }, points: { show: false }, y: true },
        scales: {
          x: { time: false, distr: x.log ? 3 : 1, range: () => this.drawing.x },
          y: { distr: y.log ? 3 : 1, range: () => this.drawing.y },
        },
        axes: [
          { ...axis(axisText(x)), size: 22 },
          { ...axis(axisText(y)), size: 44, space: 22 },
        ],
        series: [{}, { show: true, stroke: "transparent", points: { show: false }, paths: () => null }],
        hooks: {
          draw: [(self) => paintDrawing(self, this.drawing)],
          setCursor: [(self) => this.read(self)],
          ready: [(self) => this.listen(self)],
        },
      },
      [this.drawing.x as number[], this.drawing.y as number[]],
      this.frame,
    );
    return chart;
  }

  private read(chart: uPlot): void {
    const { left, top } = chart.cursor;
    if (left === undefined || top === undefined || left < 0) {
      this.readout.textContent = "";
      this.tip.hidden = true;
      return;
    }
    const { x, y } = this.options;
    const at = [chart.posToVal(left, "x"), chart.posToVal(top, "y")] as const;
    const near = (line: Line) =>
      line.x.findIndex((value, k) => {
        const across = chart.valToPos(value, "x") - left;
        return Math.hypot(across, chart.valToPos(line.y[k] ?? Number.NaN, "y") - top) < 10;
      });
    const readings = readingsOf(this.drawing.lines, at[0], near);
    const units = x.unit === y.unit ? x.unit : `${x.unit}, ${y.unit}`;
    this.readout.textContent = `${showNumber(at[0], 4)}, ${showNumber(at[1], 4)} ${units}`;
    this.tip.replaceChildren(
      ...readings.map(({ label, text, color }) => {
        const line = Object.assign(document.createElement("div"), { textContent: `${label}: ${text}` });
        line.style.borderLeftColor = shown(color);
        return line;
      }),
    );
    this.tip.hidden = readings.length === 0;
    this.tip.classList.toggle("at-left", left > chart.over.clientWidth / 2);
  }

  private listen(chart: uPlot): void {
    const drag = this.options.drag;
    if (!drag) return;
    const over = chart.over;
    over.classList.add("draggable");
    const tell = (event: PointerEvent, phase: DragPhase) => {
      const box = over.getBoundingClientRect();
      const x = Math.min(Math.max(event.clientX - box.left, 0), box.width);
      const y = Math.min(Math.max(event.clientY - box.top, 0), box.height);
      drag(chart.posToVal(x, "x"), chart.posToVal(y, "y"), phase);
    };
    over.addEventListener("pointerdown", (event) => {
      if (!event.isPrimary || event.button !== 0) return;
      over.setPointerCapture(event.pointerId);
      tell(event, "move");
    });
    over.addEventListener("pointermove", (event) => {
      if (over.hasPointerCapture(event.pointerId)) tell(event, "move");
    });
    over.addEventListener("pointerup", (event) => {
      if (over.hasPointerCapture(event.pointerId)) tell(event, "end");
    });
    // Two fingers move or enlarge the page: what the first of them began is taken back.
    over.addEventListener("pointercancel", (event) => {
      if (event.isPrimary) tell(event, "cancel");
    });
  }

  private downloads(): HTMLElement {
    const menu = document.createElement("span");
    menu.className = "downloads";
    const { id, title, x, y } = this.options;
    const table = document.createElement("button");
    table.type = "button";
    table.textContent = "Table";
    table.setAttribute("aria-label", `Show ${title} as a table`);
    table.addEventListener("click", () => showTable(title, x, y, this.drawing));
    menu.append(table);
    const kinds: [string, () => Promise<Blob> | Blob][] = [
      ["PNG", () => this.png()],
      ["SVG", () => new Blob([svgOf(title, x, y, this.drawing)], { type: "image/svg+xml" })],
      ["CSV", () => new Blob([this.csv()], { type: "text/csv" })],
    ];
    for (const [kind, make] of kinds) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = kind;
      button.setAttribute("aria-label", `Save ${title} as ${kind}`);
      button.addEventListener("click", async () => save(await make(), `${id}.${kind.toLowerCase()}`));
      menu.append(button);
    }
    return menu;
  }

  private png(): Promise<Blob> {
    const canvas = pictureOf(this.options.title, this.frame.querySelector("canvas"), this.drawing);
    return new Promise((resolve, reject) =>
      canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("no image")))),
    );
  }
}

export function save(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000); // a busy browser fetches it late
}
