// The axes at the selected point, with their names: along them arrow keys move it.
import { Vector3 } from "three";
import type { Viewer } from "./viewer";

const SVG = "http://www.w3.org/2000/svg";
const START_PX = 14;
const LENGTH_PX = 58;
const LABEL_PX = 68;
/** Axes that are seen from their ends have no label. */
const SMALLEST_PX = 12;
const NAMES = ["x", "y", "z"] as const;

export class PointAxes {
  private readonly svg = document.createElementNS(SVG, "svg");
  private readonly parts = NAMES.map((name) => {
    const line = document.createElementNS(SVG, "line");
    const text = document.createElementNS(SVG, "text");
    text.textContent = name;
    return { line, text };
  });

  constructor(private readonly viewer: Viewer) {
    this.svg.setAttribute("class", "viewer-axes");
    this.svg.setAttribute("aria-hidden", "true");
    for (const { line, text } of this.parts) this.svg.append(line, text);
    viewer.overlay.append(this.svg);
  }

  /** Show axes at a point of the rest frame, or hide them; called for each frame. */
  place(point: number[] | null, axes: Vector3[]): void {
    this.svg.style.display = point ? "" : "none";
    if (!point) return;
    const at = new Vector3().fromArray(point);
    const [x, y] = this.viewer.project(at);
    const size = LENGTH_PX * this.viewer.rig.mmPerPixel(at);
    this.parts.forEach(({ line, text }, k) => {
      const axis = axes[k];
      const [u, v] = axis ? this.viewer.project(at.clone().addScaledVector(axis, size)) : [x, y];
      const length = Math.hypot(u - x, v - y);
      const isShown = length > SMALLEST_PX;
      line.style.display = text.style.display = isShown ? "" : "none";
      if (!isShown) return;
      const [dx, dy] = [(u - x) / length, (v - y) / length];
      const ends = { x1: x + START_PX * dx, y1: y + START_PX * dy, x2: u, y2: v };
      for (const [key, value] of Object.entries(ends)) line.setAttribute(key, `${value}`);
      const reach = length + LABEL_PX - LENGTH_PX;
      text.setAttribute("x", `${x + reach * dx}`);
      text.setAttribute("y", `${y + reach * dy}`);
    });
  }

  dispose(): void {
    this.svg.remove();
  }
}
