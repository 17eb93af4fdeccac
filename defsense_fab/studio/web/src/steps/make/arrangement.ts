// Where the parts are in a picture of a step, from where it is seen, and what else it shows.
import { Vector3 } from "three";
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
  /** Lines between which must be no glue. */
  glueless: readonly number[][][];
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
    glueless: stage?.joint?.glueless ?? [],
    pins: stage?.joint?.pins ?? [],
  };
}

const HOME = new Vector3(0.5, -0.85, 0.5).normalize();
/** How far the lower side of an open joint is seen from above. */
const JOINT_TILT = 0.5;

/** From where a step is seen: from the side of an open joint, so that its lower side is visible. */
export function viewDirection(stage: GuideStage | null): Vector3 {
  if (!stage?.joint) return HOME.clone();
  const opens = new Vector3().fromArray(stage.joint.lift).normalize();
  const aside = HOME.clone().addScaledVector(opens, -HOME.dot(opens));
  if (aside.lengthSq() < 1e-3) aside.set(1, -1, 0).addScaledVector(opens, -opens.x + opens.y);
  return aside.normalize().addScaledVector(opens, JOINT_TILT).normalize();
}
