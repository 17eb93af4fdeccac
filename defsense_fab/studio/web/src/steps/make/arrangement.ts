// Where the parts are in a picture of a step, and what else it shows.
import type { BuiltCordState, Guide, GuidePin, GuideStage, PartState } from "../../protocol/messages";

export interface PartPlacement {
  shift: readonly number[];
  opacity: number;
  isVisible: boolean;
}

export interface Arrangement {
  parts: ReadonlyMap<string, PartPlacement>;
  cords: readonly BuiltCordState[];
  wires: readonly number[][][];
  pins: readonly GuidePin[];
}

const GHOST_OPACITY = 0.22;
const ORIGIN = [0, 0, 0];

/** Arrange the parts for a step, or all of them for null, at a share of the exploded view. */
export function arrange(
  guide: Guide,
  parts: readonly PartState[],
  stage: GuideStage | null,
  explosion: number,
): Arrangement {
  const place = ({ name, shift }: PartState): PartPlacement => {
    const moved = shift.map((mm) => mm * explosion);
    if (!stage || stage.view === "plates" || stage.view === "exploded") {
      return { shift: moved, opacity: 1, isVisible: true };
    }
    if (stage.joint) {
      const isUpper = stage.joint.upper.includes(name);
      const lift = stage.joint.lift.map((mm) => mm * explosion);
      const isVisible = isUpper || stage.joint.lower.includes(name);
      return { shift: isUpper ? lift : ORIGIN, opacity: 1, isVisible };
    }
    return { shift: ORIGIN, opacity: GHOST_OPACITY, isVisible: true };
  };
  const shown = new Set(stage?.cords ?? []);
  return {
    parts: new Map(parts.map((part) => [part.name, place(part)])),
    cords: guide.cords.filter(({ name }) => shown.has(name)),
    wires: stage?.joint?.wires ?? [],
    pins: stage?.joint?.pins ?? [],
  };
}
