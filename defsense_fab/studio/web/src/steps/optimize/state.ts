// What this browser shows of the search and of the layouts.
import { computed, effect, signal } from "@preact/signals";
import type { LayoutRow } from "../../protocol/messages";
import { connection, job } from "../../state/connection";
import { inPageWords } from "../../state/page-words";
import { run } from "../../state/run";

export const standing = connection.event("optimize-state");
export const search = connection.event("search");
export const layouts = connection.event("layouts");
export const errorStates = connection.event("error-states");

export const rows = computed<readonly LayoutRow[]>(() => layouts.value?.rows ?? []);
export const isSearching = computed(() => search.value?.state === "running");
export const isComparing = computed(
  () => job.value?.name === "comparison" && job.value.state !== "idle",
);

/** Name of the layout that is chosen, and of the one under the pointer. */
export const chosenName = signal<string | null>(null);
export const hoveredName = signal<string | null>(null);

export const chosen = computed(() => find(chosenName.value));
export const shownLayout = computed(() => find(hoveredName.value) ?? chosen.value);

function find(name: string | null): LayoutRow | null {
  return rows.value.find((row) => row.name === name) ?? null;
}

export function choose(name: string): void {
  chosenName.value = chosenName.value === name ? null : name;
}

/** What the panel below the scene shows. */
export const view = signal<"search" | "layouts">("layouts");

// A search that starts is shown; its layouts are once it has ended.
let wasSearching = false;
effect(() => {
  const isRunning = isSearching.value;
  if (isRunning !== wasSearching) view.value = isRunning ? "search" : "layouts";
  wasSearching = isRunning;
});

export type Cost = "parts" | "hours" | "cords";
export const cost = signal<Cost>("parts");

export const COSTS: Record<Cost, { label: string; title: string; of: (row: LayoutRow) => number | null }> = {
  parts: { label: "Parts", title: "Number of parts", of: (row) => row.parts },
  hours: { label: "Print time", title: "Print time, h (estimate)", of: (row) => row.printHours },
  cords: { label: "Cords", title: "Number of cords", of: (row) => row.cords.length },
};

/** State whose error is shown on the surface, and whether the surface is deformed. */
export const mappedState = signal("");
export const isMapDeformed = signal(true);

const capitalized = (text: string): string => `${text[0]!.toUpperCase()}${text.slice(1)}`;

export function layoutName({ name, role, isDrawn }: LayoutRow): string {
  if (role === "drawn" || (role === "candidate" && isDrawn)) return "Drawn";
  if (role === "built") return standing.value?.isBuiltMoved ? "Optimized" : "In the parts";
  if (role === "earlier") return `${capitalized(name.replace(/^earlier: /, ""))} (earlier)`;
  return capitalized(name);
}

/** Name of a layout, and whether it is drawn. */
export function layoutLabel(row: LayoutRow): string {
  return row.isDrawn && layoutName(row) !== "Drawn" ? `${layoutName(row)} (drawn)` : layoutName(row);
}

/** The layout that the main button uses: the chosen one of the search, or the best that can be made. */
export const bestRow = computed(() => find(standing.value?.bestLayout ?? null));

/** Whether the optimized cords differ from the drawn ones. */
export const differs = computed(
  () => standing.value?.standing === "drawn-differ" && bestRow.value?.isDrawn !== true,
);

/** What the main button does: use the chosen layout, or another one if that cannot be made. */
export function useBestLabel(): string {
  const row = bestRow.value;
  if (!row || row.role === "built") return "Use the optimized cords";
  return `Use “${layoutName(row)}”, which can be made`;
}

export async function applyLayout(name: string): Promise<void> {
  await run(connection.send("use-layout", { name }));
}

/** Whether the best cords of the search are made on trial to be used. */
export const isTakingBest = signal(false);

export async function applyBest(): Promise<void> {
  if (isTakingBest.peek()) return;
  isTakingBest.value = true;
  await run(connection.send("use-best", {}));
  isTakingBest.value = false;
}

export async function compareLayouts(): Promise<void> {
  view.value = "layouts";
  await run(connection.send("compare-layouts", {}));
}

export const mm = (value: number | null): string => (value === null ? "–" : value.toFixed(2));

/** A printing time as report and guide state it, as in "35 min", "2.3 h" and "18 h". */
export function printTime(hours: number): string {
  if (hours < 1) return `${(60 * hours).toFixed(0)} min`;
  return `${hours.toFixed(hours < 10 ? 1 : 0).replace(".0", "")} h`;
}

/** The expected error of a layout in its parts, if they were made on trial. */
export function inParts({ error, parts, problem }: LayoutRow): string {
  if (problem || parts === null) return "–";
  return mm(error);
}

/** What a button that uses a layout does, or why it cannot. */
export function useHint({ isDrawn, problem }: LayoutRow): string {
  if (problem) return inPageWords(problem);
  return isDrawn ? "These are the drawn cords" : "Draw these cords; Undo restores the drawn ones";
}
