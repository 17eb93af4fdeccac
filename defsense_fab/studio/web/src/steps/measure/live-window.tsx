// The live view over the whole window, in a dialog of its own.
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { LiveView } from "../../live/live-view";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { isLiveShown, status } from "./state";

export function LiveWindow() {
  const dialog = useRef<HTMLDialogElement>(null);
  const task = status.value?.live;
  useLayoutEffect(() => {
    const focused = document.activeElement;
    const element = dialog.current!;
    element.showModal();
    return () => {
      element.close();
      // The button that started the run has been replaced by the one that shows it.
      const target = focused?.isConnected && focused !== document.body ? focused : null;
      const shown = target ?? document.querySelector(".measure-card .button.primary");
      if (shown instanceof HTMLElement) shown.focus();
    };
  }, []);
  const wasRunning = useRef(false); // the answer to the start may come before the status
  useEffect(() => {
    if (task?.state !== "idle") wasRunning.current = true;
    else if (wasRunning.current || task.problem) isLiveShown.value = false; // the card shows its end
  }, [task]);
  const close = () => (isLiveShown.value = false);
  return (
    <dialog
      ref={dialog}
      class="live-window"
      aria-label="Live"
      onCancel={(event) => {
        event.preventDefault();
        close();
      }}
    >
      <LiveView
        status={task?.text}
        onClose={close}
        onStop={() => void run(connection.send("stop-live", {}))}
      />
    </dialog>
  );
}
