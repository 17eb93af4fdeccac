import { useSignal } from "@preact/signals";
import { FieldFrame, type FieldProps, useField } from "./field";
import { useTypedText } from "./typed-text";

interface TextFieldProps extends FieldProps<string> {
  layout?: "row" | "stack";
  placeholder?: string;
  /** Replaces what cannot be part of the text while it is typed. */
  fix?: (text: string) => string;
  /** What `fix` does, shown once it has done it. */
  fixNote?: string;
}

/** A text. Enter and leaving commit it, Escape restores it; a refused one stays. */
export function TextField({
  label,
  value,
  onCommit,
  field,
  help,
  disabled,
  layout,
  placeholder,
  fix = (text) => text,
  fixNote,
}: TextFieldProps) {
  const isFixed = useSignal(false);
  const note = isFixed.value ? fixNote : help;
  const state = useField(label, field, note);
  const { typed, take, refuse, restore } = useTypedText(value, () => state.setError(""));
  /** Text of a commit that is not answered yet. */
  const sent = useSignal<string | null>(null);

  const commit = async () => {
    const text = take()?.trim();
    if (text === undefined) return;
    isFixed.value = false;
    if (text === "") {
      refuse(text);
      state.setError(`${label} must not be empty`);
    } else if (text === value) state.setError("");
    else {
      sent.value = text;
      const isAccepted = await state.send(onCommit(text), text);
      sent.value = null;
      if (!isAccepted) refuse(text);
    }
  };

  const onKeyDown = (event: KeyboardEvent) => {
    if (event.key === "Enter") void commit();
    else if (event.key === "Escape" && restore()) {
      event.preventDefault();
      event.stopPropagation();
      isFixed.value = false;
      state.setError("");
    }
  };

  return (
    <FieldFrame state={state} label={label} help={note} layout={layout}>
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
        onInput={(event) => {
          const text = event.currentTarget.value;
          typed.value = fix(text);
          if (typed.value === text) return;
          event.currentTarget.value = typed.value;
          isFixed.value = true;
        }}
        onBlur={() => void commit()}
        onKeyDown={onKeyDown}
      />
    </FieldFrame>
  );
}
