// The selected, hovered and hidden items of this browser.
import { effect, signal } from "@preact/signals";
import { device } from "./connection";

export type ItemKind = "cord" | "pose" | "region" | "part";

export interface Item {
  kind: ItemKind;
  name: string;
}

/** The part that the tree shows before any part is made. */
export const BODY: Item = { kind: "part", name: "body" };

export const selection = signal<readonly Item[]>([]);
export const hovered = signal<Item | null>(null);
export const hidden = signal<readonly Item[]>([]);

export function isSame(a: Item | null, b: Item | null): boolean {
  return a !== null && b !== null && a.kind === b.kind && a.name === b.name;
}

function has(items: readonly Item[], item: Item): boolean {
  return items.some((other) => isSame(item, other));
}

function toggled(items: readonly Item[], item: Item): readonly Item[] {
  return has(items, item) ? items.filter((other) => !isSame(item, other)) : [...items, item];
}

export const isSelected = (item: Item): boolean => has(selection.value, item);
export const isHovered = (item: Item): boolean => isSame(hovered.value, item);
export const isHidden = (item: Item): boolean => has(hidden.value, item);

/** Select an item alone, or add it to the selection or remove it from there. */
export function select(item: Item, isAdded = false): void {
  selection.value = isAdded ? toggled(selection.value, item) : [item];
}

export function clearSelection(): void {
  selection.value = [];
}

export function toggleHidden(item: Item): void {
  hidden.value = toggled(hidden.value, item);
}

/** Names of the selected items of a kind, in the order of selection. */
export function selectedNames(kind: ItemKind): string[] {
  return selection.value.filter((item) => item.kind === kind).map((item) => item.name);
}

/** Let the selection and the hidden items follow a new name. */
export function followRename(item: Item, name: string): void {
  const follow = (items: readonly Item[]) =>
    items.map((other) => (isSame(other, item) ? { ...item, name } : other));
  selection.value = follow(selection.value);
  hidden.value = follow(hidden.value);
}

// Items that the device no longer has are neither selected nor hidden any more. A new name arrives with the
// device before the answer to the request does, so that this waits for the answer.
effect(() => {
  const state = device.value;
  if (!state) return;
  const names = {
    cord: new Set(state.cords.map((cord) => cord.name)),
    pose: new Set(state.poses),
    region: new Set(state.regions),
  };
  const exists = ({ kind, name }: Item) => kind === "part" || names[kind].has(name);
  setTimeout(() => {
    if (device.value !== state) return;
    for (const items of [selection, hidden]) {
      if (!items.peek().every(exists)) items.value = items.peek().filter(exists);
    }
    if (hovered.peek() && !exists(hovered.peek()!)) hovered.value = null;
  }, 200);
});
