// What is wrong with a pose, as a label and as a sentence.
import type { PoseState } from "../../protocol/messages";
import { misfitTexts } from "../../state/connection";
import { poseShape, shapeStatus, shownPose } from "./state";

export interface PoseProblem {
  short: string;
  text: string;
}

const SHORT: Record<string, string> = {
  "pose-invalid": "Not a stable equilibrium",
  "pose-not-reached": "Not reached",
};

/** What is wrong with a pose: as it was solved last, or as it is dragged now. */
export function poseProblem(pose: PoseState): PoseProblem | null {
  const misfit = misfitTexts.value.get(`pose:${pose.name}`);
  if (misfit) return { short: "Outside the body", text: misfit };
  const shown = shownPose.value?.name === pose.name ? poseShape.value : null;
  if (shown && shapeStatus.value === "failed") {
    const share = pose.warning?.code === "pose-not-reached" ? pose.warning.share : null;
    return { short: shortText(`pose-${shown.phase}`, share), text: shown.text };
  }
  if (!pose.warning) return null;
  const { code, text, share } = pose.warning;
  return { short: shortText(code, share), text };
}

function shortText(code: string, share: number | null): string {
  if (code === "pose-not-reached" && share) return `Reached ${Math.round(100 * share)} % of the pose`;
  return SHORT[code] ?? "Cannot be solved";
}
