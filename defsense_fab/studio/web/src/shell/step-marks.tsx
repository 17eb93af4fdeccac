// The marks and icons of the steps.
import type { StepStatus } from "../protocol/messages";
import type { StepName } from "../state/step";
import type { IconName } from "../ui/icons";

export type StepState = StepStatus["state"];

export const STATE_LABELS: Record<StepState, string> = {
  done: "done",
  stale: "out of date",
  ready: "to do",
  blocked: "waits for an earlier step",
};

export const STEP_ICONS: Record<StepName, IconName> = {
  body: "make",
  poses: "pose",
  inside: "section",
  sensors: "cord",
  optimize: "optimize",
  make: "download",
  measure: "measure",
};

/** A round mark: filled for done, half for out of date, open for to do, dotted for blocked. */
export function StepMark({ state }: { state: StepState }) {
  return (
    <svg class={`step-mark ${state}`} viewBox="0 0 16 16" width="14" height="14" aria-hidden="true">
      <circle cx="8" cy="8" r="6.25" />
      {state === "done" && <path d="m5 8.3 2.2 2.2L11.2 6" />}
      {state === "stale" && <path d="M8 4.5V8.5M8 11v.01" />}
    </svg>
  );
}
