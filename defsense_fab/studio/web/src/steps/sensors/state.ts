// What the step Sensors keeps in this browser.
import { computed, signal } from "@preact/signals";
import type { CordState, Judgement, Violation } from "../../protocol/messages";
import type { DrawingBoard } from "../../scene/drawing-board";
import type { Frame } from "../../scene/types";
import { device, drawnViolations, prediction } from "../../state/connection";
import { selectedNames } from "../../state/selection";

/** The plane that is drawn in; null while cords are selected and moved. */
export const drawingFrame = signal<Frame | null>(null);

/** The board in the scene, while the step is entered. */
export const board = signal<DrawingBoard | null>(null);

/** Whether a stroke is drawn as the new path of the selected cord. */
export const isRedrawing = signal(false);

/** Whether the handle of the selected cord's plane is shown. */
export const isPlaneShown = signal(false);

/** The selected control point of the selected cord; -1 for none. */
export const selectedPoint = signal(-1);

/** What is expected of the cords while one is dragged. */
export const draggedJudgement = signal<Judgement | null>(null);

/** What is expected of the cords as they are shown. */
export const judgement = computed(
  () => draggedJudgement.value ?? prediction.value?.drawn ?? null,
);

/** What is wrong with the cords as they are shown. */
export const violations = computed<readonly Violation[]>(
  () => draggedJudgement.value?.violations ?? drawnViolations.value,
);

export const isDrawing = computed(() => drawingFrame.value !== null);

/** The cord that is selected alone. */
export const selectedCord = computed<CordState | null>(() => {
  const names = selectedNames("cord");
  if (names.length !== 1) return null;
  return device.value?.cords.find(({ name }) => name === names[0]) ?? null;
});
