// Which device the parts belong to, and the one thing to do: build them, or export them.
import { useEffect } from "preact/hooks";
import type { MakeState } from "../../protocol/messages";
import { connection, isJobActive, job } from "../../state/connection";
import { run } from "../../state/run";
import { Button } from "../../ui/button";
import { Icon, type IconName } from "../../ui/icons";
import { exportDevice, exportProblem, isExporting } from "./export";
import { makeState } from "./state";

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
          <b>{state.text}</b> {state.detail}
        </span>
      </p>
      {state.problem && (
        <p class="problem" role="alert">
          <Icon name="error" />
          <span>The last build failed: {state.problem.text}</span>
        </p>
      )}
      <div class="actions">
        {state.code !== "up-to-date" && <BuildButton state={state} isPrimary={!isDone} />}
        <ExportButton state={state} isPrimary={isDone} />
      </div>
    </div>
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
      onClick={() => void run(connection.send("start-build", { stage: "report" }))}
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
