import { connection, isJobActive, pipeline } from "../state/connection";
import { run } from "../state/run";
import { enterStep } from "../state/step";
import { Button } from "../ui/button";

/** Do the next action: build up to a stage, or enter a step. */
export function doNext(): void {
  const next = pipeline.value?.next;
  if (!next || (next.stage && isJobActive.value)) return;
  enterStep(next.step);
  if (next.stage) void run(connection.send("start-build", { stage: next.stage }));
  else if (next.step === "body") void run(connection.send("make-body", {}));
}

/** The button of the next action. */
export function NextButton({ variant = "primary" }: { variant?: "primary" | "plain" }) {
  const next = pipeline.value?.next;
  if (!next?.label) return null;
  const isWaiting = next.stage !== null && isJobActive.value;
  return (
    <Button
      variant={variant}
      class="next-button"
      hint={isWaiting ? "Wait until the running job has ended" : next.hint}
      shortcut="Mod+Enter"
      disabled={isWaiting}
      onClick={doNext}
    >
      {next.label}
    </Button>
  );
}
