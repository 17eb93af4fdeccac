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
    dialog.current!.showModal();
    return () => {
      if (focused instanceof HTMLElement && focused.isConnected) focused.focus();
    };
  }, []);
  useEffect(() => {
    if (task && task.state === "idle") isLiveShown.value = false; // its end is shown in the card
  }, [task?.state]);
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
