import { useSignal } from "@preact/signals";
import { useLayoutEffect } from "preact/hooks";
import { FieldFrame, type FieldProps, useField } from "./field";

interface TextFieldProps extends FieldProps<string> {
  layout?: "row" | "stack";
  placeholder?: string;
}

/** A text. Enter and leaving commit it, Escape restores it; an empty one is refused. */
export function TextField({
  label,
  value,
  onCommit,
  field,
  help,
  disabled,
  layout,
  placeholder,
}: TextFieldProps) {
  const state = useField(label, field, help);
  const typed = useSignal<string | null>(null);
  /** Text of a commit that is not answered yet. */
  const sent = useSignal<string | null>(null);

  useLayoutEffect(() => {
    typed.value = null;
    state.setError("");
  }, [value]);

  const commit = async () => {
    const text = typed.value?.trim();
    typed.value = null;
    if (text === undefined) return;
    if (text === "") state.setError(`${label} must not be empty`);
    else if (text === value) state.setError("");
    else {
      sent.value = text;
      await state.send(onCommit(text), text);
      sent.value = null;
    }
  };

  const onKeyDown = (event: KeyboardEvent) => {
    if (event.key === "Enter") void commit();
    else if (event.key === "Escape" && typed.value !== null) {
      event.preventDefault();
      event.stopPropagation();
      typed.value = null;
      state.setError("");
    }
  };

  return (
    <FieldFrame state={state} label={label} help={help} layout={layout}>
      <input
        id={state.id}
        class="input"
        type="text"
        autocomplete="off"
        spellcheck={false}
        placeholder={placeholder}
        aria-invalid={state.error ? true : undefined}
        aria-describedby={state.describedBy}
        disabled={disabled}
        value={typed.value ?? sent.value ?? value}
        onInput={(event) => (typed.value = event.currentTarget.value)}
        onBlur={() => void commit()}
        onKeyDown={onKeyDown}
      />
    </FieldFrame>
  );
}
