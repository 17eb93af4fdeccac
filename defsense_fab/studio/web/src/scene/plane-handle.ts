// The handle of a plane: an arrow along its normal, and two arcs that turn it.
import { Plane, Vector3 } from "three";
import { HandleButton } from "./handle-button";
import { screenStep } from "./screen-steps";
import type { Frame } from "./types";
import type { Viewer } from "./viewer";

const SIZE_PX = 84;
const ARC_DEG = [18, 72] as const;
const ARC_POINTS = 12;
const STEP_MM = 0.5;
const STEP_DEG = 1;
const LARGE_STEPS = 10;
/** Planes of rotation seen flatter than this are turned by the distance on the screen. */
const SMALLEST_SINE = 0.2;
const SVG = "http://www.w3.org/2000/svg";

export interface PlaneEvents {
  /** The plane is moved; the text says by how much, for a readout at the pixel. */
  onDrag(frame: Frame, text: string, pixel: [number, number]): void;
  onDrop(): void;
  onCancel(): void;
}

export class PlaneHandle {
  private frame: Frame | null = null;
  /** Frame and pointer at the begin of a drag. */
  private start: { frame: Frame; value: number } | null = null;
  private readonly center = new Vector3();
  private readonly shift: HandleButton;
  private readonly turns: HandleButton[];
  private readonly svg = document.createElementNS(SVG, "svg");
  private readonly arrow = document.createElementNS(SVG, "path");
  private readonly arcs = [0, 1].map(() => document.createElementNS(SVG, "polyline"));
  private readonly stopListening: () => void;

  constructor(
    private readonly viewer: Viewer,
    private readonly events: PlaneEvents,
  ) {
    this.svg.setAttribute("class", "viewer-lines");
    this.svg.setAttribute("aria-hidden", "true");
    this.arrow.setAttribute("class", "arrow");
    this.svg.append(this.arrow, ...this.arcs);
    for (const arc of this.arcs) arc.setAttribute("class", "arc");
    viewer.overlay.append(this.svg);
    const end = {
      onDrop: () => {
        this.start = null;
        this.events.onDrop();
      },
      onCancel: () => {
        this.start = null;
        this.events.onCancel();
      },
    };
    this.shift = new HandleButton(viewer, "shift", {
      ...end,
      onDrag: (x, y) => this.dragShift(x, y),
      onArrow: (right, up, isLarge) => {
        const normal = this.axis(this.frame!, 2);
        const steps = screenStep(viewer.rig.camera, normal, right, up);
        const distance = steps * STEP_MM * (isLarge ? LARGE_STEPS : 1);
        this.report(shifted(this.frame!, distance), distanceText(distance), this.tip());
        end.onDrop();
      },
    });
    this.shift.setName("Move the plane along its normal");
    this.turns = [0, 1].map((axis) => {
      const button = new HandleButton(viewer, "turn", {
        ...end,
        onDrag: (x, y) => this.dragTurn(axis, x, y),
        onArrow: (right, up, isLarge) => {
          const steps = screenStep(viewer.rig.camera, this.motion(this.frame!, axis), right, up);
          const degrees = steps * STEP_DEG * (isLarge ? LARGE_STEPS : 1);
          this.report(this.turned(this.frame!, axis, degrees), angleText(degrees), this.tip());
          end.onDrop();
        },
      });
      button.setName(`Turn the plane about its ${axis === 0 ? "x" : "y"} axis`);
      return button;
    });
    this.stopListening = viewer.onFrame(() => this.place());
    this.show(null, []);
  }

  /** Show the handle at the middle of points (n, 3) in a plane, or hide it. */
  show(frame: Frame | null, points: number[][]): void {
    this.frame = frame;
    if (frame && !this.start) {
      this.center.set(0, 0, 0);
      for (const point of points) this.center.add(new Vector3().fromArray(point));
      this.center.divideScalar(points.length);
    }
    this.svg.style.display = frame ? "" : "none";
    for (const { element } of [this.shift, ...this.turns]) element.hidden = !frame;
    this.viewer.refresh();
  }

  dispose(): void {
    this.stopListening();
    for (const button of [this.shift, ...this.turns]) button.dispose();
    this.svg.remove();
  }

  private dragShift(x: number, y: number): void {
    const height = this.heightAt(x, y);
    if (height === null) return;
    this.start ??= { frame: this.frame!, value: this.heightAt(...this.tip()) ?? height };
    const distance = height - this.start.value;
    this.report(shifted(this.start.frame, distance), distanceText(distance), [x, y]);
  }

  private dragTurn(axis: number, x: number, y: number): void {
    const angle = this.angleAt(axis, x, y);
    if (angle === null) return;
    if (!this.start) {
      const from = this.angleAt(axis, ...this.arcMiddle(axis));
      this.start = { frame: this.frame!, value: from ?? angle };
    }
    let degrees = Math.round(((angle - this.start.value) * 180) / Math.PI);
    degrees = ((((degrees + 180) % 360) + 360) % 360) - 180;
    this.report(this.turned(this.start.frame, axis, degrees), angleText(degrees), [x, y]);
  }

  private report(frame: Frame, text: string, pixel: [number, number]): void {
    this.frame = frame;
    this.viewer.invalidate();
    this.events.onDrag(frame, text, pixel);
  }

  /** Return the height along the normal at which a pixel's ray passes nearest to the arrow. */
  private heightAt(x: number, y: number): number | null {
    const { origin, direction } = this.viewer.rayAt(x, y);
    const normal = this.axis(this.start?.frame ?? this.frame!, 2);
    const along = normal.dot(direction);
    const denominator = 1 - along * along;
    if (denominator < 1e-3) return null;
    const toCenter = origin.sub(this.center);
    return (toCenter.dot(normal) - along * toCenter.dot(direction)) / denominator;
  }

  /** Return the angle of a pixel around an axis of the plane, radians. */
  private angleAt(axis: number, x: number, y: number): number | null {
    const frame = this.start?.frame ?? this.frame!;
    const about = this.axis(frame, axis);
    const ray = this.viewer.rayAt(x, y);
    if (Math.abs(about.dot(ray.direction)) < SMALLEST_SINE) {
      return this.screenAngle(frame, axis, x, y);
    }
    const plane = new Plane().setFromNormalAndCoplanarPoint(about, this.center);
    const hit = ray.intersectPlane(plane, new Vector3());
    if (!hit) return null;
    hit.sub(this.center);
    return Math.atan2(hit.dot(this.axis(frame, 2)), hit.dot(this.other(frame, axis)));
  }

  /** Return the distance of a pixel in the direction in which the arc turns, as an angle. */
  private screenAngle(frame: Frame, axis: number, x: number, y: number): number {
    const motion = this.motion(frame, axis);
    const [cx, cy] = this.viewer.project(this.center);
    const size = SIZE_PX * this.viewer.rig.mmPerPixel(this.center);
    const [mx, my] = this.viewer.project(this.center.clone().addScaledVector(motion, size));
    const length = Math.hypot(mx - cx, my - cy) || 1;
    return ((x - cx) * (mx - cx) + (y - cy) * (my - cy)) / length / SIZE_PX;
  }

  /** Return the direction in which the button of an arc moves when the plane is turned. */
  private motion(frame: Frame, axis: number): Vector3 {
    const middle = this.axis(frame, 2).add(this.axis(frame, 1 - axis));
    return this.axis(frame, axis).cross(middle);
  }

  private axis(frame: Frame, row: number): Vector3 {
    return new Vector3().fromArray(frame.axes[row]!);
  }

  /** Return the direction that makes a right-handed frame with the normal, around an axis. */
  private other(frame: Frame, axis: number): Vector3 {
    return this.axis(frame, 2).cross(this.axis(frame, axis));
  }

  private turned(frame: Frame, axis: number, degrees: number): Frame {
    const about = this.axis(frame, axis);
    const angle = (degrees * Math.PI) / 180;
    const turn = (v: Vector3) => v.applyAxisAngle(about, angle);
    const origin = turn(new Vector3().fromArray(frame.origin).sub(this.center)).add(this.center);
    return {
      origin: origin.toArray(),
      axes: frame.axes.map((row) => turn(new Vector3().fromArray(row)).toArray()),
    };
  }

  /** Return the pixel of the button of an arc. */
  private arcMiddle(axis: number): [number, number] {
    const frame = this.frame!;
    return this.pixel(this.axis(frame, 2), (ARC_DEG[0] + ARC_DEG[1]) / 2, this.axis(frame, 1 - axis));
  }

  private tip(): [number, number] {
    return this.pixel(this.axis(this.frame!, 2), 0, new Vector3());
  }

  /** Return the pixel at an angle from the normal toward a direction. */
  private pixel(normal: Vector3, degrees: number, toward: Vector3): [number, number] {
    const size = SIZE_PX * this.viewer.rig.mmPerPixel(this.center);
    const angle = (degrees * Math.PI) / 180;
    const point = this.center
      .clone()
      .addScaledVector(normal, size * Math.cos(angle))
      .addScaledVector(toward, size * Math.sin(angle));
    return this.viewer.project(point);
  }

  private place(): void {
    if (!this.frame) return;
    const normal = this.axis(this.frame, 2);
    const [x, y] = this.viewer.project(this.center);
    const [u, v] = this.tip();
    this.arrow.setAttribute("d", arrowPath(x, y, u, v));
    this.shift.place([u, v]);
    this.turns.forEach((button, axis) => {
      const toward = this.axis(this.frame!, 1 - axis);
      const points = Array.from({ length: ARC_POINTS + 1 }, (_, i) => {
        const degrees = ARC_DEG[0] + ((ARC_DEG[1] - ARC_DEG[0]) * i) / ARC_POINTS;
        return this.pixel(normal, degrees, toward);
      });
      this.arcs[axis]!.setAttribute("points", points.map((p) => p.join()).join(" "));
      button.place(points[ARC_POINTS >> 1]!);
    });
  }
}

/** Return a line with a filled head, around the pixel that is dragged. */
function arrowPath(x: number, y: number, u: number, v: number): string {
  const length = Math.hypot(u - x, v - y) || 1;
  const [dx, dy] = [(u - x) / length, (v - y) / length];
  const at = (along: number, across: number) =>
    `${u + along * dx - across * dy} ${v + along * dy + across * dx}`;
  return `M${x} ${y}L${at(-8, 0)}M${at(9, 0)}L${at(-8, 7)}L${at(-8, -7)}Z`;
}

function shifted({ origin, axes }: Frame, distance: number): Frame {
  return { origin: origin.map((v, k) => v + distance * axes[2]![k]!), axes };
}

function distanceText(distance: number): string {
  return `${distance.toFixed(1).replace("-", "\u2212")} mm`;
}

function angleText(degrees: number): string {
  return `${degrees}\u00b0`.replace("-", "\u2212");
}
