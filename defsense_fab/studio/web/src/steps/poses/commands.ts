// Commands on the selected poses and regions; menus of the tree and of the scene list them.
import { type Command, registerCommands } from "../../commands";
import type { RegionState } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { isLeftPanelOpen } from "../../state/layout";
import { renaming } from "../../state/renaming";
import { run } from "../../state/run";
import { select, selection } from "../../state/selection";
import { enterStep } from "../../state/step";
import { showToast } from "../../state/toasts";
import { type MenuEntry, commandEntry } from "../../ui/menu";
import { playRamp } from "./ramp";
import { turnChosen } from "./pose-gizmo";
import { startRectangle } from "./rectangle";
import { grip, isMeshed, sceneTool, selectedPoses, selectedRegions, shownPose } from "./state";

export type ShapeKind = RegionState["shape"];

export const SHAPES: readonly { value: ShapeKind; label: string }[] = [
  { value: "box", label: "Box" },
  { value: "sphere", label: "Sphere" },
  { value: "half-space", label: "Half space: one side of a plane" },
  { value: "cylinder", label: "Cylinder" },
];

const undo = { label: "Undo", run: () => void run(connection.send("undo", {})) };

export async function addPose(): Promise<void> {
  const added = await run(connection.send("add-pose", {}));
  if (!added) return;
  enterStep("poses");
  select({ kind: "pose", name: added.name });
}

export async function addRegion(shape: ShapeKind): Promise<void> {
  const added = await run(connection.send("add-region", { shape, points: null, radius: 0 }));
  if (!added) return;
  enterStep("poses");
  select({ kind: "region", name: added.name });
}

export async function deletePoses(poses: string[]): Promise<void> {
  const answer = await run(connection.send("delete-poses", { poses }));
  if (answer !== undefined) showToast(deletedText(poses, "poses"), undo);
}

export async function deleteRegions(names: string[]): Promise<void> {
  const answer = await run(connection.send("delete-regions", { regions: names }));
  if (answer !== undefined) showToast(deletedText(names, "regions"), undo);
}

function deletedText(names: string[], plural: string): string {
  return `Deleted ${names.length === 1 ? names[0] : `${names.length} ${plural}`}`;
}

async function duplicatePoses(): Promise<void> {
  for (const pose of selectedPoses()) {
    const added = await run(connection.send("duplicate-pose", { pose }));
    if (added) select({ kind: "pose", name: added.name });
  }
}

async function duplicateRegions(): Promise<void> {
  for (const region of selectedRegions()) {
    const added = await run(connection.send("duplicate-region", { region }));
    if (added) select({ kind: "region", name: added.name });
  }
}

function startRenaming(): void {
  const item = selection.value.at(-1);
  if (!item) return;
  isLeftPanelOpen.value = true;
  renaming.value = `${item.kind}:${item.name}`;
}

const areOnly = (kind: "pose" | "region") =>
  selection.value.length > 0 && selection.value.every((item) => item.kind === kind);
const arePoses = () => areOnly("pose");
const areRegions = () => areOnly("region");

/** The axis about which arrow keys turn the chosen region. */
let keyAxis: "x" | "y" | "z" = "y";

const canTurn = () => {
  const chosen = grip.value;
  if (!isMeshed.value || !chosen || chosen.pull >= 0) return false;
  return shownPose.value?.handles.some((h) => h.region === chosen.region && h.turn === "angle") ?? false;
};

function turnCommands(): Command[] {
  const turns = [
    { id: "more", label: "Turn the region by +1°", key: "ArrowUp", other: "ArrowRight", degrees: 1 },
    { id: "less", label: "Turn the region by −1°", key: "ArrowDown", other: "ArrowLeft", degrees: -1 },
  ];
  const axes = (["x", "y", "z"] as const).map((axis) => ({
    id: `pose.axis-${axis}`,
    label: `Turn by arrow keys about ${axis}`,
    group: "Poses",
    shortcut: axis.toUpperCase(),
    when: canTurn,
    reason: "Choose a region that is turned by an angle",
    run: () => {
      keyAxis = axis;
      showToast(`Arrow keys turn ${grip.peek()?.region} about ${axis}`);
    },
  }));
  const steps = turns.flatMap(({ id, label, key, other, degrees }) => [
    {
      id: `pose.turn-${id}`,
      label,
      group: "Poses",
      shortcut: key,
      otherShortcut: other,
      when: canTurn,
      reason: "Choose a region that is turned by an angle",
      run: () => turnChosen(keyAxis, degrees),
    },
    {
      id: `pose.turn-${id}-ten`,
      label: label.replace("1°", "10°"),
      group: "Poses",
      shortcut: `Shift+${key}`,
      otherShortcut: `Shift+${other}`,
      when: canTurn,
      reason: "Choose a region that is turned by an angle",
      run: () => turnChosen(keyAxis, 10 * degrees),
    },
  ]);
  return [...axes, ...steps];
}

registerCommands([
  { id: "pose.add", label: "Add a pose", group: "Poses", run: () => void addPose() },
  ...SHAPES.map(({ value, label }) => ({
    id: `region.add-${value}`,
    label: `Add a region: ${label.toLowerCase()}`,
    group: "Regions",
    run: () => void addRegion(value),
  })),
  {
    id: "pose.rename",
    label: "Rename",
    group: "Poses",
    shortcut: "F2",
    when: arePoses,
    reason: "Select a pose first",
    run: startRenaming,
  },
  {
    id: "pose.duplicate",
    label: "Duplicate",
    group: "Poses",
    shortcut: "Mod+D",
    when: arePoses,
    reason: "Select a pose first",
    run: () => void duplicatePoses(),
  },
  {
    id: "pose.delete",
    label: "Delete",
    group: "Poses",
    shortcut: "Delete",
    isRemoving: true,
    when: arePoses,
    reason: "Select a pose first",
    run: () => void deletePoses(selectedPoses()),
  },
  {
    id: "region.rename",
    label: "Rename",
    group: "Regions",
    shortcut: "F2",
    when: areRegions,
    reason: "Select a region first",
    run: startRenaming,
  },
  {
    id: "region.duplicate",
    label: "Duplicate",
    group: "Regions",
    shortcut: "Mod+D",
    when: areRegions,
    reason: "Select a region first",
    run: () => void duplicateRegions(),
  },
  {
    id: "region.delete",
    label: "Delete",
    group: "Regions",
    shortcut: "Delete",
    isRemoving: true,
    when: areRegions,
    reason: "Select a region first",
    run: () => void deleteRegions(selectedRegions()),
  },
]);

/** Commands of the step alone. */
export const posesCommands = (): readonly Command[] => [
  {
    id: "region.rectangle",
    label: "Draw a rectangle to add a region",
    hint: "A box is fitted to all points of the surface in the rectangle",
    group: "Regions",
    shortcut: "R",
    when: () => isMeshed.value,
    reason: "Mesh the body first",
    run: () => startRectangle(false),
  },
  {
    id: "pose.pull",
    label: "Pull at a point of the body",
    hint: "Click the body; a spring pulls it there",
    group: "Poses",
    when: () => Boolean(shownPose.value) && isMeshed.value,
    reason: "Choose a pose first",
    run: () => (sceneTool.value = sceneTool.peek() === "pull" ? "view" : "pull"),
  },
  {
    id: "pose.play",
    label: "Play the pose from rest, or stop",
    group: "Poses",
    shortcut: "P",
    when: () => Boolean(shownPose.value) && isMeshed.value,
    reason: "Choose a pose first",
    run: () => void playRamp(),
  },
  ...turnCommands(),
];

/** The menu of the selected poses. */
export function poseMenu(): MenuEntry[] {
  return [
    ...commandEntry("pose.rename", "pencil"),
    ...commandEntry("pose.duplicate", "copy"),
    "separator",
    ...commandEntry("pose.delete", "trash", true),
  ];
}

/** The menu of the selected regions. */
export function regionMenu(): MenuEntry[] {
  return [
    ...commandEntry("region.rename", "pencil"),
    ...commandEntry("region.duplicate", "copy"),
    "separator",
    ...commandEntry("region.delete", "trash", true),
  ];
}
