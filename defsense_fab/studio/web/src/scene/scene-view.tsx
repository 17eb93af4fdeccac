// The scene of the page: the body and cords of the device, with what is selected and hovered.
import { effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { cordMenu } from "../shell/cord-commands";
import { connection, device, prediction } from "../state/connection";
import {
  clearSelection,
  hovered,
  isHidden,
  isSelected,
  type Item,
  select,
  selection,
} from "../state/selection";
import { type MenuEntry, openContextMenu } from "../ui/menu";
import type { Pick } from "./types";
import { Viewer } from "./viewer";

/** The menu of the selected cords; a step can replace it. */
export const cordMenuEntries = signal<() => readonly MenuEntry[]>(cordMenu);

/** The scene while it is on the page. */
export const viewer = signal<Viewer | null>(null);

/** The place of the scene; it shows the device whatever the step is. */
export function SceneView() {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const scene = new Viewer(host.current!);
    const stop = showDevice(scene);
    viewer.value = scene;
    return () => {
      viewer.value = null;
      stop();
      scene.dispose();
    };
  }, []);
  return <div ref={host} class="scene-host" />;
}

function showDevice(scene: Viewer): () => void {
  const stops = [
    connection.onArrays("body", ({ arrays }) => scene.body.set(arrays)),
    effect(() => {
      const { cords = [], cordRadius = 1 } = device.value ?? {};
      const shown = cords.map(({ name, color, path }) => {
        return { name, color, path, isVisible: !isHidden({ kind: "cord", name }) };
      });
      scene.cords.set(shown, cordRadius);
    }),
    effect(() => scene.cords.setBroken(prediction.value?.drawn?.broken ?? [])),
    effect(() => {
      const cords = selection.value.filter(({ kind }) => kind === "cord");
      scene.cords.setSelected(new Set(cords.map(({ name }) => name)));
    }),
    effect(() => {
      const item = hovered.value;
      scene.cords.setHovered(item?.kind === "cord" ? item.name : "");
    }),
  ];
  scene.picker.listen({
    onHover: (pick) => {
      const item = cordOf(pick);
      if (item?.name !== hovered.peek()?.name) hovered.value = item;
    },
    onClick: (pick, event) => {
      const item = cordOf(pick);
      const isAdded = event.shiftKey || event.ctrlKey || event.metaKey;
      if (item) select(item, isAdded);
      else if (!isAdded) clearSelection();
    },
    onMenu: (pick, x, y) => {
      const item = cordOf(pick);
      if (!item) return;
      if (!isSelected(item)) select(item);
      openContextMenu({ x, y }, `Actions for ${item.name}`, cordMenuEntries.peek()());
    },
  });
  return () => stops.forEach((stop) => stop());
}

function cordOf(pick: Pick | null): Item | null {
  return pick?.kind === "cord" ? { kind: "cord", name: pick.name } : null;
}
