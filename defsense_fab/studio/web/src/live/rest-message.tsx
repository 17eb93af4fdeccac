// Taking the present readings as those at rest, with a message that undoes it.
import { effect, signal } from "@preact/signals";
import { connection } from "../state/connection";
import { run } from "../state/run";
import { Button, IconButton } from "../ui/button";
import { liveDevice } from "./live-state";

const isShown = signal(false);

effect(() => {
  if (!liveDevice.value?.name) isShown.value = false;
});

/** Take the present readings as those of the device at rest. */
export async function takeRest(): Promise<void> {
  const answer = await run(connection.send("take-rest", {}));
  if (answer !== undefined) isShown.value = true;
}

/** What was done, in the live view itself: messages of the page cannot be clicked below its dialog. */
export function RestMessage() {
  if (!isShown.value) return null;
  return (
    <div class="live-message" role="status">
      <span>The present readings are those at rest now.</span>
      <Button
        variant="quiet"
        onClick={() => {
          isShown.value = false;
          void run(connection.send("undo-take-rest", {}));
        }}
      >
        Undo
      </Button>
      <IconButton icon="close" label="Dismiss" onClick={() => (isShown.value = false)} />
    </div>
  );
}
