// A pen that puts points in a plane, by keys or by clicks; a smooth stroke goes through them.
import { signal } from "@preact/signals";
import { catmullRom, samplePath } from "./curve";
import { Readout } from "./readout";
import type { Viewer } from "./viewer";

const SVG = "http://www.w3.org/2000/svg";
const STEP_MM = 0.5;
const LARGE_STEP_MM = 5;
/** The view follows the pen before it is this close to an edge. */
const MARGIN_PX = 70;
/** A click this close to the last point ends the stroke. */
const CLOSE_PX = 8;
const CROSS_PX = 9;
const DOT_PX = 3.5;
const MOVES: Record<string, [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowDown: [0, -1],
  ArrowUp: [0, 1],
};

export interface PenPlane {
  /** Whether a plane is drawn in. */
  isOpen(): boolean;
  /** Pixel of a point of the plane. */
  pixel(point: number[]): [number, number];
}

export class KeyboardPen {
  /** The points that are put, mm in the plane. */
  readonly points = signal<readonly number[][]>([]);
  private at = [0, 0];
  /** Where the pointer is, while it is used. */
  private pointed: number[] | null = null;
  private isShown = false;
  private hasMoved = false;
  private readonly line = path("ink");
  private readonly next = path("ink next");
  private readonly dots = path("pen-dots");
  private readonly cross = path("pen-cross");
  private readonly readout: Readout;
  private readonly news = document.createElement("div");
  private readonly stop = new AbortController();

  constructor(
    private readonly viewer: Viewer,
    svg: SVGElement,
    private readonly plane: PenPlane,
    private readonly onFinish: (stroke: number[][]) => void,
  ) {
    svg.append(this.next, this.line, this.dots, this.cross);
    this.readout = new Readout(viewer);
    this.news.className = "visually-hidden";
    this.news.ariaLive = "polite";
    viewer.overlay.append(this.news);
    const { canvas } = viewer;
    const { signal: aborted } = this.stop;
    // Before the keys of the camera.
    canvas.addEventListener("keydown", (event) => this.onKey(event), {
      capture: true,
      signal: aborted,
    });
    canvas.addEventListener("focus", () => this.show(canvas.matches(":focus-visible")), {
      signal: aborted,
    });
    canvas.addEventListener("blur", () => this.show(false), { signal: aborted });
  }

  get hasPoints(): boolean {
    return this.points.value.length > 0;
  }

  /** Start without points at a place of the plane, mm. */
  reset(at: number[]): void {
    this.points.value = [];
    this.at = at.map((value) => STEP_MM * Math.round(value / STEP_MM));
    this.isShown = this.viewer.canvas.matches(":focus-visible");
    this.viewer.refresh();
  }

  /** Remove all points; the pen stays where it is. */
  clear(): void {
    this.points.value = [];
    this.viewer.refresh();
  }

  /** Let the line from the last point end at the pointer, mm in the plane; null if it is away. */
  follow(pointed: number[] | null): void {
    this.isShown = false;
    this.pointed = pointed;
    this.viewer.refresh();
  }

  /** Put a point where the pointer was pressed; on the last point, end the stroke. */
  click(place: number[]): void {
    this.isShown = false;
    this.pointed = null;
    const last = this.points.value.at(-1);
    if (last && distance(this.plane.pixel(last), this.plane.pixel(place)) <= CLOSE_PX) return this.finish();
    this.add(place.map((value) => Math.round(10 * value) / 10));
  }

  /** Show or hide the cross. */
  show(isShown: boolean): void {
    this.isShown = isShown;
    if (isShown && this.plane.isOpen()) this.announce(this.place());
    this.viewer.refresh();
  }

  /** End the stroke at the last point. */
  finish(): void {
    const { value } = this.points;
    if (value.length < 2) this.announce("A cord needs two points at least");
    else this.onFinish(sampleStroke(value));
  }

  /** Let a screen reader read a text. */
  announce(text: string): void {
    this.news.textContent = text;
  }

  /** Draw the points, the line through them and the cross; called for each frame. */
  draw(): void {
    if (this.hasMoved && !this.viewer.rig.isChanging) this.keepInView();
    const pixel = (point: number[]) => this.plane.pixel(point);
    const { value } = this.points;
    this.line.setAttribute("d", value.length > 1 ? joined(sampleStroke(value).map(pixel)) : "");
    this.dots.setAttribute("d", value.map((point) => dot(pixel(point))).join(""));
    const last = value.at(-1);
    const end = this.isShown ? this.at : this.pointed;
    this.next.setAttribute("d", last && end ? joined([pixel(last), pixel(end)]) : "");
    const [x, y] = pixel(this.at);
    this.cross.setAttribute("d", this.isShown ? cross(x, y) : "");
    if (this.isShown) this.readout.show(x, y, this.place());
    else this.readout.hide();
  }

  /** Hide everything of the pen, when no plane is drawn in. */
  hide(): void {
    this.points.value = [];
    this.readout.hide();
  }

  dispose(): void {
    this.stop.abort();
    this.readout.dispose();
    this.news.remove();
  }

  private onKey(event: KeyboardEvent): void {
    if (!this.plane.isOpen() || event.ctrlKey || event.metaKey || event.altKey) return;
    const move = MOVES[event.key];
    if (move) this.move(move, event.shiftKey ? LARGE_STEP_MM : STEP_MM);
    else if (event.key === "Enter" && this.isOnLast()) this.finish();
    else if (event.key === "Enter" || event.key === " ") this.put();
    else if (event.key === "Backspace") this.removeLast();
    else if (event.key === "Escape" && this.points.value.length > 0) {
      this.clear();
      this.announce("All points removed");
    } else return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  private move([right, up]: [number, number], step: number): void {
    this.at = [this.at[0]! + right * step, this.at[1]! + up * step];
    this.isShown = true;
    this.hasMoved = true;
    this.announce(this.place());
    this.viewer.refresh();
  }

  private put(): void {
    this.isShown = true;
    if (!this.isOnLast()) this.add(this.at);
  }

  private add(place: number[]): void {
    this.at = place;
    this.points.value = [...this.points.value, place];
    this.announce(`Point ${this.points.value.length} at ${this.place()}`);
    this.viewer.refresh();
  }

  private removeLast(): void {
    const count = this.points.value.length;
    this.points.value = this.points.value.slice(0, -1);
    this.announce(count > 0 ? `Point ${count} removed` : "There is no point to remove");
    this.viewer.refresh();
  }

  private isOnLast(): boolean {
    const last = this.points.value.at(-1);
    return last !== undefined && last.every((value, k) => value === this.at[k]);
  }

  private place(): string {
    return `x ${this.at[0]!.toFixed(1)}, y ${this.at[1]!.toFixed(1)} mm`;
  }

  /** Move the view if the pen leaves it. */
  private keepInView(): void {
    this.hasMoved = false;
    const { width, height, rig } = this.viewer;
    const [x, y] = this.plane.pixel(this.at);
    const right = Math.min(x - MARGIN_PX, 0) + Math.max(x - width + MARGIN_PX, 0);
    const down = Math.min(y - MARGIN_PX, 0) + Math.max(y - height + MARGIN_PX, 0);
    if (right !== 0 || down !== 0) rig.panBy((100 * right) / height, (-100 * down) / height);
  }
}

function distance([x, y]: [number, number], [u, v]: [number, number]): number {
  return Math.hypot(x - u, y - v);
}

/** Return points of a smooth line through points (n, 2). */
function sampleStroke(points: readonly number[][]): number[][] {
  const all = [...points];
  const frame = { origin: [0, 0, 0], axes: [] };
  const shape = { frame, isPlanar: false, isSmooth: true, points: all, tangents: catmullRom(all) };
  return samplePath(shape);
}

function path(name: string): SVGPathElement {
  const element = document.createElementNS(SVG, "path");
  element.setAttribute("class", name);
  return element;
}

function joined(pixels: [number, number][]): string {
  return `M${pixels.join("L")}`;
}

function dot([x, y]: [number, number]): string {
  return `M${x - DOT_PX} ${y}a${DOT_PX} ${DOT_PX} 0 1 0 ${2 * DOT_PX} 0a${DOT_PX} ${DOT_PX} 0 1 0 ${-2 * DOT_PX} 0Z`;
}

function cross(x: number, y: number): string {
  return `M${x - CROSS_PX} ${y}h${2 * CROSS_PX}M${x} ${y - CROSS_PX}v${2 * CROSS_PX}`;
}
