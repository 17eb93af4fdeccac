// Dragging the selected cord: shown at once, judged by the server, written when it is dropped.
import { effect } from "@preact/signals";
import { Refusal } from "../../protocol/connection";
import type { CordState, DragResult } from "../../protocol/messages";
import { catmullRom, pointToWorld, samplePath, toPlane } from "../../scene/curve";
import { CordHandles, type HandleKind } from "../../scene/handles";
import { PlaneHandle } from "../../scene/plane-handle";
import { Readout } from "../../scene/readout";
import { cordMenuEntries } from "../../scene/stage";
import type { CordShape, Frame } from "../../scene/types";
import type { Viewer } from "../../scene/viewer";
import { connection, prediction } from "../../state/connection";
import { run } from "../../state/run";
import { showProblem } from "../../state/toasts";
import { type MenuEntry, openContextMenu } from "../../ui/menu";
import { LatestRequest } from "./latest-request";
import {
  draggedJudgement,
  isDrawing,
  isPlaneShown,
  selectedCord,
  selectedPoint,
} from "./state";

/** A drag of a part of a cord. */
interface Drag {
  cord: CordState;
  /** Error when it began, mm. */
  error: number | null;
  send: (write: boolean) => Promise<DragResult>;
  /** Where and what the readout shows, without the error. */
  pixel: [number, number];
  text: string;
}

export class CordEditor {
  private shape: CordShape | null = null;
  private drag: Drag | null = null;
  private readonly requests = new LatestRequest<DragResult>();
  private readonly handles: CordHandles;
  private readonly planeHandle: PlaneHandle;
  private readonly readout: Readout;
  private readonly stops: (() => void)[];

  constructor(private readonly viewer: Viewer) {
    this.readout = new Readout(viewer);
    const end = { onDrop: () => this.drop(), onCancel: () => this.cancel() };
    this.handles = new CordHandles(viewer, {
      ...end,
      onSelect: (index) => (selectedPoint.value = index),
      onDrag: (kind, index, to, pixel) => this.moveHandle(kind, index, to, pixel),
      onMove: (index, to) => {
        this.moveHandle("point", index, to, null);
        this.drop();
      },
      onDelete: deletePoint,
      onMenu: (index, x, y) => {
        const entry: MenuEntry = {
          id: "point.delete",
          label: "Delete the point",
          icon: "trash",
          run: () => deletePoint(index),
        };
        const name = selectedCord.peek()?.name ?? "";
        openContextMenu({ x, y }, `Actions for ${name}`, [
          entry,
          "separator",
          ...cordMenuEntries.peek()(),
        ]);
      },
    });
    this.planeHandle = new PlaneHandle(viewer, {
      ...end,
      onDrag: (frame, text, pixel) => this.movePlane(frame, text, pixel),
    });
    viewer.canvas.addEventListener("dblclick", this.onDoubleClick);
    viewer.labels.obstacles = () => this.handles.pixels();
    this.stops = [
      effect(() => {
        const cord = isDrawing.value ? null : selectedCord.value;
        const isPlane = isPlaneShown.value;
        if (!this.drag && !this.requests.isWaiting) this.show(cord, isPlane);
      }),
      effect(() => this.handles.select(selectedPoint.value)),
    ];
  }

  dispose(): void {
    this.cancel();
    this.viewer.canvas.removeEventListener("dblclick", this.onDoubleClick);
    this.viewer.labels.obstacles = () => [];
    for (const stop of this.stops) stop();
    this.handles.dispose();
    this.planeHandle.dispose();
    this.readout.dispose();
  }

  private show(cord: CordState | null, isPlane: boolean): void {
    this.shape = cord && shapeOf(cord);
    this.handles.show(cord?.name ?? "", cord?.color ?? "", isPlane ? null : this.shape);
    const isShown = isPlane && cord?.isPlanar;
    this.planeHandle.show(isShown ? this.shape!.frame : null, cord?.path ?? []);
    if (selectedPoint.peek() >= (cord?.points.length ?? 0)) selectedPoint.value = -1;
  }

  private moveHandle(
    kind: HandleKind,
    index: number,
    to: number[],
    pixel: [number, number] | null,
  ): void {
    const cord = this.drag?.cord ?? selectedCord.peek();
    if (!cord || !this.shape) return;
    const shape = { ...this.shape };
    if (kind === "tangent") {
      shape.isSmooth = false;
      shape.tangents = replaced(shape.tangents, index, to);
    } else {
      shape.points = replaced(shape.points, index, to);
      if (shape.isSmooth) shape.tangents = catmullRom(shape.points);
    }
    const request = { cord: cord.name, index, to };
    const snap = pixel !== null;
    const send = (write: boolean) =>
      kind === "tangent"
        ? connection.send("drag-tangent", { ...request, write })
        : connection.send("drag-point", { ...request, snap, write });
    const names = ["x", "y", "z"];
    const text = to.map((value, k) => `${names[k]} ${value.toFixed(1)}`).join(", ") + " mm";
    this.move(cord, shape, send, text, pixel ?? this.pixelOf(shape, index));
  }

  private movePlane(frame: Frame, text: string, pixel: [number, number]): void {
    const cord = this.drag?.cord ?? selectedCord.peek();
    if (!cord || !this.shape) return;
    const { origin, axes } = frame;
    const send = (write: boolean) =>
      connection.send("drag-plane", { cord: cord.name, origin, axes, write });
    this.move(cord, { ...this.shape, frame }, send, text, pixel);
  }

  private move(
    cord: CordState,
    shape: CordShape,
    send: Drag["send"],
    text: string,
    pixel: [number, number],
  ): void {
    const error = this.drag ? this.drag.error : (prediction.peek()?.drawn?.error ?? null);
    const drag: Drag = { cord, error, send, text, pixel };
    this.drag = drag;
    this.display(cord, shape);
    this.showReadout(drag, null);
    this.requests.ask(
      () => send(false),
      (answer, isNewest) => {
        if (this.drag?.cord !== cord) return;
        draggedJudgement.value = answer.judgement ?? draggedJudgement.peek();
        if (isNewest) this.display(cord, shapeWith(this.shape!, answer), answer.path);
        this.showReadout(this.drag, answer.snappedTo);
      },
      () => undefined, // the write reports what is wrong
    );
  }

  private display(cord: CordState, shape: CordShape, path = samplePath(shape)): void {
    this.shape = shape;
    if (!isPlaneShown.peek()) this.handles.show(cord.name, cord.color, shape);
    this.viewer.cords.setPath(cord.name, path);
  }

  private showReadout({ text, pixel, error }: Drag, snappedTo: string | null): void {
    const now = draggedJudgement.peek()?.error ?? null;
    const change = now !== null && error !== null ? now - error : null;
    this.readout.show(...pixel, snappedTo ? `${text}\nOn the ${snappedTo}` : text, change);
  }

  private drop(): void {
    const { drag } = this;
    if (!drag) return;
    this.drag = null;
    this.readout.hide();
    this.requests.ask(
      () => drag.send(true),
      (_, isNewest) => {
        if (isNewest && !this.drag) this.settle();
      },
      (error) => {
        if (error instanceof Refusal) showProblem(error.problem);
        this.restore(drag.cord);
      },
    );
  }

  private cancel(): void {
    const { drag } = this;
    this.requests.drop();
    this.drag = null;
    this.readout.hide();
    if (drag) this.restore(drag.cord);
  }

  /** Show the cord as the server has written it, once the answers are complete. */
  private settle(): void {
    draggedJudgement.value = null;
    setTimeout(() => {
      if (this.drag || this.requests.isWaiting) return;
      this.show(isDrawing.peek() ? null : selectedCord.peek(), isPlaneShown.peek());
    });
  }

  private restore(cord: CordState): void {
    draggedJudgement.value = null;
    this.viewer.cords.setPath(cord.name, cord.path);
    this.show(selectedCord.peek(), isPlaneShown.peek());
  }

  /** Add a control point where the selected cord is clicked twice. */
  private readonly onDoubleClick = (event: MouseEvent): void => {
    const cord = selectedCord.peek();
    const pick = this.viewer.picker.pick(...this.viewer.local(event));
    if (!cord || isDrawing.peek() || pick?.name !== cord.name) return;
    const { path, points } = cord;
    const distances = path.map((p) => Math.hypot(...p.map((v, k) => v - pick.point[k]!)));
    const nearest = distances.indexOf(Math.min(...distances));
    const perSpan = (path.length - 1) / (points.length - 1);
    const before = Math.min(points.length - 1, Math.floor(nearest / perSpan) + 1);
    const at = cord.isPlanar ? toPlane(cord, pick.point) : pick.point;
    void run(connection.send("insert-point", { cord: cord.name, before, at })).then((answer) => {
      if (answer !== undefined) selectedPoint.value = before;
    });
  };

  private pixelOf(shape: CordShape, index: number): [number, number] {
    const [x, y, z] = pointToWorld(shape, shape.points[index]!);
    return this.viewer.projectAt(x!, y!, z!);
  }
}

function deletePoint(index: number): void {
  const cord = selectedCord.peek();
  if (cord) void run(connection.send("delete-point", { cord: cord.name, index }));
}

function shapeOf({ origin, axes, isPlanar, isSmooth, points, tangents }: CordState): CordShape {
  return { frame: { origin, axes }, isPlanar, isSmooth, points, tangents };
}

function shapeWith(shape: CordShape, { points, tangents }: DragResult): CordShape {
  return { ...shape, points, tangents };
}

function replaced(rows: number[][], index: number, row: number[]): number[][] {
  return rows.map((old, i) => (i === index ? row : old));
}
