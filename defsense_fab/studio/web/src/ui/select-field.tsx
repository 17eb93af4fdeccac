import { useRef } from "preact/hooks";
import { FieldFrame, type FieldProps, useField } from "./field";

export interface Choice<T extends string> {
  value: T;
  label: string;
  /** Why it cannot be chosen. */
  disabled?: boolean;
}

interface SelectFieldProps<T extends string> extends FieldProps<T> {
  choices: readonly Choice<T>[];
  layout?: "row" | "stack";
}

/** One of several values. */
export function SelectField<T extends string>({
  label,
  value,
  choices,
  onCommit,
  field,
  help,
  disabled,
  layout,
}: SelectFieldProps<T>) {
  const state = useField(label, field, help);
  const current = useRef(value);
  current.current = value;
  return (
    <FieldFrame state={state} label={label} help={help} layout={layout}>
      <select
        id={state.id}
        class="input select"
        aria-invalid={state.error ? true : undefined}
        aria-describedby={state.describedBy}
        disabled={disabled}
        value={value}
        onChange={(event) => {
          const select = event.currentTarget;
          const chosen = choices[select.selectedIndex]!;
          void state.send(onCommit(chosen.value)).then(() => {
            select.value = current.current;
          });
        }}
      >
        {choices.map((choice) => (
          <option key={choice.value} value={choice.value} disabled={choice.disabled}>
            {choice.label}
          </option>
        ))}
      </select>
    </FieldFrame>
  );
}
