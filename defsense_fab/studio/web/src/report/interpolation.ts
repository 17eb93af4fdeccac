// Shapes between simulated ones: a piecewise cubic curve through them, whose slope at each is that
// of the parabola through it and its neighbors.

/** Return the weights of the shapes at increasing positions (the first is rest, at 0). */
export function weightsAt(positions: number[], position: number): number[] {
  const n = positions.length;
  const x = Math.min(Math.max(position, positions[0]!), positions[n - 1]!);
  let i = 0;
  while (i < n - 2 && x > positions[i + 1]!) i++;
  const h = positions[i + 1]! - positions[i]!;
  const u = (x - positions[i]!) / h;
  if (n === 2) return [1 - u, u];
  const weights = new Array<number>(n).fill(0);
  weights[i]! += (1 + 2 * u) * (1 - u) ** 2;
  weights[i + 1]! += u * u * (3 - 2 * u);
  addSlope(weights, positions, i, h * u * (1 - u) ** 2);
  addSlope(weights, positions, i + 1, h * u * u * (u - 1));
  return weights;
}

/** Add a share of the slope at a shape to the weights. */
function addSlope(weights: number[], positions: number[], i: number, share: number): void {
  const middle = Math.min(Math.max(i, 1), positions.length - 2);
  const around = [middle - 1, middle, middle + 1];
  for (const j of around) {
    const [a, b] = around.filter((k) => k !== j).map((k) => positions[k]!) as [number, number];
    const at = positions[j]!;
    weights[j]! += (share * (2 * positions[i]! - a - b)) / ((at - a) * (at - b));
  }
}

/** Write start (or zero) + the sum of weights times displacements. */
export function blend(
  out: Float32Array,
  start: Float32Array | null,
  displacements: Float32Array[],
  weights: number[],
): void {
  if (start) out.set(start);
  else out.fill(0);
  displacements.forEach((displacement, k) => {
    const weight = weights[k] ?? 0;
    if (weight === 0) return;
    for (let i = 0; i < out.length; i++) out[i]! += weight * displacement[i]!;
  });
}
