// The live run that the card Live describes, and its start.
import { signal } from "@preact/signals";
import type { ModelChoice } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { portOf, TWIN_PORT } from "./port-field";
import { choices, isLiveShown, status } from "./state";

export const model = signal("");
export const port = signal(TWIN_PORT);
export const outputs = signal("");
export const usesFile = signal(false);
export const keepsReadings = signal(true);

/** The model that is chosen, or else the first one. */
export function chosenModel(): ModelChoice | null {
  const models = choices.value?.models ?? [];
  return models.find(({ name }) => name === model.value) ?? models[0] ?? null;
}

/** Start the run, or show the one that runs; pass the request to a function that waits for it. */
export async function startLive(wait: (request: Promise<null>) => Promise<boolean>): Promise<void> {
  const chosen = chosenModel();
  if (!chosen) return;
  if (status.value?.live.state === "running") {
    isLiveShown.value = true;
    return;
  }
  const request = connection.send("start-live", {
    model: chosen.name,
    port: portOf(port.value),
    outputs: outputs.value,
    usesFile: usesFile.value,
    keepsReadings: keepsReadings.value,
  });
  if (await wait(request)) isLiveShown.value = true;
}
