// Commands of the step Optimize.
import type { Command } from "../../commands";
import { isJobActive } from "../../state/connection";
import {
  applyBest,
  applyLayout,
  bestRow,
  chosen,
  compareLayouts,
  differs,
  isTakingBest,
  layouts,
  search,
  standing,
  view,
} from "./state";


export const optimizeCommands = (): readonly Command[] => [
  {
    id: "optimize.use",
    label: "Use the optimized cords",
    hint: "Draw the optimized cords; Undo restores the drawn ones",
    group: "Optimize",
    when: () => differs.value && bestRow.value !== null,
    reason: () => standing.value?.bestProblem || "No optimized cords differ from the drawn ones",
    run: () => void applyLayout(bestRow.value!.name),
  },
  {
    id: "optimize.best",
    label: "Use the best so far",
    hint: "End the search and draw its best cords that can be made",
    group: "Optimize",
    when: () => !isTakingBest.value && search.value?.state !== "none" && Boolean(search.value?.best),
    reason: () => (isTakingBest.value ? "They are being made on trial" : "No search has found cords within all limits"),
    run: () => void applyBest(),
  },
  {
    id: "optimize.use-chosen",
    label: "Use the chosen layout",
    group: "Optimize",
    when: () => chosen.value !== null && !chosen.value.problem,
    reason: () => chosen.value?.problem || "Choose a layout in the table first",
    run: () => void applyLayout(chosen.value!.name),
  },
  {
    id: "optimize.compare",
    label: "Compare all layouts",
    hint: "Make the parts of all layouts on trial, and predict their errors after training",
    group: "Optimize",
    when: () => !isJobActive.value && layouts.value !== null && !layouts.value.obstacle,
    reason: () =>
      isJobActive.value ? "Wait until the running job has ended" : (layouts.value?.obstacle ?? ""),
    run: () => void compareLayouts(),
  },
  {
    id: "optimize.layouts",
    label: "Show the layouts",
    group: "Optimize",
    run: () => (view.value = "layouts"),
  },
  {
    id: "optimize.search",
    label: "Show the search",
    group: "Optimize",
    run: () => (view.value = "search"),
  },
];
