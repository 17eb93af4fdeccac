import { useSignal } from "@preact/signals";
import { FieldFrame, useField } from "../../ui/field";
import { formatNumber, parseNumber, type Range, rangeError } from "../../ui/number";
import { useTypedText } from "../../ui/typed-text";

interface OptionalFieldProps {
  label: string;
  /** Dotted key in `device.toml`. */
  field: string;
  unit: string;
  isText: boolean;
  /** The value, or null while the default holds, which is the placeholder. */
  value: number | string | null;
  placeholder: string;
  range: Range;
  onCommit: (value: number | string) => Promise<unknown>;
  /** Called for an empty field, if it may be empty. */
  onReset?: () => Promise<unknown>;
}

/**
 * A number or a text that may be absent: its placeholder is the default. Enter and leaving commit
 * it, Escape restores it, and an empty field goes back to the default.
 */
export function OptionalField(props: OptionalFieldProps) {
  const { label, field, unit, isText, value, placeholder, range, onCommit, onReset } = props;
  const state = useField(label, field);
  const { typed, take, refuse, restore } = useTypedText(value, () => state.setError(""));
  const sent = useSignal<string | null>(null);
  const current = value === null ? "" : typeof value === "number" ? formatNumber(value) : value;

  const send = async (request: Promise<unknown>, text: string) => {
    sent.value = text;
    const isAccepted = await state.send(request, text);
    sent.value = null;
    if (!isAccepted) refuse(text);
  };

  const commit = async () => {
    const text = take()?.trim();
    if (text === undefined) return;
    if (text === current) state.setError("");
    else if (text === "") {
      if (onReset) await send(onReset(), "nothing");
      else if (value !== null) state.setError(`${label} must have a value; you typed nothing`);
    } else if (isText) await send(onCommit(text), text);
    else {
      const number = parseNumber(text, unit);
      const reason = number === null ? "must be a number" : rangeError(number, range, unit);
      if (number === null || reason) {
        refuse(text);
        state.setError(`${label} ${reason}; you typed ${text}`);
      } else await send(onCommit(number), text);
    }
  };

  return (
    <FieldFrame state={state} label={label}>
      <span class="input-frame">
        <input
          id={state.id}
          class={`input ${isText ? "" : "number"}`}
          type="text"
          inputMode={isText ? "text" : "decimal"}
          autocomplete="off"
          spellcheck={false}
          placeholder={placeholder}
          aria-invalid={state.error ? true : undefined}
          aria-describedby={state.describedBy}
          value={typed.value ?? sent.value ?? current}
          onInput={(event) => (typed.value = event.currentTarget.value)}
          onFocus={(event) => event.currentTarget.select()}
          onBlur={() => void commit()}
          onKeyDown={(event) => {
            if (event.key === "Enter") void commit();
            else if (event.key === "Escape" && (restore() || state.error)) {
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
    </FieldFrame>
  );
}
