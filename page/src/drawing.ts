/** What a plot draws, as values: curves and marks, shaded areas, its axes and what is said of it. */

export interface Line {
  label: string;
  color: string;
  x: readonly number[];
  y: readonly number[];
  dash?: number[];
  width?: number;
  marker?: "dot" | "ring" | "cross";
  /** What the legend says in place of the label, how its key is drawn, and what is told of it. */
  legend?: string;
  key?: "both";
  title?: string;
  /** Drawn and saved, but not named in the legend. */
  quiet?: boolean;
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
  /** A remark at the end of the legend. */
  note?: string;
}
