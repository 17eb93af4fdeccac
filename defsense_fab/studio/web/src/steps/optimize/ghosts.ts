// Cords of the search and of layouts in the scene, over the drawn ones.
import { effect } from "@preact/signals";
import type { GhostCord } from "../../protocol/messages";
import { CordLayer, type ShownCord } from "../../scene/cord-layer";
import type { Viewer } from "../../scene/viewer";
import { device } from "../../state/connection";
import { isDark } from "../../scene/theme";
import { errorMap } from "./error-map";
import { isSearching, search, shownLayout } from "./state";

/** Thickness of the drawn cords next to others. */
const DRAWN_THICKNESS = 0.5;
const COLORS = {
  light: { best: "#1566c0", current: "#d07a00", layout: "#8a3ab9" },
  dark: { best: "#5aa9ff", current: "#ffae42", layout: "#c58af0" },
};

/** Show the cords of the search and of the shown layout; return a function that removes them. */
export function attachGhosts(viewer: Viewer): () => void {
  const layer = new CordLayer(
    () => viewer.refresh(),
    () => viewer.invalidate(),
  );
  viewer.scene.add(layer.object);
  const draw = () => {
    const tones = isDark() ? COLORS.dark : COLORS.light;
    const layout = shownLayout.value;
    const shown = layout
      ? cords(layout.isDrawn ? [] : layout.cords, "layout", tones.layout)
      : [
          ...cords(searched(search.value?.bestCords), "best", tones.best),
          ...cords(searched(search.value?.currentCords), "current", tones.current),
        ];
    layer.set(shown, (device.value?.cordRadius ?? 1) * 1.05);
    layer.object.visible = errorMap.value === null;
    viewer.cords.setThinning(shown.length > 0 ? DRAWN_THICKNESS : 1);
  };
  const stops = [
    viewer.onTheme((colors) => {
      layer.setTheme(colors);
      draw();
    }),
    effect(draw),
  ];
  return () => {
    for (const stop of stops) stop();
    viewer.scene.remove(layer.object);
    layer.dispose();
    viewer.cords.setThinning(1);
  };
}

function searched(found: readonly GhostCord[] | undefined): readonly GhostCord[] {
  return isSearching.value ? (found ?? []) : [];
}

function cords(shown: readonly GhostCord[], group: string, color: string): ShownCord[] {
  return shown.map(({ name, path }) => ({ name: `${group}/${name}`, color, path, isVisible: true }));
}
