// A place of the body at rest that another step points out, in a section through it.
import { computed, effect, signal } from "@preact/signals";
import { Vector3 } from "three";
import type { Frame } from "../../scene/types";
import type { Viewer } from "../../scene/viewer";
import { flip, normalOf } from "./plane";
import { inside, type SectionView } from "./section-view";

export interface Place {
  /** The place (3,), mm. */
  at: number[];
  text: string;
  /** Plane of the section through it. */
  plane: Frame;
}

export const place = signal<Place | null>(null);

const MAX_TEXT = 90;
const isReady = computed(() => inside.value?.isReady ?? false);

/** Show the place while there is one; return a function that forgets it. */
export function showPlace(viewer: Viewer, view: SectionView): () => void {
  let wasShown = false;
  const stop = effect(() => {
    const shown = place.value;
    viewer.labels.set("place", shown && isReady.value ? [label(shown)] : []);
    if (!shown || !isReady.value) return;
    wasShown = true;
    const { camera, controls } = viewer.rig;
    const toViewer = camera.position.clone().sub(controls.target);
    const isSeen = normalOf(shown.plane).dot(toViewer) > 0;
    view.plane.value = isSeen ? shown.plane : flip(shown.plane);
    view.state.value = 0;
    viewer.rig.flyTo(new Vector3().fromArray(shown.at));
  });
  return () => {
    stop();
    if (wasShown) viewer.rig.fit();
    place.value = null;
    viewer.labels.set("place", []);
  };
}

function label({ at, text }: Place) {
  const short = text.length > MAX_TEXT ? `${text.slice(0, MAX_TEXT).trimEnd()} ...` : text;
  return {
    id: "place",
    text: short,
    at,
    tone: "alarm" as const,
    priority: 10,
    onClick: () => (place.value = null),
  };
}
