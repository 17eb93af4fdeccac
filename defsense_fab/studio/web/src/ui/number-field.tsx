import { useSignal } from "@preact/signals";
import { FieldFrame, type FieldProps, useField } from "./field";
import { type Range, formatNumber, parseNumber, rangeError, stepped } from "./number";
import { useScrub } from "./scrub";
import { useTypedText } from "./typed-text";

interface NumberFieldProps extends FieldProps<number>, Range {
  unit?: string;
  /** Change by an arrow key; ten times as much with Shift. */
  step?: number;
  layout?: "row" | "stack";
}

/**
 * A number with its unit. Enter and leaving commit it, Escape restores it, arrow keys and a drag on
 * the label step it. A value that is not allowed stays, with the error below.
 */
export function NumberField(props: NumberFieldProps) {
  const { label, value, onCommit, field, help, disabled, unit = "", step = 1, layout } = props;
  const state = useField(label, field, help);
  const { typed, take, refuse, restore } = useTypedText(value, () => state.setError(""));
  /** Text of a commit that is not answered yet. */
  const sent = useSignal<string | null>(null);

  const commit = async () => {
    const text = take();
    if (text === null) return;
    const number = parseNumber(text, unit);
    const reason = number === null ? "must be a number" : rangeError(number, props, unit);
    const named = text.trim() === "" ? "nothing" : text.trim();
    if (number === null || reason) {
      refuse(text);
      state.setError(`${label} ${reason}; you typed ${named}`);
    } else if (number === value) state.setError("");
    else {
      sent.value = text;
      const isAccepted = await state.send(onCommit(number), named);
      sent.value = null;
      if (!isAccepted) refuse(text);
    }
  };

  const onKeyDown = (event: KeyboardEvent) => {
    if (event.key === "Enter") void commit();
    else if (event.key === "Escape" && restore()) {
      event.preventDefault();
      event.stopPropagation();
      state.setError("");
    } else if (event.key === "ArrowUp" || event.key === "ArrowDown") {
      event.preventDefault();
      const change = step * (event.shiftKey ? 10 : 1) * (event.key === "ArrowUp" ? 1 : -1);
      const from = parseNumber(typed.value ?? "", unit) ?? value;
      typed.value = formatNumber(stepped(from, change, props));
    }
  };

  const onKeyUp = ({ key }: KeyboardEvent) => {
    if (key === "ArrowUp" || key === "ArrowDown") void commit();
  };

  const scrub = useScrub(
    (steps) => {
      if (!disabled) typed.value = formatNumber(stepped(value, step * steps, props));
    },
    () => void commit(),
  );

  return (
    <FieldFrame state={state} label={label} help={help} layout={layout} labelHandlers={scrub}>
      <span class="input-frame">
        <input
          id={state.id}
          class="input number"
          type="text"
          inputMode="decimal"
          autocomplete="off"
          role="spinbutton"
          aria-valuenow={value}
          aria-valuetext={`${formatNumber(value)}${unit && ` ${unit}`}`}
          aria-valuemin={props.min ?? props.above}
          aria-valuemax={props.max}
          aria-invalid={state.error ? true : undefined}
          aria-describedby={state.describedBy}
          disabled={disabled}
          value={typed.value ?? sent.value ?? formatNumber(value)}
          onInput={(event) => (typed.value = event.currentTarget.value)}
          onFocus={(event) => event.currentTarget.select()}
          onBlur={() => void commit()}
          onKeyDown={onKeyDown}
          onKeyUp={onKeyUp}
        />
        {unit && (
          <span class="unit" aria-hidden="true">
            {unit}
          </span>
        )}
      </span>
    </FieldFrame>
  );
}
