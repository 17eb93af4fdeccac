// Controls that switch something: a switch, a check box, and a row of which one is chosen.
import { useId } from "preact/hooks";
import { Icon, type IconName } from "./icons";
import { tooltip } from "./tooltip";

interface ToggleProps {
  label: string;
  isOn: boolean;
  onChange: (isOn: boolean) => void;
  disabled?: boolean;
  hint?: string;
}

/** Something that is on or off at once. */
export function Switch({ label, isOn, onChange, disabled, hint }: ToggleProps) {
  return (
    <label class="toggle" {...tooltip(hint)}>
      <span>{label}</span>
      <input
        type="checkbox"
        role="switch"
        class="switch"
        checked={isOn}
        disabled={disabled}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
    </label>
  );
}

/** One of several things that are chosen. */
export function Checkbox({ label, isOn, onChange, disabled, hint }: ToggleProps) {
  return (
    <label class="toggle checkbox" {...tooltip(hint)}>
      <input
        type="checkbox"
        class="check"
        checked={isOn}
        disabled={disabled}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
      <span>{label}</span>
    </label>
  );
}

interface Segment<T extends string> {
  value: T;
  label: string;
  icon?: IconName;
  hint?: string;
  disabled?: boolean;
}

interface SegmentedControlProps<T extends string> {
  label: string;
  value: T;
  segments: readonly Segment<T>[];
  onChange: (value: T) => void;
  /** Whether only the icons are shown; the labels stay their names. */
  isCompact?: boolean;
}

/** A few values, of which one is chosen; arrow keys move between them. */
export function SegmentedControl<T extends string>(props: SegmentedControlProps<T>) {
  const { label, value, segments, onChange, isCompact = false } = props;
  const name = useId();
  return (
    <div class="segments" role="radiogroup" aria-label={label}>
      {segments.map((segment) => (
        <label
          key={segment.value}
          class="segment"
          {...tooltip(segment.hint ?? (isCompact ? segment.label : undefined))}
        >
          <input
            type="radio"
            name={name}
            class="visually-hidden"
            checked={segment.value === value}
            disabled={segment.disabled}
            onChange={() => onChange(segment.value)}
          />
          {segment.icon && <Icon name={segment.icon} />}
          <span class={isCompact ? "visually-hidden" : ""}>{segment.label}</span>
        </label>
      ))}
    </div>
  );
}
