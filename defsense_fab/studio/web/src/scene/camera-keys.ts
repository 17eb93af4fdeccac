// Keys that move the camera while the picture has the focus.
import type { CameraRig } from "./camera-rig";

const TURN_DEG = 10;
const ZOOM = 1.15;
const TURNS: Record<string, [number, number]> = {
  ArrowLeft: [-TURN_DEG, 0],
  ArrowRight: [TURN_DEG, 0],
  ArrowUp: [0, TURN_DEG],
  ArrowDown: [0, -TURN_DEG],
};

/** Turn the camera by the arrow keys, pan it with Shift, and zoom by plus and minus. */
export function listenForCameraKeys(element: HTMLElement, rig: CameraRig): void {
  element.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const turn = TURNS[event.key];
    if (turn && event.shiftKey) rig.panBy(turn[0], turn[1]);
    else if (turn) rig.turnBy(turn[0], turn[1]);
    else if (event.key === "+" || event.key === "=") rig.zoomBy(1 / ZOOM);
    else if (event.key === "-") rig.zoomBy(ZOOM);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
}
