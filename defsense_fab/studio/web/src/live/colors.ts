// Colors of cords by their signals, of markers by their intervals, and of lines in plots.

type Rgb = readonly [number, number, number];

const SHORTER: Rgb = [40, 90, 200];
const LONGER: Rgb = [205, 35, 45];
const UNKNOWN: Rgb = [90, 90, 90];
const REST_LIGHT: Rgb = [236, 238, 241];
const REST_DARK: Rgb = [225, 225, 225];
const NARROW: Rgb = [40, 150, 80];
const WIDE: Rgb = [215, 40, 60];

/** Distinct for color-blind people, too (Okabe & Ito 2008). */
const LINE_COLORS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00"];

export function lineColor(index: number): string {
  return LINE_COLORS[index % LINE_COLORS.length]!;
}

/** Color of a cord: blue if its resistance falls, red if it rises, up to the training's limits. */
export function cordColor(signal: number, low: number, high: number, isDark: boolean): string {
  if (!Number.isFinite(signal)) return css(UNKNOWN);
  const rest = isDark ? REST_DARK : REST_LIGHT;
  const limit = signal > 0 ? high : low;
  return css(mix(rest, signal > 0 ? LONGER : SHORTER, limit ? signal / limit : 0));
}

/** Color of a marker: green for a typical interval, red for one three times as wide. */
export function markerColor(radius: number, typical: number): Rgb {
  const known = Number.isFinite(radius) ? radius : 3 * typical;
  return mix(NARROW, WIDE, (known / Math.max(typical, 1e-9) - 1) / 2);
}

function mix(from: Rgb, to: Rgb, share: number): Rgb {
  const x = Math.min(1, Math.max(0, share));
  return [0, 1, 2].map((k) => Math.round(from[k]! + x * (to[k]! - from[k]!))) as unknown as Rgb;
}

function css([red, green, blue]: Rgb): string {
  return `rgb(${red}, ${green}, ${blue})`; // with commas, which three.js needs
}
