// Planes and cubic Hermite curves, computed as the server does, for immediate feedback.
import type { CordShape, Frame } from "./types";

const MIN_PATH_SAMPLES = 120;

/** Return a point of the rest frame for a point (2,) in a plane. */
export function toWorld({ origin, axes }: Frame, [x, y]: number[]): number[] {
  return [0, 1, 2].map((k) => origin[k]! + x! * axes[0]![k]! + y! * axes[1]![k]!);
}

/** Return the coordinates (2,) in a plane of a point of the rest frame. */
export function toPlane({ origin, axes }: Frame, point: number[]): number[] {
  return [0, 1].map((row) =>
    [0, 1, 2].reduce((sum, k) => sum + (point[k]! - origin[k]!) * axes[row]![k]!, 0),
  );
}

/** Return a point of the rest frame for a control point, in the plane or in space. */
export function pointToWorld(shape: CordShape, point: number[]): number[] {
  return shape.isPlanar ? toWorld(shape.frame, point) : point;
}

/** Return tangents of a smooth curve through points: chordal Catmull-Rom, as the server does. */
export function catmullRom(points: number[][]): number[][] {
  const last = points.length - 1;
  const steps = points.slice(1).map((p, i) => p.map((value, k) => value - points[i]![k]!));
  const lengths = steps.map((step) => Math.max(Math.hypot(...step), 1e-12));
  return points.map((_, i) => {
    if (i === 0) return [...steps[0]!];
    if (i === last) return [...steps[last - 1]!];
    const [a, b] = [lengths[i - 1]!, lengths[i]!];
    const scale = Math.min(a, b) / (a + b);
    return steps[i]!.map((after, k) => ((steps[i - 1]![k]! / a) * b + (after / b) * a) * scale);
  });
}

/** Return points along a Hermite curve in the rest frame, mm. */
export function samplePath(shape: CordShape): number[][] {
  const { points, tangents } = shape;
  const perSpan = Math.ceil(MIN_PATH_SAMPLES / (points.length - 1));
  const path: number[][] = [];
  for (let span = 0; span < points.length - 1; span++) {
    const isLast = span === points.length - 2;
    for (let i = 0; i < perSpan + (isLast ? 1 : 0); i++) {
      path.push(pointToWorld(shape, hermitePoint(points, tangents, span, i / perSpan)));
    }
  }
  return path;
}

function hermitePoint(points: number[][], tangents: number[][], span: number, t: number): number[] {
  const [t2, t3] = [t * t, t * t * t];
  const [a, b, c, d] = [2 * t3 - 3 * t2 + 1, 3 * t2 - 2 * t3, t3 - 2 * t2 + t, t3 - t2];
  const [p, q, u, v] = [points[span]!, points[span + 1]!, tangents[span]!, tangents[span + 1]!];
  return p.map((value, k) => a * value + b * q[k]! + c * u[k]! + d * v[k]!);
}
