// The numbers next to the pointer while something is dragged or drawn.
import type { Viewer } from "./viewer";

const OFFSET_PX = 16;

export class Readout {
  private readonly element = document.createElement("div");

  constructor(private readonly viewer: Viewer) {
    this.element.className = "viewer-readout";
    this.element.hidden = true;
    viewer.overlay.append(this.element);
  }

  /** Show a text at a pixel, and below it, if it is known, how much the error changes, mm. */
  show(x: number, y: number, text: string, change: number | null = null): void {
    this.element.hidden = false;
    this.element.textContent = text;
    if (change !== null) {
      const line = document.createElement("div");
      line.textContent = `Error ${signed(change)} mm`;
      if (Math.abs(change) >= 0.005) line.className = change < 0 ? "better" : "worse";
      this.element.append(line);
    }
    const { offsetWidth, offsetHeight } = this.element;
    const isRight = x + OFFSET_PX + offsetWidth < this.viewer.width;
    const isBelow = y + OFFSET_PX + offsetHeight < this.viewer.height;
    const left = isRight ? x + OFFSET_PX : x - OFFSET_PX - offsetWidth;
    const top = isBelow ? y + OFFSET_PX : y - OFFSET_PX - offsetHeight;
    this.element.style.transform = `translate(${left}px, ${top}px)`;
  }

  hide(): void {
    this.element.hidden = true;
  }

  dispose(): void {
    this.element.remove();
  }
}

/** Return a number with its sign and two decimals. */
function signed(value: number): string {
  const text = Math.abs(value).toFixed(2);
  return Number(text) === 0 ? text : `${value < 0 ? "\u2212" : "+"}${text}`;
}
