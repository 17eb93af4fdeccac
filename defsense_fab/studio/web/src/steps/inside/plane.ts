// The plane of a section: moves, turns and offsets. Planes are given in the body at rest.
import { Vector3 } from "three";
import type { Frame } from "../../scene/types";

export type Axis = "x" | "y" | "z";
export const AXES: readonly Axis[] = ["x", "y", "z"];

/** x axis, y axis and normal of the planes normal to x, y and z; z is up where it lies in them. */
const AXIS_FRAMES: Record<Axis, number[][]> = {
  x: [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
  y: [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
  z: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
};
/** Cosine of the angle within which a plane counts as normal to an axis. */
const ALIGNED = 0.99999;
const LINE_POINTS = 24;
/** Squared distance that is added so that lines are smooth, times their squared length. */
const BLUR = 1e-4;

const vector = (values: readonly number[]) => new Vector3(values[0], values[1], values[2]);

export function normalOf({ axes }: Frame): Vector3 {
  return vector(axes[2]!);
}

export function axisPlane(axis: Axis, origin: readonly number[]): Frame {
  return { origin: [...origin], axes: AXIS_FRAMES[axis].map((row) => [...row]) };
}

/** The axis to which a plane is normal, or null. */
export function axisOf({ axes }: Frame): Axis | null {
  return AXES.find((_, k) => Math.abs(axes[2]![k]!) > ALIGNED) ?? null;
}

/** Offset of a plane along its normal from the body's middle, mm. */
export function offsetOf(plane: Frame, middle: readonly number[]): number {
  return vector(plane.origin).sub(vector(middle)).dot(normalOf(plane));
}

/** Move a plane along its normal, mm. */
export function slide(plane: Frame, distance: number): Frame {
  const origin = vector(plane.origin).addScaledVector(normalOf(plane), distance);
  return { origin: origin.toArray(), axes: plane.axes };
}

/** Turn a plane over, so that the other half of the body is shown. */
export function flip({ origin, axes: [x, y, normal] }: Frame): Frame {
  return { origin, axes: [x!, y!.map((v) => -v), normal!.map((v) => -v)] };
}

/** Height of a point above a plane, mm. */
export function heightAbove({ origin, axes }: Frame, point: ArrayLike<number>, at = 0): number {
  const normal = axes[2]!;
  let height = 0;
  for (let k = 0; k < 3; k++) height += (point[at + k]! - origin[k]!) * normal[k]!;
  return height;
}

/**
 * The plane that fits a section best in its shown state, where the body may have moved and turned.
 *
 * It is the affine map of the plane's axes that fits the moved points with least squares.
 */
export function shownPlane(
  plane: Frame,
  rest: ArrayLike<number>,
  moved: ArrayLike<number>,
): Frame {
  const [x, y] = plane.axes;
  const [ux, uy] = [[0, 0, 0], [0, 0, 0]];
  const [mean, center] = [[0, 0], [0, 0, 0]];
  const count = rest.length / 3;
  const local = new Float64Array(2 * count);
  for (let i = 0; i < count; i++) {
    for (let k = 0; k < 3; k++) {
      const d = rest[3 * i + k]! - plane.origin[k]!;
      local[2 * i]! += d * x![k]!;
      local[2 * i + 1]! += d * y![k]!;
      center[k]! += moved[3 * i + k]! / count;
    }
    mean[0]! += local[2 * i]! / count;
    mean[1]! += local[2 * i + 1]! / count;
  }
  let [xx, xy, yy] = [0, 0, 0];
  for (let i = 0; i < count; i++) {
    const [p, q] = [local[2 * i]! - mean[0]!, local[2 * i + 1]! - mean[1]!];
    xx += p * p;
    xy += p * q;
    yy += q * q;
    for (let k = 0; k < 3; k++) {
      ux[k]! += p * (moved[3 * i + k]! - center[k]!);
      uy[k]! += q * (moved[3 * i + k]! - center[k]!);
    }
  }
  const det = xx * yy - xy * xy;
  if (count < 3 || det < 1e-9 * xx * yy) return plane;
  const along = [0, 1, 2].map((k) => (yy * ux[k]! - xy * uy[k]!) / det);
  const across = [0, 1, 2].map((k) => (xx * uy[k]! - xy * ux[k]!) / det);
  const origin = center.map((c, k) => c - mean[0]! * along[k]! - mean[1]! * across[k]!);
  const normal = vector(along).cross(vector(across)).toArray();
  return { origin, axes: orthonormal([along, across, normal]) };
}

function orthonormal(axes: readonly number[][]): number[][] {
  const normal = vector(axes[2]!).normalize();
  const x = vector(axes[0]!);
  x.addScaledVector(normal, -x.dot(normal)).normalize();
  return [x.toArray(), normal.clone().cross(x).toArray(), normal.toArray()];
}

/** Move a plane as another one was moved from `before` to `after`. */
export function carry(plane: Frame, before: Frame, after: Frame): Frame {
  const shift = vector(after.origin).sub(vector(before.origin));
  const local = (v: Vector3) => before.axes.map((row) => v.dot(vector(row)));
  const combine = (weights: number[]) =>
    weights.reduce((sum, w, k) => sum.addScaledVector(vector(plane.axes[k]!), w), new Vector3());
  const origin = vector(plane.origin).add(combine(local(shift))).toArray();
  const axes = after.axes.map((row) => combine(local(vector(row))).toArray());
  return { origin, axes: orthonormal(axes) };
}

/**
 * Points of a straight line between two points at rest, in the shown state.
 *
 * Each moves as the points around it whose places are known in both; the nearest count most.
 */
export function carryLine(
  [from, to]: readonly number[][],
  rest: Float32Array,
  moved: Float32Array,
): number[][] {
  const blur = BLUR * from!.reduce((sum, v, k) => sum + (to![k]! - v) ** 2, 0);
  return Array.from({ length: LINE_POINTS }, (_, i) => {
    const share = i / (LINE_POINTS - 1);
    const point = from!.map((v, k) => v + share * (to![k]! - v));
    const [shift, total] = [[0, 0, 0], { weight: 0 }];
    for (let at = 0; at < rest.length; at += 3) {
      let distance = blur;
      for (let k = 0; k < 3; k++) distance += (rest[at + k]! - point[k]!) ** 2;
      const weight = distance ** -3;
      total.weight += weight;
      for (let k = 0; k < 3; k++) shift[k]! += weight * (moved[at + k]! - rest[at + k]!);
    }
    return point.map((v, k) => v + shift[k]! / total.weight);
  });
}
