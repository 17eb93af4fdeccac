import { canReturn, showDevice } from "../state/step";
import { Button } from "../ui/button";
import { EmptyState } from "../ui/feedback";

/** The page of all devices. */
export function StartPage() {
  return (
    <main class="start-page">
      <EmptyState
        icon="devices"
        text="No devices are listed yet."
        action={canReturn.value ? <Button onClick={showDevice}>Back to the device</Button> : undefined}
      />
    </main>
  );
}
