// The offer of the introduction, which needs a device to walk through.
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { startIntroduction, wasOffered } from "../shell/introduction";
import { connection } from "../state/connection";
import { run } from "../state/run";
import { canReturn, showDevice } from "../state/step";
import { isBoolean, storedSignal } from "../state/storage";
import { Button, IconButton } from "../ui/button";
import { Icon } from "../ui/icons";
import { askForIntroduction } from "./follow-device";

const START = "bar";

const isDismissed = storedSignal("introduction-offer", false, isBoolean);

/** A card that starts the introduction, on the device that is open or on a new example. */
export function IntroductionOffer() {
  const isBusy = useSignal(false);
  useEffect(() => {
    wasOffered.value = true;
  }, []);
  if (isDismissed.value) return null;
  const start = async () => {
    isBusy.value = true;
    if (canReturn.value) showDevice();
    else {
      askForIntroduction();
      const created = await run(connection.send("create-from-gallery", { start: START, name: "" }));
      if (created === undefined) {
        isBusy.value = false;
        return;
      }
    }
    isDismissed.value = true;
    startIntroduction();
  };
  return (
    <section class="offer" aria-label="Introduction">
      <Icon name="idea" size={20} />
      <p>
        <strong>New here?</strong> Create the bar and walk through the seven steps in five minutes.
      </p>
      <Button isBusy={isBusy.value} onClick={() => void start()}>
        Take the introduction
      </Button>
      <IconButton icon="close" label="Close the offer" onClick={() => (isDismissed.value = true)} />
    </section>
  );
}
