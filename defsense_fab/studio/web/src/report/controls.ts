// Keys, and the wheel, which scrolls the page until the view is clicked.
import type { DeviceView } from "./device-view";
import type { Panel } from "./panel";

const TURN_RAD = 0.12;
const ZOOM = 1.15;

/** Turn, zoom and play by keys while the view has the focus. */
export function listenForKeys({ canvas, rig }: DeviceView, panel: Panel): void {
  const actions: Record<string, () => void> = {
    ArrowLeft: () => rig.turnBy(-TURN_RAD, 0),
    ArrowRight: () => rig.turnBy(TURN_RAD, 0),
    ArrowUp: () => rig.turnBy(0, TURN_RAD),
    ArrowDown: () => rig.turnBy(0, -TURN_RAD),
    "+": () => rig.zoomBy(ZOOM),
    "=": () => rig.zoomBy(ZOOM),
    "-": () => rig.zoomBy(1 / ZOOM),
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
