// Three numbers with one label, such as a point.
import { NumberField } from "../../ui/number-field";

interface VectorFieldProps {
  label: string;
  value: readonly number[];
  unit?: string;
  step?: number;
  disabled?: boolean;
  onCommit: (value: number[]) => Promise<unknown> | void;
}

const AXES = ["x", "y", "z"] as const;

export function VectorField({ label, value, unit = "", step, disabled, onCommit }: VectorFieldProps) {
  return (
    <fieldset class="vector-field">
      <legend>
        {label}
        {unit && <span class="muted"> ({unit})</span>}
      </legend>
      {AXES.map((axis, k) => (
        <NumberField
          key={axis}
          label={axis}
          value={value[k]!}
          step={step}
          disabled={disabled}
          onCommit={(number) => onCommit(value.map((other, i) => (i === k ? number : other)))}
        />
      ))}
    </fieldset>
  );
}
