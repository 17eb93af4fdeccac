// What floats over the picture: labels keep clear of it.

export interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

const FLOATING =
  ".scene-toolbar, .scene-legend, .view-tools, .viewer-hint, .body-fit, .introduction, .viewer-cube";
const INTERVAL_MS = 250;
const GAP_PX = 4;

/** The boxes of tools and notices over a canvas, in its pixels; they are measured now and then. */
export class CoveredPlaces {
  private boxes: Box[] = [];
  private measuredAt = -Infinity;

  constructor(private readonly canvas: HTMLCanvasElement) {}

  get current(): readonly Box[] {
    const now = performance.now();
    if (now - this.measuredAt < INTERVAL_MS) return this.boxes;
    this.measuredAt = now;
    const { left, top } = this.canvas.getBoundingClientRect();
    const floating = this.canvas.closest(".stage")?.querySelectorAll(FLOATING) ?? [];
    this.boxes = [...floating]
      .map((element) => element.getBoundingClientRect())
      .filter(({ width }) => width > 0)
      .map((box) => ({
        left: box.left - left,
        top: box.top - top,
        right: box.right - left,
        bottom: box.bottom - top,
      }));
    return this.boxes;
  }

  /** Whether a box is over one of them, or almost. */
  has(box: Box): boolean {
    return this.current.some((other) => overlaps(box, other));
  }
}

export function overlaps(a: Box, b: Box): boolean {
  return (
    a.left < b.right + GAP_PX &&
    b.left < a.right + GAP_PX &&
    a.top < b.bottom + GAP_PX &&
    b.top < a.bottom + GAP_PX
  );
}
