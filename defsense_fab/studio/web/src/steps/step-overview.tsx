import { pipeline } from "../state/connection";
import { STEP_LABELS, step, stepStatus } from "../state/step";
import { NextButton } from "../shell/next-button";
import { STEP_ICONS } from "../shell/step-marks";
import { EmptyState } from "../ui/feedback";

/** The inspector of a step without panels: its state and the next action. */
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
