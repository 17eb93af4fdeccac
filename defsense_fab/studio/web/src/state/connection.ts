// The connection of this page, and the events that most components read.
import { computed } from "@preact/signals";
import { Connection } from "../protocol/connection";
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

/** Whether a job runs or is paused, and no other one can start. */
export const isJobActive = computed(
  () => (job.value?.state ?? "idle") !== "idle" && !job.value?.givesWay,
);

/** What is outside the newest body, by kind and name, such as "region:tip". */
export const misfitTexts = computed(
  () => new Map((bodyFit.value?.misfits ?? []).map(({ kind, name, text }) => [`${kind}:${name}`, text])),
);

/** Texts of the broken limits by the name of the cord that breaks them. */
export const violationsByCord = computed(() => {
  const texts = new Map<string, string[]>();
  for (const violation of prediction.value?.drawn?.violations ?? []) {
    for (const cord of violation.cords) {
      texts.set(cord, [...(texts.get(cord) ?? []), violation.text]);
    }
  }
  return texts;
});
