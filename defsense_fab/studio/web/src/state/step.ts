// The entered step, and which screen this browser shows.
import { computed, signal } from "@preact/signals";
import type { StepStatus } from "../protocol/messages";
import { connection, page, pipeline } from "./connection";

export type StepName = StepStatus["name"];

export const STEPS: readonly StepName[] = [
  "body",
  "poses",
  "inside",
  "sensors",
  "optimize",
  "make",
  "measure",
];

export const STEP_LABELS: Record<StepName, string> = {
  body: "Body",
  poses: "Poses",
  inside: "Inside",
  sensors: "Sensors",
  optimize: "Optimize",
  make: "Make",
  measure: "Measure",
};

export const step = signal<StepName>("body");

export const stepStatus = computed(
  () => pipeline.value?.steps.find(({ name }) => name === step.value) ?? null,
);

/** Whether the next action is in the entered step, so that its own button is the main one. */
export const isNextHere = computed(() => {
  const next = pipeline.value?.next;
  return next?.stage === null && next.step === step.value && next.step !== "body";
});

/** Look of the main button of a step: only one button of the page is primary. */
export const mainVariant = computed(() => (isNextHere.value ? "primary" : "plain"));

/** Whether this browser shows all devices although one is open. */
const isStartWanted = signal(false);

export const screen = computed(() =>
  page.value?.screen === "device" && isStartWanted.value ? "start" : page.value?.screen,
);

/** Whether the start page can be left for the device that is open. */
export const canReturn = computed(() => page.value?.screen === "device" && isStartWanted.value);

export function showAllDevices(): void {
  isStartWanted.value = true;
}

export function showDevice(): void {
  isStartWanted.value = false;
}

// A device that is opened is shown at the step of the last visit, or else at the next action.
let folder: string | null = null;
let isStepChosen = false;
connection.listen("page", (event) => {
  if (event.screen === "start" || event.folder === folder) return;
  folder = event.folder;
  isStartWanted.value = false;
  const visited = sessionStorage.getItem(`step:${folder}`) as StepName;
  isStepChosen = STEPS.includes(visited);
  if (isStepChosen) step.value = visited;
  // A device without a body stays there when the body is made.
  else if (pipeline.peek()?.next.step === "body") enterStep("body");
});

connection.listen("pipeline", ({ next }) => {
  if (!isStepChosen) enterStep(next.step);
});

export function enterStep(name: StepName): void {
  isStepChosen = true;
  step.value = name;
  sessionStorage.setItem(`step:${folder ?? ""}`, name);
}
