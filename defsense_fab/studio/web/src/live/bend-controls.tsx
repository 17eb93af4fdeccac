// The simulated device is bent by its poses: its cords change, and the shape is decoded from them.
import { effect, signal } from "@preact/signals";
import { connection } from "../state/connection";
import { run } from "../state/run";
import { Checkbox } from "../ui/choices";
import { isTruthShown, liveDevice } from "./live-state";

const SEND_MS = 50;
/** Poses that are bent together share the range in which the device is trained. */
const MAX_TOTAL = 1;

// The view may be closed and opened again while the device stays bent.
const isAutomatic = signal(true);
const levels = signal<Record<string, number>>({});
let timer: ReturnType<typeof setTimeout> | undefined;

effect(() => {
  if (liveDevice.value?.name) return;
  isAutomatic.value = true;
  levels.value = {};
});

function send(): void {
  timer = undefined;
  if (!liveDevice.peek()?.name) return;
  void run(connection.send("bend-twin", { levels: isAutomatic.peek() ? null : levels.peek() }));
}

function bend(name: string, level: number): void {
  isAutomatic.value = false;
  const { [name]: _, ...others } = levels.peek();
  const total = Object.values(others).reduce((sum, other) => sum + other, 0);
  const share = Math.min(1, (MAX_TOTAL - level) / (total || 1));
  const kept = Object.entries(others).map(([other, value]) => [other, share * value]);
  levels.value = { ...Object.fromEntries(kept), [name]: level };
  timer ??= setTimeout(send, SEND_MS);
}

export function BendControls({ poses }: { poses: readonly string[] }) {
  return (
    <section class="bend-controls" aria-label="Bend the twin">
      <h3>Bend the twin</h3>
      <p class="field-help">The sliders bend the simulated device; the shape is decoded from its readings.</p>
      <Checkbox
        label="Let it move automatically"
        isOn={isAutomatic.value}
        onChange={(isOn) => {
          isAutomatic.value = isOn;
          levels.value = {};
          send();
        }}
      />
      <Checkbox
        label="Show the true shape"
        isOn={isTruthShown.value}
        onChange={(isOn) => (isTruthShown.value = isOn)}
      />
      {poses.map((name) => {
        const level = levels.value[name] ?? 0;
        const percent = Math.round(100 * level);
        return (
          <label key={name} class="bend-control">
            <span>{name}</span>
            <output>{percent} %</output>
            <input
              class="range"
              type="range"
              min={0}
              max={1}
              step={0.01}
              value={level}
              aria-label={`Bend by ${name}`}
              aria-valuetext={`${percent} %`}
              style={{ "--share": String(level) }}
              onInput={(event) => bend(name, event.currentTarget.valueAsNumber)}
            />
          </label>
        );
      })}
    </section>
  );
}
