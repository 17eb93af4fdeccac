// The parts in the scene of the page: exploded, labeled, and selected by a click.
import { effect, signal } from "@preact/signals";
import type { ArrayMessage } from "../../protocol/connection";
import { Vector3 } from "three";
import type { Label } from "../../scene/label-layer";
import { areCordsShown, isBodyShown, tool } from "../../scene/stage";
import type { Viewer } from "../../scene/viewer";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { clearSelection, hovered, isSame, select } from "../../state/selection";
import { openContextMenu } from "../../ui/menu";
import { arrange, viewDirection } from "./arrangement";
import { partMenu } from "./part-menu";
import { PartsLayer } from "./parts-layer";
import {
  explosion,
  guide,
  hiddenParts,
  hidePlace,
  type Place,
  partItem,
  parts,
  partsEvent,
  place,
  selectedPart,
  stage,
} from "./state";

const MAX_TEXT = 90;

/** The surfaces of the parts, fetched when they are first shown. */
export const meshes = signal<ArrayMessage | null>(null);

effect(() => {
  if (meshes.value && meshes.value.facts.id !== partsEvent.value?.id) meshes.value = null;
});

async function fetchMeshes(id: string): Promise<void> {
  if (!id || meshes.peek()?.facts.id === id) return;
  const answer = await run(connection.fetch("part-meshes", {}));
  if (answer?.facts.id === partsEvent.peek()?.id) meshes.value = answer ?? null;
}

/** Show the parts in a scene; return a function that removes them. */
export function attachParts(viewer: Viewer): () => void {
  const layer = new PartsLayer(() => viewer.refresh());
  viewer.scene.add(layer.object);
  const pickAt = (event: PointerEvent | { clientX: number; clientY: number }) => {
    const { origin, direction } = viewer.rayAt(...viewer.local(event));
    return layer.pick(origin.toArray(), direction.toArray());
  };
  const abort = new AbortController();
  viewer.canvas.addEventListener(
    "pointermove",
    (event) => {
      if (event.buttons !== 0 || event.pointerType === "touch") return;
      const name = pickAt(event);
      viewer.canvas.style.cursor = name ? "pointer" : "";
      const item = name ? partItem(name) : null;
      if (!isSame(item, hovered.peek())) hovered.value = item;
    },
    { signal: abort.signal },
  );
  tool.value = {
    ownsHover: true,
    onClick: (_, event) => {
      const name = pickAt(event);
      if (name) select(partItem(name));
      else clearSelection();
      return true;
    },
    onMenu: (_, x, y) => {
      const name = pickAt({ clientX: x, clientY: y });
      if (!name) return true;
      select(partItem(name));
      openContextMenu({ x, y }, name, partMenu(name));
      return true;
    },
  };
  let framed = "";
  const frame = () => {
    const box = layer.box();
    if (box.isEmpty()) return;
    viewer.rig.setBounds(box);
    viewer.rig.turnTo(viewDirection(stage.peek()));
    viewer.rig.fit();
  };
  const stops = [
    viewer.onTheme((colors) => layer.setTheme(colors)),
    effect(() => void fetchMeshes(partsEvent.value?.id ?? "")),
    effect(() => {
      isBodyShown.value = meshes.value === null;
      areCordsShown.value = meshes.value === null;
      viewer.setShadow(meshes.value === null);
      if (meshes.value) layer.setMeshes(meshes.value, parts.peek());
    }),
    effect(() => {
      if (!meshes.value || !guide.value) return;
      const { id, cordRadius: cord, wireRadius: wire } = guide.value;
      const current = stage.value;
      const hiddenNames = new Set(hiddenParts.value);
      const show = (share: number) => {
        const arranged = arrange(guide.value!, parts.value, current, share);
        // A warning is mostly about a cord, which is inside.
        const shown = place.value ? { ...arranged, cords: guide.value!.cords } : arranged;
        layer.apply(shown, { cord, wire }, hiddenNames, place.value !== null);
      };
      const key = `${id} ${current?.id ?? ""} ${place.value ? "place" : ""}`;
      if (key !== framed && !place.value) {
        show(1); // what fits at the largest distance fits always
        frame();
      }
      framed = key;
      show(explosion.value);
      viewer.labels.set("parts", labels(layer));
    }),
    effect(() => layer.setSelected(selectedPart.value)),
    effect(() => layer.setHovered(hovered.value?.kind === "part" ? hovered.value.name : null)),
    effect(() => {
      const shown = place.value;
      viewer.labels.set("place", shown ? [placeLabel(shown)] : []);
      if (shown) viewer.rig.flyTo(new Vector3().fromArray([...shown.at]));
    }),
  ];
  return () => {
    abort.abort();
    for (const stop of stops) stop();
    tool.value = null;
    viewer.labels.set("parts", []);
    viewer.labels.set("place", []);
    viewer.scene.remove(layer.object);
    layer.dispose();
    isBodyShown.value = areCordsShown.value = true;
    viewer.setShadow(true);
    if (!viewer.body.isEmpty) {
      viewer.rig.setBounds(viewer.body.box);
      viewer.rig.fit();
    }
  };
}

function placeLabel({ at, text }: Place): Label {
  const short = text.length > MAX_TEXT ? `${text.slice(0, MAX_TEXT).trimEnd()} ...` : text;
  return { id: "place", text: short, at: [...at], tone: "alarm", priority: 10, onClick: hidePlace };
}

function labels(layer: PartsLayer) {
  const pins = stage.value?.joint?.pins ?? [];
  return [
    ...(place.value ? [] : layer.middles()).map(({ name, at }) => ({
      id: `part ${name}`,
      text: name,
      at,
      tone: name === selectedPart.value ? ("accent" as const) : ("plain" as const),
      priority: name === selectedPart.value ? 3 : 2,
      onClick: () => select(partItem(name)),
    })),
    ...pins.map(({ letter, end }) => ({
      id: `pin ${letter}`,
      text: letter,
      at: end,
      tone: "plain" as const,
      priority: 1,
    })),
  ];
}
