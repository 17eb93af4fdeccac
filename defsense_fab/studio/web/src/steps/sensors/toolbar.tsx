// The tools on the scene: select or draw, the plane that is drawn in, and the view.
import { effect } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { runCommand } from "../../commands";
import { DrawingBoard } from "../../scene/drawing-board";
import { cordMenuEntries, viewer } from "../../scene/stage";
import { cordMenu } from "../../shell/cord-commands";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { select } from "../../state/selection";
import { Button, IconButton } from "../../ui/button";
import { SegmentedControl } from "../../ui/choices";
import { CordEditor } from "./cord-editor";
import { HeatMapTools, heatMap } from "./heat-map";
import { showLimits } from "./limit-labels";
import { ProposeButton } from "./propose-button";
import { axisAcross, atOffset, offsetOf, type PlaneAxis } from "./planes";
import {
  choosePlane,
  sensorMenu,
  startDrawing,
  stopDrawing,
} from "./sensor-commands";
import { board, drawingFrame, isDrawing, isRedrawing, selectedCord } from "./state";

/** The tools; while they are on the page, cords can be edited in the scene. */
export function SensorsToolbar() {
  useEffect(() => effect(() => (viewer.value ? editCords(viewer.value) : undefined)), []);
  return (
    <>
      <SegmentedControl
        label="Tool"
        value={isDrawing.value ? "draw" : "select"}
        segments={[
          { value: "select", label: "Select", icon: "select", hint: "Select and move cords" },
          { value: "draw", label: "Draw", icon: "draw", hint: "Draw a cord in a plane (D)" },
        ]}
        onChange={(tool) => (tool === "draw" ? startDrawing() : stopDrawing())}
      />
      {!isDrawing.value && <ProposeButton variant="quiet" />}
      {isDrawing.value && <PlaneTools />}
    </>
  );
}

/** Choose the plane: across an axis, that of the selected cord, and its position. */
function PlaneTools() {
  const frame = drawingFrame.value!;
  const box = viewer.value?.body.box;
  const cord = selectedCord.value;
  if (!box) return null;
  const chosen = axisAcross(frame);
  const value = offsetOf(frame);
  const corners = [box.min, box.max].map((corner) =>
    [corner.x, corner.y, corner.z].map((v, k) => v * frame.axes[2]![k]!),
  );
  const sum = (pick: (a: number, b: number) => number) =>
    corners[0]!.reduce((total, v, k) => total + pick(v, corners[1]![k]!), 0);
  const [low, high] = [sum(Math.min), sum(Math.max)];
  return (
    <>
      <SegmentedControl
        label="Plane across"
        value={chosen ?? "cord"}
        segments={[
          { value: "x", label: "x", hint: "Plane across the x axis" },
          { value: "y", label: "y", hint: "Plane across the y axis" },
          { value: "z", label: "z", hint: "Plane across the z axis" },
          {
            value: "cord",
            label: "Cord",
            hint: cord?.isPlanar ? `Plane of ${cord.name}` : "Select a planar cord first",
            disabled: !cord?.isPlanar,
          },
        ]}
        onChange={(name: PlaneAxis | "cord") => {
          if (name !== "cord") choosePlane(name);
          else if (cord) drawingFrame.value = { origin: cord.origin, axes: cord.axes };
        }}
      />
      <label class="plane-offset">
        <span>Offset</span>
        <input
          aria-label="Offset of the plane"
          class="range"
          type="range"
          min={low}
          max={high}
          step={0.5}
          value={value}
          style={{ "--share": String(high > low ? (value - low) / (high - low) : 0) }}
          aria-valuetext={`${value.toFixed(1)} mm`}
          onInput={(event) => {
            drawingFrame.value = atOffset(frame, event.currentTarget.valueAsNumber);
          }}
        />
        <output>{value.toFixed(1)} mm</output>
      </label>
      {(board.value?.pen.points.value.length ?? 0) > 0 && (
        <Button
          disabled={board.value!.pen.points.value.length < 2}
          hint="End the cord at the last point"
          shortcut="Enter"
          onClick={() => runCommand("sensor.finish")}
        >
          Finish
        </Button>
      )}
      <IconButton icon="close" label="Stop drawing" shortcut="Escape" onClick={stopDrawing} />
      <HeatMapTools />
    </>
  );
}

/** Let cords be dragged, drawn and judged in a scene; return a function to stop. */
function editCords(scene: NonNullable<typeof viewer.value>): () => void {
  const editor = new CordEditor(scene);
  const drawing = new DrawingBoard(scene, (stroke) => void addStroke(stroke, drawing));
  board.value = drawing;
  cordMenuEntries.value = () => [...sensorMenu(), "separator", ...cordMenu()];
  const stops = [
    effect(() => {
      const frame = drawingFrame.value;
      drawing.open(frame);
      if (!frame) return;
      const { origin, axes } = frame;
      void run(connection.send("outline-of", { origin, axes })).then((outline) => {
        if (outline && drawingFrame.peek() === frame) drawing.setOutline(outline.segments);
      });
    }),
    heatMap.open(scene),
    effect(() => {
      heatMap.plane.value = drawingFrame.value;
    }),
    showLimits(scene),
  ];
  return () => {
    drawingFrame.value = null;
    cordMenuEntries.value = cordMenu;
    for (const stop of stops) stop();
    board.value = null;
    drawing.dispose();
    editor.dispose();
  };
}

async function addStroke(stroke: number[][], drawing: DrawingBoard): Promise<void> {
  const frame = drawingFrame.peek();
  if (!frame) return;
  const replaces = isRedrawing.peek() ? (selectedCord.peek()?.name ?? "") : "";
  const { origin, axes } = frame;
  const added = await run(connection.send("add-stroke", { origin, axes, stroke, replaces }));
  drawing.cancel();
  if (!added) return;
  drawing.pen.clear();
  drawing.pen.announce(`${added.name} ${replaces ? "redrawn" : "added"}`);
  select({ kind: "cord", name: added.name });
}
