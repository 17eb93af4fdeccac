// Commands of the whole page.
import type { Command } from "../commands";
import { startBuild } from "../state/building";
import { connection, device, isJobActive, job } from "../state/connection";
import { isBottomPanelOpen, isLeftPanelOpen } from "../state/layout";
import { cancelWork, pageWork } from "../state/page-work";
import { run } from "../state/run";
import { clearSelection, isHidden, select, selection, toggleHidden } from "../state/selection";
import { STEPS, STEP_LABELS, enterStep, showAllDevices } from "../state/step";
import { isDark, theme } from "../state/theme";
import { toasts } from "../state/toasts";
import { isKeyHelpOpen, isPaletteOpen } from "../ui/command-palette";
import { cancelJob } from "./job-strip";
import { startIntroduction } from "./introduction";
import { doNext } from "./next-button";
import { enterRegion, focusHeading, isInField, leaveField } from "./regions";

/** Selected items that the scene shows, and that can be hidden there. */
const visibleItems = () => selection.value.filter(({ kind }) => kind !== "pose");

const STAGES = [
  { stage: "simulate", label: "Simulate the poses" },
  { stage: "optimize", label: "Optimize the sensors" },
  { stage: "report", label: "Build the parts" },
] as const;

export const pageCommands = (): readonly Command[] => [
  {
    id: "undo",
    label: "Undo",
    group: "Edit",
    shortcut: "Mod+Z",
    when: () => Boolean(device.value?.undoName),
    reason: "There is nothing to undo",
    run: () => void run(connection.send("undo", {})),
  },
  {
    id: "redo",
    label: "Redo",
    group: "Edit",
    shortcut: "Mod+Shift+Z",
    otherShortcut: "Mod+Y",
    when: () => Boolean(device.value?.redoName),
    reason: "There is nothing to redo",
    run: () => void run(connection.send("redo", {})),
  },
  {
    id: "select-all",
    label: "Select all cords",
    group: "Edit",
    shortcut: "Mod+A",
    run: () => {
      clearSelection();
      for (const { name } of device.value?.cords ?? []) select({ kind: "cord", name }, true);
    },
  },
  {
    id: "select-none",
    label: "Select nothing",
    group: "Edit",
    shortcut: "Escape",
    when: () => selection.value.length > 0,
    reason: "Nothing is selected",
    run: clearSelection,
  },
  {
    id: "hide",
    label: "Hide or show the selection",
    group: "View",
    shortcut: "H",
    when: () => visibleItems().length > 0,
    reason: "Nothing in the scene is selected",
    run: () => {
      const items = visibleItems();
      const areHidden = items.every(isHidden);
      for (const item of items) if (isHidden(item) === areHidden) toggleHidden(item);
    },
  },
  ...STEPS.map((name, index) => ({
    id: `step.${name}`,
    label: `Go to ${STEP_LABELS[name]}`,
    group: "Steps",
    shortcut: String(index + 1),
    run: () => {
      enterStep(name);
      setTimeout(focusHeading);
    },
  })),
  {
    id: "next",
    label: "Do the next action",
    group: "Steps",
    shortcut: "Mod+Enter",
    worksInFields: true,
    run: doNext,
  },
  ...STAGES.map(({ stage, label }) => ({
    id: `build.${stage}`,
    label,
    group: "Steps",
    when: () => !isJobActive.value,
    reason: "Wait until the running job has ended",
    run: () => void startBuild(stage),
  })),
  {
    id: "leave-field",
    label: "Restore a field; again: leave it, to the scene",
    group: "Edit",
    shortcut: "Escape",
    worksInFields: true,
    when: isInField,
    reason: "The focus is not in a field",
    run: leaveField,
  },
  {
    id: "next-panel",
    label: "Go to the next panel",
    group: "View",
    shortcut: "F6",
    worksInFields: true,
    run: () => enterRegion(1),
  },
  {
    id: "previous-panel",
    label: "Go to the previous panel",
    group: "View",
    shortcut: "Shift+F6",
    worksInFields: true,
    run: () => enterRegion(-1),
  },
  {
    id: "pause",
    label: "Pause or resume the job",
    group: "Steps",
    when: () => isJobActive.value && Boolean(job.value?.canPause),
    reason: "No job is running that can be paused",
    run: () => {
      const kind = job.value?.state === "paused" ? "resume-job" : "pause-job";
      void run(connection.send(kind, {}));
    },
  },
  {
    id: "cancel",
    label: "Cancel the job",
    group: "Steps",
    when: () => isJobActive.value || Boolean(pageWork.value?.cancel),
    reason: "No job is running",
    run: () => (isJobActive.peek() ? void cancelJob() : cancelWork()),
  },
  {
    id: "dismiss",
    label: "Dismiss the messages",
    group: "View",
    shortcut: "Escape",
    when: () => toasts.value.length > 0,
    reason: "There are no messages",
    run: () => (toasts.value = []),
  },
  {
    id: "left-panel",
    label: "Show or hide the list of parts",
    group: "View",
    shortcut: "Mod+B",
    run: () => {
      isLeftPanelOpen.value = !isLeftPanelOpen.value;
    },
  },
  {
    id: "bottom-panel",
    label: "Show or hide the bottom panel",
    group: "View",
    shortcut: "Mod+J",
    run: () => {
      isBottomPanelOpen.value = !isBottomPanelOpen.value;
    },
  },
  {
    id: "theme",
    label: "Switch between light and dark",
    group: "View",
    run: () => {
      theme.value = isDark.value ? "light" : "dark";
    },
  },
  { id: "devices", label: "All devices", group: "View", run: showAllDevices },
  {
    id: "palette",
    label: "Commands",
    group: "Help",
    shortcut: "Mod+K",
    worksInFields: true,
    run: () => {
      isPaletteOpen.value = true;
    },
  },
  {
    id: "keys",
    label: "Keyboard shortcuts",
    group: "Help",
    shortcut: "?",
    run: () => {
      isKeyHelpOpen.value = true;
    },
  },
  { id: "introduction", label: "Introduction", group: "Help", run: startIntroduction },
];
