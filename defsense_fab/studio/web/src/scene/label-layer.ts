// Labels as elements of the page that stay at their places in the scene and do not overlap.
import { Vector3 } from "three";
import { type Box, overlaps } from "./covered-places";
import type { Viewer } from "./viewer";

export type LabelTone = "plain" | "alarm" | "accent";

export interface Label {
  /** Unique identifier. */
  id: string;
  text: string;
  /** Place in the rest frame (3,), mm. */
  at: number[];
  tone: LabelTone;
  /** Labels of a higher priority keep their place. */
  priority: number;
  onClick?: () => void;
}

interface Entry {
  label: Label;
  element: HTMLElement;
  stem: SVGLineElement;
  width: number;
  height: number;
  /** Where the element and its stem are shown; elements are written only when it changes. */
  shown: string;
}

const OBSTACLE_PX = 7;
/** Where a label may be, from its place to its middle, in units of its half size and a stem. */
const SIDES = [
  [0.8, -1], [-0.8, -1], [0.8, 1], [-0.8, 1], [0, -1], [0, 1], [1, 0], [-1, 0],
] as const;
const STEMS_PX = [14, 34, 60, 90];
const SVG = "http://www.w3.org/2000/svg";

export class LabelLayer {
  readonly element = document.createElement("div");
  /** Pixels that labels leave free, such as those of handles. */
  obstacles: () => [number, number][] = () => [];
  private readonly stems = document.createElementNS(SVG, "svg");
  private readonly groups = new Map<string, Label[]>();
  private readonly entries = new Map<string, Entry>();
  private readonly stopListening: () => void;
  private readonly place = new Vector3();

  constructor(private readonly viewer: Viewer) {
    this.element.className = "viewer-labels";
    this.stems.setAttribute("aria-hidden", "true");
    this.element.append(this.stems);
    viewer.overlay.append(this.element);
    this.stopListening = viewer.onFrame(() => this.arrange());
  }

  /** Show the labels of a group, such as "limits"; they replace the last ones of the group. */
  set(group: string, labels: Label[]): void {
    this.groups.set(group, labels);
    const all = [...this.groups.values()].flat();
    const ids = new Set(all.map(({ id }) => id));
    for (const [id, { element, stem }] of this.entries) {
      if (ids.has(id)) continue;
      element.remove();
      stem.remove();
      this.entries.delete(id);
    }
    for (const label of all) this.show(label);
    this.viewer.invalidate();
  }

  dispose(): void {
    this.stopListening();
    this.element.remove();
  }

  private show(label: Label): void {
    const known = this.entries.get(label.id);
    if (known && !!known.label.onClick === !!label.onClick) {
      known.label = label;
      if (known.element.textContent !== label.text) {
        known.element.textContent = label.text;
        known.width = 0;
        known.shown = "";
      }
      known.element.dataset.tone = label.tone;
      return;
    }
    known?.element.remove();
    known?.stem.remove();
    const element = document.createElement(label.onClick ? "button" : "span");
    element.className = "viewer-label";
    element.dataset.tone = label.tone;
    element.textContent = label.text;
    const stem = document.createElementNS(SVG, "line");
    stem.dataset.tone = label.tone;
    const entry: Entry = { label, element, stem, width: 0, height: 0, shown: "" };
    element.addEventListener("click", () => entry.label.onClick?.());
    this.element.append(element);
    this.stems.append(stem);
    this.entries.set(label.id, entry);
  }

  private arrange(): void {
    const used: Box[] = this.obstacles().map(([x, y]) => ({
      left: x - OBSTACLE_PX,
      top: y - OBSTACLE_PX,
      right: x + OBSTACLE_PX,
      bottom: y + OBSTACLE_PX,
    }));
    const { width, height } = this.viewer;
    const entries = [...this.entries.values()].sort((a, b) => b.label.priority - a.label.priority);
    for (const entry of entries) {
      if (entry.width === 0) {
        entry.width = entry.element.offsetWidth;
        entry.height = entry.element.offsetHeight;
      }
    }
    for (const entry of entries) {
      const [x, y] = this.viewer.project(this.place.fromArray(entry.label.at));
      const isShown = x > 0 && y > 0 && x < width && y < height;
      const box = isShown ? this.freeBox(entry, x, y, used) : null;
      if (box) used.push(box);
      const shown = box ? `${x} ${y} ${box.left} ${box.top}` : "hidden";
      if (shown === entry.shown) continue;
      entry.shown = shown;
      moveElements(entry, x, y, box);
    }
  }

  private freeBox(entry: Entry, x: number, y: number, used: Box[]): Box | null {
    const { width, height } = entry;
    for (const stem of STEMS_PX) {
      for (const [sx, sy] of SIDES) {
        const left = Math.round(x + sx * (width / 2 + stem / 2) - width / 2);
        const top = Math.round(y + sy * (height / 2 + stem) - height / 2);
        const box = { left, top, right: left + width, bottom: top + height };
        const { width: right, height: bottom } = this.viewer;
        const isInside = left >= 0 && top >= 0 && box.right <= right && box.bottom <= bottom;
        const isFree = isInside && !this.viewer.covered.has(box);
        if (isFree && !used.some((other) => overlaps(box, other))) return box;
      }
    }
    return null;
  }
}

function moveElements({ element, stem }: Entry, x: number, y: number, box: Box | null): void {
  element.style.visibility = stem.style.visibility = box ? "visible" : "hidden";
  if (!box) return;
  element.style.transform = `translate(${box.left}px, ${box.top}px)`;
  stem.setAttribute("x1", `${x}`);
  stem.setAttribute("y1", `${y}`);
  stem.setAttribute("x2", `${Math.min(Math.max(x, box.left), box.right)}`);
  stem.setAttribute("y2", `${Math.min(Math.max(y, box.top), box.bottom)}`);
}
