// Colors of numbers: a table of 256 colors, which the section and its legend both read.
import type { ColorMap } from "../../protocol/messages";

export const TABLE_SIZE = 256;

/** A range of numbers with round ends, and the distance of its ticks. */
export interface ColorRange {
  low: number;
  high: number;
  step: number;
}

export class ColorScale {
  /** Colors (256, 4) of the map, in sRGB. */
  readonly table: Uint8Array;
  /** Numbers at the two ends of the table. */
  readonly start: number;
  readonly end: number;

  constructor(
    map: ColorMap,
    readonly range: ColorRange,
  ) {
    this.table = tableOf(map);
    const reach = Math.max(-range.low, range.high);
    this.start = map.isDiverging ? -reach : range.low;
    this.end = map.isDiverging ? reach : range.high;
  }

  /** Index of a number's color in the table. */
  indexOf(value: number): number {
    const share = (value - this.start) / (this.end - this.start);
    return Math.min(TABLE_SIZE - 1, Math.max(0, Math.round(share * (TABLE_SIZE - 1))));
  }

  /** Numbers at round distances from end to end. */
  ticks(): number[] {
    const { low, high, step } = this.range;
    const first = Math.ceil(low / step - 1e-6);
    const last = Math.floor(high / step + 1e-6);
    return Array.from({ length: last - first + 1 }, (_, k) => (first + k) * step);
  }

  /** Place of a number on the bar, 0 to 1. */
  shareOf(value: number): number {
    const { low, high } = this.range;
    return Math.min(1, Math.max(0, (value - low) / (high - low)));
  }
}

/** The smallest range that contains two. */
export function joinRanges(a: ColorRange, b: ColorRange): ColorRange {
  return {
    low: Math.min(a.low, b.low),
    high: Math.max(a.high, b.high),
    step: Math.max(a.step, b.step),
  };
}

/** A number of the scale as text, with a sign if the range has both. */
export function formatValue(value: number, range: ColorRange, isExact = false): string {
  const digits = Math.max(0, -Math.floor(Math.log10(range.step * (isExact ? 0.2 : 1)) + 1e-9));
  const decimals = Math.min(6, digits + (isExact || isRound(range.step, digits) ? 0 : 1));
  const text = Math.abs(value).toFixed(decimals);
  if (Number(text) === 0) return "0";
  if (value < 0) return `\u2212${text}`;
  return range.low < 0 ? `+${text}` : text;
}

function isRound(step: number, digits: number): boolean {
  const scaled = step * 10 ** digits;
  return Math.abs(scaled - Math.round(scaled)) < 1e-6;
}

const tables = new WeakMap<ColorMap, Uint8Array>();

function tableOf(map: ColorMap): Uint8Array {
  const known = tables.get(map);
  if (known) return known;
  const table = new Uint8Array(4 * TABLE_SIZE);
  const last = map.colors.length - 1;
  for (let i = 0; i < TABLE_SIZE; i++) {
    const place = (i / (TABLE_SIZE - 1)) * last;
    const k = Math.min(last - 1, Math.floor(place));
    for (let c = 0; c < 3; c++) {
      const [a, b] = [map.colors[k]![c]!, map.colors[k + 1]![c]!];
      table[4 * i + c] = Math.round(a + (place - k) * (b - a));
    }
    table[4 * i + 3] = 255;
  }
  tables.set(map, table);
  return table;
}
