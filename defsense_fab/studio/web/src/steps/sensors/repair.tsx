// Cords that break a limit: the buttons that repair them, and the place of the first broken limit.
import { signal } from "@preact/signals";
import { Vector3 } from "three";
import { runCommand } from "../../commands";
import { viewer } from "../../scene/stage";
import { connection, device, drawnViolations, pipeline, prediction } from "../../state/connection";
import { newWork, showWork } from "../../state/page-work";
import { run } from "../../state/run";
import { select } from "../../state/selection";
import { mainVariant } from "../../state/step";
import { showToast } from "../../state/toasts";
import { Button } from "../../ui/button";
import { isDrawing, selectedCord } from "./state";

const isRepairing = signal(false);

/** Names of the drawn cords that break a limit, which a repair may cure. */
export function brokenCords(): string[] {
  const names = (prediction.value?.drawn?.violations ?? []).flatMap(({ cords }) => cords);
  return [...new Set(names)];
}

/** Move cords until they keep the limits; all of them if none are named. */
export async function repairCords(cords: string[]): Promise<void> {
  isRepairing.value = true;
  const noun = device.peek()?.noun ?? "cord";
  const title = cords.length === 1 ? `Repair ${cords[0]}` : `Repair the ${noun}s`;
  const result = await run(showWork(newWork(title), connection.send("repair-cords", { cords })));
  isRepairing.value = false;
  if (!result) return;
  const moved = `${result.cords.join(", ")} moved by up to ${result.largestMove.toFixed(1)} mm.`;
  const rest = result.remaining.length ? ` Still broken: ${result.remaining.join("; ")}.` : "";
  const more = result.isComplete ? "" : " Not all were tried in 30 s: repair again to continue.";
  showToast(moved + rest + more, {
    label: "Undo",
    run: () => void run(connection.send("undo", {})),
  });
}

/** Select the cord of the next action, or the first one that breaks a limit or cannot be made, and show where. */
export function showBrokenLimit(): void {
  const violations = drawnViolations.peek();
  const next = pipeline.peek()?.next.cord ?? "";
  const found = violations.find(({ cords }) => cords.includes(next)) ?? violations[0];
  if (!found) return;
  const name = found.cords.includes(next) ? next : found.cords[0]!;
  select({ kind: "cord", name });
  viewer.peek()?.rig.flyTo(new Vector3().fromArray(found.at));
}

/** What repairs the selected cord, and all of them. */
export function RepairPanel() {
  const broken = brokenCords();
  if (broken.length === 0 || isDrawing.value) return null;
  const noun = device.value?.noun ?? "cord";
  const name = selectedCord.value?.name;
  const isSelectedBroken = name !== undefined && broken.includes(name);
  const isAlone = isSelectedBroken && broken.length === 1;
  return (
    <section class="repair-panel" aria-label="Broken limits">
      <p>
        <strong>Broken limits: {broken.join(", ")}.</strong> A repair moves as little as possible.
      </p>
      <div class="button-row">
        {isSelectedBroken && (
          <Button
            variant={mainVariant.value}
            isBusy={isRepairing.value}
            hint="Move its control points until it keeps all limits"
            onClick={() => runCommand("sensor.repair")}
          >
            Repair this {noun}
          </Button>
        )}
        {!isAlone && (
          <Button
            variant={isSelectedBroken ? "plain" : mainVariant.value}
            isBusy={isRepairing.value}
            hint={`Move the control points of ${broken.join(", ")}`}
            onClick={() => runCommand("sensor.repair-all")}
          >
            Repair all
          </Button>
        )}
        <Button variant="quiet" onClick={() => runCommand("sensor.show-limit")}>
          Show the place
        </Button>
      </div>
    </section>
  );
}
