// The place of a warning: the cord there is selected, and a section is opened through it.
import type { Guide } from "../../protocol/messages";
import { device } from "../../state/connection";
import { select } from "../../state/selection";
import { enterStep } from "../../state/step";
import { axisPlane } from "../inside/plane";
import { place as sectionPlace } from "../inside/place";
import { inside } from "../inside/section-view";
import { guide, showPlace } from "./state";

/** A place farther from all cords, mm, belongs to none of them. */
const MAX_CORD_DISTANCE = 8;

/** Show the place of a warning inside the body, or among the parts without a simulation. */
export function openPlace(at: readonly number[], text: string): void {
  const name = nearestCord(guide.peek(), at);
  const cord = device.peek()?.cords.find((other) => other.name === name);
  if (cord) select({ kind: "cord", name: cord.name });
  if (!inside.peek()?.isReady) {
    showPlace(at);
    return;
  }
  const plane = cord?.isPlanar ? { origin: cord.origin, axes: cord.axes } : axisPlane("z", at);
  sectionPlace.value = { at: [...at], text, plane };
  enterStep("inside");
}

function nearestCord(shown: Guide | null, at: readonly number[]): string {
  const distanceTo = (point: number[]) => Math.hypot(...point.map((v, k) => v - at[k]!));
  const found = (shown?.cords ?? [])
    .map(({ name, path }) => ({ name, distance: Math.min(...path.map(distanceTo)) }))
    .sort((a, b) => a.distance - b.distance)[0];
  return found && found.distance < MAX_CORD_DISTANCE ? found.name : "";
}
