// How well the drawn cords sense each pose.
import type { PoseError } from "../protocol/messages";

/** Share of its movement from which on a pose's error is marked. */
const HARDLY_SENSED = 0.2;

export type Sensing = "sensed" | "hardly" | "not at all";

export function shareOf({ error, movement }: PoseError): number {
  return error / Math.max(movement, 1e-6);
}

/** The pose whose error is the largest share of its movement. */
export function worstPose(poses: readonly PoseError[]): PoseError | null {
  return poses.reduce<PoseError | null>((a, b) => (a && shareOf(a) >= shareOf(b) ? a : b), null);
}

export function sensingOf(pose: PoseError): Sensing {
  const share = shareOf(pose);
  if (share >= 1) return "not at all";
  return share > HARDLY_SENSED ? "hardly" : "sensed";
}

/** What is said of the pose that is sensed worst. */
export function describeWorst(pose: PoseError): string {
  const sensing = sensingOf(pose);
  if (sensing === "not at all") return `Not sensed at all: ${pose.pose}`;
  const { error, movement } = pose;
  const percent = Math.round(100 * shareOf(pose));
  const start = sensing === "hardly" ? "Hardly sensed" : "Sensed worst";
  return `${start}: ${pose.pose}, ${error.toFixed(2)} mm of ${movement.toFixed(1)} mm movement (${percent} %)`;
}
