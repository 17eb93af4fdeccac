import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Button } from "../ui/button";
import { ProgressBar } from "../ui/feedback";
import { Icon } from "../ui/icons";
import { gallery, uploadFirst, uploadState } from "./upload";

const ACCEPTED = ".step,.stp,.stl,.obj,.ply,.off,.3mf,.glb,.msh,.vtu,.mesh";

/** The place for a body of one's own: files can be dropped anywhere on the page. */
export function DropZone() {
  const input = useRef<HTMLInputElement>(null);
  const isDragged = useFileDrop();
  const state = uploadState.value;
  const isBusy = state.name === "sending" || state.name === "reading";
  const { formats = "", maxUploadMb = 0 } = gallery.value ?? {};
  return (
    <section
      class={`drop-zone ${isDragged ? "dragged" : ""} ${state.name === "failed" ? "invalid" : ""}`}
      aria-label="Your own body"
    >
      <span class="drop-icon">
        <Icon name="upload" size={24} />
      </span>
      <div class="drop-text">
        <h3>{isDragged ? "Drop the file to upload it" : "Drop a body here"}</h3>
        <p>
          STEP, or a mesh ({formats}), up to {maxUploadMb} MB.
        </p>
      </div>
      <Button icon="file" isBusy={isBusy} onClick={() => input.current!.click()}>
        Choose a file
      </Button>
      <input
        ref={input}
        type="file"
        hidden
        accept={ACCEPTED}
        onChange={(event) => {
          void uploadFirst(event.currentTarget.files);
          event.currentTarget.value = "";
        }}
      />
      {state.name === "sending" && (
        <div class="drop-state">
          <span>
            Sending {state.file}, {Math.round(100 * state.share)} %
          </span>
          <ProgressBar label={`Sending ${state.file}`} share={state.share} />
        </div>
      )}
      {state.name === "reading" && (
        <div class="drop-state" role="status">
          <span>Reading {state.file}, checking that it is closed …</span>
          <ProgressBar label={`Reading ${state.file}`} share={null} />
        </div>
      )}
      {state.name === "failed" && (
        <p class="field-error drop-state" role="alert">
          <Icon name="error" size={14} /> <span>{state.text}</span>
        </p>
      )}
    </section>
  );
}

/** Upload a file that is dropped anywhere on the page; return whether one is dragged over it. */
function useFileDrop(): boolean {
  const isDragged = useSignal(false);
  useEffect(() => {
    const hasFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") ?? false;
    const onOver = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      isDragged.value = true;
    };
    const onLeave = (event: DragEvent) => {
      if (event.relatedTarget === null) isDragged.value = false;
    };
    const onDrop = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      isDragged.value = false;
      void uploadFirst(event.dataTransfer?.files);
    };
    addEventListener("dragover", onOver);
    addEventListener("dragleave", onLeave);
    addEventListener("drop", onDrop);
    return () => {
      removeEventListener("dragover", onOver);
      removeEventListener("dragleave", onLeave);
      removeEventListener("drop", onDrop);
    };
  }, []);
  return isDragged.value;
}
