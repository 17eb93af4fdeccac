// The page of a live view or of a guided run that is not part of the studio.
import { connection } from "../state/connection";
import { Icon } from "../ui/icons";
import { GuidedScreen, guidedState } from "./guided-screen";
import "./live-root.css";
import { LiveView } from "./live-view";

export const livePage = connection.event("live-page");

export function LiveRoot() {
  if (livePage.value?.screen === "live") {
    return (
      <div class="live-page">
        <LiveView />
        {connection.isLost.value && (
          <p class="live-lost" role="alert">
            <Icon name="warning" /> The run has ended, or does not answer.
          </p>
        )}
      </div>
    );
  }
  const state = connection.isLost.value ? null : guidedState.value;
  return (
    <main class="guided-page">
      <h1>{livePage.value?.title}</h1>
      {state?.run ? <GuidedScreen state={state} waitsAtEnd /> : <p>This run has ended.</p>}
    </main>
  );
}
