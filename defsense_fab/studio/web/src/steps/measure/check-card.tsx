import { signal } from "@preact/signals";
import type { CheckResult } from "../../protocol/messages";
import { connection, device } from "../../state/connection";
import { Button } from "../../ui/button";
import { Checkbox } from "../../ui/choices";
import { Icon } from "../../ui/icons";
import { SelectField } from "../../ui/select-field";
import { Table } from "../../ui/table";
import { CardFrame, CardMessage, Obstacle, Warning, obstacleOf } from "./card-frame";
import { PortField, portOf, TWIN_PORT } from "./port-field";
import { useRequest } from "./request";
import { isGuidedOpen, results, status } from "./state";
import { TextInput } from "./text-input";
import { cardVariant } from "./next-card";

const port = signal(TWIN_PORT);
const fault = signal("");
const hasWiggle = signal(true);
const hasPoses = signal(true);
const reference = signal("");

/** The wiring of the device on its board, real or simulated. */
export function CheckCard() {
  const request = useRequest();
  const task = status.value?.check;
  const result = results.value?.check;
  const isTwin = port.value.chosen === "twin";
  const obstacle = obstacleOf({ needsBuild: true });
  const start = () =>
    void request.send(
      connection.send("start-check", {
        port: isTwin && fault.value ? `twin:${fault.value}` : portOf(port.value),
        wiggle: hasWiggle.value,
        poses: hasPoses.value,
        reference: reference.value.split(/[\s,;]+/).filter(Boolean).map(Number),
      }),
    );
  return (
    <CardFrame
      name="check"
      lead="Find open, shorted, exchanged and loose wires before you record. Try it on the simulated twin first."
    >
      <div class="card-fields">
        <PortField
          label="Board"
          draft={port.value}
          onChange={(draft) => (port.value = draft)}
          typedHelp="For example /dev/ttyUSB0, COM3, udp://elbow or twin:unit=2,loose=A"
        />
        {isTwin && <FaultField />}
        <TextInput
          label="Reference resistors"
          value={reference.value}
          onInput={(text) => (reference.value = text)}
          placeholder="As the build proposes"
          help="In ohm: one for each channel, or one for all"
        />
      </div>
      <div class="card-checks">
        <Checkbox
          label="Move each wire, to find loose contacts"
          isOn={hasWiggle.value}
          onChange={(on) => (hasWiggle.value = on)}
        />
        <Checkbox
          label="Hold poses, if only they tell wires apart"
          isOn={hasPoses.value}
          onChange={(on) => (hasPoses.value = on)}
        />
      </div>
      <div class="card-actions">
        <Button
          variant={cardVariant("check")}
          icon="play"
          isBusy={task?.state === "running"}
          disabled={isGuidedOpen.value || Boolean(obstacle)}
          hint={obstacle || undefined}
          onClick={start}
        >
          Start the check
        </Button>
      </div>
      {task?.state !== "running" && <Obstacle text={obstacle} />}
      <CardMessage request={request} task={task} />
      {result && <CheckTable result={result} />}
    </CardFrame>
  );
}

function FaultField() {
  const cords = device.value?.cords.map(({ name }) => name) ?? [];
  const [first, second] = cords;
  const list = [{ value: "", label: "None" }];
  if (first) {
    list.push(
      { value: `cut=${first}`, label: `Wire of ${first} cut` },
      { value: `short=${first}`, label: `Wire of ${first} shorted` },
      { value: `loose=${first}`, label: `Contact of ${first} loose` },
    );
  }
  if (first && second) {
    list.push({ value: `swap=${first}+${second}`, label: `${first} and ${second} exchanged` });
  }
  return (
    <SelectField
      label="Simulated fault"
      layout="stack"
      value={fault.value}
      choices={list}
      onCommit={(value) => {
        fault.value = value;
      }}
    />
  );
}

function CheckTable({ result }: { result: CheckResult }) {
  const faults = result.findings.filter(({ code }) => code !== "ok").length;
  return (
    <section class="card-result" aria-label="Result of the check">
      <h3 class={result.isSound ? "sound" : "faulty"}>
        <Icon name={result.isSound ? "check" : "warning"} />
        {result.isSound
          ? "All channels are in order"
          : `${faults} of ${result.findings.length} channels need attention`}
      </h3>
      <Table
        caption="Channels"
        rows={result.findings}
        rowKey={({ channel }) => String(channel)}
        columns={[
          { title: "Pin", cell: ({ channel }) => `A${channel}` },
          { title: "Cord", cell: ({ cord }) => cord },
          { title: "State", cell: ({ code }) => <span class={`finding-code ${code}`}>{code}</span> },
          {
            title: "What to do",
            cell: ({ text, action }) => (
              <>
                {text}. {action && <strong>{action}.</strong>}
              </>
            ),
          },
        ]}
      />
      <p class="card-note">
        {result.port}, {result.rate.toFixed(0)} readings per second, {result.averages} conversions
        each; reference{" "}
        {[...new Set(result.reference)].map((ohm) => `${ohm.toFixed(0)} ohm`).join(", ")}
      </p>
      {result.notes.map((note) => (
        <Warning key={note}>{note}</Warning>
      ))}
    </section>
  );
}
