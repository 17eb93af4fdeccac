import { PageMenu } from "../shell/page-menu";
import { canReturn, showDevice } from "../state/step";
import { Button } from "../ui/button";
import { EmptyState } from "../ui/feedback";

/** The page of all devices. */
export function StartPage() {
  return (
    <div class="start-page">
      <header class="start-header">
        <h1>DefSense studio</h1>
        <PageMenu />
      </header>
      <main>
        <EmptyState
          icon="devices"
          text="No devices are listed yet."
          action={canReturn.value && <Button onClick={showDevice}>Back to the device</Button>}
        />
      </main>
    </div>
  );
}
