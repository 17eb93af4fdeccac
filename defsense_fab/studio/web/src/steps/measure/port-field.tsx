import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { IconButton } from "../../ui/button";
import { SelectField } from "../../ui/select-field";
import { choices } from "./state";
import { TextInput } from "./text-input";

const OTHER = "other";

export interface PortDraft {
  /** A known port, or "other". */
  chosen: string;
  /** The port that is typed. */
  typed: string;
}

export const TWIN_PORT: PortDraft = { chosen: "twin", typed: "" };

export function portOf({ chosen, typed }: PortDraft): string {
  return chosen === OTHER ? typed.trim() : chosen;
}

interface PortFieldProps {
  label: string;
  draft: PortDraft;
  onChange: (draft: PortDraft) => void;
  /** Whether recordings can be chosen, too. */
  hasRecordings?: boolean;
  /** Further ports at the end of the list. */
  extra?: readonly { value: string; label: string }[];
  typedHelp: string;
}

/** A board, the simulated twin, or a port that is typed. */
export function PortField(props: PortFieldProps) {
  const { label, draft, onChange, hasRecordings = false, extra = [], typedHelp } = props;
  const known = (choices.value?.ports ?? []).filter(({ isBoard }) => isBoard || hasRecordings);
  const list = [
    ...known.map(({ port, label: text }) => ({ value: port, label: text })),
    ...extra,
    { value: OTHER, label: "Other ..." },
  ];
  const isKnown = list.some(({ value }) => value === draft.chosen);
  return (
    <>
      <div class="port-row">
        <SelectField
          label={label}
          layout="stack"
          value={isKnown ? draft.chosen : (list[0]?.value ?? OTHER)}
          choices={list}
          onCommit={(chosen) => onChange({ ...draft, chosen })}
        />
        <IconButton
          icon="refresh"
          label="Search for boards again"
          onClick={() => void run(connection.send("refresh-choices", {}))}
        />
      </div>
      {draft.chosen === OTHER && (
        <TextInput
          label="Port"
          value={draft.typed}
          onInput={(typed) => onChange({ ...draft, typed })}
          help={typedHelp}
        />
      )}
    </>
  );
}
