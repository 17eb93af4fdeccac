// The field of a name that is edited in place; a refused name stays, with the reason below it.
import { useSignal } from "@preact/signals";
import { useId, useRef } from "preact/hooks";

interface NameInputProps {
  /** The present name. */
  name: string;
  /** Replaces what cannot be part of the name while it is typed. */
  fix?: (text: string) => string;
  /** What `fix` does. */
  fixNote?: string;
  /** Rename it; return why the name is refused, or null. */
  onRename: (name: string) => Promise<string | null>;
  onDone: () => void;
}

/** Enter and leaving rename, Escape and an empty name keep the old one. */
export function NameInput({ name, fix = (text) => text, fixNote, onRename, onDone }: NameInputProps) {
  const id = useId();
  const problem = useSignal("");
  const isFixed = useSignal(false);
  const isBusy = useRef(false);
  const refused = useRef("");
  const note = problem.value || (isFixed.value ? fixNote : "");

  const finish = async (typed: string) => {
    const text = typed.trim();
    if (isBusy.current || (text && text === refused.current)) return;
    if (text === "" || text === name) return onDone();
    isBusy.current = true;
    const reason = await onRename(text);
    isBusy.current = false;
    if (reason === null) return onDone();
    refused.current = text;
    problem.value = reason;
  };

  return (
    <span class="name-input">
      <input
        class="input tree-input"
        aria-label={`New name of ${name}`}
        aria-invalid={problem.value ? true : undefined}
        aria-describedby={note ? id : undefined}
        spellcheck={false}
        autocomplete="off"
        defaultValue={name}
        ref={(input) => {
          if (!input || input.dataset["isReady"]) return;
          input.dataset["isReady"] = "true";
          input.focus();
          input.select();
        }}
        onClick={(event) => event.stopPropagation()}
        onDblClick={(event) => event.stopPropagation()}
        onInput={(event) => {
          const { value } = event.currentTarget;
          problem.value = "";
          if (fix(value) === value) return;
          event.currentTarget.value = fix(value);
          isFixed.value = true;
        }}
        onBlur={(event) => void finish(event.currentTarget.value)}
        onKeyDown={(event) => {
          event.stopPropagation();
          if (event.key === "Enter") void finish(event.currentTarget.value);
          if (event.key !== "Escape") return;
          isBusy.current = true; // leaving it does not rename
          onDone();
        }}
      />
      {note && (
        <span id={id} class={`name-note ${problem.value ? "refused" : ""}`} role="alert">
          {note}
        </span>
      )}
    </span>
  );
}
