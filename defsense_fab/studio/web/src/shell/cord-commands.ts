// Commands on the selected cords; menus of the tree and of the scene list them.
import type { Command } from "../commands";
import { connection, device } from "../state/connection";
import { isLeftPanelOpen } from "../state/layout";
import { renaming } from "../state/renaming";
import { run } from "../state/run";
import { select, selectedNames } from "../state/selection";
import { showToast } from "../state/toasts";
import { type MenuEntry, commandEntry } from "../ui/menu";

type Axis = "x" | "y" | "z";

const AXES: readonly Axis[] = ["x", "y", "z"];

const selectedCords = () => selectedNames("cord");
const cordOf = (name: string) => device.peek()?.cords.find((cord) => cord.name === name);

export const isLocked = (name: string): boolean => cordOf(name)?.free.length === 0;

/** Let the optimizer change a cord, or keep it as it is. */
export async function setLocked(name: string, isNowLocked: boolean): Promise<void> {
  const isPlanar = cordOf(name)?.isPlanar ?? true;
  const free: ("path" | "plane")[] = isNowLocked ? [] : isPlanar ? ["path", "plane"] : ["path"];
  await run(connection.send("set-freedoms", { cord: name, free }));
}

export async function deleteCords(names: readonly string[]): Promise<void> {
  const answer = await run(connection.send("delete-cords", { cords: [...names] }));
  if (answer === undefined) return;
  const text = names.length === 1 ? `Deleted ${names[0]}` : `Deleted ${names.length} cords`;
  const name = device.peek()?.undoName;
  const undo = () => {
    if (device.peek()?.undoName === name) void run(connection.send("undo", {}));
    else showToast("Other edits followed; undo them first.");
  };
  showToast(text, { label: "Undo", run: undo });
}

async function duplicate(name: string): Promise<void> {
  const added = await run(connection.send("duplicate-cord", { cord: name }));
  if (added) select({ kind: "cord", name: added.name });
}

async function mirror(name: string, axis: Axis): Promise<void> {
  const added = await run(connection.send("mirror-cord", { cord: name, axis }));
  if (added) select({ kind: "cord", name: added.name });
}

/** Run an action for each selected cord, one after another. */
async function forEachCord(action: (name: string) => Promise<void>): Promise<void> {
  for (const name of selectedCords()) await action(name);
}

const hasOne = () => selectedCords().length === 1;
const hasSome = () => selectedCords().length > 0;

export const cordCommands = (): readonly Command[] => [
  {
    id: "cord.rename",
    label: "Rename",
    group: "Cords",
    shortcut: "F2",
    when: hasOne,
    reason: "Select one cord first",
    run: () => {
      isLeftPanelOpen.value = true;
      renaming.value = `cord:${selectedCords()[0]}`;
    },
  },
  {
    id: "cord.duplicate",
    label: "Duplicate",
    group: "Cords",
    shortcut: "Mod+D",
    when: hasSome,
    reason: "Select a cord first",
    run: () => void forEachCord(duplicate),
  },
  ...AXES.map((axis) => ({
    id: `cord.mirror-${axis}`,
    label: `Mirror across ${axis}`,
    group: "Cords",
    when: hasSome,
    reason: "Select a cord first",
    run: () => void forEachCord((name) => mirror(name, axis)),
  })),
  {
    id: "cord.lock",
    label: "Lock or unlock",
    hint: "The optimizer does not change locked cords",
    group: "Cords",
    shortcut: "L",
    when: hasSome,
    reason: "Select a cord first",
    run: () => {
      const isNowLocked = !selectedCords().every(isLocked);
      void forEachCord((name) => setLocked(name, isNowLocked));
    },
  },
  {
    id: "cord.delete",
    label: "Delete",
    group: "Cords",
    shortcut: "Delete",
    isRemoving: true,
    otherShortcut: "Backspace",
    when: hasSome,
    reason: "Select a cord first",
    run: () => void deleteCords(selectedCords()),
  },
];

/** The menu of the selected cords. */
export function cordMenu(): MenuEntry[] {
  return [
    ...commandEntry("cord.rename", "pencil"),
    ...commandEntry("cord.duplicate", "copy"),
    ...AXES.flatMap((axis) => commandEntry(`cord.mirror-${axis}`, "mirror")),
    "separator",
    ...commandEntry("cord.lock", "lock"),
    ...commandEntry("hide", "eye"),
    "separator",
    ...commandEntry("cord.delete", "trash", true),
  ];
}
