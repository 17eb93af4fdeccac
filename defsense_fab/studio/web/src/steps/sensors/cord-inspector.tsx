// One selected cord: its name, numbers, freedoms and actions.
import { runCommand } from "../../commands";
import type { CordNumbers, CordState, Violation } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { cordMenu, setLocked } from "../../shell/cord-commands";
import { rename } from "../../shell/rename";
import { inPageWords } from "../../state/page-words";
import { run } from "../../state/run";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { MenuButton, commandEntry } from "../../ui/menu";
import { NumberField } from "../../ui/number-field";
import { Section } from "../../ui/section";
import { SelectField } from "../../ui/select-field";
import { TextField } from "../../ui/text-field";
import { limitTitle, showViolation } from "./limit-labels";
import { isPlaneShown, judgement, selectedPoint, violations } from "./state";

type Freedom = "path" | "plane" | "offset" | "ends";

/** What the optimizer may move; values are the sorted freedoms. */
const CHOICES: { value: string; label: string; isPlanar?: boolean }[] = [
  { value: "", label: "Nothing (locked)" },
  { value: "path", label: "Its path" },
  { value: "plane", label: "Its plane", isPlanar: true },
  { value: "path,plane", label: "Path and plane", isPlanar: true },
  { value: "offset,path", label: "Path, plane along its normal", isPlanar: true },
  { value: "offset", label: "Plane along its normal", isPlanar: true },
  { value: "ends,path", label: "Path and ends in space", isPlanar: false },
];

export function CordInspector({ cord }: { cord: CordState }) {
  const ownViolations = violations.value.filter(({ cords }) => cords.includes(cord.name));
  const numbers = judgement.value?.cords.find(({ name }) => name === cord.name);
  return (
    <>
      <header class="cord-header">
        <span class="swatch large" style={{ background: cord.color }} aria-hidden="true" />
        <h2>{cord.name}</h2>
        <MenuButton label={`Actions for ${cord.name}`} entries={cordMenu} />
      </header>
      <div class="panel-body">
        <TextField
          label="Name"
          value={cord.name}
          onCommit={(name) => rename("cord", cord.name, name)}
        />
        <SelectField
          label="Optimizer moves"
          layout="stack"
          value={[...cord.free].sort().join()}
          choices={choicesFor(cord)}
          onCommit={(value) => {
            const free = value.split(",").filter(Boolean) as Freedom[];
            return connection.send("set-freedoms", { cord: cord.name, free });
          }}
        />
        {cord.free.length === 0 && <LockNote name={cord.name} />}
      </div>
      {numbers && <Numbers numbers={numbers} violations={ownViolations} />}
      <Section title="Shape" name="cord-shape">
        <PointFields cord={cord} />
        <Actions cord={cord} />
      </Section>
    </>
  );
}

/** What a lock does, where it comes from, and how to remove it. */
function LockNote({ name }: { name: string }) {
  return (
    <div class="lock-note">
      <Icon name="lock" size={14} />
      <p>
        Locked: builds and the optimizer keep it as drawn. “Build these cords as drawn” and “Use” of a layout lock cords.
      </p>
      <Button icon="unlock" shortcut="L" onClick={() => void setLocked(name, false)}>
        Unlock
      </Button>
    </div>
  );
}

function choicesFor({ free, isPlanar }: CordState) {
  const value = [...free].sort().join();
  const choices = CHOICES.filter(
    (choice) => choice.value === value || (choice.isPlanar ?? isPlanar) === isPlanar,
  );
  const isKnown = choices.some((choice) => choice.value === value);
  return isKnown ? choices : [...choices, { value, label: free.join(" and ") }];
}

function Numbers({ numbers, violations }: { numbers: CordNumbers; violations: Violation[] }) {
  const radius = numbers.radius === null ? "Straight" : `${numbers.radius.toFixed(1)} mm`;
  const rows: [label: string, value: string, codes: string[]][] = [
    ["Length", `${numbers.length.toFixed(1)} mm`, ["channel-length-not-allowed"]],
    ["Smallest radius", radius, ["bend-too-tight"]],
    ["Smallest wall", `${numbers.wall.toFixed(2)} mm`, ["wall-too-thin", "path-leaves-body"]],
  ];
  const codes = rows.flatMap((row) => row[2]);
  const others = violations.filter(({ code }) => !codes.includes(code));
  return (
    <Section title="Numbers" name="cord-numbers">
      <dl class="cord-numbers">
        {rows.map(([label, value, ofRow]) => {
          const broken = violations.filter(({ code }) => ofRow.includes(code));
          return (
            <div key={label} class={broken.length ? "broken" : ""}>
              <dt>{label}</dt>
              <dd>{value}</dd>
              {broken.map((violation, i) => (
                <LimitButton key={i} violation={violation} />
              ))}
            </div>
          );
        })}
      </dl>
      {others.map((violation, i) => (
        <LimitButton key={i} violation={violation} />
      ))}
    </Section>
  );
}

function capitalized(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** A broken limit; it shows the place. */
function LimitButton({ violation }: { violation: Violation }) {
  return (
    <button type="button" class="limit" onClick={() => showViolation(violation)}>
      <Icon name="warning" size={14} />
      <span>
        <strong>{limitTitle(violation)}</strong> {capitalized(inPageWords(violation.text))}
      </span>
    </button>
  );
}

/** Coordinates of the selected control point. */
function PointFields({ cord }: { cord: CordState }) {
  const index = selectedPoint.value;
  const point = cord.points[index];
  if (!point) {
    return <p class="muted">{cord.points.length} points. Click one to move it by numbers.</p>;
  }
  const move = (k: number, value: number) =>
    connection.send("drag-point", {
      cord: cord.name,
      index,
      to: point.map((old, i) => (i === k ? value : old)),
      snap: false,
      write: true,
    });
  return (
    <fieldset class="point-fields">
      <legend>
        Point {index + 1} of {cord.points.length}
      </legend>
      {point.map((value, k) => (
        <NumberField
          key={k}
          label={["x", "y", "z"][k]!}
          value={Number(value.toFixed(3))}
          unit="mm"
          step={0.5}
          onCommit={(typed) => move(k, typed)}
        />
      ))}
      <Button
        variant="quiet"
        icon="trash"
        onClick={() => void run(connection.send("delete-point", { cord: cord.name, index }))}
      >
        Delete the point
      </Button>
    </fieldset>
  );
}

function Actions({ cord }: { cord: CordState }) {
  return (
    <div class="action-grid">
      <Button icon="cord" shortcut="S" onClick={() => runCommand("sensor.smooth")}>
        Smooth
      </Button>
      <Button icon="plus" shortcut="A" onClick={() => runCommand("sensor.add-point")}>
        Add point
      </Button>
      <Button icon="draw" shortcut="Shift+D" onClick={() => runCommand("sensor.redraw")}>
        New path
      </Button>
      <Button
        icon="section"
        shortcut="G"
        aria-pressed={isPlaneShown.value && cord.isPlanar}
        disabled={!cord.isPlanar}
        hint={cord.isPlanar ? "Move and turn the plane in the scene" : "The path is in space"}
        onClick={() => runCommand("sensor.plane")}
      >
        Move plane
      </Button>
      <MenuButton
        label="Mirror"
        icon="mirror"
        entries={() => ["x", "y", "z"].flatMap((axis) => commandEntry(`cord.mirror-${axis}`))}
      >
        Mirror
      </MenuButton>
      <Button icon="copy" shortcut="Mod+D" onClick={() => runCommand("cord.duplicate")}>
        Duplicate
      </Button>
      <Button
        variant="quiet"
        class="danger-text"
        icon="trash"
        shortcut="Delete"
        onClick={() => runCommand("cord.delete")}
      >
        Delete
      </Button>
    </div>
  );
}
