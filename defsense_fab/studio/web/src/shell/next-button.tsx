import { runCommand } from "../commands";
import { startBuild } from "../state/building";
import { connection, isJobActive, pipeline } from "../state/connection";
import { run } from "../state/run";
import { enterStep, isNextHere } from "../state/step";
import { Button } from "../ui/button";

const PANEL_BUTTONS = ".scene-cover button.primary, .inspector button.primary";

/** Do the next action: build up to a stage, or enter a step and go to its main button. */
export function doNext(): void {
  const next = pipeline.value?.next;
  if (!next || (next.stage && isJobActive.value)) return;
  if (isNextHere.value) document.querySelector<HTMLElement>(PANEL_BUTTONS)?.focus();
  enterStep(next.step);
  if (next.cord) requestAnimationFrame(() => runCommand("sensor.show-limit"));
  if (next.stage) void startBuild(next.stage);
  else if (next.step === "body") void run(connection.send("make-body", {}));
}

/** The button of the next action. */
export function NextButton({ variant = "primary" }: { variant?: "primary" | "plain" }) {
  const next = pipeline.value?.next;
  if (!next?.label) return null;
  const isWaiting = next.stage !== null && isJobActive.value;
  return (
    <Button
      variant={isNextHere.value ? "plain" : variant}
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
