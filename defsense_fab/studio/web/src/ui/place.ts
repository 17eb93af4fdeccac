// Places floating elements next to others, inside the window.
const GAP_PX = 6;
const MARGIN_PX = 8;

/** Move a fixed element below or above a rectangle, or to the other side if it does not fit. */
export function placeNextTo(element: HTMLElement, anchor: DOMRect, side: "below" | "above"): void {
  const { offsetWidth: width, offsetHeight: height } = element;
  const below = anchor.bottom + GAP_PX;
  const above = anchor.top - GAP_PX - height;
  const fitsBelow = below + height <= innerHeight - MARGIN_PX;
  const fitsAbove = above >= MARGIN_PX;
  const isBelow = side === "below" ? fitsBelow || !fitsAbove : !fitsAbove && fitsBelow;
  const left = anchor.left + anchor.width / 2 - width / 2;
  element.style.left = `${clamp(left, MARGIN_PX, innerWidth - width - MARGIN_PX)}px`;
  element.style.top = `${clamp(isBelow ? below : above, MARGIN_PX, innerHeight - height - MARGIN_PX)}px`;
}

export function clamp(value: number, low: number, high: number): number {
  return Math.max(low, Math.min(high, value));
}
