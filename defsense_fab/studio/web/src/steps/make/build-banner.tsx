// Which device the parts belong to, and the one thing to do: build them, or export them.
import { useEffect } from "preact/hooks";
import type { MakeState } from "../../protocol/messages";
import { ErrorHelp } from "../../shell/error-help";
import { RemedyButton } from "../../shell/remedy-button";
import { startBuild } from "../../state/building";
import { connection, isJobActive, job } from "../../state/connection";
import { inPageWords } from "../../state/page-words";
import { run } from "../../state/run";
import { Button } from "../../ui/button";
import { Icon, type IconName } from "../../ui/icons";
import { exportDevice, exportProblem, isExporting } from "./export";
import { makeState } from "./state";

const layouts = connection.event("layouts");

const ICONS: Record<MakeState["code"], IconName> = {
  "not-built": "make",
  outdated: "warning",
  "other-options": "info",
  "up-to-date": "check",
};

export function BuildBanner() {
  const state = makeState.value;
  if (!state) return null;
  const isDone = state.code === "up-to-date" || state.code === "other-options";
  return (
    <div class={`make-banner ${state.code}`}>
      <p role="status">
        <Icon name={ICONS[state.code]} />
        <span>
          <b>{inPageWords(state.text)}</b> {inPageWords(state.detail)}
        </span>
      </p>
      {state.cords && <PartCords state={state} />}
      {state.problem && (
        <p class="problem" role="alert">
          <Icon name="error" />
          <span>The last build failed: {state.problem.text}</span>
        </p>
      )}
      {state.problem && <RemedyButton problem={state.problem} />}
      <div class="actions">
        {state.code !== "up-to-date" && <BuildButton state={state} isPrimary={!isDone} />}
        <ExportButton state={state} isPrimary={isDone} />
      </div>
    </div>
  );
}

function PartErrors({ state: { error, inUse } }: { state: MakeState }) {
  if (error === null) return null;
  const [middle, low, high] = inUse;
  return (
    <dl class="fact-list make-errors">
      <div>
        <dt>
          Expected error, in the parts
          <ErrorHelp />
        </dt>
        <dd>{error.toFixed(2)} mm</dd>
      </div>
      {middle !== undefined && low !== undefined && high !== undefined && (
        <div>
          <dt>Error in use</dt>
          <dd>
            {middle.toFixed(2)} mm ({low.toFixed(2)} to {high.toFixed(2)})
          </dd>
        </div>
      )}
    </dl>
  );
}

/** Which cords the parts contain, and the way to the same ones in Sensors. */
function PartCords({ state }: { state: MakeState }) {
  const built = layouts.value?.rows.find(({ role }) => role === "built");
  return (
    <>
      <p class={state.areCordsDrawn ? "muted" : "make-differs"}>{state.cords}</p>
      <PartErrors state={state} />
      {!state.areCordsDrawn && built && (
        <Button
          hint="Replace the drawn cords by those of the parts; Undo brings them back"
          onClick={() => void run(connection.send("use-layout", { name: built.name }))}
        >
          Use the cords of the parts
        </Button>
      )}
    </>
  );
}

function BuildButton({ state, isPrimary }: { state: MakeState; isPrimary: boolean }) {
  const isBuilding = job.value?.name === "build" && job.value.state !== "idle";
  const hint = isJobActive.value ? "Wait until the running job has ended" : state.buildObstacle;
  return (
    <Button
      variant={isPrimary ? "primary" : "plain"}
      isBusy={isBuilding}
      disabled={isJobActive.value || Boolean(state.buildObstacle)}
      hint={hint || "Build the parts, the guide and the report"}
      onClick={() => void startBuild("report")}
    >
      Build the parts
    </Button>
  );
}

function ExportButton({ state, isPrimary }: { state: MakeState; isPrimary: boolean }) {
  useEffect(() => {
    exportProblem.value = "";
  }, [state]);
  return (
    <>
      <Button
        icon="download"
        variant={isPrimary ? "primary" : "plain"}
        isBusy={isExporting.value}
        disabled={Boolean(state.exportObstacle)}
        hint={state.exportObstacle || "Save parts, guide, report, lists and design in one file"}
        onClick={() => void exportDevice()}
      >
        Export as zip
      </Button>
      {exportProblem.value && (
        <p class="problem" role="alert">
          <Icon name="error" />
          <span>{exportProblem.value}</span>
        </p>
      )}
    </>
  );
}
