import { findCommand, isAvailable, runAnywhere, runCommand } from "../commands";
import { startBuild } from "../state/building";
import { connection, device, isJobActive, pipeline } from "../state/connection";
import { draw } from "../state/remedies";
import { run } from "../state/run";
import { type StepName, enterStep, isNextHere, step } from "../state/step";
import { Button } from "../ui/button";

const PANEL_BUTTONS = ".scene-cover button.primary, .inspector button.primary";

/** Steps that show the simulation's results themselves: a simulation does not leave them. */
const USES_OF_SIMULATION: readonly StepName[] = ["inside", "sensors", "optimize"];

/** Do the next action: build up to a stage, draw, or enter a step and go to its main button. */
export function doNext(): void {
  const next = pipeline.value?.next;
  if (!next || (next.stage && isJobActive.value)) return;
  if (next.step === "sensors" && device.value?.cords.length === 0) return draw();
  const addPose = findCommand("pose.add");
  const { poses = [], regions = [] } = device.value ?? {};
  if (next.step === "poses" && addPose && poses.length === 0 && regions.length > 1) return runAnywhere(addPose);
  const live = findCommand("measure.live");
  if (next.step === "measure" && live && isAvailable(live)) return runAnywhere(live);
  if (isNextHere.value) document.querySelector<HTMLElement>(PANEL_BUTTONS)?.focus();
  const stays = next.stage === "simulate" && USES_OF_SIMULATION.includes(step.value);
  if (!stays) enterStep(next.step);
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
