import { signal } from "@preact/signals";
import type { ResponseResult } from "../../protocol/messages";
import { connection, isJobActive } from "../../state/connection";
import { Button } from "../../ui/button";
import { CardFrame, CardMessage, Warning } from "./card-frame";
import { PortField, portOf } from "./port-field";
import { type CardRequest, useRequest } from "./request";
import { choices, isGuidedOpen, results, status } from "./state";
import { TextInput } from "./text-input";
import { Notes, ReportLink } from "./train-card";

const SIMULATED = "twin:speed=20";
const port = signal({ chosen: SIMULATED, typed: "" });
const specimen = signal("specimen");

/** The response of the cord, measured on a bent specimen. */
export function SpecimenCard() {
  const request = useRequest();
  const response = results.value?.response;
  const { specimens = [], simulatedSpecimens = [] } = choices.value ?? {};
  const used = specimens.length > 0 ? specimens : simulatedSpecimens;
  return (
    <CardFrame
      name="specimen"
      lead="Optional: measure how your own cord answers to strain. The design is optimized with this response instead of the data sheet."
    >
      <div class="card-fields">
        <PortField
          label="Board"
          draft={port.value}
          extra={[{ value: SIMULATED, label: "twin, 20 times as fast" }]}
          onChange={(draft) => (port.value = draft)}
          typedHelp="For example /dev/ttyUSB0 or COM3"
        />
        <TextInput
          label="Specimen"
          value={specimen.value}
          onInput={(text) => (specimen.value = text)}
          help="Folder that defsense calibrate specimen wrote, in the device's folder"
        />
      </div>
      <div class="card-actions">
        <Button
          variant={used.length > 0 ? "plain" : "primary"}
          icon="play"
          disabled={isGuidedOpen.value || isJobActive.value}
          onClick={() =>
            void request.send(
              connection.send("measure-specimen", { port: portOf(port.value), specimen: specimen.value }),
            )
          }
        >
          Measure a specimen
        </Button>
        <Button
          disabled={isJobActive.value || simulatedSpecimens.length > 0}
          hint={simulatedSpecimens.length > 0 ? "They exist already" : "Try the fit without a specimen"}
          onClick={() => void request.send(connection.send("simulate-specimens", {}))}
        >
          Simulate specimens
        </Button>
        <Button
          variant={used.length > 0 ? "primary" : "plain"}
          disabled={isJobActive.value || used.length === 0}
          hint={used.length > 0 ? undefined : "Measure or simulate specimens first"}
          onClick={() => void request.send(connection.send("fit-response", {}))}
        >
          Fit the response
        </Button>
      </div>
      <p class="card-note">{used.length > 0 ? `Sessions: ${used.join(", ")}` : "No sessions on specimens yet."}</p>
      <CardMessage request={request} task={status.value?.specimen} />
      {response && <Response response={response} request={request} />}
    </CardFrame>
  );
}

function Response({ response, request }: { response: ResponseResult; request: CardRequest }) {
  const [low, high] = response.interval;
  const [shortest, longest] = response.strains.map((strain) => `${(100 * strain).toFixed(1)} %`);
  return (
    <section class="card-result" aria-label="Fitted response">
      {response.isSimulated && (
        <Warning>Fitted to simulated specimens. The result does not describe a real cord.</Warning>
      )}
      <h3>
        Response of the cord
        <span class="card-headline">
          k = {response.kRes.toFixed(2)} ({low!.toFixed(2)} to {high!.toFixed(2)})
        </span>
      </h3>
      <p>{response.reason}</p>
      <p class="card-note">
        Strains from {shortest} to {longest}, {response.readings} readings of {response.pieces} pieces; 95 % interval.
      </p>
      <Notes notes={response.warnings} />
      <div class="card-actions">
        <Button
          disabled={!response.canUse}
          hint={response.canUse ? "Set the response of this device; Undo restores it" : "The device uses it"}
          onClick={() => void request.send(connection.send("use-response", {}))}
        >
          Use the response
        </Button>
        <ReportLink file="response.html" />
      </div>
    </section>
  );
}
