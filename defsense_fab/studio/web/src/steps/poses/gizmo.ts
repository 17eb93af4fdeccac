// A gizmo: three rings that turn and three arrows that move, with the angle and the way shown.
import { Plane, Vector3 } from "three";
import { Readout } from "../../scene/readout";
import { screenStep } from "../../scene/screen-steps";
import type { Viewer } from "../../scene/viewer";
import { plain, signedDegrees } from "./rotations";

export interface GizmoPlace {
  /** What it moves, for names of its parts, such as "tip". */
  name: string;
  center: number[];
  canTurn: boolean;
  canShift: boolean;
  /** Text above it. */
  title: string;
}

export interface GizmoEvents {
  /** It was turned by an angle about an axis of the world since the press; radians. */
  onTurn(axis: Vector3, radians: number): void;
  /** It was moved by (3,) mm since the press. */
  onShift(by: Vector3): void;
  /** The pointer or the key was released. */
  onDrop(): void;
  onCancel(): void;
  /** A key turns it about an axis by radians, or moves it along one by mm. */
  onStep(kind: "ring" | "arrow", axis: Vector3, value: number): void;
  /** The whole rotation or position, in words; the second line of the readout. */
  describe(): string;
}

/** Radius of the rings, and the share of a small scene that it may take. */
const RING_PX = 86;
const RING_SHARE = 0.2;
const HEAD_PX = 12;
const RING_POINTS = 72;
/** Distance of the name of a ring's axis, in radii, and how far it leaves the widest place. */
const LABEL_REACH = 1.13;
const LABEL_TURN = 0.15;
const TITLE_GAP_PX = 22;
const AXES = ["x", "y", "z"] as const;
const UNITS = [new Vector3(1, 0, 0), new Vector3(0, 1, 0), new Vector3(0, 0, 1)];
/** Rings seen flatter than this are turned by the distance on the screen. */
const SMALLEST_SINE = 0.18;
const DEGREE = Math.PI / 180;
const SVG = "http://www.w3.org/2000/svg";

interface Part {
  kind: "ring" | "arrow";
  axis: number;
  front: SVGPathElement;
  back: SVGPathElement;
  hit: SVGPathElement;
  /** Name of a ring's axis, at the ring. */
  label: SVGTextElement | null;
}

interface Drag {
  part: Part;
  center: Vector3;
  start: number;
  last: number;
  turns: number;
  pointer: number;
  pixel: [number, number];
}

export class Gizmo {
  private readonly svg = document.createElementNS(SVG, "svg");
  private readonly sector = document.createElementNS(SVG, "path");
  private readonly parts: Part[];
  private readonly readout: Readout;
  private readonly title = document.createElement("div");
  private readonly center = new Vector3();
  private readonly stopListening: () => void;
  private place: GizmoPlace | null = null;
  private drag: Drag | null = null;
  private frame = 0;

  constructor(
    private readonly viewer: Viewer,
    private readonly events: GizmoEvents,
    /** Where arrows begin and end, from the center. */
    private readonly arrowPx: readonly [number, number] = [26, 64],
  ) {
    this.svg.setAttribute("class", "gizmo");
    this.sector.setAttribute("class", "gizmo-sector");
    this.svg.append(this.sector);
    this.parts = (["ring", "arrow"] as const).flatMap((kind) =>
      AXES.map((_, axis) => this.makePart(kind, axis)),
    );
    this.title.className = "gizmo-title";
    viewer.overlay.append(this.svg, this.title);
    this.readout = new Readout(viewer);
    this.stopListening = viewer.onFrame(() => this.arrange());
    this.show(null);
  }

  get isDragged(): boolean {
    return this.drag !== null;
  }

  /** Show the gizmo at a place, or hide it; it stays where it is while it is dragged. */
  show(place: GizmoPlace | null): void {
    this.place = place;
    this.svg.style.display = place ? "" : "none";
    this.title.hidden = !place?.title;
    this.title.textContent = place?.title ?? "";
    if (!place) {
      this.end();
      return;
    }
    for (const { kind, axis, hit } of this.parts) {
      const isShown = kind === "ring" ? place.canTurn : place.canShift;
      (hit.parentNode as SVGElement).style.display = isShown ? "" : "none";
      const verb = kind === "ring" ? "Turn" : "Move";
      const along = kind === "ring" ? "about" : "along";
      hit.setAttribute("aria-label", `${verb} ${place.name} ${along} ${AXES[axis]}`);
      hit.setAttribute("aria-valuetext", this.events.describe());
    }
    this.viewer.refresh();
  }

  dispose(): void {
    this.stopListening();
    cancelAnimationFrame(this.frame);
    this.svg.remove();
    this.title.remove();
    this.readout.dispose();
  }

  private makePart(kind: Part["kind"], axis: number): Part {
    const group = document.createElementNS(SVG, "g");
    group.setAttribute("class", `gizmo-part ${kind} axis-${AXES[axis]}`);
    const [back, front, hit] = ["back", "front", "hit"].map((name) => {
      const path = document.createElementNS(SVG, "path");
      path.setAttribute("class", name);
      return path;
    }) as [SVGPathElement, SVGPathElement, SVGPathElement];
    hit.setAttribute("tabindex", "0");
    hit.setAttribute("role", "slider");
    hit.setAttribute("aria-valuenow", "0");
    group.append(back, front, hit);
    const label = kind === "ring" ? document.createElementNS(SVG, "text") : null;
    if (label) {
      label.textContent = AXES[axis]!;
      label.setAttribute("aria-hidden", "true");
      group.append(label);
    }
    this.svg.append(group);
    const part = { kind, axis, front, back, hit, label };
    hit.addEventListener("pointerdown", (event) => this.press(part, event));
    hit.addEventListener("pointermove", (event) => this.move(event));
    hit.addEventListener("pointerup", (event) => this.release(event));
    hit.addEventListener("pointercancel", () => this.cancel());
    hit.addEventListener("keydown", (event) => this.onKey(part, event));
    return part;
  }

  // The pointer

  private press(part: Part, event: PointerEvent): void {
    if (event.button !== 0 || !this.place) return;
    event.preventDefault();
    event.stopPropagation();
    part.hit.focus({ preventScroll: true, focusVisible: false } as FocusOptions);
    part.hit.setPointerCapture(event.pointerId);
    const pixel = this.viewer.local(event);
    const center = new Vector3().fromArray(this.place.center);
    const start = this.valueAt(part, center, pixel);
    if (start === null) return;
    this.drag = { part, center, start, last: start, turns: 0, pointer: event.pointerId, pixel };
    (part.hit.parentNode as SVGElement).classList.add("dragged");
    this.svg.classList.add("dragging");
  }

  private move(event: PointerEvent): void {
    if (!this.drag) return;
    this.drag.pixel = this.viewer.local(event);
    const isFine = event.ctrlKey || event.metaKey;
    const isCoarse = event.shiftKey;
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this.report(isFine, isCoarse);
    });
  }

  private report(isFine: boolean, isCoarse: boolean): void {
    const { drag } = this;
    if (!drag) return;
    const value = this.valueAt(drag.part, drag.center, drag.pixel);
    if (value === null) return;
    if (drag.part.kind === "ring") {
      if (value - drag.last > Math.PI) drag.turns--;
      if (value - drag.last < -Math.PI) drag.turns++;
    }
    drag.last = value;
    const total = value + 2 * Math.PI * drag.turns - drag.start;
    const step = stepOf(drag.part.kind, isFine, isCoarse);
    this.apply(drag.part, Math.round(total / step) * step);
    this.title.hidden = true;
    this.showReadout(drag.part, Math.round(total / step) * step, drag.pixel);
  }

  private apply({ kind, axis }: Part, value: number): void {
    const unit = UNITS[axis]!.clone();
    if (kind === "ring") this.events.onTurn(unit, value);
    else this.events.onShift(unit.multiplyScalar(value));
    this.viewer.refresh();
  }

  private showReadout({ kind, axis }: Part, value: number, [x, y]: [number, number]): void {
    const text =
      kind === "ring"
        ? `${value > 0 ? "+" : ""}${signedDegrees(value / DEGREE)} about ${AXES[axis]}`
        : `${value > 0 ? "+" : ""}${plain(value)} mm along ${AXES[axis]}`;
    this.readout.show(x, y, `${text}\n${this.events.describe()}`);
  }

  private release(event: PointerEvent): void {
    if (!this.drag) return;
    const isMoved = this.frame !== 0 || this.drag.last !== this.drag.start || this.drag.turns !== 0;
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    if (isMoved) {
      this.report(event.ctrlKey || event.metaKey, event.shiftKey);
      this.end();
      this.events.onDrop();
    } else this.end();
  }

  private cancel(): void {
    if (!this.drag) return;
    this.end();
    this.events.onCancel();
  }

  private end(): void {
    const { drag } = this;
    this.drag = null;
    if (drag) {
      (drag.part.hit.parentNode as SVGElement).classList.remove("dragged");
      if (drag.part.hit.hasPointerCapture(drag.pointer)) {
        drag.part.hit.releasePointerCapture(drag.pointer);
      }
    }
    this.svg.classList.remove("dragging");
    this.title.hidden = !this.place?.title;
    this.sector.setAttribute("d", "");
    this.readout.hide();
    this.viewer.refresh();
  }

  private onKey(part: Part, event: KeyboardEvent): void {
    if (event.key === "Escape" && this.drag) this.cancel();
    else if (event.key === "ArrowRight") this.step(part, event, 1, 0);
    else if (event.key === "ArrowLeft") this.step(part, event, -1, 0);
    else if (event.key === "ArrowUp") this.step(part, event, 0, 1);
    else if (event.key === "ArrowDown") this.step(part, event, 0, -1);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** Arrows follow the screen; for rings, up and right turn by a positive angle. */
  private step(part: Part, event: KeyboardEvent, right: number, up: number): void {
    const isRing = part.kind === "ring";
    const { camera } = this.viewer.rig;
    const sign = isRing ? right + up : screenStep(camera, UNITS[part.axis]!, right, up);
    const value = sign * (isRing ? DEGREE : 1) * (event.shiftKey ? 10 : 1);
    this.events.onStep(part.kind, UNITS[part.axis]!.clone(), value);
  }

  // Geometry

  /** Factor by which the gizmo is smaller in a small scene, such as that of a phone. */
  private get scale(): number {
    return Math.min(1, (RING_SHARE * Math.min(this.viewer.width, this.viewer.height)) / RING_PX);
  }

  /** The angle around a ring, or the way along an arrow, at a pixel. */
  private valueAt(part: Part, center: Vector3, [x, y]: [number, number]): number | null {
    const axis = UNITS[part.axis]!;
    const ray = this.viewer.rayAt(x, y);
    if (part.kind === "arrow") {
      const along = axis.dot(ray.direction);
      const denominator = 1 - along * along;
      if (denominator < 1e-3) return null;
      const from = ray.origin.sub(center);
      return (from.dot(axis) - along * from.dot(ray.direction)) / denominator;
    }
    const [u, v] = around(part.axis);
    if (Math.abs(axis.dot(ray.direction)) < SMALLEST_SINE) {
      return this.flatAngle(axis, center, [x, y]);
    }
    const hit = ray.intersectPlane(new Plane().setFromNormalAndCoplanarPoint(axis, center), new Vector3());
    if (!hit) return null;
    hit.sub(center);
    return Math.atan2(hit.dot(v), hit.dot(u));
  }

  /** The angle of a ring that is seen from its side, by the way on the screen. */
  private flatAngle(axis: Vector3, center: Vector3, [x, y]: [number, number]): number {
    const view = this.viewer.rig.camera.getWorldDirection(new Vector3()).negate();
    const motion = axis.clone().cross(view).normalize();
    const radius = RING_PX * this.scale;
    const size = radius * this.viewer.rig.mmPerPixel(center);
    const [cx, cy] = this.viewer.project(center);
    const [mx, my] = this.viewer.project(center.clone().addScaledVector(motion, size));
    const length = Math.hypot(mx - cx, my - cy) || 1;
    return ((x - cx) * (mx - cx) + (y - cy) * (my - cy)) / length / radius;
  }

  private arrange(): void {
    if (!this.place) return;
    if (this.drag) this.center.copy(this.drag.center);
    else this.center.fromArray(this.place.center);
    const mm = this.scale * this.viewer.rig.mmPerPixel(this.center);
    this.arrangeTitle();
    for (const part of this.parts) {
      if (part.kind === "ring") this.arrangeRing(part, mm);
      else this.arrangeArrow(part, mm);
    }
  }

  private arrangeTitle(): void {
    const [x, y] = this.viewer.project(this.center);
    const { offsetWidth: width, offsetHeight: height } = this.title;
    const left = Math.min(Math.max(x - width / 2, TITLE_GAP_PX), this.viewer.width - width - TITLE_GAP_PX);
    const radius = RING_PX * this.scale;
    const above = y - radius - TITLE_GAP_PX - height;
    const box = { left, top: above, right: left + width, bottom: above + height };
    const isFree = above > TITLE_GAP_PX && !this.viewer.covered.has(box);
    const top = isFree ? above : y + radius + TITLE_GAP_PX;
    this.title.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
  }

  private arrangeRing({ axis, front, back, hit, label }: Part, mm: number): void {
    const [u, v] = around(axis);
    const view = this.viewer.rig.camera.position.clone().sub(this.center);
    let [near, far] = ["", ""];
    let wasNear = false;
    let [labelAt, farthest] = [u, -1];
    const [cx, cy] = this.viewer.project(this.center);
    for (let i = 0; i <= RING_POINTS; i++) {
      const angle = (2 * Math.PI * i) / RING_POINTS;
      const spoke = u.clone().multiplyScalar(Math.cos(angle)).addScaledVector(v, Math.sin(angle));
      const isNear = spoke.dot(view) >= 0;
      const pixel = this.pixel(spoke, RING_PX * mm);
      if (i > 0) {
        if (wasNear) near += `L${pixel}`;
        else far += `L${pixel}`;
      }
      if (i === 0 || isNear !== wasNear) {
        if (isNear) near += `M${pixel}`;
        else far += `M${pixel}`;
      }
      wasNear = isNear;
      const [x, y] = this.viewer.project(this.center.clone().addScaledVector(spoke, RING_PX * mm));
      const distance = isNear ? Math.hypot(x - cx, y - cy) * (1 - LABEL_TURN * Math.cos(angle)) : -1;
      if (distance > farthest) [labelAt, farthest] = [spoke, distance];
    }
    const [x, y] = this.viewer.project(this.center.clone().addScaledVector(labelAt, LABEL_REACH * RING_PX * mm));
    label?.setAttribute("x", x.toFixed(1));
    label?.setAttribute("y", y.toFixed(1));
    front.setAttribute("d", near);
    back.setAttribute("d", far);
    hit.setAttribute("d", near);
    if (this.drag?.part.axis === axis && this.drag.part.kind === "ring") this.drawSector(u, v, mm);
  }

  private drawSector(u: Vector3, v: Vector3, mm: number): void {
    const { start, last, turns } = this.drag!;
    const end = last + 2 * Math.PI * turns;
    const count = Math.max(2, Math.ceil(Math.abs(end - start) / (3 * DEGREE)));
    const points = Array.from({ length: count + 1 }, (_, i) => {
      const angle = start + ((end - start) * i) / count;
      const spoke = u.clone().multiplyScalar(Math.cos(angle)).addScaledVector(v, Math.sin(angle));
      return this.pixel(spoke, RING_PX * mm);
    });
    const [x, y] = this.viewer.project(this.center);
    this.sector.setAttribute("d", `M${x} ${y}L${points.join("L")}Z`);
  }

  private arrangeArrow({ axis, front, back, hit }: Part, mm: number): void {
    const unit = UNITS[axis]!;
    const from = this.viewer.project(this.center.clone().addScaledVector(unit, this.arrowPx[0] * mm));
    const to = this.viewer.project(this.center.clone().addScaledVector(unit, this.arrowPx[1] * mm));
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const length = Math.hypot(dx, dy);
    const isHidden = length < 8;
    (front.parentNode as SVGElement).classList.toggle("end-on", isHidden);
    const [ux, uy] = [dx / (length || 1), dy / (length || 1)];
    const base = [to[0] - HEAD_PX * ux, to[1] - HEAD_PX * uy] as const;
    const side = HEAD_PX * 0.42;
    const line = `M${from[0]} ${from[1]}L${to[0]} ${to[1]}`;
    back.setAttribute("d", line);
    hit.setAttribute("d", line);
    front.setAttribute(
      "d",
      `M${to[0]} ${to[1]}L${base[0] - side * uy} ${base[1] + side * ux}` +
        `L${base[0] + side * uy} ${base[1] - side * ux}Z`,
    );
  }

  private pixel(spoke: Vector3, radius: number): string {
    const [x, y] = this.viewer.project(this.center.clone().addScaledVector(spoke, radius));
    return `${x.toFixed(1)} ${y.toFixed(1)}`;
  }
}

/** Two unit vectors across an axis, which make a right-handed frame with it. */
function around(axis: number): [Vector3, Vector3] {
  return [UNITS[(axis + 1) % 3]!.clone(), UNITS[(axis + 2) % 3]!.clone()];
}

/** The step of a drag: whole degrees and half millimeters, finer with Ctrl, larger with Shift. */
function stepOf(kind: Part["kind"], isFine: boolean, isCoarse: boolean): number {
  if (kind === "ring") return (isCoarse ? 15 : isFine ? 0.1 : 1) * DEGREE;
  return isCoarse ? 5 : isFine ? 0.1 : 0.5;
}
