// The keys of the step Make.
import type { Command } from "../../commands";
import { openSection } from "../../ui/section";
import { exportDevice } from "./export";
import {
  guide,
  hiddenParts,
  isolate,
  makeState,
  selectedPart,
  showAllParts,
  showStage,
  stageIndex,
  stages,
} from "./state";

/** Lists at the right, by the names of their sections. */
const LISTS = [
  { section: "warnings", label: "Open the warnings" },
  { section: "Print", label: "Open the print list" },
  { section: "Cut list", label: "Open the cut list" },
  { section: "Bill of materials", label: "Open the shopping list" },
  { section: "checks", label: "Open the checks" },
  { section: "files", label: "Open the files" },
];

export const makeCommands = (): readonly Command[] => [
  {
    id: "make.next",
    label: "Next step of the assembly",
    group: "Make",
    shortcut: "ArrowRight",
    when: () => stageIndex.value < stages.value.length - 1,
    reason: "This is the last step, or nothing is built",
    run: () => showStage(stageIndex.value + 1),
  },
  {
    id: "make.previous",
    label: "Previous step of the assembly",
    group: "Make",
    shortcut: "ArrowLeft",
    when: () => stageIndex.value >= 0,
    reason: "All parts are shown",
    run: () => showStage(stageIndex.value - 1),
  },
  {
    id: "make.isolate",
    label: "Isolate the selected part",
    group: "Make",
    shortcut: "I",
    when: () => selectedPart.value !== null,
    reason: "Select a part first",
    run: () => isolate(selectedPart.value!),
  },
  {
    id: "make.show-all",
    label: "Show all parts",
    group: "Make",
    shortcut: "A",
    when: () => hiddenParts.value.length > 0,
    reason: "No part is hidden",
    run: showAllParts,
  },
  {
    id: "make.export",
    label: "Export as zip",
    hint: "Save parts, guide, report, lists and design in one file",
    group: "Make",
    when: () => makeState.value !== null && !makeState.value.exportObstacle,
    reason: () => makeState.value?.exportObstacle ?? "",
    run: () => void exportDevice(),
  },
  ...LISTS.map(({ section, label }) => ({
    id: `make.${section}`,
    label,
    group: "Make",
    when: () => Boolean(guide.value?.id),
    reason: "Build the parts first",
    run: () => openSection(`make.${section}`),
  })),
];

/** Let arrow keys change the step also after a button was pressed, which has no use for them. */
export function followArrows(): () => void {
  const onKeyDown = (event: KeyboardEvent) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const isPlain = !event.ctrlKey && !event.metaKey && !event.altKey && !event.shiftKey;
    const { target } = event;
    if (by === undefined || !isPlain || event.defaultPrevented || !(target instanceof Element)) return;
    if (!target.matches("button, summary, a[href]") || target.closest("dialog, [role=menu]")) return;
    event.preventDefault();
    showStage(stageIndex.value + by);
  };
  document.addEventListener("keydown", onKeyDown);
  return () => document.removeEventListener("keydown", onKeyDown);
}
