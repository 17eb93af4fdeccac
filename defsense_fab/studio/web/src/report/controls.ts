// Keys, and the wheel, which scrolls the page until the view is clicked.
import { listenForCameraKeys } from "../scene/camera-keys";
import type { DeviceView } from "./device-view";
import type { Panel } from "./panel";

/** Turn, zoom and play by keys while the view has the focus. */
export function listenForKeys({ canvas, rig }: DeviceView, panel: Panel): void {
  listenForCameraKeys(canvas, rig);
  const actions: Record<string, () => void> = {
    0: () => panel.look("home"),
    Home: () => panel.look("home"),
    1: () => panel.look("front"),
    2: () => panel.look("right"),
    3: () => panel.look("top"),
    o: () => panel.toggleJoints(),
    p: () => panel.togglePlayback(),
    Escape: () => panel.select(null),
  };
  canvas.addEventListener("keydown", (event) => {
    const action = actions[event.key];
    if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action();
  });
}

/** Zoom with the wheel only while the view has the focus, and hide the hint at the first press. */
export function limitWheel({ canvas, rig: { controls } }: DeviceView, hint: HTMLElement): void {
  controls.enableZoom = false;
  canvas.addEventListener("focus", () => (controls.enableZoom = true));
  canvas.addEventListener("blur", () => (controls.enableZoom = false));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus({ preventScroll: true });
    if (event.pointerType === "touch") controls.enableZoom = true;
    hint.hidden = true;
  });
}
