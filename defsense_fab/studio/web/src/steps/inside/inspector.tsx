// What the section shows, where its plane is, the numbers of a point, and the next cord.
import { startBuild } from "../../state/building";
import { device, isJobActive } from "../../state/connection";
import { enterStep } from "../../state/step";
import { Button } from "../../ui/button";
import { EmptyState } from "../../ui/feedback";
import { MenuButton } from "../../ui/menu";
import { Section } from "../../ui/section";
import { SelectField } from "../../ui/select-field";
import { SliderField } from "../../ui/slider-field";
import { setOffset, setPlaneOfCord, tool, view } from "./inside-state";
import { NextCordPanel } from "./next-cord-tools";
import { axisOf, offsetOf } from "./plane";
import { inside } from "./section-view";

const BY_ANGLE = "";

export function InsideInspector() {
  const state = inside.value;
  if (!state) return null;
  if (!state.isReady) return <NotSimulated text={state.text} />;
  return (
    <>
      <Section title="Colors" name="inside-colors">
        <Colors />
      </Section>
      <Section title="Plane" name="inside-plane">
        <PlaneFields />
      </Section>
      <Section title="Point" name="inside-point">
        <PointNumbers />
      </Section>
      <Section title="Another cord" name="inside-next-cord">
        <NextCordPanel tool={tool} view={view} />
      </Section>
    </>
  );
}

function NotSimulated({ text }: { text: string }) {
  const hasPoses = (device.value?.poses.length ?? 0) > 0;
  const simulate = () => void startBuild("simulate");
  return (
    <EmptyState
      icon="section"
      text={`${text}.`}
      action={
        hasPoses ? (
          <Button
            hint="Compute the deformation of each pose with finite elements"
            isBusy={isJobActive.value}
            onClick={simulate}
          >
            Simulate the poses
          </Button>
        ) : (
          <Button onClick={() => enterStep("poses")}>Add a pose</Button>
        )
      }
    />
  );
}

function Colors() {
  const quantities = inside.value!.quantities.filter(({ name }) => name !== "next-cord");
  const info = view.info.value;
  const cords = device.value?.cords ?? [];
  if (tool.isOn.value) {
    return <p class="field-help">The colors show where another cord would help.</p>;
  }
  return (
    <>
      <SelectField
        label="Quantity"
        layout="stack"
        value={view.quantity.value}
        choices={quantities.map(({ name, label }) => ({ value: name, label }))}
        help={info?.hint}
        onCommit={(name) => {
          view.quantity.value = name;
        }}
      />
      {info?.needsDirection && (
        <SelectField
          label="Direction"
          value={view.cord.value}
          choices={[
            { value: BY_ANGLE, label: "Angle" },
            ...cords.map(({ name }) => ({ value: name, label: `Along ${name}` })),
          ]}
          onCommit={(name) => {
            view.cord.value = name;
          }}
        />
      )}
      {info?.needsDirection && view.cord.value === BY_ANGLE && (
        <SliderField
          label="Angle in the plane"
          unit={"\u00b0"}
          min={0}
          max={180}
          value={view.angle.value}
          onInput={(degrees) => (view.angle.value = degrees)}
          onCommit={(degrees) => {
            view.angle.value = degrees;
          }}
        />
      )}
    </>
  );
}

function PlaneFields() {
  const plane = view.plane.value;
  if (!plane) return null;
  const [low, high] = view.limits.value;
  const offset = Number(offsetOf(plane, inside.value!.middle).toFixed(2));
  const cords = (device.value?.cords ?? []).filter(({ isPlanar }) => isPlanar);
  return (
    <>
      <SliderField
        key={axisOf(plane) ?? "tilted"}
        label="Offset"
        unit="mm"
        min={Math.min(low, offset)}
        max={Math.max(high, offset)}
        step={0.1}
        value={offset}
        help="Along the normal, from the middle of the body"
        onInput={setOffset}
        onCommit={setOffset}
      />
      {cords.length > 0 && (
        <MenuButton
          label="Put the plane on a cord"
          icon="cord"
          entries={() =>
            cords.map(({ name }) => ({
              id: name,
              label: `Plane of ${name}`,
              run: () => setPlaneOfCord(name),
            }))
          }
        >
          Plane of a cord
        </MenuButton>
      )}
    </>
  );
}

type Row = [name: string, value: string];

function PointNumbers() {
  const point = view.picked.value;
  if (!point) return <p class="field-help">Click the section to see all numbers of a point.</p>;
  const info = view.info.value;
  const rows: Row[] = [
    ["Largest strain", percent(point.largest)],
    ["Smallest strain", percent(point.smallest)],
    ...(info?.needsDirection ? [["Along the direction", percent(point.along)] as Row] : []),
    ["Variation over all states", `${point.deviation.toFixed(1)} %`],
    ...(point.drop === null ? [] : [["Error with a cord here", millimeters(-point.drop)] as Row]),
    ["At rest", coordinates(point.rest)],
    ["In this state", coordinates(point.position)],
  ];
  return (
    <dl class="section-numbers">
      {rows.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

function percent(value: number): string {
  const text = Math.abs(value).toFixed(1);
  return Number(text) === 0 ? "0.0 %" : `${value < 0 ? "\u2212" : "+"}${text} %`;
}

function millimeters(value: number): string {
  return `${value > 0 ? "+" : ""}${value.toFixed(2).replace("-", "\u2212")} mm`;
}

function coordinates(point: readonly number[]): string {
  return `${point.map((x) => x.toFixed(1).replace("-", "\u2212")).join(", ")} mm`;
}
