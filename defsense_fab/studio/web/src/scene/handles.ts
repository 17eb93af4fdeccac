// The handles of a cord: its control points, and the tangents of the selected one.
import { Plane, Vector3 } from "three";
import { pointToWorld, toPlane } from "./curve";
import { HandleButton } from "./handle-button";
import { PointAxes } from "./point-axes";
import { screenSteps } from "./screen-steps";
import type { CordShape } from "./types";
import type { Viewer } from "./viewer";

const STEP_MM = 0.5;
const LARGE_STEP_MM = 5;
/** Tangents are drawn at a third of their length, as far as the curve follows them. */
const TANGENT_SHARE = 1 / 3;
const SVG = "http://www.w3.org/2000/svg";

export type HandleKind = "point" | "tangent";

export interface HandleEvents {
  onSelect(index: number): void;
  /** A point or tangent is dragged to coordinates of the shape; the pointer is at a pixel. */
  onDrag(kind: HandleKind, index: number, to: number[], pixel: [number, number]): void;
  onDrop(): void;
  onCancel(): void;
  /** A point is moved by a key. */
  onMove(index: number, to: number[]): void;
  onDelete(index: number): void;
  /** A menu of a point is requested at a place of the window. */
  onMenu(index: number, x: number, y: number): void;
}

export class CordHandles {
  private shape: CordShape | null = null;
  private name = "";
  private color = "";
  private selected = -1;
  private points: HandleButton[] = [];
  private tangents: HandleButton[] = [];
  private readonly svg = document.createElementNS(SVG, "svg");
  private readonly lines = [0, 1].map(() => document.createElementNS(SVG, "line"));
  private readonly axisLabels: PointAxes;
  private readonly stopListening: () => void;
  private readonly at = new Vector3();

  constructor(
    private readonly viewer: Viewer,
    private readonly events: HandleEvents,
  ) {
    this.svg.setAttribute("class", "viewer-lines");
    this.svg.setAttribute("aria-hidden", "true");
    this.svg.append(...this.lines);
    viewer.overlay.append(this.svg);
    this.axisLabels = new PointAxes(viewer);
    this.stopListening = viewer.onFrame(() => this.place());
  }

  /** Pixels of the control points. */
  pixels(): [number, number][] {
    const { shape } = this;
    return (shape?.points ?? []).map((point) => this.pixel(pointToWorld(shape!, point)));
  }

  /** Show the handles of a cord, or none. */
  show(name: string, color: string, shape: CordShape | null): void {
    if (name !== this.name) this.selected = -1;
    [this.name, this.color, this.shape] = [name, color, shape];
    const count = shape?.points.length ?? 0;
    while (this.points.length > count) this.points.pop()!.dispose();
    while (this.points.length < count) this.points.push(this.pointButton(this.points.length));
    if (this.selected >= count) this.selected = -1;
    this.style();
  }

  /** Select a control point, -1 for none. */
  select(index: number, hasFocus = false): void {
    this.selected = index;
    this.style();
    if (hasFocus) this.points[index]?.element.focus();
  }

  dispose(): void {
    this.stopListening();
    for (const button of [...this.points, ...this.tangents]) button.dispose();
    this.axisLabels.dispose();
    this.svg.remove();
  }

  private style(): void {
    this.points.forEach((button, i) => {
      button.setName(`${this.name}, point ${i + 1} of ${this.points.length}`);
      button.element.ariaPressed = String(i === this.selected);
      button.element.style.setProperty("--handle", this.color);
    });
    const ends = this.shape && this.selected >= 0 ? 2 : 0;
    while (this.tangents.length > ends) this.tangents.pop()!.dispose();
    for (let end = this.tangents.length; end < ends; end++) {
      this.tangents.push(this.tangentButton(end));
    }
    this.viewer.refresh();
  }

  private pointButton(index: number): HandleButton {
    return new HandleButton(this.viewer, "point", {
      onSelect: () => {
        this.select(index);
        this.events.onSelect(index);
      },
      onDrag: (x, y) => {
        const to = this.shapePoint(x, y, this.shape!.points[index]!);
        if (to) this.events.onDrag("point", index, to, [x, y]);
      },
      onDrop: () => this.events.onDrop(),
      onCancel: () => this.events.onCancel(),
      onArrow: (right, up, isLarge) => {
        const step = isLarge ? LARGE_STEP_MM : STEP_MM;
        const to = this.stepped(this.shape!.points[index]!, right * step, up * step);
        this.events.onMove(index, to);
      },
      onDelete: () => this.events.onDelete(index),
      onMenu: (x, y) => this.events.onMenu(index, x, y),
    });
  }

  private tangentButton(end: number): HandleButton {
    const sign = end === 0 ? 1 : -1;
    const send = (tangent: number[], pixel: [number, number]) =>
      this.events.onDrag("tangent", this.selected, tangent, pixel);
    const button = new HandleButton(this.viewer, "tangent", {
      onDrag: (x, y) => {
        const point = this.shape!.points[this.selected]!;
        const to = this.shapePoint(x, y, point);
        if (to) send(to.map((v, k) => (sign * (v - point[k]!)) / TANGENT_SHARE), [x, y]);
      },
      onDrop: () => this.events.onDrop(),
      onCancel: () => this.events.onCancel(),
      onArrow: (right, up, isLarge) => {
        const step = (isLarge ? LARGE_STEP_MM : STEP_MM) * sign;
        const tangent = this.shape!.tangents[this.selected]!;
        send(this.stepped(tangent, right * step, up * step), this.pixel(this.tangentEnd(end)));
        this.events.onDrop();
      },
      onMenu: (x, y) => this.events.onMenu(this.selected, x, y),
    });
    button.setName(`${end === 0 ? "Forward" : "Backward"} tangent`);
    return button;
  }

  /** Return a point moved along the axes that are nearest to the directions on the screen. */
  private stepped(point: number[], right: number, up: number): number[] {
    const steps = screenSteps(this.viewer.rig.camera, this.axes(), right, up);
    return point.map((v, k) => v + steps[k]!);
  }

  /** Return the axes of the cord's coordinates: two in a plane, or those of space. */
  private axes(): Vector3[] {
    const { isPlanar, frame } = this.shape!;
    const rows = isPlanar ? frame.axes.slice(0, 2) : [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    return rows.map((row) => new Vector3().fromArray(row));
  }

  /** Return the point of the cord's plane, or of the view's through `near`, at a pixel. */
  private shapePoint(x: number, y: number, near: number[]): number[] | null {
    const shape = this.shape!;
    const { origin, axes } = shape.frame;
    const normal = shape.isPlanar
      ? new Vector3().fromArray(axes[2]!)
      : this.viewer.rig.camera.getWorldDirection(new Vector3());
    const through = new Vector3().fromArray(shape.isPlanar ? origin : near);
    const plane = new Plane().setFromNormalAndCoplanarPoint(normal, through);
    const hit = this.viewer.rayAt(x, y).intersectPlane(plane, new Vector3());
    if (!hit) return null;
    return shape.isPlanar ? toPlane(shape.frame, hit.toArray()) : hit.toArray();
  }

  private tangentEnd(end: number): number[] {
    const shape = this.shape!;
    const [point, tangent] = [shape.points[this.selected]!, shape.tangents[this.selected]!];
    const share = end === 0 ? TANGENT_SHARE : -TANGENT_SHARE;
    return pointToWorld(shape, point.map((v, k) => v + share * tangent[k]!));
  }

  private pixel(point: number[]): [number, number] {
    return this.viewer.project(this.at.fromArray(point));
  }

  private place(): void {
    const { shape } = this;
    this.svg.style.visibility = this.tangents.length ? "visible" : "hidden";
    const chosen = shape?.points[this.selected];
    this.axisLabels.place(chosen ? pointToWorld(shape!, chosen) : null, chosen ? this.axes() : []);
    if (!shape) return;
    const pixels = this.pixels();
    this.points.forEach((button, i) => button.place(pixels[i]!));
    if (!this.tangents.length) return;
    const [x, y] = pixels[this.selected]!;
    this.tangents.forEach((button, end) => {
      const [u, v] = this.pixel(this.tangentEnd(end));
      button.place([u, v]);
      const line = this.lines[end]!;
      for (const [key, value] of Object.entries({ x1: x, y1: y, x2: u, y2: v })) {
        line.setAttribute(key, `${value}`);
      }
    });
  }
}
