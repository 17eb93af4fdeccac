// The button that adds the cord which lowers the error most.
import { runCommand } from "../../commands";
import { prediction } from "../../state/connection";
import { Button } from "../../ui/button";
import { isProposing, proposeObstacle } from "./propose";

const EFFECT = "Add the cord that lowers the error most";

export function ProposeButton({ variant }: { variant: "plain" | "quiet" }) {
  const isReady = prediction.value?.isReady ?? false;
  const obstacle = proposeObstacle();
  return (
    <Button
      variant={variant}
      icon="idea"
      shortcut="P"
      hint={obstacle || (isReady ? EFFECT : `${EFFECT}. The poses are simulated first`)}
      disabled={obstacle !== ""}
      isBusy={isProposing.value}
      onClick={() => runCommand("sensor.propose")}
    >
      Propose
    </Button>
  );
}
