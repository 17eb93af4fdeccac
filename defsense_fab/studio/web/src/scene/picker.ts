// What lies under the pointer: cords within some pixels first, then the body.
import { Vector3 } from "three";
import type { Pick } from "./types";
import type { Viewer } from "./viewer";

const MOUSE_TOLERANCE_PX = 6;
const TOUCH_TOLERANCE_PX = 16;
/** A press that moves less is a click, not a drag of the camera. */
const CLICK_PX = 4;

export interface PickerEvents {
  onHover(pick: Pick | null): void;
  onClick(pick: Pick | null, event: PointerEvent): void;
  onMenu(pick: Pick | null, x: number, y: number): void;
}

export class Picker {
  isEnabled = true;
  private events: PickerEvents | null = null;
  private press: { x: number; y: number; button: number } | null = null;
  private readonly stop = new AbortController();
  private readonly a = new Vector3();
  private readonly b = new Vector3();

  constructor(private readonly viewer: Viewer) {
    const { canvas } = viewer;
    const { signal } = this.stop;
    canvas.addEventListener("pointerdown", this.onDown, { signal });
    canvas.addEventListener("pointermove", this.onMove, { signal });
    canvas.addEventListener("pointerup", this.onUp, { signal });
    canvas.addEventListener("pointerleave", () => this.hover(null), { signal });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
  }

  /** Report hovers, clicks and requests of a context menu. */
  listen(events: PickerEvents): void {
    this.events = events;
  }

  /** Return what lies at a pixel; with a tolerance around cords. */
  pick(x: number, y: number, tolerance = MOUSE_TOLERANCE_PX): Pick | null {
    return this.pickCord(x, y, tolerance) ?? this.pickBody(x, y);
  }

  dispose(): void {
    this.stop.abort();
  }

  private pickCord(x: number, y: number, tolerance: number): Pick | null {
    let best: Pick | null = null;
    let nearest = Infinity;
    for (const cord of this.viewer.cords.cords) {
      if (!cord.isVisible) continue;
      const { path } = cord;
      const middle = path[path.length >> 1]!;
      const mmPerPixel = this.viewer.rig.mmPerPixel(this.a.fromArray(middle));
      const reach = tolerance + this.viewer.cords.shownRadius / mmPerPixel;
      let [px, py] = this.viewer.project(this.a.fromArray(path[0]!));
      for (let i = 1; i < path.length; i++) {
        const [qx, qy] = this.viewer.project(this.b.fromArray(path[i]!));
        const [ux, uy] = [qx - px, qy - py];
        const along = ((x - px) * ux + (y - py) * uy) / (ux * ux + uy * uy || 1);
        const t = Math.min(1, Math.max(0, along));
        const distance = Math.hypot(x - px - t * ux, y - py - t * uy);
        if (distance < reach && distance < nearest) {
          nearest = distance;
          const point = path[i - 1]!.map((value, k) => value + t * (path[i]![k]! - value));
          best = { kind: "cord", name: cord.name, point, faceIndex: -1 };
        }
        [px, py] = [qx, qy];
      }
    }
    return best;
  }

  private pickBody(x: number, y: number): Pick | null {
    const { origin, direction } = this.viewer.rayAt(x, y);
    const [from, along] = [origin.toArray(), direction.toArray()];
    const { face, distance } = this.viewer.body.intersect(from, along);
    if (face < 0) return null;
    const point = from.map((value, k) => value + distance * along[k]!);
    return { kind: "body", name: "", point, faceIndex: face };
  }

  private readonly onDown = (event: PointerEvent): void => {
    const [x, y] = this.viewer.local(event);
    this.press = { x, y, button: event.button };
  };

  private readonly onMove = (event: PointerEvent): void => {
    if (!this.isEnabled || event.buttons !== 0 || event.pointerType === "touch") return;
    const [x, y] = this.viewer.local(event);
    this.hover(this.pickCord(x, y, MOUSE_TOLERANCE_PX));
  };

  private readonly onUp = (event: PointerEvent): void => {
    const { press } = this;
    this.press = null;
    if (!this.isEnabled || !press) return;
    const [x, y] = this.viewer.local(event);
    if (Math.hypot(x - press.x, y - press.y) > CLICK_PX) return;
    const tolerance = event.pointerType === "touch" ? TOUCH_TOLERANCE_PX : MOUSE_TOLERANCE_PX;
    const pick = this.pick(x, y, tolerance);
    if (press.button === 0) this.events?.onClick(pick, event);
    if (press.button === 2) this.events?.onMenu(pick, event.clientX, event.clientY);
  };

  private hover(pick: Pick | null): void {
    this.viewer.canvas.style.cursor = pick ? "pointer" : "";
    this.events?.onHover(pick);
  }
}
