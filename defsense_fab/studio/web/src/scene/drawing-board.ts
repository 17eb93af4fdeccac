// A plane that faces the viewer, to draw in: grid, outline of the body, and the stroke.
import { Plane, Vector3 } from "three";
import { toPlane, toWorld } from "./curve";
import { KeyboardPen } from "./keyboard-pen";
import { Readout } from "./readout";
import { roundLength } from "./scale-bar";
import type { Frame } from "./types";
import type { Viewer } from "./viewer";

const SVG = "http://www.w3.org/2000/svg";
const MAJOR_PX = 90;
const MINOR_PARTS = 5;
/** Points of a stroke are at least this far apart. */
const STEP_PX = 2;
const HINT =
  "Drag to draw, or click points and end with a double click. " +
  '<span class="hint-keys">Keys: <kbd>←↑↓→</kbd> move the pen (<kbd>Shift</kbd> 5 mm), ' +
  "<kbd>Space</kbd> add a point, <kbd>Backspace</kbd> remove it, <kbd>Enter</kbd> finish, " +
  "<kbd>Esc</kbd> cancel, <kbd>X</kbd> <kbd>Y</kbd> <kbd>Z</kbd> plane, " +
  "<kbd>PgUp</kbd> <kbd>PgDn</kbd> offset</span>";
const CANVAS_NAME =
  "Plane to draw in; arrow keys move the pen, Space puts a point, Backspace removes the last one, " +
  "Enter on the last point finishes, Escape cancels, X, Y and Z turn the plane, " +
  "Page Up and Page Down move it";
/** Height above and below the section that is left for tools and hint. */
const MARGIN_PX = 94;
const DIMMING = 0.16;
const THINNING = 0.4;

export class DrawingBoard {
  readonly pen: KeyboardPen;
  private frame: Frame | null = null;
  private readonly usualMargin: number;
  private outline: number[][][] = [];
  private stroke: number[][] = [];
  private pointer = -1;
  private readonly svg = document.createElementNS(SVG, "svg");
  private readonly minor = path("grid minor");
  private readonly major = path("grid major");
  private readonly axes = path("grid axes");
  private readonly section = path("section");
  private readonly ink = path("ink");
  private readonly numbers = document.createElementNS(SVG, "g");
  private readonly hint = document.createElement("p");
  private readonly readout: Readout;
  private readonly stop = new AbortController();
  private readonly stopListening: () => void;

  constructor(
    private readonly viewer: Viewer,
    private readonly onStroke: (stroke: number[][]) => void,
  ) {
    this.usualMargin = viewer.rig.marginHeight;
    this.svg.setAttribute("class", "viewer-board");
    this.svg.setAttribute("aria-hidden", "true");
    this.svg.append(this.minor, this.major, this.axes, this.section, this.ink, this.numbers);
    this.svg.style.display = "none";
    viewer.overlay.append(this.svg);
    this.hint.className = "viewer-hint";
    this.hint.hidden = true;
    this.hint.innerHTML = HINT;
    viewer.overlay.append(this.hint);
    this.readout = new Readout(viewer);
    const plane = {
      isOpen: () => this.frame !== null,
      pixel: (point: number[]) => this.pixel(point),
    };
    this.pen = new KeyboardPen(viewer, this.svg, plane, onStroke);
    const { canvas } = viewer;
    const { signal } = this.stop;
    canvas.addEventListener("pointerdown", (event) => this.press(event), { signal });
    canvas.addEventListener("pointermove", (event) => this.move(event), { signal });
    canvas.addEventListener("pointerup", (event) => this.release(event), { signal });
    canvas.addEventListener("pointercancel", () => this.cancel(), { signal });
    canvas.addEventListener("pointerleave", () => this.leave(), { signal });
    this.stopListening = viewer.onFrame(() => this.place());
  }

  get isDrawing(): boolean {
    return this.pointer >= 0;
  }

  /** Face a plane, or leave it. */
  open(frame: Frame | null): void {
    const { viewer } = this;
    const isSameView = frame && this.frame && isParallel(frame, this.frame);
    this.frame = frame;
    this.cancel();
    this.outline = [];
    this.svg.style.display = frame ? "" : "none";
    this.hint.hidden = frame === null;
    viewer.nameCanvas(frame ? CANVAS_NAME : null);
    viewer.canvas.classList.toggle("drawing", frame !== null);
    viewer.picker.isEnabled = frame === null;
    viewer.setPlain(frame !== null);
    viewer.rig.marginHeight = frame ? MARGIN_PX : this.usualMargin;
    viewer.body.setDimming(frame ? DIMMING : 1);
    viewer.cords.setThinning(frame ? THINNING : 1);
    this.readout.hide();
    if (!frame) {
      viewer.rig.leave();
      this.pen.hide();
    } else if (!isSameView) {
      this.svg.style.visibility = "hidden"; // until the view has turned and points can be put
      viewer.rig.face(frame);
      this.pen.reset(toPlane(frame, viewer.body.box.getCenter(new Vector3()).toArray()));
    }
    viewer.refresh();
  }

  /** Show the outline of the body: segments (s, 2, 2) in the plane, mm. */
  setOutline(segments: number[][][]): void {
    this.outline = segments;
    this.viewer.refresh();
  }

  /** Discard the stroke that is drawn. */
  cancel(): void {
    this.pointer = -1;
    this.stroke = [];
    this.viewer.refresh();
  }

  dispose(): void {
    if (this.frame) this.open(null);
    this.stop.abort();
    this.stopListening();
    this.readout.dispose();
    this.pen.dispose();
    this.hint.remove();
    this.svg.remove();
  }

  private press(event: PointerEvent): void {
    if (!this.frame || event.button !== 0 || this.viewer.rig.isTurning) return;
    if (!event.isPrimary) {
      this.cancel(); // two fingers move the view
      return;
    }
    this.pointer = event.pointerId;
    this.viewer.canvas.setPointerCapture(event.pointerId);
    this.stroke = [];
    this.extend(event);
  }

  private move(event: PointerEvent): void {
    if (!this.frame || this.viewer.rig.isTurning) return;
    // Where points were put by clicks, a drag only moves the next one.
    if (event.pointerId === this.pointer && !this.pen.hasPoints) {
      for (const part of event.getCoalescedEvents()) this.extend(part);
      this.extend(event);
    }
    const [x, y] = this.viewer.local(event);
    const [u, v] = this.planePoint(x, y);
    this.pen.follow([u!, v!]);
    this.readout.show(x, y, `x ${u!.toFixed(1)}, y ${v!.toFixed(1)} mm`);
    this.viewer.refresh();
  }

  private release(event: PointerEvent): void {
    if (this.pointer < 0) return;
    const { stroke } = this;
    this.pointer = -1;
    if (stroke.length > 2) return this.onStroke(stroke);
    this.cancel();
    this.pen.click(this.planePoint(...this.viewer.local(event)));
  }

  private leave(): void {
    this.readout.hide();
    this.pen.follow(null);
  }

  private extend(event: PointerEvent): void {
    const point = this.planePoint(...this.viewer.local(event));
    const last = this.stroke.at(-1);
    const step = STEP_PX * this.viewer.rig.mmPerPixel(this.viewer.rig.controls.target);
    if (last && Math.hypot(point[0]! - last[0]!, point[1]! - last[1]!) < step) return;
    this.stroke.push(point);
  }

  private planePoint(x: number, y: number): number[] {
    const frame = this.frame!;
    const plane = new Plane().setFromNormalAndCoplanarPoint(
      new Vector3().fromArray(frame.axes[2]!),
      new Vector3().fromArray(frame.origin),
    );
    const hit = this.viewer.rayAt(x, y).intersectPlane(plane, new Vector3());
    return hit ? toPlane(frame, hit.toArray()) : [0, 0];
  }

  private place(): void {
    if (!this.frame) return;
    const isShown = !this.viewer.rig.isTurning;
    this.svg.style.visibility = isShown ? "visible" : "hidden";
    if (!isShown) return;
    this.placeGrid();
    const pixel = (point: number[]) => this.pixel(point);
    this.section.setAttribute(
      "d",
      this.outline.map(([a, b]) => `M${pixel(a!)}L${pixel(b!)}`).join(""),
    );
    const line = this.stroke.map(pixel).join("L");
    this.ink.setAttribute("d", line && `M${line}`);
    this.pen.draw();
  }

  private placeGrid(): void {
    const { width, height, rig } = this.viewer;
    const spacing = roundLength(1.6 * MAJOR_PX * rig.mmPerPixel(rig.controls.target));
    const [left, top] = this.planePoint(0, 0);
    const [right, bottom] = this.planePoint(width, height);
    const lines = { minor: "", major: "", axes: "" };
    const texts: SVGTextElement[] = [];
    const step = spacing / MINOR_PARTS;
    const add = (index: number, line: string, text: () => SVGTextElement) => {
      if (index === 0) lines.axes += line;
      else if (index % MINOR_PARTS === 0) lines.major += line;
      else lines.minor += line;
      if (index % MINOR_PARTS === 0) texts.push(text());
    };
    for (let i = Math.ceil(left! / step); i * step < right!; i++) {
      const x = Math.round(this.pixel([i * step, 0])[0]) + 0.5;
      add(i, `M${x} 0V${height}`, () => gridNumber(i * step, x + 4, height - 8));
    }
    for (let i = Math.ceil(bottom! / step); i * step < top!; i++) {
      const y = Math.round(this.pixel([0, i * step])[1]) + 0.5;
      add(i, `M0 ${y}H${width}`, () => gridNumber(i * step, 8, y - 4));
    }
    this.minor.setAttribute("d", lines.minor);
    this.major.setAttribute("d", lines.major);
    this.axes.setAttribute("d", lines.axes);
    this.numbers.replaceChildren(...texts);
  }

  private pixel(point: number[]): [number, number] {
    return this.viewer.project(new Vector3().fromArray(toWorld(this.frame!, point)));
  }
}

function path(name: string): SVGPathElement {
  const element = document.createElementNS(SVG, "path");
  element.setAttribute("class", name);
  return element;
}

function gridNumber(value: number, x: number, y: number): SVGTextElement {
  const text = document.createElementNS(SVG, "text");
  text.setAttribute("x", `${x}`);
  text.setAttribute("y", `${y}`);
  text.textContent = `${Number(value.toPrecision(4))}`;
  return text;
}

function isParallel(a: Frame, b: Frame): boolean {
  return a.axes.every((axis, i) => axis.every((v, k) => Math.abs(v - b.axes[i]![k]!) < 1e-6));
}
