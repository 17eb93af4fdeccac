// Scales of charts: from values to pixels, with ticks at round numbers.

export interface Scale {
  /** Pixel of a value. */
  at: (value: number) => number;
  ticks: number[];
}

/** A linear scale over values, with a margin as a share of their range. */
export function linearScale(values: readonly number[], from: number, to: number, margin = 0.08): Scale {
  const [least, most] = extent(values);
  const room = (most - least) * margin || Math.abs(most) * 0.05 || 1;
  return scaleBetween(least - room, most + room, from, to);
}

/** A linear scale over whole numbers, with ticks at whole numbers only. */
export function countScale(values: readonly number[], from: number, to: number): Scale {
  const [least, most] = extent(values);
  const [low, high] = [Math.floor(least) - 0.6, Math.ceil(most) + 0.6];
  const scale = scaleBetween(low, high, from, to);
  return { ...scale, ticks: roundTicks(low, high, WHOLE).filter((tick) => tick >= 0) };
}

function scaleBetween(low: number, high: number, from: number, to: number): Scale {
  return {
    at: (value) => from + ((value - low) / (high - low)) * (to - from),
    ticks: roundTicks(low, high),
  };
}

/** A linear scale from zero. */
export function scaleFromZero(values: readonly number[], from: number, to: number): Scale {
  const high = Math.max(...values, 1e-9);
  return { at: (value) => from + (value / high) * (to - from), ticks: roundTicks(0, high) };
}

/** A logarithmic scale over positive values. */
export function logScale(values: readonly number[], from: number, to: number): Scale {
  const [least, most] = extent(values.filter((value) => value > 0));
  const [low, high] = [least * 0.85, most * 1.18];
  const range = Math.log(high / low);
  return {
    at: (value) => from + (Math.log(Math.max(value, low) / low) / range) * (to - from),
    ticks: logTicks(low, high),
  };
}

function extent(values: readonly number[]): [number, number] {
  return values.length === 0 ? [0.1, 1] : [Math.min(...values), Math.max(...values)];
}

const ROUND = [1, 2, 2.5, 5, 10];
const WHOLE = [1, 2, 5, 10];
const WANTED_TICKS = 5;

/** Round numbers between two values, about five. */
function roundTicks(low: number, high: number, factors: readonly number[] = ROUND): number[] {
  const least = factors === WHOLE ? 1 : 0; // whole numbers are not divided
  const rough = Math.max(least, (high - low) / WANTED_TICKS);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * factors.find((factor) => factor * power >= rough)!;
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return range(first, last).map((k) => Number((k * step).toPrecision(12)));
}

/** 1, 2 and 5 times the powers of ten; round numbers if there are few of these. */
function logTicks(low: number, high: number): number[] {
  const powers = range(Math.floor(Math.log10(low)), Math.ceil(Math.log10(high)));
  const within = (ticks: number[]) => ticks.filter((tick) => tick >= low && tick <= high);
  const all = powers.flatMap((power) => [1, 2, 5].map((k) => Number(`${k}e${power}`)));
  const ticks = within(all);
  return ticks.length < 3 ? within(roundTicks(low, high)) : ticks;
}

function range(first: number, last: number): number[] {
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, k) => first + k);
}
