// Rotation vectors: axis times angle in radians; more than half a turn is kept.
import { Quaternion, Vector3 } from "three";
import type { HandleState } from "../../protocol/messages";

const SMALLEST_ANGLE = 1e-9;
const PARALLEL = 1 - 1e-7;

/** The rotation vector of a handle. */
export function handleRotation({ axis, degrees }: Pick<HandleState, "axis" | "degrees">): Vector3 {
  return new Vector3().fromArray(axis).multiplyScalar((degrees * Math.PI) / 180);
}

/** A rotation that is followed by a turn about an axis of the world. */
export function turned(rotation: Vector3, axis: Vector3, radians: number): Vector3 {
  const angle = rotation.length();
  const cosine = angle < SMALLEST_ANGLE ? 1 : Math.abs(rotation.dot(axis)) / angle;
  if (cosine > PARALLEL) return rotation.clone().addScaledVector(axis, radians);
  const turn = new Quaternion().setFromAxisAngle(axis, radians);
  return nearestVector(turn.multiply(quaternion(rotation)), rotation);
}

export function quaternion(rotation: Vector3): Quaternion {
  const angle = rotation.length();
  if (angle < SMALLEST_ANGLE) return new Quaternion();
  return new Quaternion().setFromAxisAngle(rotation.clone().divideScalar(angle), angle);
}

/** The rotation vector of a quaternion that is nearest to the previous one. */
function nearestVector(q: Quaternion, previous: Vector3): Vector3 {
  const sine = Math.hypot(q.x, q.y, q.z);
  if (sine < SMALLEST_ANGLE) {
    const turns = Math.round(previous.length() / (2 * Math.PI));
    return turns === 0 ? new Vector3() : previous.clone().setLength(2 * Math.PI * turns);
  }
  const angle = 2 * Math.atan2(sine, q.w);
  const axis = new Vector3(q.x, q.y, q.z).divideScalar(sine);
  const turns = Math.round((previous.dot(axis) - angle) / (2 * Math.PI));
  return axis.multiplyScalar(angle + 2 * Math.PI * turns);
}

/** A rotation in words, such as "−30° about y". */
export function rotationText(rotation: Vector3): string {
  const angle = rotation.length();
  if (angle < 1e-4) return "0°";
  const unit = rotation.clone().divideScalar(angle).toArray();
  const main = unit.findIndex((value) => Math.abs(value) > 0.99985);
  const degrees = (angle * 180) / Math.PI;
  if (main >= 0) return `${signedDegrees(degrees * Math.sign(unit[main]!))} about ${"xyz"[main]}`;
  return `${signedDegrees(degrees)} about (${unit.map((v) => v.toFixed(2).replace("-", "\u2212")).join(", ")})`;
}

/** An angle with at most one decimal and a real minus sign, such as "−30°". */
export function signedDegrees(degrees: number): string {
  return `${plain(degrees)}°`;
}

/** A number with at most one decimal and a real minus sign. */
export function plain(value: number): string {
  const rounded = Math.round(value * 10) / 10;
  return `${rounded < 0 ? "\u2212" : ""}${Math.abs(rounded)}`;
}
