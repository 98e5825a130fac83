/** A plot: axes by uPlot, any curves over them, a readout, and what was drawn for downloads. */

import uPlot from "uplot";
import { csvOf, showNumber, svgOf } from "./export";
import { readingsOf } from "./readings";
import { showTable } from "./table";

export interface Line {
  label: string;
  color: string;
  x: readonly number[];
  y: readonly number[];
  dash?: number[];
  width?: number;
  marker?: "dot" | "ring" | "cross";
  fill?: boolean;
}

export interface Axis {
  label: string;
  unit: string;
  log?: boolean;
}

export interface Shade {
  rows: readonly string[];
  x: [number, number];
  y: [number, number];
}

export interface Drawing {
  lines: Line[];
  x: [number, number];
  y: [number, number];
  shade?: Shade;
  summary: string;
}

export interface PlotOptions {
  id: string;
  title: string;
  x: Axis;
  y: Axis;
  drag?: (x: number, y: number, phase: "move" | "end") => void;
  hint?: string;
}

const RING = "M6 4a3 3 0 1 0 6 0a3 3 0 1 0 -6 0";

const EMPTY: Drawing = { lines: [], x: [1, 2], y: [1, 2], summary: "nothing yet" };

export function axisText(axis: Axis): string {
  return axis.unit === "" ? axis.label : `${axis.label} (${axis.unit})`;
}

export class Plot {
  readonly figure = document.createElement("figure");
  private readonly frame = document.createElement("div");
  private readonly legend = document.createElement("ul");
  private readonly readout = document.createElement("output");
  private readonly tip = document.createElement("div");
  private readonly summary = document.createElement("p");
  private chart: uPlot | undefined;
  private drawing = EMPTY;

  constructor(readonly options: PlotOptions) {
    const { figure, frame, legend, readout, summary } = this;
    figure.id = options.id;
    figure.className = "plot";
    const caption = document.createElement("figcaption");
    const title = document.createElement("h2");
    title.textContent = options.title;
    caption.append(title, readout, this.downloads());
    frame.className = "frame";
    this.tip.className = "tip";
    this.tip.hidden = true;
    legend.className = "legend";
    summary.className = "unseen";
    frame.setAttribute("aria-hidden", "true"); // the text below says what the picture shows
    figure.append(caption, frame, this.tip, legend, summary);
    if (options.hint) frame.title = options.hint;
    new ResizeObserver(() => this.fit()).observe(frame);
  }

  /** Draw; what was drawn before is no longer shown as stale. */
  show(drawing: Drawing): void {
    this.drawing = drawing;
    this.figure.classList.remove("stale");
    this.summary.textContent = `${this.options.title}: ${drawing.summary}`;
    this.legend.replaceChildren(
      ...drawing.lines
        .filter((line) => line.label !== "")
        .map((line) => {
          const entry = document.createElement("li");
          const key = document.createElementNS("http://www.w3.org/2000/svg", "svg");
          key.setAttribute("viewBox", "0 0 18 8");
          key.setAttribute("aria-hidden", "true");
          const shape = document.createElementNS("http://www.w3.org/2000/svg", "path");
          const paths = { cross: "M6 1l6 6m0 -6l-6 6", ring: RING, dot: RING, line: "M0 4h18" };
          shape.setAttribute("d", paths[line.marker ?? "line"]);
          shape.setAttribute("stroke", line.color);
          shape.setAttribute("stroke-width", "2");
          shape.setAttribute("fill", line.marker === "dot" ? line.color : "none");
          if (line.dash) shape.setAttribute("stroke-dasharray", line.dash.map((d) => d / 1.5).join(" "));
          key.append(shape);
          entry.append(key, line.label);
          return entry;
        }),
    );
    if (!this.chart) this.fit();
    this.chart?.setData([drawing.x as number[], drawing.y as number[]], true);
  }

  /** Say that what is drawn is no longer true. */
  grey(): void {
    this.figure.classList.add("stale");
  }

  restyle(): void {
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
          { ...axis(axisText(y)), size: 44 },
        ],
        series: [{}, { show: true, stroke: "transparent", points: { show: false }, paths: () => null }],
        hooks: {
          draw: [(self) => this.paint(self)],
          setCursor: [(self) => this.read(self)],
          ready: [(self) => this.listen(self)],
        },
      },
      [this.drawing.x as number[], this.drawing.y as number[]],
      this.frame,
    );
    return chart;
  }

  private paint(chart: uPlot): void {
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    if (this.drawing.shade) paintShade(chart, this.drawing.shade);
    for (const line of this.drawing.lines) paintLine(chart, line);
    ctx.restore();
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
        line.style.borderLeftColor = color;
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
    const tell = (event: PointerEvent, phase: "move" | "end") => {
      const box = over.getBoundingClientRect();
      const x = Math.min(Math.max(event.clientX - box.left, 0), box.width);
      const y = Math.min(Math.max(event.clientY - box.top, 0), box.height);
      drag(chart.posToVal(x, "x"), chart.posToVal(y, "y"), phase);
    };
    over.addEventListener("pointerdown", (event) => {
      over.setPointerCapture(event.pointerId);
      tell(event, "move");
    });
    over.addEventListener("pointermove", (event) => {
      if (over.hasPointerCapture(event.pointerId)) tell(event, "move");
    });
    over.addEventListener("pointerup", (event) => tell(event, "end"));
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
    const source = this.frame.querySelector("canvas");
    const canvas = document.createElement("canvas");
    canvas.width = source?.width ?? 1;
    canvas.height = source?.height ?? 1;
    const ctx = canvas.getContext("2d");
    if (ctx && source) {
      ctx.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--panel").trim();
      ctx.fillRect(0, 0, canvas.width, canvas.height);
      ctx.drawImage(source, 0, 0);
    }
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
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

function paintLine(chart: uPlot, line: Line): void {
  const { ctx } = chart;
  const ratio = devicePixelRatio;
  ctx.strokeStyle = line.color;
  ctx.fillStyle = line.color;
  ctx.lineWidth = (line.width ?? 1.6) * ratio;
  ctx.setLineDash((line.dash ?? []).map((d) => d * ratio));
  ctx.lineJoin = "round";
  if (!line.marker) ctx.beginPath();
  let down = false;
  for (let k = 0; k < line.x.length; k++) {
    const x = line.x[k];
    const y = line.y[k];
    if (x === undefined || y === undefined || !Number.isFinite(x) || !Number.isFinite(y)) {
      down = false;
      continue;
    }
    const px = chart.valToPos(x, "x", true);
    const py = Math.min(Math.max(chart.valToPos(y, "y", true), -1e5), 1e5);
    if (line.marker) {
      paintMarker(ctx, line.marker, px, py, (line.width ?? 3) * ratio);
    } else if (down) ctx.lineTo(px, py);
    else ctx.moveTo(px, py);
    down = true;
  }
  if (!line.marker) ctx.stroke();
  ctx.setLineDash([]);
}

function paintMarker(ctx: CanvasRenderingContext2D, kind: string, x: number, y: number, r: number): void {
  ctx.beginPath();
  ctx.lineWidth = Math.max(1, r / 2);
  if (kind === "cross") {
    ctx.moveTo(x - r, y - r);
    ctx.lineTo(x + r, y + r);
    ctx.moveTo(x - r, y + r);
    ctx.lineTo(x + r, y - r);
    ctx.stroke();
    return;
  }
  ctx.arc(x, y, r, 0, 2 * Math.PI);
  if (kind === "dot") ctx.fill();
  else ctx.stroke();
}

function paintShade(chart: uPlot, shade: Shade): void {
  const { ctx } = chart;
  ctx.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--shade").trim();
  const rows = shade.rows.length;
  for (const [k, row] of shade.rows.entries()) {
    const y0 = chart.valToPos(shade.y[0] + ((shade.y[1] - shade.y[0]) * (k - 0.5)) / (rows - 1), "y", true);
    const y1 = chart.valToPos(shade.y[0] + ((shade.y[1] - shade.y[0]) * (k + 0.5)) / (rows - 1), "y", true);
    const step = (shade.x[1] - shade.x[0]) / (row.length - 1);
    for (const run of row.matchAll(/1+/g)) {
      const x0 = chart.valToPos(shade.x[0] + step * (run.index - 0.5), "x", true);
      const x1 = chart.valToPos(shade.x[0] + step * (run.index + run[0].length - 0.5), "x", true);
      ctx.fillRect(x0, y1, x1 - x0, y0 - y1 + 1);
    }
  }
}
