// The panel at the right: the selected cord, two compared cords, or how to get the first one.
import { device } from "../../state/connection";
import { selectedNames } from "../../state/selection";
import { deleteCords } from "../../shell/cord-commands";
import { Button } from "../../ui/button";
import { EmptyState } from "../../ui/feedback";
import { runCommand } from "../../commands";
import { CordComparison } from "./comparison";
import { CordInspector } from "./cord-inspector";
import { ProposeButton } from "./propose-button";
import { RepairPanel } from "./repair";
import { selectedCord } from "./state";

export function SensorsInspector() {
  return (
    <>
      <RepairPanel />
      <Selected />
    </>
  );
}

function Selected() {
  const names = selectedNames("cord");
  const cord = selectedCord.value;
  if (cord) return <CordInspector cord={cord} key={cord.name} />;
  if (names.length === 2) return <CordComparison first={names[0]!} second={names[1]!} />;
  if (names.length > 2) return <SeveralCords names={names} />;
  return <NoCord />;
}

function NoCord() {
  const noun = device.value?.noun ?? "cord";
  const hasCords = (device.value?.cords.length ?? 0) > 0;
  const text = hasCords
    ? `Select a ${noun} to see and change it, or add another one.`
    : `The device has no ${noun}s yet. Draw one, or let the program propose it.`;
  return (
    <EmptyState
      icon="cord"
      text={text}
      action={
        <span class="button-row">
          <Button icon="draw" shortcut="D" onClick={() => runCommand("sensor.draw")}>
            Draw
          </Button>
          <ProposeButton variant="plain" />
          <Button
            variant="quiet"
            shortcut="N"
            hint="Add a cord along the middle of the body"
            onClick={() => runCommand("sensor.straight")}
          >
            Straight
          </Button>
        </span>
      }
    />
  );
}

function SeveralCords({ names }: { names: string[] }) {
  return (
    <div class="panel-body">
      <h2>{names.length} cords</h2>
      <p class="muted">{names.join(", ")}</p>
      <div class="button-row">
        <Button icon="copy" shortcut="Mod+D" onClick={() => runCommand("cord.duplicate")}>
          Duplicate
        </Button>
        <Button icon="lock" shortcut="L" onClick={() => runCommand("cord.lock")}>
          Lock or unlock
        </Button>
        <Button
          variant="quiet"
          icon="trash"
          shortcut="Delete"
          onClick={() => void deleteCords(names)}
        >
          Delete
        </Button>
      </div>
    </div>
  );
}
