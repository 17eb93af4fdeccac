// The connection of this page, and the events that most components read.
import { computed, signal } from "@preact/signals";
import { Connection } from "../protocol/connection";
import type { Violation } from "../protocol/messages";
import { nameFields, readProblems } from "./page-words";

const scheme = location.protocol === "https:" ? "wss" : "ws";

export const connection = new Connection(`${scheme}://${location.host}/socket`, readProblems);

connection.listen("device-fields", ({ groups }) => {
  nameFields(groups.flatMap(({ fields, more }) => [...fields, ...more]));
});

export const page = connection.event("page");
export const device = connection.event("device-state");
export const pipeline = connection.event("pipeline");
export const prediction = connection.event("prediction");
export const job = connection.event("job");
export const bodyFit = connection.event("body-fit");
export const question = connection.event("question");

/** How often the file of the device was valid again after an error in it. */
export const corrections = signal(0);

let hasFileError = false;
connection.listen("page", (event) => {
  const hadFileError = hasFileError;
  hasFileError = event.screen === "device" && event.problem !== null;
  if (hadFileError && !hasFileError) corrections.value++;
});

/** Whether a job runs or is paused, and no other one can start. */
export const isJobActive = computed(
  () => (job.value?.state ?? "idle") !== "idle" && !job.value?.givesWay,
);

/** What is outside the newest body, by kind and name, such as "region:tip". */
export const misfitTexts = computed(
  () => new Map((bodyFit.value?.misfits ?? []).map(({ kind, name, text }) => [`${kind}:${name}`, text])),
);

/** What is wrong with the drawn cords: broken limits, and why they cannot be made. */
export const drawnViolations = computed<readonly Violation[]>(() => {
  const { drawn = null, check } = prediction.value ?? {};
  return [...(drawn?.violations ?? []), ...(check?.problem ? [check.problem] : [])];
});

/** Places (b, 3) where the drawn cords are shown as broken, mm: all of those that cannot be made. */
export const brokenPlaces = computed<number[][]>(() => {
  const { drawn = null, check } = prediction.value ?? {};
  const failed = check?.problem?.cords ?? [];
  const paths = (device.value?.cords ?? []).filter(({ name }) => failed.includes(name));
  return [...(drawn?.broken ?? []), ...paths.flatMap(({ path }) => path)];
});

/** Texts of what is wrong by the name of the cord. */
export const violationsByCord = computed(() => {
  const texts = new Map<string, string[]>();
  for (const violation of drawnViolations.value) {
    for (const cord of violation.cords) {
      texts.set(cord, [...(texts.get(cord) ?? []), violation.text]);
    }
  }
  return texts;
});
