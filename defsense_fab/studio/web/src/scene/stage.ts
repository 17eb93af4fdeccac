// The scene of the device's page: it shows body and cords, and reports what is clicked in it.
import { effect, signal } from "@preact/signals";
import { cordMenu } from "../shell/cord-commands";
import { brokenPlaces, connection, device } from "../state/connection";
import {
  clearSelection,
  hovered,
  isHidden,
  type Item,
  isSame,
  isSelected,
  select,
  selectedNames,
  selection,
} from "../state/selection";
import { type MenuEntry, openContextMenu } from "../ui/menu";
import type { Label } from "./label-layer";
import type { Pick } from "./types";
import { Viewer } from "./viewer";

/** The scene that is shown, or null before the page of a device. */
export const viewer = signal<Viewer | null>(null);

/** Whether body and cords of the device are shown; a step may show other things in their place. */
export const isBodyShown = signal(true);
export const areCordsShown = signal(true);
/** Opacity of the body, 0 to 1. */
const bodyOpacity = signal(1);

/** The menu of the selected cords; a step can replace it. */
export const cordMenuEntries = signal<() => readonly MenuEntry[]>(cordMenu);

/** What a step does with clicks and menus in the scene before cords are selected. */
export interface SceneTool {
  /** Whether the step follows the pointer itself. */
  ownsHover?: boolean;
  /** Return whether the click is handled. */
  onClick?(pick: Pick | null, event: PointerEvent): boolean;
  onMenu?(pick: Pick | null, x: number, y: number): boolean;
}

export const tool = signal<SceneTool | null>(null);

/** Show the device in an element; return a function that removes the scene. */
export function openStage(host: HTMLElement): () => void {
  const shown = new Viewer(host);
  const stops = [
    connection.onArrays("body", ({ arrays }) => shown.body.set(arrays)),
    effect(() => shown.body.setVisible(isBodyShown.value)),
    effect(() => shown.body.setOpacity(bodyOpacity.value)),
    effect(() => {
      const cords = areCordsShown.value ? (device.value?.cords ?? []) : [];
      shown.cords.set(
        cords.map(({ name, color, path }) => ({
          name,
          color,
          path,
          isVisible: !isHidden({ kind: "cord", name }),
        })),
        device.value?.cordRadius ?? 1,
      );
    }),
    effect(() => shown.cords.setBroken(brokenPlaces.value)),
    effect(() => {
      void selection.value;
      shown.cords.setSelected(new Set(selectedNames("cord")));
    }),
    effect(() => shown.cords.setHovered(hovered.value?.kind === "cord" ? hovered.value.name : "")),
  ];
  shown.picker.listen({
    onHover: (pick) => {
      if (tool.peek()?.ownsHover) return;
      const item = itemOf(pick);
      if (!isSame(item, hovered.peek())) hovered.value = item;
      shown.labels.set("hovered", pick && item ? [nameLabel(item, pick)] : []);
    },
    onClick: (pick, event) => {
      if (tool.value?.onClick?.(pick, event)) return;
      const item = itemOf(pick);
      const isAdded = event.shiftKey || event.ctrlKey || event.metaKey;
      if (item) select(item, isAdded);
      else if (!isAdded) clearSelection();
    },
    onMenu: (pick, x, y) => {
      if (tool.value?.onMenu?.(pick, x, y)) return;
      const item = itemOf(pick);
      if (!item) return;
      if (!isSelected(item)) select(item);
      openContextMenu({ x, y }, `Actions for ${item.name}`, cordMenuEntries.peek()());
    },
  });
  viewer.value = shown;
  return () => {
    viewer.value = null;
    for (const stop of stops) stop();
    shown.dispose();
  };
}

function nameLabel({ name }: Item, { point }: Pick): Label {
  return { id: "hovered", text: name, at: point, tone: "plain", priority: 20 };
}

function itemOf(pick: Pick | null): Item | null {
  return pick?.kind === "cord" ? { kind: "cord", name: pick.name } : null;
}
