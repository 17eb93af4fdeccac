// The fields of the selected pose.
import type { PoseState } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { Button } from "../../ui/button";
import { Icon, type IconName } from "../../ui/icons";
import { MenuButton } from "../../ui/menu";
import { Section } from "../../ui/section";
import { SelectField } from "../../ui/select-field";
import { UNDERSCORE_NOTE, rename, underscored } from "../../shell/rename";
import { TextField } from "../../ui/text-field";
import { poseMenu } from "./commands";
import { isMeshing, isMeshNeeded } from "./mesh";
import { HandleFields } from "./handle-fields";
import { Gravity, Pressures, Pulls, Symmetry } from "./load-fields";
import { centers, chosenGrip, grip, isMeshed, regions, shapeStatus, type ShapeStatus } from "./state";
import { poseProblem } from "./warnings";

type Role = PoseState["roles"][number];

const ROLES: readonly { value: Role; label: string }[] = [
  { value: "free", label: "Free" },
  { value: "held", label: "Held" },
  { value: "turned", label: "Turned" },
  { value: "moved", label: "Turned, moved" },
];

export function PosePanel({ pose }: { pose: PoseState }) {
  return (
    <>
      <header class="item-header">
        <Icon name="pose" />
        <h2>{pose.name}</h2>
        <MenuButton label={`Actions for ${pose.name}`} entries={poseMenu} />
      </header>
      <ShapeStatusLine pose={pose} />
      <Section title="Pose" name="pose.name" isOpenAtFirst={false}>
        <TextField
          label="Name"
          value={pose.name}
          fix={underscored}
          fixNote={UNDERSCORE_NOTE}
          onCommit={(name) => rename("pose", pose.name, name)}
        />
      </Section>
      <Section title="Regions" name="pose.regions">
        {regions.value.map(({ name, color }, k) => (
          <RegionRow key={name} pose={pose} name={name} color={color} role={pose.roles[k] ?? "free"} />
        ))}
      </Section>
      <Pulls pose={pose} />
      <Section title="Loads" name="pose.loads" isOpenAtFirst={false} aside={loadCount(pose) || undefined}>
        <Gravity pose={pose} />
        <Pressures pose={pose} />
        <Symmetry pose={pose} />
      </Section>
    </>
  );
}

function loadCount({ pressures, symmetry, gravity }: PoseState): number {
  return pressures.length + symmetry.length + Number(gravity.some(Boolean));
}

const STATUS: Record<ShapeStatus, { text: string; icon: IconName | null }> = {
  none: { text: "", icon: null },
  solving: { text: "Solving ...", icon: "refresh" },
  coarse: { text: "Refining ...", icon: "refresh" },
  solved: { text: "Quick shape", icon: "check" },
  checked: { text: "Accurate shape", icon: "check" },
  stopped: { text: "Stopped; the last shape stays", icon: "stop" },
  failed: { text: "", icon: "warning" },
};

function ShapeStatusLine({ pose }: { pose: PoseState }) {
  const problem = poseProblem(pose);
  const status = shapeStatus.value;
  if (problem) {
    return (
      <div class="notice warning" role="status">
        <Icon name="warning" />
        <p>
          <strong>{problem.short}.</strong> {problem.text}
        </p>
      </div>
    );
  }
  if (isMeshing.value) {
    return (
      <p class="shape-status" role="status">
        <span class="spinner" aria-hidden="true" />
        <span>Meshing the body; then it follows</span>
      </p>
    );
  }
  if (!isMeshed.value) return null;
  if (isMeshNeeded.value && (status === "solved" || status === "checked")) {
    return (
      <p class="shape-status" role="status">
        <Icon name="info" size={14} />
        <span>Shape of an earlier body</span>
      </p>
    );
  }
  const { text, icon } = STATUS[status];
  const isBusy = status === "solving" || status === "coarse";
  return (
    <p class={`shape-status ${status}`} role="status">
      {isBusy ? <span class="spinner" aria-hidden="true" /> : icon && <Icon name={icon} size={14} />}
      <span>{text}</span>
      {isBusy && (
        <Button variant="quiet" onClick={() => void run(connection.send("stop-solving", {}))}>
          Stop
        </Button>
      )}
    </p>
  );
}

interface RegionRowProps {
  pose: PoseState;
  name: string;
  color: string;
  role: Role;
}

function RegionRow({ pose, name, color, role }: RegionRowProps) {
  const handle = pose.handles.find(({ region }) => region === name);
  const isChosen = grip.value?.region === name;
  return (
    <div class={`region-row ${handle && isChosen ? "chosen" : ""}`}>
      <div class="region-role">
        {handle ? (
          <button
            type="button"
            class="region-name"
            aria-pressed={isChosen}
            onClick={() => (chosenGrip.value = { region: name, pull: -1 })}
          >
            <span class="swatch region" style={{ background: color }} />
            {name}
          </button>
        ) : (
          <span class="region-name">
            <span class="swatch region" style={{ background: color }} />
            {name}
          </span>
        )}
        <SelectField
          label={`Role of ${name}`}
          value={role}
          choices={ROLES}
          onCommit={(value) =>
            connection.send("set-role", {
              pose: pose.name,
              region: name,
              role: value,
              center: centers.value[name] ?? null,
            })
          }
        />
      </div>
      {handle && isChosen && <HandleFields pose={pose.name} handle={handle} />}
    </div>
  );
}
