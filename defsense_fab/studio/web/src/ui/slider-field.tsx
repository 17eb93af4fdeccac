import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { useField } from "./field";
import { Icon } from "./icons";
import { type Range, formatNumber, parseNumber, rangeError } from "./number";
import { useTypedText } from "./typed-text";

interface SliderFieldProps {
  label: string;
  value: number;
  min: number;
  max: number;
  step?: number;
  unit?: string;
  /** Numbers that can be typed; by default those of the slider. */
  limits?: Range;
  /** Called while the handle is dragged. */
  onInput?: (value: number) => void;
  /** Called when it is released, and for a number that is typed. */
  onCommit?: (value: number) => Promise<unknown> | void;
  field?: string;
  help?: string;
  disabled?: boolean;
}

/** A number in a range: a slider, with a field next to its label. */
export function SliderField(props: SliderFieldProps) {
  const { label, value, min, max, step = 1, unit = "", onInput, onCommit, disabled } = props;
  const state = useField(label, props.field, props.help);
  const dragged = useSignal<number | null>(null);
  const { typed, take, refuse, restore } = useTypedText(value, () => state.setError(""));
  const shown = dragged.value ?? value;
  const share = max > min ? (shown - min) / (max - min) : 0;

  useEffect(() => {
    dragged.value = null;
  }, [value]);

  const release = async (number: number) => {
    await state.send(onCommit?.(number), formatNumber(number));
    dragged.value = null;
  };

  const commitTyped = () => {
    const text = take();
    if (text === null) return;
    const number = parseNumber(text, unit);
    const limits = props.limits ?? { min, max };
    const reason = number === null ? "must be a number" : rangeError(number, limits, unit);
    if (number === null || reason) {
      refuse(text);
      state.setError(`${label} ${reason}; you typed ${text.trim() || "nothing"}`);
      return;
    }
    onInput?.(number);
    void release(number);
  };

  return (
    <div class={`field slider ${state.error ? "invalid" : ""}`}>
      <label for={state.id} class="field-label">
        {label}
      </label>
      <span class="input-frame">
        <input
          class="input number"
          type="text"
          inputMode="decimal"
          autocomplete="off"
          aria-label={`${label}, number`}
          aria-invalid={state.error ? true : undefined}
          aria-describedby={state.describedBy}
          disabled={disabled}
          value={typed.value ?? formatNumber(shown, 4)}
          onInput={(event) => (typed.value = event.currentTarget.value)}
          onFocus={(event) => event.currentTarget.select()}
          onBlur={commitTyped}
          onKeyDown={(event) => {
            if (event.key === "Enter") commitTyped();
            else if (event.key === "Escape" && restore()) {
              event.preventDefault();
              event.stopPropagation();
              state.setError("");
            }
          }}
        />
        {unit && (
          <span class="unit" aria-hidden="true">
            {unit}
          </span>
        )}
      </span>
      <input
        id={state.id}
        class="range"
        type="range"
        min={min}
        max={max}
        step={step}
        style={{ "--share": String(share) }}
        aria-valuetext={`${formatNumber(shown, 4)}${unit && ` ${unit}`}`}
        disabled={disabled}
        value={shown}
        onInput={(event) => {
          dragged.value = event.currentTarget.valueAsNumber;
          onInput?.(dragged.value);
        }}
        onChange={(event) => void release(event.currentTarget.valueAsNumber)}
      />
      {state.error ? (
        <p id={`${state.id}-error`} class="field-error" role="alert">
          <Icon name="error" size={14} /> <span>{state.error}</span>
        </p>
      ) : (
        props.help && (
          <p id={`${state.id}-help`} class="field-help">
            {props.help}
          </p>
        )
      )}
    </div>
  );
}
