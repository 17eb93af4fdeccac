// The scene of the live view: the moving surface, its cords colored by signal, and its markers.
import { Box3, Vector3 } from "three";
import type { ArrayMessage, NumberArray } from "../protocol/connection";
import type { LiveDevice } from "../protocol/messages";
import { BodyLayer } from "../scene/body-layer";
import { isDark, onThemeChange } from "../scene/theme";
import { Viewer } from "../scene/viewer";
import { cordColor, markerColor } from "./colors";
import type { Frame } from "./frame";
import { isTruthShown } from "./live-state";
import { MarkerLayer } from "./marker-layer";

const BODY_OPACITY = 0.5;
/** Color of the true shape, also in the legend. */
const TRUE_COLOR = "#e66101";
const MARKER_SIZE = 0.006; // radius, of the body's diagonal
const DEFAULT_SIZE_MM = 100; // of devices without a surface
const TRACK_COLOR_LIGHT = [20, 20, 20] as const;
const TRACK_COLOR_DARK = [240, 240, 240] as const;

export class LiveScene {
  private readonly viewer: Viewer;
  private readonly markers = new MarkerLayer("disc");
  private readonly tracks = new MarkerLayer("diamond");
  private readonly trueBody: BodyLayer;
  private readonly stops: (() => void)[];
  private device: LiveDevice | null = null;
  private counts: NumberArray = new Uint32Array();
  private rest: NumberArray = new Float32Array();
  /** Points (p, 3) of each cord, mm, as they are shown; overwritten by each frame. */
  private paths: number[][][] = [];
  private isDark = isDark();
  private hasBounds = false;
  private frame: Frame | null = null;
  private isFrameNew = false;

  constructor(host: HTMLElement) {
    this.viewer = new Viewer(host);
    this.viewer.canvas.setAttribute("aria-label", "Live device");
    this.viewer.scene.add(this.markers.object, this.tracks.object);
    this.viewer.body.setOpacity(BODY_OPACITY);
    this.viewer.body.setGrid(true);
    this.viewer.onNextFrame(() => this.showFrame());
    const invalidate = () => this.viewer.invalidate();
    this.trueBody = new BodyLayer(invalidate, invalidate);
    this.trueBody.setLinesOnly();
    this.viewer.scene.add(this.trueBody.object);
    this.stops = [
      onThemeChange(() => {
        this.isDark = isDark();
        if (this.frame) this.show(this.frame);
      }),
      this.viewer.onTheme((colors) =>
        this.trueBody.setTheme({ ...colors, body: TRUE_COLOR, edge: TRUE_COLOR }),
      ),
      isTruthShown.subscribe(() => this.frame && this.show(this.frame)),
    ];
  }

  setDevice(device: LiveDevice): void {
    this.device = device;
    this.createCords(); // its arrays may have come first
  }

  /** Show the device at rest. */
  setRest({ arrays }: ArrayMessage): void {
    let size = DEFAULT_SIZE_MM;
    if (arrays.vertices) {
      this.viewer.body.set(arrays);
      this.trueBody.set(arrays);
      this.trueBody.setVisible(false);
      size = this.viewer.body.box.getSize(new Vector3()).length();
      this.hasBounds = true;
    }
    this.counts = arrays.cordCounts!;
    this.rest = arrays.cords!;
    this.markers.setSize(MARKER_SIZE * size);
    this.tracks.setSize(1.2 * MARKER_SIZE * size);
    this.createCords();
  }

  /** Show a frame in the next picture; of frames that arrive in between, the last one. */
  show(frame: Frame): void {
    this.frame = frame;
    this.isFrameNew = true;
    this.viewer.invalidate();
  }

  fit(): void {
    this.viewer.rig.look("home", true);
  }

  dispose(): void {
    for (const stop of this.stops) stop();
    this.trueBody.dispose();
    this.markers.dispose();
    this.tracks.dispose();
    this.viewer.dispose();
  }

  private showFrame(): void {
    const { device, frame } = this;
    if (!device || !frame || !this.isFrameNew) return;
    this.isFrameNew = false;
    if (frame.vertices && !this.viewer.body.isEmpty) this.viewer.body.deform(frame.vertices);
    const truth = isTruthShown.peek() ? frame.trueVertices : null;
    if (truth && !this.trueBody.isEmpty) this.trueBody.deform(truth);
    this.trueBody.setVisible(truth !== null);
    this.moveCords(frame.cords ?? this.rest, frame.signals);
    this.markers.set(frame.markers, (k) => markerColor(frame.radius[k]!, device.markerRadius));
    const trackColor = this.isDark ? TRACK_COLOR_DARK : TRACK_COLOR_LIGHT;
    this.tracks.set(frame.tracks ?? new Float32Array(), () => trackColor);
    if (!this.hasBounds && frame.markers.length > 0) this.lookAt(frame.markers);
  }

  /** Create the cords, at rest. */
  private createCords(): void {
    const device = this.device;
    if (!device) return;
    this.paths = Array.from(this.counts, (count) => Array.from({ length: count }, () => [0, 0, 0]));
    const cords = this.paths.map((path, k) => ({
      name: this.cordName(k),
      color: this.cordColor(k, 0),
      path,
      isVisible: true,
    }));
    this.movePaths(this.rest);
    this.viewer.cords.set(cords, device.cordRadius);
  }

  /** Move the cords to points (p, 3) and color them by the signals of their channels. */
  private moveCords(points: NumberArray, signals: NumberArray): void {
    this.movePaths(points);
    for (const [k, path] of this.paths.entries()) {
      this.viewer.cords.setPath(this.cordName(k), path);
      this.viewer.cords.setColor(this.cordName(k), this.cordColor(k, signals[k]!));
    }
  }

  /** Write points (p, 3) of all cords to the paths. */
  private movePaths(points: NumberArray): void {
    let at = 0;
    for (const path of this.paths) {
      for (const point of path) {
        for (let axis = 0; axis < 3; axis++) point[axis] = points[at++]!;
      }
    }
  }

  private cordName(index: number): string {
    return this.device!.channels[index] ?? `cord ${index + 1}`;
  }

  private cordColor(index: number, signal: number): string {
    const { low, high } = this.device!;
    return cordColor(signal, low[index] ?? 0, high[index] ?? 0, this.isDark);
  }

  /** Point the camera at markers, which are all that is known of the device. */
  private lookAt(points: NumberArray): void {
    this.hasBounds = true;
    this.viewer.rig.setBounds(new Box3().setFromArray(points));
    this.viewer.rig.look("home", false);
  }
}
