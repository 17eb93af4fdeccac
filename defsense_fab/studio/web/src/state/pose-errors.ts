// How well the drawn cords sense each pose.
import type { PoseError } from "../protocol/messages";

export type Sensing = "sensed" | "poorly" | "not at all";

/** The pose whose error is the largest share of its movement. */
export function worstPose(poses: readonly PoseError[]): PoseError | null {
  return poses.reduce<PoseError | null>((a, b) => (a && shareOf(a) >= shareOf(b) ? a : b), null);
}

export function sensingOf({ error, movement, grade }: PoseError): Sensing {
  if (error >= movement) return "not at all";
  return grade === "poor" ? "poorly" : "sensed";
}

/** Text about the pose that is sensed worst. */
export function describeWorst(pose: PoseError): string {
  const sensing = sensingOf(pose);
  if (sensing === "not at all") return `Not sensed at all: ${pose.pose}`;
  const start = sensing === "poorly" ? "Poorly sensed" : "Sensed worst";
  return `${start}: ${pose.pose}, ${pose.text}`;
}

function shareOf({ error, travel }: PoseError): number {
  return error / Math.max(travel, 1e-6);
}
