// A rectangle that is drawn over the body: a box is fitted to the points of the surface in it.
import { Vector3 } from "three";
import type { Viewer } from "../../scene/viewer";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { select } from "../../state/selection";
import { showToast } from "../../state/toasts";
import { shownVertices } from "./display";
import { editedRegion, isMeshed, meshedBody, sceneTool } from "./state";

const SMALLEST_PX = 4;

/** Whether the next rectangle replaces the edited region. */
let isRefit = false;

/** Start to draw a rectangle, for a new region or for the edited one. */
export function startRectangle(replaces: boolean): void {
  isRefit = replaces;
  sceneTool.value = "rectangle";
}

/** Listen for rectangles: with Shift, or while the tool is chosen; return a function to stop. */
export function listenForRectangles(viewer: Viewer): () => void {
  const { canvas, overlay, rig } = viewer;
  const box = document.createElement("div");
  box.className = "selection-rectangle";
  box.hidden = true;
  overlay.append(box);
  const stop = new AbortController();
  const options = { signal: stop.signal, capture: true };
  let from: [number, number] | null = null;

  const end = () => {
    from = null;
    box.hidden = true;
    rig.controls.enabled = true;
    viewer.picker.isEnabled = true;
    if (sceneTool.peek() === "rectangle") sceneTool.value = "view";
    isRefit = false;
  };

  canvas.addEventListener(
    "pointerdown",
    (event) => {
      const isTool = sceneTool.peek() === "rectangle";
      if (event.button !== 0 || !isMeshed.peek() || !(isTool || event.shiftKey)) return;
      event.stopImmediatePropagation();
      rig.controls.enabled = false;
      viewer.picker.isEnabled = false;
      canvas.setPointerCapture(event.pointerId);
      from = viewer.local(event);
    },
    options,
  );
  canvas.addEventListener(
    "pointermove",
    (event) => {
      if (!from) return;
      event.stopImmediatePropagation();
      const { left, top, width, height } = bounds(from, viewer.local(event));
      box.hidden = false;
      Object.assign(box.style, {
        transform: `translate(${left}px, ${top}px)`,
        width: `${width}px`,
        height: `${height}px`,
      });
    },
    options,
  );
  canvas.addEventListener(
    "pointerup",
    (event) => {
      if (!from) return;
      event.stopImmediatePropagation();
      const rectangle = bounds(from, viewer.local(event));
      const region = isRefit ? (editedRegion.peek()?.name ?? "") : "";
      end();
      if (Math.max(rectangle.width, rectangle.height) >= SMALLEST_PX) void fit(viewer, rectangle, region);
    },
    options,
  );
  canvas.addEventListener("pointercancel", end, options);
  document.addEventListener(
    "keydown",
    (event) => {
      if (event.key !== "Escape" || (!from && sceneTool.peek() === "view")) return;
      event.preventDefault();
      event.stopPropagation();
      end();
      sceneTool.value = "view";
    },
    options,
  );
  return () => {
    end();
    stop.abort();
    box.remove();
  };
}

interface Rectangle {
  left: number;
  top: number;
  width: number;
  height: number;
}

function bounds([x, y]: [number, number], [u, v]: [number, number]): Rectangle {
  return { left: Math.min(x, u), top: Math.min(y, v), width: Math.abs(u - x), height: Math.abs(v - y) };
}

async function fit(viewer: Viewer, rectangle: Rectangle, region: string): Promise<void> {
  const rest = meshedBody.peek()?.arrays["vertices"];
  const shown = shownVertices.peek();
  if (!rest || shown.length !== rest.length) return;
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  const point = new Vector3();
  const { left, top, width, height } = rectangle;
  let count = 0;
  for (let i = 0; i < rest.length; i += 3) {
    const [x, y] = viewer.project(point.set(shown[i]!, shown[i + 1]!, shown[i + 2]!));
    if (x < left || x > left + width || y < top || y > top + height) continue;
    count++;
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k]!, rest[i + k]!);
      high[k] = Math.max(high[k]!, rest[i + k]!);
    }
  }
  if (count === 0) {
    showToast("The rectangle holds no point of the surface. Draw it over the body.", null, true);
    return;
  }
  const added = await run(connection.send("fit-region", { region, low, high }));
  if (!added) return;
  select({ kind: "region", name: added.name });
  const more = added.count - count;
  const note = more > 0 ? `, ${more} of them outside the rectangle` : "";
  showToast(`${added.name} holds ${added.count} points of the surface${note}`);
}
