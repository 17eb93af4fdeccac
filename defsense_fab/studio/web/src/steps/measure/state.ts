// The state of the step Measure: what the server reports, and what this browser shows.
import { computed, signal } from "@preact/signals";
import { connection, device } from "../../state/connection";
import { storedSignal } from "../../state/storage";

const CARDS = ["check", "record", "train", "live", "specimen"] as const;
export type CardName = (typeof CARDS)[number];

export const choices = connection.event("measure-choices");
export const status = connection.event("measure-status");
export const results = connection.event("measure-results");
export const guided = connection.event("guided-state");

export const CARD_LABELS: Record<CardName, string> = {
  check: "Check the board",
  record: "Record",
  train: "Train",
  live: "Live",
  specimen: "Calibrate the cord",
};

const isCard = (value: unknown): value is CardName => CARDS.includes(value as CardName);

/** The card that this browser shows. */
export const card = storedSignal<CardName>("measure.card", "check", isCard);

/** Whether this browser shows the live view over the whole window. */
export const isLiveShown = signal(false);

/** Whether a guided run is open, which leaves no other to be started. */
export const isGuidedOpen = computed(() => Boolean(guided.value?.run));

export const noun = computed(() => device.value?.noun ?? "cord");

/** Names of the sessions that are chosen for training; null for the newest usable one. */
export const chosenSessions = signal<ReadonlySet<string> | null>(null);

export const usableSessions = computed(() =>
  (choices.value?.sessions ?? []).filter(({ problem }) => !problem),
);

export const rawSessions = computed(() =>
  (choices.value?.sessions ?? []).filter(({ isRaw }) => isRaw),
);

/** Names of the sessions to train on. */
export const trainingSessions = computed(() => {
  const names = usableSessions.value.map(({ name }) => name);
  return chosenSessions.value === null
    ? names.slice(-1)
    : names.filter((name) => chosenSessions.value!.has(name));
});
