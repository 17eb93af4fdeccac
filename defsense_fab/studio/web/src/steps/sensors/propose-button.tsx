// The button that adds the cord which lowers the error most.
import { runCommand } from "../../commands";
import { prediction } from "../../state/connection";
import { Button } from "../../ui/button";
import { proposalShare } from "./state";

export function ProposeButton({ variant }: { variant: "plain" | "quiet" }) {
  const isReady = prediction.value?.isReady ?? false;
  return (
    <Button
      variant={variant}
      icon="idea"
      shortcut="P"
      hint={isReady ? "Add the cord that lowers the error most" : prediction.value?.text}
      disabled={!isReady}
      isBusy={proposalShare.value !== null}
      onClick={() => runCommand("sensor.propose")}
    >
      Propose
    </Button>
  );
}
