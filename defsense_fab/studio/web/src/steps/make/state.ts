// What this browser shows of the parts and of their assembly.
import { computed, effect, signal } from "@preact/signals";
import type { GuideStage, PartState } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { type Item, hidden, isHidden, selectedNames, toggleHidden } from "../../state/selection";

export const makeState = connection.event("make-state");
export const partsEvent = connection.event("parts");
export const guide = connection.event("guide");
const progress = connection.event("assembly-progress");

export const parts = computed<readonly PartState[]>(() => partsEvent.value?.parts ?? []);
export const stages = computed<readonly GuideStage[]>(() => guide.value?.stages ?? []);

/** Index of the step that is shown; -1 for all parts. */
export const stageIndex = signal(-1);
export const stage = computed(() => stages.value[stageIndex.value] ?? null);

/** Distance of the parts, from 0 (assembled) to 1. */
export const explosion = signal(1);

/** The place of a warning: where (3,), mm, and what is there. */
export interface Place {
  readonly at: readonly number[];
  readonly text: string;
}

/** The place that is shown, among the assembled parts, which are transparent meanwhile. */
export const place = signal<Place | null>(null);

export function showStage(index: number): void {
  place.value = null;
  stageIndex.value = Math.min(Math.max(index, -1), stages.value.length - 1);
}

export function showPlace(shown: Place): void {
  stageIndex.value = -1;
  explosion.value = 0;
  place.value = shown;
}

export function hidePlace(): void {
  place.value = null;
  explosion.value = 1;
}

const done = computed(() => new Set(progress.value?.done ?? []));
export const isDone = ({ id }: GuideStage): boolean => done.value.has(id);
export const doneCount = computed(() => stages.value.filter(isDone).length);

export async function tick({ id }: GuideStage, isTicked: boolean): Promise<void> {
  await run(connection.send("tick-stage", { stage: id, isDone: isTicked }));
}

export const partItem = (name: string): Item => ({ kind: "part", name });

export const selectedPart = computed(() => {
  const names = new Set(parts.value.map(({ name }) => name));
  return selectedNames("part").filter((name) => names.has(name))[0] ?? null;
});

export const hiddenParts = computed(() =>
  parts.value.map(({ name }) => name).filter((name) => isHidden(partItem(name))),
);

export function togglePart(name: string): void {
  toggleHidden(partItem(name));
}

/** Hide all parts but one. */
export function isolate(name: string): void {
  const others = parts.value.filter((part) => part.name !== name).map((part) => partItem(part.name));
  hidden.value = [...withoutParts(hidden.value), ...others];
}

export function showAllParts(): void {
  hidden.value = withoutParts(hidden.value);
}

function withoutParts(items: readonly Item[]): readonly Item[] {
  const names = new Set(parts.value.map(({ name }) => name));
  return items.filter(({ kind, name }) => kind !== "part" || !names.has(name));
}

// Other parts start with all of them.
let shownId = "";
effect(() => {
  const id = partsEvent.value?.id ?? "";
  if (id === shownId) return;
  shownId = id;
  stageIndex.value = -1;
  place.value = null;
});
