// Numbers as they are shown and typed.
export interface Range {
  min?: number;
  max?: number;
  /** Bound that is not allowed itself. */
  above?: number;
}

/** A number as text, with at most so many significant digits. */
export function formatNumber(value: number, digits = 6): string {
  return Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : "";
}

/** The number that a text means, with a decimal point or comma; null if it means none. */
export function parseNumber(text: string, unit = ""): number | null {
  const bare = text
    .trim()
    .replace(unit && text.trim().endsWith(unit) ? unit : "", "")
    .trim();
  const value = Number(bare.replace(",", ".").replace("−", "-"));
  return bare !== "" && Number.isFinite(value) ? value : null;
}

/** Why a number is not allowed, such as "must be greater than 0"; empty if it is. */
export function rangeError(value: number, { min, max, above }: Range, unit = ""): string {
  const limit = (bound: number) => formatNumber(bound) + (unit && bound !== 0 ? ` ${unit}` : "");
  if (above !== undefined && value <= above) return `must be greater than ${limit(above)}`;
  if (min !== undefined && value < min) return `must be at least ${limit(min)}`;
  if (max !== undefined && value > max) return `must be at most ${limit(max)}`;
  return "";
}

/** A value moved by a step and kept in its range. */
export function stepped(value: number, step: number, range: Range): number {
  const moved = Number((value + step).toPrecision(12));
  const low = range.min ?? -Infinity;
  const bounded = Math.min(range.max ?? Infinity, Math.max(low, moved));
  return range.above !== undefined && bounded <= range.above ? value : bounded;
}
