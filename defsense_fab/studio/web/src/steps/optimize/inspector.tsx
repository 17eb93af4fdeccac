// What is true of the cords, the search or the chosen layout, and the error map.
import type { ComponentChildren } from "preact";
import { findCommand, isAvailable, reasonAgainst, runAnywhere } from "../../commands";
import type { LayoutRow, OptimizeState } from "../../protocol/messages";
import { ErrorHelp } from "../../shell/error-help";
import { startBuild } from "../../state/building";
import { inPageWords } from "../../state/page-words";
import { describeWorst, sensingOf, worstPose } from "../../state/pose-errors";
import { run } from "../../state/run";
import { connection, device, isJobActive, prediction } from "../../state/connection";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { Section } from "../../ui/section";
import { ErrorMapSection } from "./error-map-section";
import { LayoutDetails } from "./layout-details";
import {
  applyBest,
  applyLayout,
  bestRow,
  chosen,
  differs,
  isSearching,
  isTakingBest,
  rows,
  search,
  standing,
  useBestLabel,
  useHint,
} from "./state";
import { mainVariant } from "../../state/step";

export function OptimizeInspector() {
  return (
    <div class="optimize-inspector">
      <Standing />
      {chosen.value && (
        <Section title="Layout" name="optimize.layout">
          <LayoutDetails row={chosen.value} />
        </Section>
      )}
      <Section title="Error on the surface" name="optimize.map">
        <ErrorMapSection />
      </Section>
    </div>
  );
}

const ICONS = {
  "not-ready": "info",
  "never-searched": "info",
  locked: "lock",
  searching: "optimize",
  optimized: "check",
  "drawn-differ": "info",
  outdated: "warning",
} as const;

function Standing() {
  const state = standing.value;
  if (!state) return null;
  return (
    <div class={`search-standing ${state.standing}`}>
      <p role="status">
        <Icon name={ICONS[state.standing]} />
        <span>{state.text}</span>
      </p>
      {isSearching.value ? <SearchNumbers /> : <Numbers state={state} />}
      {state.standing === "optimized" && <MoreAccurate />}
      {!isSearching.value && <PoorlySensed />}
      <Actions />
    </div>
  );
}

/** The pose that the drawn cords sense poorly, and what may help. */
function PoorlySensed() {
  const worst = worstPose(prediction.value?.drawn?.poses ?? []);
  const propose = findCommand("sensor.propose");
  if (!worst || !propose || sensingOf(worst) === "sensed") return null;
  const noun = device.value?.noun ?? "cord";
  return (
    <div class="poorly-sensed">
      <p>
        <span class="problem-text">{describeWorst(worst)}.</span> Another {noun} may help.
      </p>
      <Button
        icon="idea"
        disabled={!isAvailable(propose)}
        hint={isAvailable(propose) ? `Search in Sensors for the ${noun} that lowers the error most, and add it` : reasonAgainst(propose)}
        onClick={() => runAnywhere(propose)}
      >
        Propose another {noun}
      </Button>
    </div>
  );
}

/** Share of the drawn cords' error by which another layout is worth a word. */
const WORTH_A_WORD = 0.02;

/** The layout that the search did not take, though it is a little more accurate in its parts. */
function MoreAccurate() {
  const drawn = rows.value.find((row) => row.isDrawn);
  if (!drawn?.error || drawn.parts === null) return null;
  const made = rows.value.filter(({ role, problem, parts }) => role === "candidate" && !problem && parts !== null);
  const other = made.sort((a, b) => (a.error ?? Infinity) - (b.error ?? Infinity))[0];
  if (!other?.error || other.error > (1 - WORTH_A_WORD) * drawn.error) return null;
  return (
    <p class="muted">
      {`Another layout has ${other.error.toFixed(2)} mm in the parts, with ${effort(other)}; the drawn one has ${effort(drawn)}. “Use” in the table takes the other.`}
    </p>
  );
}

function effort({ parts, planes }: LayoutRow): string {
  return `${counted(parts ?? 0, "part")} and ${counted(planes, "plane")}`;
}

const counted = (count: number, noun: string): string => `${count} ${noun}${count === 1 ? "" : "s"}`;

function Numbers({ state }: { state: OptimizeState }) {
  const { drawn, isDrawnInParts, built, isBuiltMoved } = state;
  if (drawn === null && built === null) return null;
  return (
    <ErrorNumbers>
      <Number label={isDrawnInParts ? "Drawn, in the parts" : "Drawn, without the cuts"} error={drawn} tone="drawn" />
      {isBuiltMoved && <Number label="Optimized, in the parts" error={built} tone="built" />}
    </ErrorNumbers>
  );
}

function ErrorNumbers({ children }: { children: ComponentChildren }) {
  return (
    <>
      <h3 class="standing-title">
        Expected error
        <ErrorHelp />
      </h3>
      <dl class="standing-numbers">{children}</dl>
    </>
  );
}

function SearchNumbers() {
  const { best = null, drawn = null } = search.value ?? {};
  return (
    <ErrorNumbers>
      <Number label="Drawn, without the cuts" error={drawn} tone="drawn" />
      <Number label="Best so far, without the cuts" error={best} tone="best" />
    </ErrorNumbers>
  );
}

function Number({ label, error, tone }: { label: string; error: number | null; tone: string }) {
  return (
    <div>
      <dt>
        <i class={`chart-mark ${tone}`} aria-hidden="true" />
        {label}
      </dt>
      <dd>{error === null ? "–" : `${error.toFixed(2)} mm`}</dd>
    </div>
  );
}

/** Whether the search has found cords that are better than the drawn ones. */
function isBestBetter(): boolean {
  const { best = null, drawn = null } = search.value ?? {};
  return best !== null && (drawn === null || best < drawn);
}

/** Whether a layout is less accurate in its parts than the drawn cords are in theirs. */
function isWorseThanDrawn({ error, parts }: LayoutRow): boolean {
  const drawn = rows.value.find((row) => row.isDrawn);
  if (!drawn || drawn.parts === null || parts === null) return false;
  return (error ?? Infinity) > (drawn.error ?? Infinity);
}

/** One primary button: use what was found, or search. */
function Actions() {
  const { obstacle = "", standing: code } = standing.value ?? {};
  const best = bestRow.value;
  const reason = standing.value?.bestProblem ?? "";
  const isOffered = differs.value && (best !== null || Boolean(reason));
  const hasBest = isBestBetter();
  const isMain = best !== null && !chosen.value && !isWorseThanDrawn(best);
  if (isSearching.value) {
    return (
      <Button
        variant={mainVariant.value}
        disabled={!hasBest}
        isBusy={isTakingBest.value}
        hint={hasBest ? "Stop optimizing and draw the best cords that can be made" : "No better cords within all limits yet"}
        onClick={() => void applyBest()}
      >
        Use the best so far
      </Button>
    );
  }
  const isLocked = (device.value?.cords ?? []).every(({ free }) => free.length === 0);
  return (
    <div class="actions">
      {isOffered && (
        <Button
          variant={isMain ? "primary" : "plain"}
          disabled={!best}
          hint={best ? useHint(best) : `They cannot be made: ${inPageWords(reason)}`}
          onClick={() => void (best && applyLayout(best.name))}
        >
          {useBestLabel()}
        </Button>
      )}
      <Button
        variant={(isOffered && best) || code === "optimized" || chosen.value ? "plain" : "primary"}
        disabled={Boolean(obstacle) || isJobActive.value}
        hint={
          isJobActive.value
            ? "Wait until the running job has ended"
            : obstacle || "Move the cords that are not locked to reduce the error"
        }
        onClick={() => void startBuild("optimize")}
      >
        {code === "never-searched" || code === "not-ready" || isLocked ? "Optimize" : "Optimize again"}
      </Button>
      {isLocked && obstacle && code !== "not-ready" && (
        <Button
          icon="unlock"
          hint="Let the optimizer move all cords; lock single ones in Sensors"
          onClick={() => void run(connection.send("unlock-cords", {}))}
        >
          Unlock all
        </Button>
      )}
      {hasBest && code !== "optimized" && code !== "locked" && !isOffered && (
        <Button
          isBusy={isTakingBest.value}
          hint="Draw the best cords of the search that ended early and can be made"
          onClick={() => void applyBest()}
        >
          Use the best found
        </Button>
      )}
    </div>
  );
}
