// The section of the step Inside, and how it is shown in this browser.
import { effect, signal } from "@preact/signals";
import type { Viewer } from "../../scene/viewer";
import { device } from "../../state/connection";
import { NextCordTool } from "./next-cord";
import { type Axis, axisPlane, flip, offsetOf, slide } from "./plane";
import { SectionLayer } from "./section-layer";
import { inside, SectionView } from "./section-view";

const PLAY_MS = 650;

export const view = new SectionView((state) => {
  const { origin, axes } = state;
  view.plane.value = { origin, axes };
  view.state.value = state.firstState;
}, true);

export const tool = new NextCordTool(view);

/** Whether the section is seen along its normal. */
export const isFacing = signal(false);

/** Whether the states are played one after another. */
export const isPlaying = signal(false);

/** Show the section in a scene; return a function to stop. */
export function openInside(viewer: Viewer): () => void {
  const layer = new SectionLayer(viewer, view, tool, { hasBody: true });
  const stops = [
    view.open(),
    tool.open(),
    effect(() => layer.face(isFacing.value)),
    effect(() => (isPlaying.value ? play() : undefined)),
  ];
  return () => {
    isFacing.value = isPlaying.value = false;
    for (const stop of stops) stop();
    layer.dispose();
  };
}

/** Put the plane in the middle of the body, normal to an axis. */
export function setAxis(axis: Axis): void {
  const { middle = [0, 0, 0] } = inside.peek() ?? {};
  view.plane.value = axisPlane(axis, middle);
}

/** Move the plane to an offset from the middle of the body, mm. */
export function setOffset(offset: number): void {
  const plane = view.plane.peek();
  const state = inside.peek();
  if (plane && state) view.plane.value = slide(plane, offset - offsetOf(plane, state.middle));
}

export function flipPlane(): void {
  const plane = view.plane.peek();
  if (plane) view.plane.value = flip(plane);
}

/** Put the plane on the plane of a cord. */
export function setPlaneOfCord(name: string): void {
  const cord = device.peek()?.cords.find((other) => other.name === name);
  if (cord) view.plane.value = { origin: cord.origin, axes: cord.axes };
}

/** Show the next state, and rest after the last. */
export function showNextState(): void {
  const count = inside.peek()?.states.length ?? 0;
  if (count) view.state.value = (view.state.peek() + 1) % count;
}

function play(): () => void {
  const timer = setInterval(showNextState, PLAY_MS);
  return () => clearInterval(timer);
}
