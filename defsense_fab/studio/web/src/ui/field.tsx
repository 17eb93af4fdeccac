// The common parts of all fields: label, help, error, and a commit that may be refused.
import { useSignal } from "@preact/signals";
import type { ComponentChildren, JSX } from "preact";
import { useId, useLayoutEffect } from "preact/hooks";
import type { Problem } from "../protocol/messages";
import { corrections } from "../state/connection";
import { attempt, useFieldProblem } from "../state/run";
import { Icon } from "./icons";

export interface FieldProps<T> {
  label: string;
  value: T;
  /** Called with a valid value; a refusal of the promise is shown below the field. */
  onCommit: (value: T) => Promise<unknown> | void;
  /** Dotted key in `device.toml`, whose errors are shown below the field. */
  field?: string;
  /** One short sentence below the field. */
  help?: string;
  disabled?: boolean;
}

interface FieldState {
  id: string;
  error: string;
  /** Identifiers of the texts that describe the control. */
  describedBy: string | undefined;
  setError: (text: string) => void;
  /** Wait for a value that was typed as `text`; its refusal becomes the field's error.
   *  Return whether it is accepted. */
  send: (request: Promise<unknown> | void, text?: string) => Promise<boolean>;
}

/** The error of a field and its identifiers. */
export function useField(label: string, key: string | undefined, help?: string): FieldState {
  const id = useId();
  const problem = useFieldProblem(key);
  const own = useSignal("");
  const error = own.value || (problem.value ? describe(problem.value, label) : "");
  const setError = (text: string) => {
    own.value = text;
    problem.value = null;
  };
  useLayoutEffect(() => setError(""), [corrections.value]);
  const send = async (request: Promise<unknown> | void, text = "") => {
    setError("");
    let isAccepted = true;
    if (request) {
      await attempt(request, (refused) => {
        isAccepted = false;
        const isOfOtherField = key && refused.field && refused.field !== key;
        setError(isOfOtherField ? refused.text : describe(refused, label, text));
      });
    }
    return isAccepted;
  };
  const describedBy = error ? `${id}-error` : help ? `${id}-help` : undefined;
  return { id, error, describedBy, setError, send };
}

/** The message of a refusal, with the field's label and the typed text. */
function describe(problem: Problem, label: string, typed = ""): string {
  const message = problem.message.replace(/\.$/, "");
  const sentence = message.startsWith("Must ")
    ? `${label} ${message[0]!.toLowerCase()}${message.slice(1)}`
    : message;
  return typed && !message.includes(typed) ? `${sentence}; you typed ${typed}` : sentence;
}

type LabelHandlers = Pick<
  JSX.IntrinsicElements["label"],
  "onPointerDown" | "onPointerMove" | "onPointerUp" | "onPointerCancel" | "onClick"
>;

interface FrameProps {
  state: FieldState;
  label: ComponentChildren;
  help?: string;
  /** Whether the label is left of the control or above it. */
  layout?: "row" | "stack";
  /** Handlers of a label that can be dragged. */
  labelHandlers?: LabelHandlers;
  children: ComponentChildren;
}

/** A label, a control, and its help or error. */
export function FieldFrame(props: FrameProps) {
  const { state, label, help, layout = "row", labelHandlers, children } = props;
  const { id, error } = state;
  return (
    <div class={`field ${layout} ${error ? "invalid" : ""}`}>
      <label for={id} class={`field-label ${labelHandlers ? "scrub" : ""}`} {...labelHandlers}>
        {label}
      </label>
      <div class="field-control">{children}</div>
      {error ? (
        <p id={`${id}-error`} class="field-error" role="alert">
          <Icon name="error" size={14} /> <span>{error}</span>
        </p>
      ) : (
        help && (
          <p id={`${id}-help`} class="field-help">
            {help}
          </p>
        )
      )}
    </div>
  );
}
