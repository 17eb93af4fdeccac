import type { EvaluationResult, SessionChoice, TrainingResult } from "../../protocol/messages";
import { ErrorHelp } from "../../shell/error-help";
import { connection, isJobActive } from "../../state/connection";
import { Button } from "../../ui/button";
import { Checkbox } from "../../ui/choices";
import { EmptyState } from "../../ui/feedback";
import { Icon } from "../../ui/icons";
import { Table } from "../../ui/table";
import { CardFrame, CardMessage, Warning } from "./card-frame";
import { type CardRequest, useRequest } from "./request";
import {
  card,
  choices,
  chosenSessions,
  rawSessions,
  results,
  status,
  trainingSessions,
} from "./state";
import { DecoderHelp } from "./decoder-help";
import { cardVariant } from "./next-card";

const makeState = connection.event("make-state");

/** Sessions, training and evaluation, with their results. */
export function TrainCard() {
  const request = useRequest();
  const { training, evaluation } = results.value ?? {};
  return (
    <CardFrame
      name="train"
      lead="Decoders are compared by cross-validation; the best one becomes the model. A part at the end of each session is kept for the test."
    >
      <Sessions />
      <Actions request={request} />
      <CardMessage request={request} task={status.value?.train} />
      {training && <TrainingTable result={training} />}
      {evaluation && <EvaluationTable result={evaluation} />}
    </CardFrame>
  );
}

function Sessions() {
  const sessions = choices.value?.sessions ?? [];
  if (sessions.length === 0) {
    return (
      <EmptyState
        icon="measure"
        text="No sessions yet. Record the simulated twin, or the device itself."
        action={<Button onClick={() => (card.value = "record")}>Record a session</Button>}
      />
    );
  }
  return (
    <fieldset class="session-list">
      <legend>Sessions</legend>
      {[...sessions].reverse().map((session) => (
        <Session key={session.name} session={session} />
      ))}
    </fieldset>
  );
}

function Session({ session: { name, summary, problem, isRaw } }: { session: SessionChoice }) {
  const chosen = trainingSessions.value;
  const toggle = (isOn: boolean) => {
    const next = new Set(chosen);
    if (isOn) next.add(name);
    else next.delete(name);
    chosenSessions.value = next;
  };
  return (
    <div class="session-row">
      <Checkbox
        label={name}
        isOn={chosen.includes(name)}
        disabled={Boolean(problem)}
        onChange={toggle}
      />
      <span class={problem ? "session-problem" : "session-summary"}>
        {isRaw ? "Not processed yet" : problem || summary}
      </span>
    </div>
  );
}

function Actions({ request }: { request: CardRequest }) {
  const isBusy = isJobActive.value;
  const sessions = trainingSessions.value;
  const hasSession = sessions.length > 0;
  const raw = rawSessions.value.length;
  const hint = hasSession ? undefined : "Choose a processed session";
  return (
    <div class="card-actions">
      {raw > 0 && (
        <Button
          icon="refresh"
          disabled={isBusy}
          onClick={() => void request.send(connection.send("process-sessions", {}))}
        >
          {raw === 1 ? "Process the recording" : `Process ${raw} recordings`}
        </Button>
      )}
      <Button
        variant={cardVariant("train")}
        icon="play"
        disabled={isBusy || !hasSession}
        hint={hint}
        onClick={() => void request.send(connection.send("train-model", { sessions }))}
      >
        Train
      </Button>
      <Button
        disabled={isBusy || !hasSession || !results.value?.training}
        hint={results.value?.training ? hint : "Train a model first"}
        onClick={() => void request.send(connection.send("evaluate-model", { sessions }))}
      >
        Evaluate
      </Button>
      <Button
        variant="quiet"
        disabled={isBusy || !choices.value?.isBuilt}
        hint="Train on the simulated states alone, without any session"
        onClick={() => void request.send(connection.send("train-on-simulation", {}))}
      >
        Train on the simulation
      </Button>
    </div>
  );
}

function TrainingTable({ result }: { result: TrainingResult }) {
  const chosen = result.decoders.find(({ isChosen }) => isChosen);
  return (
    <section class="card-result" aria-label="Trained model">
      {result.warning && <Warning>{result.warning}</Warning>}
      <h3>
        {result.model}
        {result.decoders.length > 0 && <DecoderHelp />}
        {chosen && (
          <span class="card-headline">
            Measured error {(chosen.test ?? chosen.folds).toFixed(2)} mm{" "}
            {chosen.test === null ? "by cross-validation" : "in the test"}
          </span>
        )}
      </h3>
      <ErrorInUse />
      {result.decoders.length > 0 && (
        <Table
          caption="Errors of the decoders, mm"
          rows={result.decoders}
          rowKey={({ decoder }) => decoder}
          isChosen={({ isChosen }) => isChosen}
          columns={[
            {
              title: "Decoder",
              cell: ({ decoder, isChosen }) => (
                <span class="decoder-name">
                  {decoder} {isChosen && <span class="chosen-mark"><Icon name="check" size={14} /> chosen</span>}
                </span>
              ),
            },
            { title: "Cross-validation", isNumber: true, cell: ({ folds }) => folds.toFixed(2) },
            { title: "Test", isNumber: true, cell: ({ test }) => test?.toFixed(2) ?? "–" },
            { title: "Peak", isNumber: true, cell: ({ peak }) => peak?.toFixed(2) ?? "–" },
          ]}
        />
      )}
      <p class="card-note">
        Errors of the markers in mm (RMSE; peak: the largest). Chosen by cross-validation: each session in turn is left out and predicted from the others.
        {result.trainedImages !== null &&
          ` Trained on ${result.trainedImages} images and tested on the ${result.testedImages} that follow.`}
      </p>
      {result.trainedOn && (
        <Warning>
          The model was trained on {result.trainedOn} and not on measurements of this device. Expect errors
          several times the prediction until you train on a session.
        </Warning>
      )}
      <Notes notes={result.notes} />
    </section>
  );
}

/** The error that the design expects here, next to the measured one. */
function ErrorInUse() {
  const [middle, low, high] = makeState.value?.inUse ?? [];
  if (middle === undefined || low === undefined || high === undefined) return null;
  return (
    <p class="card-note">
      By the design, the error in use is {middle.toFixed(2)} mm (90 of 100 devices:{" "}
      {low.toFixed(2)} to {high.toFixed(2)} mm). <ErrorHelp />
    </p>
  );
}

function EvaluationTable({ result }: { result: EvaluationResult }) {
  return (
    <section class="card-result" aria-label="Evaluation">
      <h3>
        Evaluation
        <span class="card-headline">Measured error {result.rmse.toFixed(2)} mm</span>
      </h3>
      <ErrorInUse />
      <Table
        caption="Errors of the model, mm"
        rows={[result]}
        rowKey={({ model }) => model}
        columns={[
          { title: "Model", cell: ({ model }) => model },
          {
            title: "RMSE ± SD",
            isNumber: true,
            cell: ({ rmse, deviation }) => `${rmse.toFixed(2)} ± ${deviation.toFixed(2)}`,
          },
          { title: "Peak", isNumber: true, cell: ({ peak }) => peak.toFixed(2) },
          { title: "Average peak", isNumber: true, cell: ({ averagePeak }) => averagePeak.toFixed(2) },
          { title: "Frames", isNumber: true, cell: ({ frames }) => frames },
        ]}
      />
      <p class="card-note">On images that were not used for training.</p>
      <Notes notes={result.notes} />
      <ReportLink file="evaluation.html" />
    </section>
  );
}

export function Notes({ notes }: { notes: readonly string[] }) {
  if (notes.length === 0) return null;
  return (
    <ul class="card-notes">
      {notes.map((note) => (
        <li key={note}>{note}</li>
      ))}
    </ul>
  );
}

/** A link that saves a report. */
export function ReportLink({ file }: { file: string }) {
  return (
    <a class="button plain" href={`/files/measure/${file}`} download={file}>
      <Icon name="download" /> Download the report
    </a>
  );
}
