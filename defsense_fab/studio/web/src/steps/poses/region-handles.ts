// The outline of the edited region, and handles that move it and change its size.
import { effect } from "@preact/signals";
import { BufferAttribute, BufferGeometry, Color, LineBasicMaterial, LineSegments, Vector3 } from "three";
import type { RegionState } from "../../protocol/messages";
import { HandleButton } from "../../scene/handle-button";
import { ORDER } from "../../scene/order";
import { Readout } from "../../scene/readout";
import { screenStep } from "../../scene/screen-steps";
import type { Viewer } from "../../scene/viewer";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { draggedRegion } from "./display";
import { Gizmo, type GizmoEvents } from "./gizmo";
import { type RegionShape, outline, shapeGrips, shifted } from "./region-geometry";
import { plain } from "./rotations";
import { editedRegion, posesState } from "./state";

const STEP_MM = 0.5;
const LARGE_STEPS = 10;
/** Where arrows begin and end: outside of the handles of small regions. */
const ARROWS_PX = [58, 104] as const;

/** Write the shape of a region. */
export async function writeRegion(region: string, shape: RegionShape): Promise<void> {
  await run(connection.send("set-region", { region, ...plainShape(shape) }));
}

function plainShape({ shape, points, radius }: RegionShape): RegionShape {
  return { shape, points, radius };
}

/** Show the edited region; return a function that removes it. */
export function showRegionHandles(viewer: Viewer): () => void {
  const material = new LineBasicMaterial({ depthTest: false, transparent: true });
  const lines = new LineSegments(new BufferGeometry(), material);
  lines.renderOrder = ORDER.grid;
  lines.frustumCulled = false;
  viewer.scene.add(lines);
  const readout = new Readout(viewer);
  let start: RegionState | null = null;
  let buttons: HandleButton[] = [];

  const drag = (region: RegionState, shape: RegionShape) => {
    start ??= region;
    draggedRegion.value = { name: region.name, shape };
    viewer.refresh();
  };
  const stopDrag = () => {
    start = null;
    draggedRegion.value = null;
    readout.hide();
  };
  const drop = async () => {
    const dragged = draggedRegion.peek();
    readout.hide();
    start = null;
    if (dragged) await writeRegion(dragged.name, dragged.shape);
    if (draggedRegion.peek() === dragged) draggedRegion.value = null;
  };

  const events: GizmoEvents = {
    onTurn: () => undefined,
    onShift: (by) => {
      const region = start ?? editedRegion.peek();
      if (region) drag(region, shifted(region, by.toArray()));
    },
    onDrop: () => void drop(),
    onCancel: stopDrag,
    onStep: (_, axis, value) => {
      const region = editedRegion.peek();
      const by = axis.multiplyScalar(value).toArray();
      if (region) void run(connection.send("shift-region", { region: region.name, by }));
    },
    describe: () => "",
  };
  const gizmo = new Gizmo(viewer, events, ARROWS_PX);

  const shown = (): { region: RegionState; shape: RegionShape } | null => {
    const region = editedRegion.value;
    if (!region) return null;
    const dragged = draggedRegion.value;
    return { region, shape: dragged?.name === region.name ? dragged.shape : region };
  };

  const makeButton = (index: number): HandleButton => {
    const grips = () => {
      const region = start ?? editedRegion.peek();
      return region ? { region, handle: shapeGrips(region)[index] } : null;
    };
    return new HandleButton(viewer, "point", {
      onDrag: (x, y) => {
        const found = grips();
        if (!found?.handle) return;
        const { region, handle } = found;
        const distance = wayAlong(viewer, handle.at, handle.direction, x, y);
        if (distance === null) return;
        const shape = handle.drag(Math.round(distance / STEP_MM) * STEP_MM);
        drag(region, shape);
        const at = shapeGrips(shape)[index]!;
        const value = handle.name === "Radius" ? shape.radius : along(at.at, at.direction);
        readout.show(x, y, `${handle.name} ${plain(value)} mm`);
      },
      onDrop: () => void drop(),
      onCancel: stopDrag,
      onArrow: (right, up, isLarge) => {
        const found = grips();
        if (!found?.handle) return;
        const direction = new Vector3().fromArray(found.handle.direction);
        const steps = screenStep(viewer.rig.camera, direction, right, up);
        const distance = steps * STEP_MM * (isLarge ? LARGE_STEPS : 1);
        void writeRegion(found.region.name, found.handle.drag(distance));
      },
    });
  };

  const stopEffect = effect(() => {
    const now = shown();
    lines.visible = now !== null;
    const grips = now ? shapeGrips(now.shape) : [];
    while (buttons.length > grips.length) buttons.pop()!.dispose();
    while (buttons.length < grips.length) buttons.push(makeButton(buttons.length));
    if (now) {
      const { region, shape } = now;
      material.color = new Color(region.color);
      lines.geometry.dispose();
      lines.geometry = new BufferGeometry();
      const points = outline(shape, posesState.value?.size ?? 100);
      lines.geometry.setAttribute("position", new BufferAttribute(points, 3));
      buttons.forEach((button, i) => {
        button.setName(`${grips[i]!.name} of ${region.name}`);
        button.element.style.setProperty("--handle", region.color);
      });
    }
    if (!gizmo.isDragged) {
      const center = now?.region.center;
      gizmo.show(center ? { name: now.region.name, center, canTurn: false, canShift: true, title: "" } : null);
    }
    viewer.refresh();
  });
  const at = new Vector3();
  const stopFrame = viewer.onFrame(() => {
    const now = shown();
    const grips = now ? shapeGrips(now.shape) : [];
    buttons.forEach((button, i) => {
      if (grips[i]) button.place(viewer.project(at.fromArray(grips[i].at)));
    });
  });
  return () => {
    stopEffect();
    stopFrame();
    stopDrag();
    gizmo.dispose();
    readout.dispose();
    for (const button of buttons) button.dispose();
    buttons = [];
    viewer.scene.remove(lines);
    lines.geometry.dispose();
    material.dispose();
  };
}

/** The way along a line through a place at which a pixel's ray passes nearest, mm. */
function wayAlong(viewer: Viewer, place: number[], direction: number[], x: number, y: number): number | null {
  const { origin, direction: ray } = viewer.rayAt(x, y);
  const unit = new Vector3().fromArray(direction);
  const cosine = unit.dot(ray);
  const denominator = 1 - cosine * cosine;
  if (denominator < 1e-3) return null;
  const from = origin.sub(new Vector3().fromArray(place));
  return (from.dot(unit) - cosine * from.dot(ray)) / denominator;
}

/** The coordinate of a place along the axis of a direction. */
function along(place: number[], direction: number[]): number {
  const main = direction.findIndex((value) => Math.abs(value) > 0.999);
  if (main >= 0) return place[main]!;
  return place.reduce((sum, value, k) => sum + value * direction[k]!, 0);
}
