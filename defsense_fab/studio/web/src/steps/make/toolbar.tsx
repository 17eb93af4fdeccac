import { useEffect } from "preact/hooks";
import { IconButton } from "../../ui/button";
import { followArrows } from "./make-commands";
import { explosion, hiddenParts, isolate, parts, selectedPart, showAllParts, togglePart } from "./state";

/** The exploded view, and which parts are visible. */
export function MakeToolbar() {
  useEffect(followArrows, []);
  if (parts.value.length === 0) return null;
  const name = selectedPart.value;
  const isOff = name !== null && hiddenParts.value.includes(name);
  return (
    <div class="make-toolbar">
      <label class="explosion">
        <span>Exploded view</span>
        <input
          class="range"
          type="range"
          min={0}
          max={100}
          style={{ "--share": String(explosion.value) }}
          value={100 * explosion.value}
          aria-valuetext={`${Math.round(100 * explosion.value)} %`}
          onInput={(event) => (explosion.value = event.currentTarget.valueAsNumber / 100)}
        />
      </label>
      <IconButton
        icon={isOff ? "eye" : "eyeOff"}
        label={isOff ? "Show the selected part" : "Hide the selected part"}
        disabled={name === null}
        hint={name === null ? "Select a part to hide it" : undefined}
        onClick={() => name !== null && togglePart(name)}
      />
      <IconButton
        icon="part"
        label="Isolate the selected part"
        disabled={name === null}
        hint={name === null ? "Select a part to isolate it" : undefined}
        shortcut="I"
        onClick={() => name !== null && isolate(name)}
      />
      <IconButton
        icon="eye"
        label="Show all parts"
        disabled={hiddenParts.value.length === 0}
        hint={hiddenParts.value.length === 0 ? "All parts are visible" : undefined}
        shortcut="A"
        onClick={showAllParts}
      />
    </div>
  );
}
