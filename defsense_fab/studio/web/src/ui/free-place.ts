// A place in the window where a box covers no controls.

interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

/** What must stay visible, in addition to labels and handles of the scene where they fit. */
const OBSTACLES =
  "button, a[href], input, select, textarea, summary, [role=treeitem], .scene-toolbar, " +
  ".scene-legend, .view-tools, .viewer-hint, .introduction, .dialog-frame";
const MARGIN_PX = 12;
const STEP_PX = 16;
/** The places across the area that are tried, 0 at the left and 1 at the right. */
const ACROSS = [0.5, 0, 1];

function overlap(a: Box, b: Box): number {
  const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
  const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
  return width > 0 && height > 0 ? width * height : 0;
}

/** The boxes of all visible controls that are not within an element. */
function obstacles(except: Element): Box[] {
  return [...document.querySelectorAll(OBSTACLES)]
    .filter((element) => !except.contains(element) && element.checkVisibility())
    .map((element) => element.getBoundingClientRect());
}

/** Move an element within an area to where it covers least: at the bottom if that is free. */
export function moveToFreePlace(element: HTMLElement, area: Box): void {
  const { width, height } = element.getBoundingClientRect();
  const boxes = obstacles(element);
  const room = Math.max(0, area.right - area.left - width - 2 * MARGIN_PX);
  const lowest = Math.max(area.top, area.bottom - height - MARGIN_PX);
  let best = { left: area.left + MARGIN_PX + room / 2, top: lowest, covered: Infinity };
  for (let top = lowest; top >= area.top + MARGIN_PX && best.covered > 0; top -= STEP_PX) {
    for (const share of ACROSS) {
      const left = area.left + MARGIN_PX + share * room;
      const box = { left, top, right: left + width, bottom: top + height };
      const covered = boxes.reduce((sum, other) => sum + overlap(box, other), 0);
      if (covered < best.covered) best = { left, top, covered };
    }
  }
  element.style.left = `${Math.max(0, best.left)}px`;
  element.style.top = `${best.top}px`;
}
