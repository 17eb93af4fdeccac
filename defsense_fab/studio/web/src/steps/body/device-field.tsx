// One key of device.toml: its control, what it means, and the way back to its default.
import type { DeviceField } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { IconButton } from "../../ui/button";
import { formatNumber } from "../../ui/number";
import { Popover } from "../../ui/popover";
import { SelectField } from "../../ui/select-field";
import { OptionalField } from "./optional-field";

const UNSET = "";
/** Longest default in words that a field has room for. */
const MAX_PLACEHOLDER_LENGTH = 14;

/** A field with its description and, if it is set, a button that resets it. */
export function DeviceFieldRow({ field }: { field: DeviceField }) {
  const { key, label, canReset } = field;
  const fallback = defaultText(field);
  return (
    <div class={`field-row ${canReset ? "set" : ""}`} data-field={key}>
      <Control field={field} />
      <Popover label={`About ${label}`}>
        <div class="field-about">
          <p>{field.description}</p>
          {fallback && <p>Default: {fallback}.</p>}
          <p>
            <code>{key}</code> in device.toml
          </p>
        </div>
      </Popover>
      {canReset && (
        <IconButton
          icon="undo"
          class="reset"
          label={`Reset ${label}${fallback && ` to ${fallback}`}`}
          onClick={() => void run(connection.send("reset-field", { key }))}
        />
      )}
    </div>
  );
}

function Control({ field }: { field: DeviceField }) {
  const { key, label, kind, value, choices, unit } = field;
  const set = (next: number | boolean | string) => connection.send("set-field", { key, value: next });
  const reset = () => connection.send("reset-field", { key });
  if (kind === "number" || kind === "whole" || kind === "text") {
    return (
      <OptionalField
        label={label}
        field={key}
        unit={unit}
        isText={kind === "text"}
        value={typeof value === "boolean" ? null : value}
        placeholder={shortDefault(field)}
        range={{
          ...(field.low !== null && (field.isLowOpen ? { above: field.low } : { min: field.low })),
          ...(field.high !== null && !field.isHighOpen && { max: field.high }),
        }}
        onCommit={set}
        onReset={field.canReset ? reset : undefined}
      />
    );
  }
  const options =
    kind === "switch"
      ? [
          { value: "true", label: "Yes" },
          { value: "false", label: "No" },
        ]
      : choices.map((choice) => ({ value: choice, label: choice }));
  const unset = { value: UNSET, label: `${shortDefault(field)} (default)` };
  return (
    <SelectField
      label={label}
      field={key}
      value={value === null ? UNSET : String(value)}
      choices={[unset, ...options]}
      onCommit={(chosen) =>
        chosen === UNSET ? reset() : set(kind === "switch" ? chosen === "true" : chosen)
      }
    />
  );
}

/** The value that holds without the key, in words. */
function defaultText(field: DeviceField, hasUnit = true): string {
  const { default: value, unit, defaultText: words } = field;
  if (typeof value === "number") {
    return `${formatNumber(value)}${hasUnit && unit ? ` ${unit}` : ""}`;
  }
  if (typeof value === "boolean") return value ? "yes" : "no";
  return value ?? words;
}

/** The default in a word, where there is little room. */
function shortDefault(field: DeviceField): string {
  const text = defaultText(field, false);
  return text !== "" && text.length <= MAX_PLACEHOLDER_LENGTH ? text : "automatic";
}
