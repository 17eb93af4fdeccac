import { FieldFrame, useField } from "../../ui/field";

interface TextInputProps {
  label: string;
  value: string;
  onInput: (value: string) => void;
  help?: string;
  placeholder?: string;
}

/** A text that may be empty, and that belongs to this browser only. */
export function TextInput({ label, value, onInput, help, placeholder }: TextInputProps) {
  const state = useField(label, undefined, help);
  return (
    <FieldFrame state={state} label={label} help={help} layout="stack">
      <input
        id={state.id}
        class="input"
        type="text"
        autocomplete="off"
        spellcheck={false}
        placeholder={placeholder}
        aria-describedby={state.describedBy}
        value={value}
        onInput={(event) => onInput(event.currentTarget.value)}
      />
    </FieldFrame>
  );
}
