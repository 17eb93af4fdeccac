import { useEffect, useRef } from "preact/hooks";
import type { Parameter } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { IconButton } from "../../ui/button";
import { Switch } from "../../ui/choices";
import { formatNumber, type Range } from "../../ui/number";
import { SelectField } from "../../ui/select-field";
import { SliderField } from "../../ui/slider-field";
import { TextField } from "../../ui/text-field";

/** Time without a new value after which a dragged slider is taken to rest, ms. */
const REST_MS = 400;

/** The field of a parameter of the script; one that is set can be reset to the script's default. */
export function ParameterField({ parameter }: { parameter: Parameter }) {
  const { name, isSet, unit } = parameter;
  const canReset = isSet && parameter.default !== null && parameter.value !== parameter.default;
  return (
    <div class={`field-row parameters ${canReset ? "set" : ""}`}>
      <Control parameter={parameter} />
      {canReset && (
        <IconButton
          icon="undo"
          class="reset"
          label={`Reset ${name} to ${inWords(parameter.default, unit)}`}
          onClick={() => void run(connection.send("reset-parameter", { name }))}
        />
      )}
    </div>
  );
}

function Control({ parameter }: { parameter: Parameter }) {
  const { name, kind, unit, value, low, high, step, choices } = parameter;
  const field = `body.parameters.${name}`;
  const set = useLatest(name);
  if (low !== null && high !== null) {
    return (
      <SliderField
        label={name}
        field={field}
        unit={unit}
        value={Number(value)}
        min={low}
        max={high}
        step={step}
        limits={limits(parameter)}
        onInput={set.later}
        onCommit={set.now}
      />
    );
  }
  if (kind === "switch") {
    return <Switch label={name} isOn={value === true} onChange={(isOn) => void run(set.now(isOn))} />;
  }
  if (kind === "choice") {
    const text = String(value);
    const listed = choices.includes(text) ? choices : [text, ...choices];
    return (
      <SelectField
        label={name}
        field={field}
        value={text}
        choices={listed.map((choice) => ({ value: choice, label: choice }))}
        onCommit={set.now}
      />
    );
  }
  return <TextField label={name} field={field} value={String(value ?? "")} onCommit={set.now} />;
}

/** Set a parameter now, or when its slider rests. */
function useLatest(name: string) {
  const timer = useRef<ReturnType<typeof setTimeout>>(undefined);
  useEffect(() => () => clearTimeout(timer.current), []);
  const now = (value: number | boolean | string) => {
    clearTimeout(timer.current);
    return connection.send("set-parameter", { name, value });
  };
  const later = (value: number) => {
    clearTimeout(timer.current);
    timer.current = setTimeout(() => void run(now(value)), REST_MS);
  };
  return { now, later };
}

/** The numbers that the script accepts. */
function limits({ min, max }: Parameter): Range {
  return { ...(min !== null && { min }), ...(max !== null && { max }) };
}

function inWords(value: Parameter["default"], unit: string): string {
  if (typeof value === "number") return `${formatNumber(value)}${unit && ` ${unit}`}`;
  if (typeof value === "boolean") return value ? "on" : "off";
  return String(value);
}
