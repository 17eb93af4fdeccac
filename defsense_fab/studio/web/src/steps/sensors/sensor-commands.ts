// Commands of the step Sensors, in addition to those on selected cords.
import type { Command } from "../../commands";
import type { CordState } from "../../protocol/messages";
import { viewer } from "../../scene/stage";
import { connection, device, drawnViolations } from "../../state/connection";
import { run } from "../../state/run";
import { select, selectedNames } from "../../state/selection";
import { showToast } from "../../state/toasts";
import { type MenuEntry, commandEntry, openContextMenu } from "../../ui/menu";
import { propose, proposeObstacle } from "./propose";
import { brokenCords, repairCords, showBrokenLimit } from "./repair";
import { atOffset, offsetOf, planeAcross, type PlaneAxis } from "./planes";
import {
  board,
  drawingFrame,
  isDrawing,
  isPlaneShown,
  isRedrawing,
  selectedCord,
  selectedPoint,
} from "./state";

async function add(request: Promise<{ name: string } | null>): Promise<void> {
  const added = await run(request);
  if (added) select({ kind: "cord", name: added.name });
}

/** Draw in the plane of the selected cord, or else through the middle of the body. */
export function startDrawing(isNewPath = false): void {
  const cord = selectedCord.peek();
  const box = viewer.peek()?.body.box;
  if (!box || box.isEmpty()) {
    showToast("Make the body before you draw in it", null, true);
    return;
  }
  isRedrawing.value = isNewPath && cord !== null;
  focusCanvas();
  if (cord?.isPlanar) {
    drawingFrame.value = { origin: cord.origin, axes: cord.axes };
    return;
  }
  const size = [box.max.x - box.min.x, box.max.y - box.min.y, box.max.z - box.min.z];
  const axis = (["x", "y", "z"] as const)[size.indexOf(Math.min(...size))]!;
  drawingFrame.value = planeAcross(axis, middleOf(box));
}

/** Give the keys to the pen. */
function focusCanvas(): void {
  viewer.peek()?.canvas.focus();
}

export function middleOf({ min, max }: { min: Vector; max: Vector }): number[] {
  return [(min.x + max.x) / 2, (min.y + max.y) / 2, (min.z + max.z) / 2];
}

interface Vector {
  x: number;
  y: number;
  z: number;
}

export function stopDrawing(): void {
  drawingFrame.value = null;
}

/** Discard what is drawn; if nothing is, stop drawing. */
function cancelDrawing(): void {
  const open = board.peek();
  if (open?.isDrawing) open.cancel();
  else if (open?.pen.points.peek().length) open.pen.clear();
  else stopDrawing();
}

/** Draw in the plane across an axis, through the middle of the body. */
export function choosePlane(axis: PlaneAxis): void {
  const box = viewer.peek()?.body.box;
  if (!box) return;
  drawingFrame.value = planeAcross(axis, middleOf(box));
  board.peek()?.pen.announce(`Plane across ${axis}`);
}

function movePlane(by: number): void {
  const frame = atOffset(drawingFrame.peek()!, offsetOf(drawingFrame.peek()!) + by);
  drawingFrame.value = frame;
  board.peek()?.pen.announce(`Plane at ${offsetOf(frame).toFixed(1)} mm`);
}

/** Add a control point in the longest span, or in the one after the selected point. */
function addPoint({ name, points }: CordState): void {
  const spans = points.slice(1).map((p, i) => Math.hypot(...p.map((v, k) => v - points[i]![k]!)));
  const chosen = selectedPoint.peek();
  const span =
    chosen >= 0 ? Math.min(chosen, spans.length - 1) : spans.indexOf(Math.max(...spans));
  const at = points[span]!.map((v, k) => (v + points[span + 1]![k]!) / 2);
  void run(connection.send("insert-point", { cord: name, before: span + 1, at })).then((answer) => {
    if (answer !== undefined) selectedPoint.value = span + 1;
  });
}

/** Select the next cord in the list. */
function selectNext(): void {
  const names = (device.peek()?.cords ?? []).map(({ name }) => name);
  const last = names.indexOf(selectedNames("cord").at(-1) ?? "");
  if (names.length) select({ kind: "cord", name: names[(last + 1) % names.length]! });
}

function openMirrorMenu(): void {
  const entries = ["x", "y", "z"].flatMap((axis) => commandEntry(`cord.mirror-${axis}`, "mirror"));
  const rect = viewer.peek()?.canvas.getBoundingClientRect();
  if (!rect) return;
  const point = { x: rect.left + rect.width / 2, y: rect.top + rect.height / 2 };
  openContextMenu(point, "Mirror across", entries);
}

const PLANE_STEP_MM = 0.5;
const LARGE_PLANE_STEP_MM = 5;
const PLANE_MOVES = [
  { name: "up", label: "Move the plane up", key: "PageUp", by: PLANE_STEP_MM },
  { name: "down", label: "Move the plane down", key: "PageDown", by: -PLANE_STEP_MM },
  { name: "far-up", label: "Move the plane up by 5 mm", key: "Shift+PageUp", by: LARGE_PLANE_STEP_MM },
  {
    name: "far-down",
    label: "Move the plane down by 5 mm",
    key: "Shift+PageDown",
    by: -LARGE_PLANE_STEP_MM,
  },
];

/** Commands while a plane is drawn in. */
const drawingCommands = (): readonly Command[] => [
  {
    id: "sensor.finish",
    label: "Finish the cord",
    hint: "End the cord at the last point",
    group: "Drawing",
    when: () => (board.value?.pen.points.value.length ?? 0) > 1,
    reason: "Put two points first",
    run: () => board.peek()?.pen.finish(),
  },
  {
    id: "sensor.stop",
    label: "Discard the points, or stop drawing",
    group: "Drawing",
    shortcut: "Escape",
    when: () => isDrawing.value,
    reason: "Start to draw a cord first",
    run: cancelDrawing,
  },
  ...(["x", "y", "z"] as const).map((axis) => ({
    id: `sensor.plane-${axis}`,
    label: `Draw in the plane across ${axis}`,
    group: "Drawing",
    shortcut: axis.toUpperCase(),
    when: () => isDrawing.value,
    reason: "Start to draw a cord first",
    run: () => choosePlane(axis),
  })),
  ...PLANE_MOVES.map(({ name, label, key, by }) => ({
    id: `sensor.plane-${name}`,
    label,
    group: "Drawing",
    shortcut: key,
    when: () => isDrawing.value,
    reason: "Start to draw a cord first",
    run: () => movePlane(by),
  })),
];

const hasCord = () => selectedCord.value !== null;
const hasBroken = () => brokenCords().length > 0;
const isBroken = () => hasCord() && brokenCords().includes(selectedCord.value!.name);

export const sensorCommands = (): readonly Command[] => [
  ...drawingCommands(),
  {
    id: "sensor.draw",
    label: "Draw a cord",
    hint: "Draw a path in a plane",
    group: "Sensors",
    shortcut: "D",
    run: () => (isDrawing.peek() ? focusCanvas() : startDrawing()),
  },
  {
    id: "sensor.straight",
    label: "Add a straight cord",
    hint: "Add a cord along the middle of the body",
    group: "Sensors",
    shortcut: "N",
    run: () => void add(connection.send("add-straight", {})),
  },
  {
    id: "sensor.propose",
    label: "Propose a cord",
    hint: "Add the cord that lowers the error most",
    group: "Sensors",
    shortcut: "P",
    when: () => proposeObstacle() === "",
    reason: proposeObstacle,
    run: () => void propose(),
  },
  {
    id: "sensor.repair",
    label: "Repair the cord",
    hint: "Move its control points until it keeps all limits",
    group: "Sensors",
    shortcut: "R",
    when: isBroken,
    reason: "Select a cord that breaks a limit first",
    run: () => void repairCords([selectedCord.peek()!.name]),
  },
  {
    id: "sensor.repair-all",
    label: "Repair all cords",
    hint: "Move control points until all cords keep all limits",
    group: "Sensors",
    when: hasBroken,
    reason: "All limits are kept",
    run: () => void repairCords([]),
  },
  {
    id: "sensor.show-limit",
    label: "Show the first broken limit",
    group: "Sensors",
    when: () => drawnViolations.value.length > 0,
    reason: "All limits are kept",
    run: showBrokenLimit,
  },
  {
    id: "sensor.next",
    label: "Select the next cord",
    group: "Sensors",
    shortcut: "C",
    run: selectNext,
  },
  {
    id: "sensor.mirror",
    label: "Mirror",
    group: "Sensors",
    shortcut: "M",
    when: hasCord,
    reason: "Select a cord first",
    run: openMirrorMenu,
  },
  {
    id: "sensor.redraw",
    label: "Draw a new path",
    hint: "Replace the path of the selected cord by a stroke",
    group: "Sensors",
    shortcut: "Shift+D",
    when: hasCord,
    reason: "Select a cord first",
    run: () => startDrawing(true),
  },
  {
    id: "sensor.smooth",
    label: "Smooth",
    hint: "Compute the tangents from the control points",
    group: "Sensors",
    shortcut: "S",
    when: hasCord,
    reason: "Select a cord first",
    run: () => void run(connection.send("smooth-cord", { cord: selectedCord.peek()!.name })),
  },
  {
    id: "sensor.add-point",
    label: "Add a point",
    group: "Sensors",
    shortcut: "A",
    when: hasCord,
    reason: "Select a cord first",
    run: () => addPoint(selectedCord.peek()!),
  },
  {
    id: "sensor.plane",
    label: "Move the plane",
    hint: "Show an arrow and two arcs that move the plane of the cord",
    group: "Sensors",
    shortcut: "G",
    when: () => Boolean(selectedCord.value?.isPlanar),
    reason: "Select a cord in a plane first",
    run: () => {
      isPlaneShown.value = !isPlaneShown.peek();
    },
  },
];

/** Entries of the menu of a cord that is selected. */
export function sensorMenu(): MenuEntry[] {
  return [
    ...commandEntry("sensor.smooth", "cord"),
    ...commandEntry("sensor.add-point", "plus"),
    ...commandEntry("sensor.redraw", "draw"),
    ...commandEntry("sensor.plane", "section"),
  ];
}
