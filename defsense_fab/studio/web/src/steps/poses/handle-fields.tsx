// How a pose turns and moves a region, by numbers.
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { HandleState } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { Checkbox } from "../../ui/choices";
import { NumberField } from "../../ui/number-field";
import { SelectField } from "../../ui/select-field";
import { previewTurn } from "./pose-gizmo";
import { VectorField } from "./vector-field";

const TURNS = [
  { value: "angle", label: "By an angle" },
  { value: "hinge", label: "Freely about an axis (hinge)" },
  { value: "free", label: "Freely" },
] as const;

const AXES = ["x", "y", "z"] as const;
const UNITS: Record<(typeof AXES)[number], number[]> = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };
const MAX_DEGREES = 3600;
const MIN_SLIDER_DEGREES = 90;

type AxisName = (typeof AXES)[number] | "custom";

export function HandleFields({ pose, handle }: { pose: string; handle: HandleState }) {
  const { region, turn, axis, degrees } = handle;
  const setTurn = (content: Partial<Pick<HandleState, "turn" | "axis" | "degrees">>) =>
    connection.send("set-turn", { pose, region, turn, axis, degrees, ...content });
  return (
    <div class="handle-fields">
      <SelectField
        label="Turn"
        value={turn}
        choices={TURNS}
        layout="stack"
        onCommit={(value) => setTurn({ turn: value })}
      />
      {turn !== "free" && <AxisField axis={axis} onCommit={(value) => setTurn({ axis: value })} />}
      {turn === "angle" && (
        <>
          <NumberField
            label="Angle"
            value={degrees}
            min={-MAX_DEGREES}
            max={MAX_DEGREES}
            unit="°"
            onCommit={(value) => setTurn({ degrees: value })}
          />
          <AngleSlider
            degrees={degrees}
            onInput={(value) => previewTurn(pose, handle, value)}
            onCommit={(value) => void run(setTurn({ degrees: value }))}
          />
        </>
      )}
      <ShiftFields pose={pose} handle={handle} />
      {turn !== "free" && <PivotField pose={pose} handle={handle} />}
    </div>
  );
}

interface AngleSliderProps {
  degrees: number;
  onInput: (degrees: number) => void;
  onCommit: (degrees: number) => void;
}

/** A slider of an angle, whose range grows with the angle. */
function AngleSlider({ degrees, onInput, onCommit }: AngleSliderProps) {
  const dragged = useSignal<number | null>(null);
  useEffect(() => {
    dragged.value = null;
  }, [degrees]);
  const shown = dragged.value ?? degrees;
  const limit = Math.max(MIN_SLIDER_DEGREES, Math.ceil(Math.abs(degrees) / 90) * 90);
  return (
    <input
      class="range"
      type="range"
      aria-label="Angle, slider"
      aria-valuetext={`${shown}°`}
      min={-limit}
      max={limit}
      step={1}
      style={{ "--share": String((shown + limit) / (2 * limit)) }}
      value={shown}
      onInput={(event) => {
        dragged.value = event.currentTarget.valueAsNumber;
        onInput(dragged.value);
      }}
      onChange={(event) => onCommit(event.currentTarget.valueAsNumber)}
    />
  );
}

function axisName(axis: readonly number[]): AxisName {
  const main = axis.findIndex((value) => Math.abs(value) > 0.9999);
  return main >= 0 && axis[main]! > 0 ? AXES[main]! : "custom";
}

interface AxisFieldProps {
  axis: number[];
  onCommit: (axis: number[]) => Promise<unknown>;
}

function AxisField({ axis, onCommit }: AxisFieldProps) {
  const name = axisName(axis);
  const choices = [...AXES.map((value) => ({ value, label: value })), { value: "custom" as const, label: "Other" }];
  return (
    <>
      <SelectField<AxisName>
        label="Axis"
        value={name}
        choices={choices}
        onCommit={(value) => (value === "custom" ? onCommit([1, 1, 0]) : onCommit(UNITS[value]))}
      />
      {name === "custom" && <VectorField label="Direction of the axis" value={axis} step={0.1} onCommit={onCommit} />}
    </>
  );
}

function ShiftFields({ pose, handle }: { pose: string; handle: HandleState }) {
  const { region, shift } = handle;
  const send = (value: (number | null)[]) => connection.send("set-shift", { pose, region, shift: value });
  if (shift.every((value) => value === null)) {
    return <p class="muted">Its place is free: it moves to where only a torque turns it. Choose “Turned, moved” to set the place.</p>;
  }
  return (
    <fieldset class="vector-field shift">
      <legend>
        Moved by <span class="muted">(mm)</span>
      </legend>
      {AXES.map((name, k) => (
        <div key={name}>
          <NumberField
            label={name}
            value={shift[k] ?? 0}
            disabled={shift[k] === null}
            step={0.5}
            onCommit={(value) => send(shift.map((other, i) => (i === k ? value : other)))}
          />
          <Checkbox
            label="Free"
            hint={`Let the region move along ${name} to where nothing pushes it`}
            isOn={shift[k] === null}
            onChange={(isOn) => void send(shift.map((other, i) => (i === k ? (isOn ? null : 0) : other)))}
          />
        </div>
      ))}
    </fieldset>
  );
}

function PivotField({ pose, handle }: { pose: string; handle: HandleState }) {
  const { region, about, center } = handle;
  const send = (value: number[] | null) => connection.send("set-pivot", { pose, region, about: value });
  return (
    <>
      <Checkbox
        label="Turn about its middle"
        isOn={about === null}
        onChange={(isOn) => void send(isOn ? null : center.map((value) => Math.round(value * 10) / 10))}
      />
      {about && <VectorField label="Turned about" unit="mm" value={about} onCommit={send} />}
    </>
  );
}
