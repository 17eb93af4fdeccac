// Taking the present readings as those at rest, with a message that undoes it.
import { signal } from "@preact/signals";
import { connection } from "../state/connection";
import { run } from "../state/run";
import { Button, IconButton } from "../ui/button";

const SHOWN_MS = 15_000;

const isShown = signal(false);
let timer: ReturnType<typeof setTimeout> | undefined;

function show(isNowShown: boolean): void {
  clearTimeout(timer);
  isShown.value = isNowShown;
  if (isNowShown) timer = setTimeout(() => show(false), SHOWN_MS);
}

/** Take the present readings as those of the device at rest. */
export async function takeRest(): Promise<void> {
  const answer = await run(connection.send("take-rest", {}));
  if (answer !== undefined) show(true);
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
          show(false);
          void run(connection.send("undo-take-rest", {}));
        }}
      >
        Undo
      </Button>
      <IconButton icon="close" label="Dismiss" onClick={() => show(false)} />
    </div>
  );
}
