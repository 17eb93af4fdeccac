// A bar of a round length in mm, at the lower right of the scene.
import type { Viewer } from "./viewer";

const LARGEST_PX = 120;
/** Largest share of the view's width. */
const LARGEST_SHARE = 0.25;

export class ScaleBar {
  private readonly element = document.createElement("div");
  private readonly text = document.createElement("span");
  private readonly bar = document.createElement("div");
  private readonly stopListening: () => void;
  private shown = "";

  constructor(viewer: Viewer) {
    this.element.className = "viewer-scale";
    this.element.setAttribute("role", "img");
    this.element.append(this.text, this.bar);
    viewer.overlay.append(this.element);
    this.stopListening = viewer.onFrame(() => {
      const largest = Math.min(LARGEST_PX, LARGEST_SHARE * viewer.width);
      this.show(viewer.rig.mmPerPixel(viewer.rig.controls.target), largest);
    });
  }

  setHidden(isHidden: boolean): void {
    this.element.hidden = isHidden;
  }

  dispose(): void {
    this.stopListening();
    this.element.remove();
  }

  private show(mmPerPixel: number, largestPx: number): void {
    const length = roundLength(largestPx * mmPerPixel);
    const width = Math.round(length / mmPerPixel);
    const label = `${Number(length.toPrecision(1))} mm`;
    if (this.shown === `${label} ${width}`) return;
    this.shown = `${label} ${width}`;
    this.text.textContent = label;
    this.bar.style.width = `${width}px`;
    this.element.setAttribute("aria-label", `Scale: ${label}`);
  }
}

/** Return the largest of 1, 2 and 5 times a power of ten that is not larger. */
export function roundLength(largest: number): number {
  const power = 10 ** Math.floor(Math.log10(largest));
  return [5, 2, 1].map((digit) => digit * power).find((length) => length <= largest) ?? power;
}
