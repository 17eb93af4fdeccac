// What a pose does with the body besides regions: pulls, gravity, pressures, planes of symmetry.
import type { PoseState } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { Button, IconButton } from "../../ui/button";
import { MenuButton } from "../../ui/menu";
import { NumberField } from "../../ui/number-field";
import { Section } from "../../ui/section";
import { chosenGrip, grip, isMeshed, regions, sceneTool } from "./state";
import { VectorField } from "./vector-field";

interface PoseProps {
  pose: PoseState;
}

/** Points that the pose pulls by springs. */
export function Pulls({ pose }: PoseProps) {
  const isPulling = sceneTool.value === "pull";
  const chosen = grip.value?.pull ?? -1;
  return (
    <Section title="Pulls at points" name="pose.pulls" isOpenAtFirst={false} aside={pose.pulls.length || undefined}>
      {pose.pulls.map((pull, index) => {
        const send = (content: Partial<typeof pull>) =>
          connection.send("set-pull", { pose: pose.name, index, ...pull, ...content });
        return (
          <div key={index} class={`region-row ${chosen === index ? "chosen" : ""}`}>
            <div class="region-role">
              <button
                type="button"
                class="region-name"
                aria-pressed={chosen === index}
                onClick={() => (chosenGrip.value = { region: "", pull: index })}
              >
                Pull {index + 1}
              </button>
              <IconButton
                icon="trash"
                label={`Delete pull ${index + 1}`}
                onClick={() => void run(connection.send("delete-pull", { pose: pose.name, index }))}
              />
            </div>
            {chosen === index && (
              <div class="handle-fields">
                <VectorField label="Point at rest" unit="mm" value={pull.at} onCommit={(at) => send({ at })} />
                <VectorField label="Pulled by" unit="mm" value={pull.by} onCommit={(by) => send({ by })} />
                <NumberField
                  label="Stiffness"
                  value={pull.stiffness}
                  unit="N/mm"
                  above={0}
                  step={0.1}
                  onCommit={(stiffness) => send({ stiffness })}
                />
              </div>
            )}
          </div>
        );
      })}
      <Button
        icon="plus"
        aria-pressed={isPulling}
        disabled={!isMeshed.value}
        hint={isMeshed.value ? "Click the point of the body" : "Mesh the body first"}
        onClick={() => (sceneTool.value = isPulling ? "view" : "pull")}
      >
        {isPulling ? "Click the body ..." : "Pull at a point"}
      </Button>
    </Section>
  );
}

export function Gravity({ pose }: PoseProps) {
  return (
    <VectorField
      label="Gravity"
      unit="g"
      value={pose.gravity}
      onCommit={(gravity) => connection.send("set-gravity", { pose: pose.name, gravity })}
    />
  );
}

/** A menu of the regions that a list of loads does not have yet. */
function AddMenu({ label, used, onAdd }: { label: string; used: string[]; onAdd: (region: string) => void }) {
  const free = regions.value.filter(({ name }) => !used.includes(name));
  if (free.length === 0) return null;
  return (
    <MenuButton
      label={label}
      icon="plus"
      entries={() => [
        { heading: "Region" },
        ...free.map(({ name }) => ({ id: name, label: name, run: () => onAdd(name) })),
      ]}
    >
      {label}
    </MenuButton>
  );
}

export function Pressures({ pose }: PoseProps) {
  const send = (region: string, value: number | null) =>
    connection.send("set-pressure", { pose: pose.name, region, value });
  return (
    <div class="load-list">
      {pose.pressures.map(({ region, value }) => (
        <div key={region} class="load-row">
          <NumberField
            label={`Pressure on ${region}`}
            value={value}
            unit="MPa"
            step={0.001}
            onCommit={(number) => send(region, number)}
          />
          <IconButton
            icon="trash"
            label={`Delete the pressure on ${region}`}
            onClick={() => void run(send(region, null))}
          />
        </div>
      ))}
      <AddMenu
        label="Add a pressure"
        used={pose.pressures.map(({ region }) => region)}
        onAdd={(region) => void run(send(region, 0.001))}
      />
    </div>
  );
}

export function Symmetry({ pose }: PoseProps) {
  const send = (region: string, normal: number[] | null) =>
    connection.send("set-symmetry", { pose: pose.name, region, normal });
  return (
    <div class="load-list">
      {pose.symmetry.map(({ region, normal }) => (
        <div key={region} class="load-row">
          <VectorField
            label={`${region} stays in a plane with this normal`}
            value={normal}
            step={0.1}
            onCommit={(value) => send(region, value)}
          />
          <IconButton icon="trash" label={`Release ${region}`} onClick={() => void run(send(region, null))} />
        </div>
      ))}
      <AddMenu
        label="Keep a region in its plane"
        used={pose.symmetry.map(({ region }) => region)}
        onAdd={(region) => void run(send(region, [1, 0, 0]))}
      />
    </div>
  );
}
