// The page of a live view or of a guided run that is not part of the studio.
import { connection } from "../state/connection";
import { GuidedScreen, guidedState } from "./guided-screen";
import "./live-root.css";
import { LiveView } from "./live-view";

export const livePage = connection.event("live-page");

export function LiveRoot() {
  if (livePage.value?.screen === "live") return <LiveView />;
  const state = guidedState.value;
  return (
    <main class="guided-page">
      <h1>{livePage.value?.title}</h1>
      {state?.run ? <GuidedScreen state={state} waitsAtEnd /> : <p>This run has ended.</p>}
    </main>
  );
}
