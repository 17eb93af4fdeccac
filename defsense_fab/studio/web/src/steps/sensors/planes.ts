// The planes that can be drawn in: those along the axes, and that of a cord.
import type { Frame } from "../../scene/types";

export type PlaneAxis = "x" | "y" | "z";

/** Axes of the planes that face an axis of the body; seen from the front, the right and above. */
const AXES: Record<PlaneAxis, number[][]> = {
  x: [
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 0],
  ],
  y: [
    [1, 0, 0],
    [0, 0, 1],
    [0, -1, 0],
  ],
  z: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
};

/** Return the plane across an axis through a point, with the body's axes as its own. */
export function planeAcross(axis: PlaneAxis, middle: number[]): Frame {
  const axes = AXES[axis];
  const normal = axes[2]!;
  const height = normal.reduce((sum, value, k) => sum + value * middle[k]!, 0);
  return { origin: normal.map((value) => value * height), axes };
}

/** Return which axis a plane is across; null for an oblique one. */
export function axisAcross({ axes }: Frame): PlaneAxis | null {
  const same = (a: number[][]) => a.every((row, i) => row.every((v, k) => v === axes[i]![k]));
  return (["x", "y", "z"] as const).find((axis) => same(AXES[axis])) ?? null;
}

/** Return the position of a plane along its normal, mm. */
export function offsetOf({ origin, axes }: Frame): number {
  return origin.reduce((sum, value, k) => sum + value * axes[2]![k]!, 0);
}

/** Return the plane at another position along its normal. */
export function atOffset(frame: Frame, offset: number): Frame {
  const shift = offset - offsetOf(frame);
  return { ...frame, origin: frame.origin.map((v, k) => v + shift * frame.axes[2]![k]!) };
}
