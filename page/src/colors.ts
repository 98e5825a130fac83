/** Colours of what is drawn: one for each thing in all plots, and its twin for the dark theme. Files are always drawn light. */

export const COLORS = {
  exact: "#0072b2",
  balance: "#2f9fe0",
  peaks: "#b8578a",
  engine: "#7a5cc0",
  range: "#cbbcf0",
  unstable: "#c0182b",
  g1: "#b07a00",
  g2: "#d55e00",
  g2d: "#00885f",
  // A model that its data do not determine.
  g1_faint: "#cdb26c",
  g2_faint: "#e3a978",
  g2d_faint: "#74bda4",
  mark: "#e0338c",
  own: "#1c2430",
  guide: "#7d8794",
} as const;

const DARK: Record<keyof typeof COLORS, string> = {
  exact: "#5bb8f5",
  balance: "#a5dbff",
  peaks: "#e6a0c8",
  engine: "#b59cf0",
  range: "#5a4a8c",
  unstable: "#ff6b70",
  g1: "#f0b93a",
  g2: "#ff8a47",
  g2d: "#3fd6a6",
  g1_faint: "#8f7536",
  g2_faint: "#9a5c36",
  g2d_faint: "#378268",
  mark: "#ff6fb5",
  own: "#f2f5f9",
  guide: "#9aa5b3",
};

const TWINS: ReadonlyMap<string, string> = new Map(
  (Object.keys(COLORS) as (keyof typeof COLORS)[]).map((name) => [COLORS[name], DARK[name]]),
);

export function isDark(): boolean {
  return document.documentElement.dataset.theme === "dark";
}

/** The colour that stands for this one in the theme shown. */
export function shown(color: string, dark = isDark()): string {
  return dark ? (TWINS.get(color) ?? color) : color;
}
