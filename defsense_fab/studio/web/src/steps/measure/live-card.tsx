import type { ModelChoice } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { Button } from "../../ui/button";
import { Checkbox } from "../../ui/choices";
import { EmptyState } from "../../ui/feedback";
import { SelectField } from "../../ui/select-field";
import { CardFrame, CardMessage, Warning } from "./card-frame";
import { chosenModel, keepsReadings, model, outputs, port, startLive, usesFile } from "./live-run";
import { PortField } from "./port-field";
import { useRequest } from "./request";
import { card, choices, isLiveShown, status } from "./state";
import { TextInput } from "./text-input";
import { cardVariant } from "./next-card";

/** The device in motion: its shape is decoded from the readings of the cords. */
export function LiveCard() {
  const models = choices.value?.models ?? [];
  return (
    <CardFrame
      name="live"
      lead="The shape is decoded from the readings, and its values can be sent to other programs. Without a board, the simulated twin moves."
    >
      {models.length === 0 ? (
        <EmptyState
          icon="measure"
          text="No model yet. Train one on a session, or on the simulation alone."
          action={<Button onClick={() => (card.value = "train")}>Train a model</Button>}
        />
      ) : (
        <LiveForm models={models} />
      )}
    </CardFrame>
  );
}

function LiveForm({ models }: { models: readonly ModelChoice[] }) {
  const request = useRequest();
  const task = status.value?.live;
  const isRunning = task?.state === "running";
  const chosen = chosenModel()!;
  return (
    <>
      <div class="card-fields">
        <SelectField
          label="Model"
          layout="stack"
          value={chosen.name}
          choices={models.map(({ name }) => ({ value: name, label: name }))}
          onCommit={(value) => void (model.value = value)}
          help={describe(chosen)}
        />
        <PortField
          label="Source"
          hasRecordings
          draft={port.value}
          onChange={(draft) => (port.value = draft)}
          typedHelp="For example udp://192.168.1.20, replay:board.csv or twin:unit=2,cut=A@20-30"
        />
        <TextInput
          label="Outputs"
          value={outputs.value}
          onInput={(text) => (outputs.value = text)}
          placeholder="None"
          help="For example osc,port=9000; websocket"
        />
      </div>
      <div class="card-checks">
        {choices.value?.hasLiveFile && (
          <Checkbox
            label="Also send the outputs of live.toml"
            isOn={usesFile.value}
            onChange={(on) => (usesFile.value = on)}
          />
        )}
        <Checkbox
          label="Keep the readings, in the folder live"
          isOn={keepsReadings.value}
          onChange={(on) => (keepsReadings.value = on)}
        />
      </div>
      <ModelWarnings model={chosen} />
      <div class="card-actions">
        {isRunning || task?.state === "stopping" ? (
          <>
            <Button variant={cardVariant("live")} icon="monitor" onClick={() => (isLiveShown.value = true)}>
              Show the live view
            </Button>
            <Button
              icon="stop"
              isBusy={task.state === "stopping"}
              onClick={() => void request.send(connection.send("stop-live", {}))}
            >
              Stop
            </Button>
          </>
        ) : (
          <Button
            variant={cardVariant("live")}
            icon="play"
            disabled={Boolean(chosen.problem)}
            hint={chosen.problem || undefined}
            onClick={() => void startLive(request.send)}
          >
            Start
          </Button>
        )}
      </div>
      <CardMessage request={request} task={task} />
    </>
  );
}

function ModelWarnings({ model: chosen }: { model: ModelChoice }) {
  const { isBuilt = true, changes = [] } = choices.value ?? {};
  return (
    <>
      {chosen.problem && <Warning>{chosen.problem}</Warning>}
      {chosen.warning && <Warning>{chosen.warning}</Warning>}
      {!isBuilt && <Warning>The device is not built yet. Build it in Make.</Warning>}
      {changes.length > 0 && (
        <Warning>The cords have changed since the build; the built ones are used. {changes.join("; ")}.</Warning>
      )}
    </>
  );
}

function describe({ about, error }: ModelChoice): string {
  return error === null ? about : `${about}; test error ${error.toFixed(2)} mm`;
}
