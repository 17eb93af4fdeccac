import { signal } from "@preact/signals";
import { connection, isJobActive } from "../../state/connection";
import { Button } from "../../ui/button";
import { SegmentedControl } from "../../ui/choices";
import { NumberField } from "../../ui/number-field";
import { SelectField } from "../../ui/select-field";
import { CardFrame, CardMessage, Obstacle, ProblemMessage, Warning, obstacleOf } from "./card-frame";
import { PortField, portOf, TWIN_PORT } from "./port-field";
import { useRequest } from "./request";
import { card, choices, isGuidedOpen, status } from "./state";
import { TextInput } from "./text-input";
import { cardVariant } from "./next-card";

type Source = "twin" | "device";

const source = signal<Source>("twin");
const minutes = signal(2);
const unit = signal(1);
const seed = signal<number | null>(null);
const cords = signal("");

const port = signal(TWIN_PORT);
const cameras = signal("twin");
const calibration = signal("cameras.toml");
const session = signal<string | null>(null);
const rounds = signal(2);
const seconds = signal(8);

const CORD_FAMILIES = [
  { value: "", label: "Default of the device" },
  { value: "viscoelastic", label: "Viscoelastic (assumed)" },
  { value: "hysteretic", label: "Hysteretic (knitted)" },
  { value: "network", label: "Network (printed TPU)" },
];

/** Training data: of the simulated twin at once, or of the device step by step. */
export function RecordCard() {
  return (
    <CardFrame
      name="record"
      lead="A session pairs the readings with the shapes of the device. The simulated twin records one in a minute; the real device is recorded pose by pose with cameras."
    >
      <SegmentedControl<Source>
        label="What is recorded"
        value={source.value}
        segments={[
          { value: "twin", label: "Simulated twin" },
          { value: "device", label: "Step by step" },
        ]}
        onChange={(value) => (source.value = value)}
      />
      {source.value === "twin" ? <TwinForm /> : <DeviceForm />}
    </CardFrame>
  );
}

function TwinForm() {
  const request = useRequest();
  const task = status.value?.record;
  const shownSeed = seed.value ?? choices.value?.freeSeed ?? 1;
  const obstacle = obstacleOf({ needsBuild: true });
  const start = async () => {
    const content = { minutes: minutes.value, unit: unit.value, seed: shownSeed, cords: cords.value };
    if (await request.send(connection.send("record-twin", content))) seed.value = null;
  };
  return (
    <>
      <div class="card-fields">
        <NumberField
          label="Duration"
          unit="min"
          value={minutes.value}
          min={0.2}
          max={1440}
          layout="stack"
          onCommit={(value) => void (minutes.value = value)}
        />
        <NumberField
          label="Built unit"
          value={unit.value}
          min={0}
          layout="stack"
          help="Each number is another built copy of the device, with its own tolerances and cords"
          onCommit={(value) => void (unit.value = value)}
        />
        <NumberField
          label="Seed of the movement"
          value={shownSeed}
          min={0}
          layout="stack"
          help="Each number is another random movement of the hand"
          onCommit={(value) => void (seed.value = value)}
        />
        <SelectField
          label="Memory of the cords"
          layout="stack"
          value={cords.value}
          choices={CORD_FAMILIES}
          help="How the readings depend on how the cords were stretched before"
          onCommit={(value) => void (cords.value = value)}
        />
      </div>
      <div class="card-actions">
        <Button
          variant={cardVariant("record")}
          icon="play"
          isBusy={task?.state === "running"}
          disabled={Boolean(obstacle)}
          hint={obstacle || undefined}
          onClick={() => void start()}
        >
          Record the twin
        </Button>
        <NextCard code="twin-recorded" label="Train on it" />
      </div>
      {task?.state !== "running" && <Obstacle text={obstacle} />}
      <CardMessage request={request} task={task} />
    </>
  );
}

function DeviceForm() {
  const request = useRequest();
  const task = status.value?.record;
  const name = session.value ?? choices.value?.freeSession ?? "session";
  const obstacle = obstacleOf({ needsBuild: false });
  const start = async () => {
    const content = {
      port: portOf(port.value),
      cameras: cameras.value,
      calibration: calibration.value,
      session: name,
      rounds: rounds.value,
      seconds: seconds.value,
    };
    if (await request.send(connection.send("start-recording", content))) session.value = null;
  };
  return (
    <>
      {choices.value && !choices.value.hasTags && <MissingTags />}
      <div class="card-fields">
        <PortField
          label="Board"
          draft={port.value}
          extra={[{ value: "none", label: "No board" }]}
          onChange={(draft) => (port.value = draft)}
          typedHelp="For example /dev/ttyUSB0, COM3 or udp://elbow"
        />
        <TextInput
          label="Cameras"
          value={cameras.value}
          onInput={(text) => (cameras.value = text)}
          help="One for each of the calibration, such as 0 2; or twin; or none"
        />
        {!cameras.value.trim().startsWith("twin") && (
          <TextInput
            label="Calibration"
            value={calibration.value}
            onInput={(text) => (calibration.value = text)}
            help={choices.value?.hasCalibration ? "File in the device's folder" : "There is no cameras.toml yet: run defsense capture camera"}
          />
        )}
        <TextInput
          label="Session"
          value={name}
          onInput={(text) => (session.value = text)}
          help="Folder of the session; a stopped one is resumed"
        />
        <NumberField
          label="Rounds"
          value={rounds.value}
          min={1}
          max={100}
          layout="stack"
          onCommit={(value) => void (rounds.value = value)}
        />
        <NumberField
          label="Time per pose"
          unit="s"
          value={seconds.value}
          min={1}
          max={600}
          layout="stack"
          onCommit={(value) => void (seconds.value = value)}
        />
      </div>
      <div class="card-actions">
        <Button
          variant={cardVariant("record")}
          icon="play"
          isBusy={task?.state === "running"}
          disabled={isGuidedOpen.value || Boolean(obstacle) || !choices.value?.hasTags}
          hint={choices.value?.hasTags ? obstacle || undefined : "Make the tags first"}
          onClick={() => void start()}
        >
          Start or resume
        </Button>
        <NextCard code="recording-complete" label="Process and train" />
      </div>
      {task?.state !== "running" && <Obstacle text={obstacle} />}
      <CardMessage request={request} task={task} />
    </>
  );
}

function MissingTags() {
  const request = useRequest();
  return (
    <>
      <Warning>
        Cameras see the device by printed tags, which have no places yet.{" "}
        <Button
          disabled={isJobActive.value}
          onClick={() => void request.send(connection.send("make-tags", {}))}
        >
          Make the tags
        </Button>
      </Warning>
      {request.problem.value && <ProblemMessage problem={request.problem.value} />}
    </>
  );
}

function NextCard({ code, label }: { code: string; label: string }) {
  if (status.value?.record.code !== code) return null;
  return (
    <Button icon="arrowRight" onClick={() => (card.value = "train")}>
      {label}
    </Button>
  );
}
