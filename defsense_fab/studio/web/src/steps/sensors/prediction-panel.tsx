// The panel below the scene: expected error, drawn and in the parts, by pose, with signals and limits.
import { useRef } from "preact/hooks";
import type { Judgement, PartsCheck, PoseError } from "../../protocol/messages";
import { NextButton } from "../../shell/next-button";
import { ErrorHelp } from "../../shell/error-help";
import { device, prediction } from "../../state/connection";
import { inPageWords } from "../../state/page-words";
import { describeWorst, sensingOf, worstPose } from "../../state/pose-errors";
import { hovered, isSame, isSelected, select } from "../../state/selection";
import { Icon } from "../../ui/icons";
import { tooltip } from "../../ui/tooltip";
import { ErrorBar, roundUp, SignalBar } from "./bars";
import { limitTitle, showViolation } from "./limit-labels";
import { draggedJudgement, judgement, violations } from "./state";

/** Number of cords above which their signals are shown without bars. */
const MANY_CORDS = 3;
/** Lines of the scale of errors. */
const SCALE_PARTS = 2;

export function PredictionPanel() {
  const state = prediction.value;
  const shown = judgement.value;
  if (!state) return null;
  if (!state.isReady && !shown) return <NotReady />;
  return (
    <div class="prediction" aria-busy={state.isComputing}>
      <div class="prediction-summary">
        <Headline />
        {state.drawnProblem && <p class="problem-text">{state.drawnProblem.message}</p>}
        {shown && <Limits judgement={shown} />}
      </div>
      {!state.isReady && <NotReady />}
      {shown && shown.poses.length > 0 && (
        <div class="pose-scroll">
          <PoseTable judgement={shown} />
        </div>
      )}
    </div>
  );
}

function NotReady() {
  return (
    <div class="prediction-empty">
      <Icon name="measure" />
      <p>{prediction.value?.text}</p>
      <NextButton variant="plain" />
    </div>
  );
}

function Headline() {
  const { built, isBuiltDrawn, hasBuiltParts, check } = prediction.value!;
  const error = judgement.value?.error ?? null;
  const isDragged = draggedJudgement.value !== null;
  const inParts = isDragged ? null : check.error;
  const [inUse] = isDragged ? [] : check.inUse;
  const noun = device.value?.noun ?? "cord";
  return (
    <>
      <div class="headline-row">
        <p class="headline" aria-live="polite">
          <span>
            <strong>{error === null ? "No prediction" : millimeters(error)}</strong>{" "}
            {error !== null && "without the cuts"}
          </span>
          {inParts !== null && (
            <span>
              <strong>{millimeters(inParts)}</strong> in the parts
            </span>
          )}
        </p>
        <ErrorHelp side="above" />
      </div>
      {(inUse !== undefined || (built !== null && !isBuiltDrawn)) && (
        <p class="muted">
          {inUse !== undefined && `Error in use: ${millimeters(inUse)}. `}
          {built !== null && !isBuiltDrawn && `${hasBuiltParts ? "Last build" : "Last optimized"}, other ${noun}s: ${millimeters(built)} in the parts.`}
        </p>
      )}
      <WorstPose />
    </>
  );
}

const millimeters = (value: number): string => `${value.toFixed(2)} mm`;

function WorstPose() {
  const worst = worstPose(judgement.value?.poses ?? []);
  if (!worst) return null;
  return <p class={sensingOf(worst) === "sensed" ? "muted" : "problem-text"}>{describeWorst(worst)}</p>;
}

function Limits({ judgement: { cords } }: { judgement: Judgement }) {
  if (cords.length === 0) return <p class="problem-text">Without {device.value?.noun ?? "cord"}s nothing is sensed.</p>;
  if (violations.value.length === 0) return <Kept />;
  return (
    <ul class="limits" aria-label="Broken limits">
      {violations.value.map((violation, i) => (
        <li key={i}>
          <button
            type="button"
            class="limit"
            {...tooltip(inPageWords(violation.text))}
            onClick={() => showViolation(violation)}
          >
            <Icon name="warning" size={14} />
            <span>
              {limitTitle(violation)}: {violation.cords.join(", ")}
            </span>
          </button>
        </li>
      ))}
    </ul>
  );
}

/** What is known of the parts by the state of their check. */
const UNKNOWN_PARTS: Partial<Record<PartsCheck["state"], string>> = {
  checking: "Checking the parts …",
  aborted: "The parts could not be checked; the next change checks them again.",
};

/** That no limit is broken, and whether the parts can be made, as far as that is known. */
function Kept() {
  const { isReady, check } = prediction.value!;
  if (draggedJudgement.value) return <p class="muted">The path keeps its limits.</p>;
  if (check.state === "passed") {
    const count = check.parts === null ? "" : `, in ${check.parts} parts`;
    return (
      <p class="kept" role="status">
        All limits are kept, and the {device.value?.noun ?? "cord"}s can be made{count}.
      </p>
    );
  }
  const then = UNKNOWN_PARTS[check.state] ?? "The parts are not checked yet.";
  return (
    <p class="muted checking" role="status">
      {check.state === "checking" && <span class="spinner" aria-hidden="true" />}
      <span>
        The paths keep their limits. {isReady ? then : "The parts are checked after the simulation."}
      </span>
    </p>
  );
}

/** A scale that stays while something is dragged, and fits otherwise. */
function useScale(largest: number): number {
  const scale = useRef(0);
  const isFitting = largest > scale.current || largest < scale.current / 5;
  if (draggedJudgement.value === null && largest > 0 && isFitting) {
    scale.current = roundUp(largest * 1.05);
  }
  return scale.current || 1;
}

/** Poses by error, the worst first; their order stays while something is dragged. */
function sorted(poses: readonly PoseError[]): PoseError[] {
  const order = new Map((prediction.value?.drawn?.poses ?? poses).map(({ pose, error }) => [pose, error]));
  return [...poses].sort((a, b) => (order.get(b.pose) ?? 0) - (order.get(a.pose) ?? 0));
}

function PoseTable({ judgement: { poses } }: { judgement: Judgement }) {
  const cords = device.value?.cords ?? [];
  const errorScale = useScale(Math.max(...poses.map(({ error }) => error)));
  const signals = poses.flatMap((pose) => pose.signals.map(Math.abs));
  const signalScale = useScale(Math.max(0, ...signals));
  const lines = Array.from({ length: SCALE_PARTS + 1 }, (_, i) => (errorScale * i) / SCALE_PARTS);
  return (
    <table class={cords.length > MANY_CORDS ? "pose-table narrow" : "pose-table"}>
      <caption class="visually-hidden">Expected error and signals of each pose</caption>
      <thead>
        <tr>
          <th scope="col">Pose</th>
          <th scope="col" class="error-column">
            <span class="visually-hidden">Error</span>
            <span class="error-scale" aria-hidden="true">
              {lines.map((value) => (
                <span key={value}>{Number(value.toPrecision(2))}</span>
              ))}
            </span>
          </th>
          {cords.map(({ name, color }) => (
            <th key={name} scope="col">
              <button
                type="button"
                class="cord-heading"
                aria-pressed={isSelected({ kind: "cord", name })}
                data-hovered={isSame(hovered.value, { kind: "cord", name }) || undefined}
                onClick={(event) => select({ kind: "cord", name }, event.shiftKey || event.ctrlKey)}
                onPointerEnter={() => (hovered.value = { kind: "cord", name })}
                onPointerLeave={() => (hovered.value = null)}
              >
                <span class="swatch" style={{ background: color }} />
                {name}
              </button>
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {sorted(poses).map(({ pose, error, signals: values }) => (
          <tr key={pose}>
            <th scope="row">{pose}</th>
            <td class="error-column">
              <ErrorBar error={error} scale={errorScale} />
            </td>
            {cords.map(({ name }, i) => (
              <td key={name}>
                {values[i] !== undefined && <SignalBar signal={values[i]} scale={signalScale} />}
              </td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}
