import { useSignal } from "@preact/signals";
import { connection, device } from "../state/connection";
import { attempt } from "../state/run";
import { tooltip } from "../ui/tooltip";
import { useTypedText } from "../ui/typed-text";

/** The device's name, edited in place: Enter and leaving rename it, Escape keeps it. */
export function DeviceName() {
  const name = device.value?.name ?? "";
  const problem = useSignal("");
  const { typed, take, refuse, restore } = useTypedText(name, () => (problem.value = ""));
  const shown = typed.value ?? name;
  const commit = async () => {
    const text = take()?.trim();
    if (text === undefined) return;
    problem.value = "";
    if (text === name) return;
    await attempt(connection.send("rename-device", { name: text }), ({ text: reason }) => {
      refuse(text);
      problem.value = reason;
    });
  };
  return (
    <span class="device-name-frame">
      <input
        class="device-name"
        aria-label="Device name"
        aria-invalid={problem.value ? true : undefined}
        aria-describedby={problem.value ? "device-name-problem" : undefined}
        autocomplete="off"
        spellcheck={false}
        maxLength={120}
        size={Math.max(6, Math.min(24, shown.length))}
        value={shown}
        {...tooltip(typed.value === null ? "Rename the device" : undefined)}
        onInput={(event) => (typed.value = event.currentTarget.value)}
        onBlur={() => void commit()}
        onKeyDown={(event) => {
          if (event.key === "Enter") void commit();
          if (event.key !== "Escape" || !restore()) return;
          event.preventDefault();
          event.stopPropagation();
          problem.value = "";
        }}
      />
      {problem.value && (
        <span id="device-name-problem" class="name-note refused" role="alert">
          {problem.value}
        </span>
      )}
    </span>
  );
}
