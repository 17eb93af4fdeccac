// The states to scrub: a slider from rest through all simulated states.
import { IconButton } from "../../ui/button";
import { isPlaying, showNextState, view } from "./inside-state";
import { inside } from "./section-view";

export function StatesStrip() {
  const states = inside.value?.states ?? [];
  if (!states.length) return <p class="field-help">Simulate the poses to see their states.</p>;
  if (!view.plane.value) return null; // what is shown first is not set yet
  const state = view.state.value;
  const last = states.length - 1;
  const label = states[state]?.label ?? "";
  return (
    <div class="states-strip">
      <IconButton
        icon={isPlaying.value ? "pause" : "play"}
        label={isPlaying.value ? "Pause" : "Play the states"}
        onClick={() => (isPlaying.value = !isPlaying.value)}
      />
      <IconButton icon="arrowRight" label="Next state" shortcut="S" onClick={showNextState} />
      <div class="states-scale">
        <input
          class="range"
          type="range"
          min={0}
          max={last}
          step={1}
          value={state}
          aria-label="State"
          aria-valuetext={label}
          style={{ "--share": String(last ? state / last : 0) }}
          onInput={(event) => {
            isPlaying.value = false;
            view.state.value = event.currentTarget.valueAsNumber;
          }}
        />
        <div class="states-groups" aria-hidden="true">
          {groups(states.map(({ name }) => name)).map(({ name, first, end }) => (
            <span
              key={`${name} ${first}`}
              class={state >= first && state < end ? "current" : ""}
              style={{ flexGrow: end - first }}
              title={name}
            >
              <span>{name}</span>
            </span>
          ))}
        </div>
      </div>
      <output class="state-label">{label}</output>
    </div>
  );
}

interface StateGroup {
  name: string;
  first: number;
  end: number;
}

/** The pose of a state such as "bend@0.5" or "0.9*bend", or "mixtures" for several poses. */
function groupOf(name: string): string {
  return name.includes("+") ? "mixtures" : name.split("@")[0]!.replace(/^[\d.]+\*/, "");
}

/** Neighboring states of one pose, and those of mixtures, under one name. */
function groups(names: readonly string[]): StateGroup[] {
  const found: StateGroup[] = [];
  names.forEach((name, k) => {
    const title = groupOf(name);
    const last = found.at(-1);
    if (last?.name === title) last.end = k + 1;
    else found.push({ name: title, first: k, end: k + 1 });
  });
  return found;
}
