// Color maps, the same as in the pictures of the report: reversed magma for errors, viridis for
// strains.

const MAPS = {
  error: "fcfdbf fecf92 fe9f6d f7705c de4968 b73779 8c2981 641a80 3b0f70 140e36 000004",
  strain: "440154 482475 414487 355f8d 2a788e 21918c 22a884 44bf70 7ad151 bddf26 fde725",
};
const STEPS = 256;

export type Quantity = keyof typeof MAPS;

/** Return sRGB values (256, 3) from 0 to 1. */
export function colorTable(quantity: Quantity): Float32Array {
  const stops = MAPS[quantity]
    .split(" ")
    .map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255));
  const table = new Float32Array(3 * STEPS);
  for (let i = 0; i < STEPS; i++) {
    const x = (i / (STEPS - 1)) * (stops.length - 1);
    const k = Math.min(Math.floor(x), stops.length - 2);
    for (let c = 0; c < 3; c++) {
      table[3 * i + c] = stops[k]![c]! + (x - k) * (stops[k + 1]![c]! - stops[k]![c]!);
    }
  }
  return table;
}

/** Return the place in a table of a share from 0 to 1 of the scale. */
export function tablePlace(share: number): number {
  return 3 * Math.round((STEPS - 1) * Math.min(Math.max(share, 0), 1));
}

/** Return the scale as a CSS background. */
export function cssGradient(quantity: Quantity): string {
  const stops = MAPS[quantity].split(" ").map((hex) => `#${hex}`);
  return `linear-gradient(90deg, ${stops.join(", ")})`;
}
