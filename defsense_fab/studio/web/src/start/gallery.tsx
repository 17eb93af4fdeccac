// The devices to start from, and the question for the name of the new one.
import { useSignal } from "@preact/signals";
import { useId } from "preact/hooks";
import type { GalleryDevice, Problem } from "../protocol/messages";
import { connection } from "../state/connection";
import { attempt } from "../state/run";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";
import { Icon } from "../ui/icons";
import { newFolder, recentDevices } from "./recent-devices";
import { gallery } from "./upload";

/** Cards of the devices to start from. */
export function Gallery() {
  const chosen = useSignal<GalleryDevice | null>(null);
  return (
    <>
      <ul class="card-grid">
        {gallery.value?.devices.map((device) => (
          <li key={device.name}>
            <button type="button" class="device-card" onClick={() => (chosen.value = device)}>
              <span class="card-picture example">
                <img src={device.picture} alt="" />
              </span>
              <span class="card-body">
                <strong>{device.title}</strong>
                <span class="card-about">{device.about}</span>
                <span class="card-chips">
                  {device.poses.map((pose) => (
                    <span key={pose} class="chip">
                      {pose.replaceAll("_", " ")}
                    </span>
                  ))}
                  <span class="chip cords">
                    <Icon name="cord" size={12} /> {device.cords} {device.cords === 1 ? "cord" : "cords"}
                  </span>
                </span>
              </span>
            </button>
          </li>
        ))}
      </ul>
      {chosen.value && <NewDeviceDialog start={chosen.value} onClose={() => (chosen.value = null)} />}
    </>
  );
}

function NewDeviceDialog({ start, onClose }: { start: GalleryDevice; onClose: () => void }) {
  const id = useId();
  const isNewFolder = recentDevices.value?.isNewFolder ?? false;
  const folder = recentDevices.value?.folder ?? "";
  const name = useSignal(isNewFolder ? start.name : (folder.split(/[/\\]/).at(-1) ?? start.name));
  const problem = useSignal<Problem | null>(null);
  const isBusy = useSignal(false);
  const create = async () => {
    if (isBusy.value) return;
    isBusy.value = true;
    problem.value = null;
    const content = { start: start.name, name: name.value };
    await attempt(connection.send("create-from-gallery", content), (refused) => {
      problem.value = refused;
    });
    isBusy.value = false;
  };
  return (
    <Dialog
      title={`New device from “${start.title}”`}
      size="small"
      onClose={onClose}
      actions={
        <>
          <Button onClick={onClose}>Cancel</Button>
          <Button variant="primary" isBusy={isBusy.value} onClick={() => void create()}>
            Create the device
          </Button>
        </>
      }
    >
      <p class="card-about">{start.about}</p>
      <div class={`field stack ${problem.value ? "invalid" : ""}`}>
        <label class="field-label" for={id}>
          Name
        </label>
        <input
          id={id}
          class="input"
          autofocus
          autocomplete="off"
          spellcheck={false}
          value={name.value}
          aria-invalid={problem.value ? true : undefined}
          aria-describedby={`${id}-text`}
          onInput={(event) => (name.value = event.currentTarget.value)}
          onFocus={(event) => event.currentTarget.select()}
          onKeyDown={(event) => {
            if (event.key === "Enter") void create();
          }}
        />
        {problem.value ? (
          <p id={`${id}-text`} class="field-error" role="alert">
            <Icon name="error" size={14} /> <span>{problem.value.text}</span>
          </p>
        ) : (
          <p id={`${id}-text`} class="field-help">
            {newFolder(name.value || start.name)}
          </p>
        )}
      </div>
    </Dialog>
  );
}
