import { useEffect, useRef } from "preact/hooks";
import { pipeline } from "../state/connection";
import { isPhone } from "../state/layout";
import { STEPS, STEP_LABELS, enterStep, step } from "../state/step";
import { Icon } from "../ui/icons";
import { tooltip } from "../ui/tooltip";
import { STATE_LABELS, StepMark } from "./step-marks";

/** The steps of the work in their order, with the state of each. */
export function PipelineBar() {
  const list = useRef<HTMLOListElement>(null);
  const entered = step.value;
  useEffect(() => {
    const current = list.current?.querySelector("[aria-current]");
    current?.scrollIntoView({ block: "nearest", inline: "center", behavior: "smooth" });
  }, [entered, isPhone.value]);
  return (
    <nav class="pipeline" aria-label="Steps">
      <ol ref={list}>
        {STEPS.map((name, index) => {
          const status = pipeline.value?.steps.find((other) => other.name === name);
          const state = status?.state ?? "blocked";
          return (
            <li key={name}>
              <button
                type="button"
                class={`step ${state}`}
                aria-current={name === entered ? "step" : undefined}
                onClick={() => enterStep(name)}
                {...tooltip(status?.text, String(index + 1))}
              >
                <StepMark state={state} />
                {STEP_LABELS[name]}
                <span class="visually-hidden">, {STATE_LABELS[state]}</span>
              </button>
              {index < STEPS.length - 1 && <Icon name="chevronRight" size={12} />}
            </li>
          );
        })}
      </ol>
    </nav>
  );
}
