// Broken limits as labels on the spot, and as what a click on them shows.
import { effect } from "@preact/signals";
import { Vector3 } from "three";
import type { Violation } from "../../protocol/messages";
import { viewer } from "../../scene/stage";
import type { Viewer } from "../../scene/viewer";
import { selection } from "../../state/selection";
import { draggedJudgement, isDrawing, violations } from "./state";

/** Names of limits, where their places leave little room. */
const TITLES: Record<string, string> = {
  "bend-too-tight": "Bend too tight",
  "wall-too-thin": "Wall too thin",
  "channel-length-not-allowed": "Length not allowed",
  "cords-too-close": "Cords too close",
  "cord-near-itself": "Cord near itself",
  "pad-too-close": "Pad too close",
  "path-leaves-body": "Leaves the body",
  "end-far-from-surface": "End far from the surface",
  "exit-not-allowed": "Exit not allowed",
  "kept-region-crossed": "Crosses a kept region",
  "kept-region-cut": "Cuts a kept region",
  "channel-cuts-part": "Groove cuts a part",
  "overlaps-solid": "Cannot be inserted",
  "part-too-thin": "Part too thin",
  "part-too-large": "Part too large for the bed",
  "cord-stretch-too-short": "Too little cord to stretch",
};

export function limitTitle({ code }: Violation): string {
  return TITLES[code] ?? "Cannot be made";
}

/** Select the cords that break a limit, and show where. */
export function showViolation({ cords, at }: Violation): void {
  selection.value = cords.map((name) => ({ kind: "cord", name }));
  viewer.peek()?.rig.flyTo(new Vector3().fromArray(at));
}

/** Show labels where limits are broken; return a function to stop. */
export function showLimits(scene: Viewer): () => void {
  const stop = effect(() => {
    const shown = isDrawing.value ? [] : violations.value;
    scene.labels.set(
      "limits",
      shown.map((violation, i) => ({
        id: `limit-${i}`,
        text: limitTitle(violation),
        at: violation.at,
        tone: "alarm",
        priority: 10,
        onClick: () => showViolation(violation),
      })),
    );
    if (draggedJudgement.value) scene.cords.setBroken(draggedJudgement.value.broken);
  });
  return () => {
    stop();
    scene.labels.set("limits", []);
  };
}
