// The keys of the step Make.
import type { Command } from "../../commands";
import { step } from "../../state/step";
import {
  hiddenParts,
  isolate,
  selectedPart,
  showAllParts,
  showStage,
  stageIndex,
  stages,
} from "./state";

export const makeCommands = (): readonly Command[] => [
  {
    id: "make.next",
    label: "Next step of the assembly",
    group: "Make",
    shortcut: "ArrowRight",
    when: () => step.value === "make" && stageIndex.value < stages.value.length - 1,
    run: () => showStage(stageIndex.value + 1),
  },
  {
    id: "make.previous",
    label: "Previous step of the assembly",
    group: "Make",
    shortcut: "ArrowLeft",
    when: () => step.value === "make" && stageIndex.value >= 0,
    run: () => showStage(stageIndex.value - 1),
  },
  {
    id: "make.isolate",
    label: "Isolate the selected part",
    group: "Make",
    shortcut: "I",
    when: () => step.value === "make" && selectedPart.value !== null,
    run: () => isolate(selectedPart.value!),
  },
  {
    id: "make.show-all",
    label: "Show all parts",
    group: "Make",
    shortcut: "A",
    when: () => step.value === "make" && hiddenParts.value.length > 0,
    run: showAllParts,
  },
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
