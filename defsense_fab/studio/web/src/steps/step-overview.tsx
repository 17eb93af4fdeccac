import { pipeline } from "../state/connection";
import { STEP_LABELS, step, stepStatus } from "../state/step";
import { NextButton } from "../shell/next-button";
import { STEP_ICONS } from "../shell/step-marks";
import { EmptyState } from "../ui/feedback";

/** What a step shows before it has panels: its state, and what to do next. */
export function StepOverview() {
  const status = stepStatus.value;
  const isNext = pipeline.value?.next.step === step.value;
  return (
    <EmptyState
      icon={STEP_ICONS[step.value]}
      text={status?.text || `${STEP_LABELS[step.value]} has nothing to set yet.`}
      action={isNext ? <NextButton variant="plain" /> : undefined}
    />
  );
}
