import { runCommand } from "../commands";
import type { CordState } from "../protocol/messages";
import { connection, device, misfitTexts, violationsByCord } from "../state/connection";
import { isDrawerOpen, isPhone } from "../state/layout";
import { posePictures } from "../state/pose-pictures";
import { renaming } from "../state/renaming";
import {
  BODY,
  type Item,
  type ItemKind,
  hovered,
  isHidden,
  isHovered,
  isSelected,
  select,
  selectedNames,
  toggleHidden,
} from "../state/selection";
import { STEP_LABELS, type StepName, enterStep } from "../state/step";
import { partNodes } from "../steps/make/part-nodes";
import { IconButton } from "../ui/button";
import type { IconName } from "../ui/icons";
import { commandEntry, openContextMenuFor } from "../ui/menu";
import { Tree, type TreeNode } from "../ui/tree";
import { cordMenu, deleteCords, isLocked, setLocked } from "./cord-commands";
import { UNDERSCORE_NOTE, renameOrReason, underscored } from "./rename";

const posesState = connection.event("poses-state");

/** The tree of all that the device consists of. */
export function LeftPanel() {
  return (
    <aside
      class="left-panel"
      aria-label="Device"
      onKeyDown={(event) => {
        if (event.key === "Escape" && isDrawerOpen.value) isDrawerOpen.value = false;
      }}
    >
      {isPhone.value && (
        <header class="panel-header">
          <h2>Device</h2>
          <IconButton
            icon="close"
            label="Close the list"
            onClick={() => (isDrawerOpen.value = false)}
          />
        </header>
      )}
      <Tree
        label="Parts of the device"
        nodes={nodes()}
        renaming={renaming.value}
        onRenaming={(id) => (renaming.value = id)}
      />
    </aside>
  );
}

function nodes(): TreeNode[] {
  const { regions = [], poses = [], cords = [], noun = "cord" } = device.value ?? {};
  const sensors = `${noun[0]!.toUpperCase()}${noun.slice(1)}s`;
  return [
    { ...itemNode(BODY, "make"), label: "Body", buttons: [eye(BODY, "body")] },
    group("regions", "Regions", regions.map(regionNode)),
    group("poses", "Poses", poses.map(poseNode)),
    group("cords", sensors, cords.map(cordNode)),
    ...partNodes(),
  ];
}

function group(id: string, label: string, children: TreeNode[]): TreeNode {
  return { id, label, children, count: children.length };
}

/** The step where items of a kind are edited. */
const STEP_OF_KIND: Record<ItemKind, StepName> = {
  cord: "sensors",
  pose: "poses",
  region: "poses",
  part: "body",
};

function itemNode(item: Item, icon: IconName): TreeNode {
  const home = STEP_OF_KIND[item.kind];
  const open = () => enterStep(home);
  return {
    id: `${item.kind}:${item.name}`,
    label: item.name,
    icon,
    isSelected: isSelected(item),
    isHovered: isHovered(item),
    isDimmed: isHidden(item),
    onSelect: (isAdded) => select(item, isAdded),
    onHover: (isOver) => (hovered.value = isOver ? item : null),
    onOpen: open,
    onMenu: (event) => {
      if (!isSelected(item)) select(item);
      const label = `Open in ${STEP_LABELS[home]}`;
      openContextMenuFor(event, `Actions for ${item.name}`, [
        { id: "open", label, icon: "arrowRight", run: open },
        ...commandEntry(`${item.kind}.rename`, "pencil"),
        ...commandEntry(`${item.kind}.duplicate`, "copy"),
        ...(item.kind === "pose" ? [] : commandEntry("hide", "eye")),
        ...commandEntry(`${item.kind}.delete`, "trash", true),
      ]);
    },
  };
}

function regionNode(name: string): TreeNode {
  const item: Item = { kind: "region", name };
  const found = posesState.value?.regions.find((region) => region.name === name);
  return {
    ...itemNode(item, "region"),
    color: found?.color,
    hasOutline: true,
    problem: found?.problems.join(" ") || misfitTexts.value.get(`region:${name}`),
    buttons: [eye(item, name)],
    onRename: (to) => renameOrReason("region", name, to),
    onDelete: () => deleteSelected(item),
  };
}

function poseNode(name: string): TreeNode {
  const item: Item = { kind: "pose", name };
  const found = posesState.value?.poses.find((pose) => pose.name === name);
  return {
    ...itemNode(item, "pose"),
    picture: posePictures.value.get(name),
    problem: misfitTexts.value.get(`pose:${name}`) ?? found?.warning?.text,
    onRename: (to) => renameOrReason("pose", name, to),
    fixName: underscored,
    fixNote: UNDERSCORE_NOTE,
    onDelete: () => deleteSelected(item),
  };
}

function deleteSelected(item: Item): void {
  if (!isSelected(item)) select(item);
  runCommand(`${item.kind}.delete`);
}

function eye(item: Item, label: string) {
  const isOff = isHidden(item);
  return {
    icon: isOff ? ("eyeOff" as const) : ("eye" as const),
    label: `${isOff ? "Show" : "Hide"} ${label}`,
    isOn: isOff,
    run: () => toggleHidden(item),
  };
}

function cordNode({ name, color, free }: CordState): TreeNode {
  const item: Item = { kind: "cord", name };
  const isFixed = free.length === 0;
  return {
    ...itemNode(item, "cord"),
    color,
    problem: violationsByCord.value.get(name)?.join(". "),
    buttons: [
      eye(item, name),
      {
        icon: isFixed ? "lock" : "unlock",
        label: `${isFixed ? "Unlock" : "Lock"} ${name}`,
        isOn: isFixed,
        hint: isFixed
          ? `Unlock ${name}: builds and the optimizer keep it as drawn`
          : `Lock ${name}, so that builds and the optimizer keep it as drawn`,
        run: () => void setLocked(name, !isLocked(name)),
      },
    ],
    onRename: (to) => renameOrReason("cord", name, to),
    onDelete: () => void deleteCords(isSelected(item) ? selectedNames("cord") : [name]),
    onMenu: (event) => {
      if (!isSelected(item)) select(item);
      openContextMenuFor(event, `Actions for ${name}`, cordMenu());
    },
  };
}
