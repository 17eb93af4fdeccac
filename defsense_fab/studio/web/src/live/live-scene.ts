// The scene of the live view: the moving surface, its cords colored by signal, and its markers.
import { Box3, Vector3 } from "three";
import type { ArrayMessage, NumberArray } from "../protocol/connection";
import type { LiveDevice } from "../protocol/messages";
import { isDark, onThemeChange } from "../scene/theme";
import { Viewer } from "../scene/viewer";
import { cordColor, markerColor } from "./colors";
import type { Frame } from "./frame";
import { MarkerLayer } from "./marker-layer";

const BODY_OPACITY = 0.5;
const MARKER_SIZE = 0.006; // radius, of the body's diagonal
const DEFAULT_SIZE_MM = 100; // of devices without a surface
const TRACK_COLOR_LIGHT = [20, 20, 20] as const;
const TRACK_COLOR_DARK = [240, 240, 240] as const;

export class LiveScene {
  private readonly viewer: Viewer;
  private readonly markers = new MarkerLayer("ball");
  private readonly tracks = new MarkerLayer("diamond");
  private readonly stopTheme: () => void;
  private device: LiveDevice | null = null;
  private counts: NumberArray = new Uint32Array();
  private rest: NumberArray = new Float32Array();
  private isDark = isDark();
  private hasBounds = false;
  private frame: Frame | null = null;

  constructor(host: HTMLElement) {
    this.viewer = new Viewer(host);
    this.viewer.canvas.setAttribute("aria-label", "Live device");
    this.viewer.scene.add(this.markers.object, this.tracks.object);
    this.viewer.body.setOpacity(BODY_OPACITY);
    this.stopTheme = onThemeChange(() => {
      this.isDark = isDark();
      if (this.frame) this.show(this.frame);
    });
  }

  setDevice(device: LiveDevice): void {
    this.device = device;
  }

  /** Show the device at rest. */
  setRest({ arrays }: ArrayMessage): void {
    let size = DEFAULT_SIZE_MM;
    if (arrays.vertices) {
      this.viewer.body.set(arrays);
      size = this.viewer.body.box.getSize(new Vector3()).length();
      this.hasBounds = true;
    }
    this.counts = arrays.cordCounts!;
    this.rest = arrays.cords!;
    this.markers.setSize(MARKER_SIZE * size);
    this.tracks.setSize(1.2 * MARKER_SIZE * size);
    this.showCords(this.rest, null);
  }

  show(frame: Frame): void {
    this.frame = frame;
    const device = this.device;
    if (!device) return;
    if (frame.vertices && !this.viewer.body.isEmpty) this.viewer.body.deform(frame.vertices);
    this.showCords(frame.cords ?? this.rest, frame.signals);
    this.markers.set(frame.markers, (k) => markerColor(frame.radius[k]!, device.markerRadius));
    const trackColor = this.isDark ? TRACK_COLOR_DARK : TRACK_COLOR_LIGHT;
    this.tracks.set(frame.tracks ?? new Float32Array(), () => trackColor);
    if (!this.hasBounds && frame.markers.length > 0) this.lookAt(frame.markers);
    this.viewer.invalidate();
  }

  fit(): void {
    this.viewer.rig.look("home", true);
  }

  dispose(): void {
    this.stopTheme();
    this.markers.dispose();
    this.tracks.dispose();
    this.viewer.dispose();
  }

  private showCords(points: NumberArray, signals: NumberArray | null): void {
    const device = this.device;
    if (!device) return;
    let at = 0;
    const cords = Array.from(this.counts, (count, k) => {
      const path: number[][] = [];
      for (const end = at + count; at < end; at++) {
        path.push([points[3 * at]!, points[3 * at + 1]!, points[3 * at + 2]!]);
      }
      const signal = signals ? signals[k]! : 0;
      const color = cordColor(signal, device.low[k] ?? 0, device.high[k] ?? 0, this.isDark);
      return { name: device.channels[k] ?? `cord ${k + 1}`, color, path, isVisible: true };
    });
    this.viewer.cords.set(cords, device.cordRadius);
  }

  /** Point the camera at markers, which are all that is known of the device. */
  private lookAt(points: NumberArray): void {
    this.hasBounds = true;
    this.viewer.rig.setBounds(new Box3().setFromArray(points));
    this.viewer.rig.look("home", false);
  }
}
