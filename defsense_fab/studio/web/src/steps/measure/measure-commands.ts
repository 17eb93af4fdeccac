// Commands of the step Measure: each shows a card, with the focus on its main button.
import type { Command } from "../../commands";
import { run } from "../../state/run";
import { startLive } from "./live-run";
import { type CardName, card, choices, usableSessions } from "./state";

/** In which the card appears, ms. */
const APPEAR_MS = 100;

function show(name: CardName, isSource = false): void {
  card.value = name;
  setTimeout(() => {
    const stage = document.querySelector(".scene-cover");
    const first = isSource ? null : stage?.querySelector<HTMLElement>("button.primary");
    (first ?? stage?.querySelector<HTMLElement>("input, select, button"))?.focus();
  }, APPEAR_MS);
}

const isBuilt = () => Boolean(choices.value?.isBuilt);
const NOT_BUILT = "Build the device in Make first";

export const measureCommands = (): readonly Command[] => [
  {
    id: "measure.check",
    label: "Check the board",
    group: "Measure",
    when: isBuilt,
    reason: NOT_BUILT,
    run: () => show("check"),
  },
  {
    id: "measure.record",
    label: "Record the twin or the device",
    group: "Measure",
    when: isBuilt,
    reason: NOT_BUILT,
    run: () => show("record"),
  },
  {
    id: "measure.train",
    label: "Train a model",
    group: "Measure",
    when: () => usableSessions.value.length > 0,
    reason: "Record a session first",
    run: () => show("train"),
  },
  {
    id: "measure.live",
    label: "Run the device live",
    hint: "Start the live view with the model and the source of the card Live",
    group: "Measure",
    when: () => (choices.value?.models.length ?? 0) > 0,
    reason: "Train a model first",
    run: () => {
      show("live");
      void startLive(async (request) => (await run(request)) !== undefined);
    },
  },
  {
    id: "measure.specimen",
    label: "Calibrate the cord",
    group: "Measure",
    run: () => show("specimen", true),
  },
];
