import { useSignal } from "@preact/signals";
import { connection, device } from "../state/connection";
import { run } from "../state/run";
import { tooltip } from "../ui/tooltip";

/** The device's name, edited in place: Enter and leaving rename it, Escape keeps it. */
export function DeviceName() {
  const typed = useSignal<string | null>(null);
  const name = device.value?.name ?? "";
  const shown = typed.value ?? name;
  const commit = async () => {
    const text = typed.value?.trim();
    if (text !== undefined && text !== name) await run(connection.send("rename-device", { name: text }));
    typed.value = null;
  };
  return (
    <input
      class="device-name"
      aria-label="Device name"
      autocomplete="off"
      spellcheck={false}
      maxLength={120}
      size={Math.max(6, Math.min(24, shown.length))}
      value={shown}
      {...tooltip(typed.value === null ? "Rename the device" : undefined)}
      onInput={(event) => (typed.value = event.currentTarget.value)}
      onBlur={() => void commit()}
      onKeyDown={(event) => {
        if (event.key === "Escape") typed.value = null;
        if (event.key === "Enter" || event.key === "Escape") {
          const input = event.currentTarget;
          setTimeout(() => input.blur());
        }
      }}
    />
  );
}
