// Directions of arrow keys: the axis of a plane or of space that is nearest to them on the screen.
import { type Camera, Vector3 } from "three";

/** Smallest share of an axis along a direction of the screen for which its sign counts. */
const SMALLEST_SHARE = 0.3;

/** Return the shares (right, up) of a direction on the screen. */
function onScreen(camera: Camera, direction: Vector3): [number, number] {
  const { elements } = camera.matrixWorld;
  const unit = direction.clone().normalize();
  return [0, 4].map((column) =>
    unit.dot(new Vector3(elements[column], elements[column + 1], elements[column + 2])),
  ) as [number, number];
}

/** Return the steps along each axis for steps to the right and upward on the screen. */
export function screenSteps(camera: Camera, axes: Vector3[], right: number, up: number): number[] {
  const shares = axes.map((axis) => onScreen(camera, axis));
  const indices = axes.map((_, k) => k);
  let best = { across: 0, along: 1, fit: -1 };
  for (const across of indices) {
    for (const along of indices) {
      const fit = Math.abs(shares[across]![0]) + Math.abs(shares[along]![1]);
      if (across !== along && fit > best.fit) best = { across, along, fit };
    }
  }
  const signs = [Math.sign(shares[best.across]![0]) || 1, Math.sign(shares[best.along]![1]) || 1];
  return indices.map((k) => {
    if (k === best.across) return right * signs[0]!;
    return k === best.along ? up * signs[1]! : 0;
  });
}

/** Return the step along one direction for a step to the right or upward on the screen. */
export function screenStep(camera: Camera, direction: Vector3, right: number, up: number): number {
  const [x, y] = onScreen(camera, direction);
  const sign = (share: number) => (share < -SMALLEST_SHARE ? -1 : 1);
  return right * sign(x) + up * sign(y);
}
