// What the step Poses shows in the scene, and what clicks in it do.
import { effect } from "@preact/signals";
import { Vector3 } from "three";
import { tool } from "../../scene/stage";
import type { Pick } from "../../scene/types";
import type { Viewer } from "../../scene/viewer";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { isSelected, select } from "../../state/selection";
import { openContextMenu } from "../../ui/menu";
import { poseMenu, regionMenu } from "./commands";
import { hoveredRegion, showPosedBody, shownVertices } from "./display";
import { followMesh } from "./mesh";
import { showPoseGizmo } from "./pose-gizmo";
import { showPoseMarks } from "./pose-marks";
import { listenForRectangles } from "./rectangle";
import { verticesInside } from "./region-geometry";
import { showRegionHandles } from "./region-handles";
import { chosenGrip, followShownPose, meshedBody, regions, sceneTool, shownPose } from "./state";

/** Margin above and below the body, for the tool bar and for rings at its ends. */
const MARGIN_PX = 96;

/** Show the step's things in the scene; return a function that removes them. */
export function showPoses(viewer: Viewer): () => void {
  const usualMargin = viewer.rig.marginHeight;
  viewer.rig.marginHeight = MARGIN_PX;
  viewer.rig.fitAgain();
  const stops = [
    followMesh(),
    showPosedBody(viewer),
    showRegionHandles(viewer),
    showPoseGizmo(viewer),
    showPoseMarks(viewer),
    listenForRectangles(viewer),
    followShownPose(),
    listenForHover(viewer),
    effect(() => {
      viewer.canvas.style.cursor = sceneTool.value === "view" ? "" : "crosshair";
    }),
  ];
  tool.value = {
    onClick: (pick) => {
      if (sceneTool.peek() === "pull") {
        void pullAt(pick);
        return true;
      }
      const region = pick && regionAt(pick);
      if (!region) return false;
      choose(region);
      return true;
    },
    onMenu: (pick, x, y) => {
      const region = pick && regionAt(pick);
      const pose = shownPose.peek();
      if (region) {
        const item = { kind: "region" as const, name: region };
        if (!isSelected(item)) select(item);
        openContextMenu({ x, y }, `Actions for ${region}`, regionMenu());
      } else if (pose && pick) openContextMenu({ x, y }, `Actions for ${pose.name}`, poseMenu());
      else return false;
      return true;
    },
  };
  return () => {
    viewer.rig.marginHeight = usualMargin;
    viewer.rig.fitAgain();
    tool.value = null;
    sceneTool.value = "view";
    for (const stop of stops) stop();
  };
}

/** Choose a region: what the shown pose moves of it, or else the region itself. */
function choose(region: string): void {
  const isMoved = shownPose.peek()?.handles.some((handle) => handle.region === region);
  if (isMoved) chosenGrip.value = { region, pull: -1 };
  else select({ kind: "region", name: region });
}

/** The name of the region whose face is at a pick. */
function regionAt({ kind, faceIndex }: Pick): string | null {
  const body = meshedBody.peek();
  if (kind !== "body" || faceIndex < 0 || !body) return null;
  const corners = [...body.arrays["faces"]!.subarray(3 * faceIndex, 3 * faceIndex + 3)];
  const rest = body.arrays["vertices"]!;
  const points = corners.flatMap((corner) => [...rest.subarray(3 * corner, 3 * corner + 3)]);
  const found = regions.peek().find((region) => verticesInside(region, points).every(Boolean));
  return found?.name ?? null;
}

function listenForHover(viewer: Viewer): () => void {
  const stop = new AbortController();
  let frame = 0;
  viewer.canvas.addEventListener(
    "pointermove",
    (event) => {
      if (event.buttons !== 0 || sceneTool.peek() !== "view" || frame) return;
      frame = requestAnimationFrame(() => {
        frame = 0;
        const pick = viewer.picker.pick(...viewer.local(event));
        const name = pick && regionAt(pick);
        hoveredRegion.value = name ?? "";
        viewer.canvas.style.cursor = name ? "pointer" : "";
      });
    },
    { signal: stop.signal },
  );
  viewer.canvas.addEventListener("pointerleave", () => (hoveredRegion.value = ""), {
    signal: stop.signal,
  });
  return () => {
    cancelAnimationFrame(frame);
    stop.abort();
    hoveredRegion.value = "";
  };
}

/** Pull at the point of the body that was clicked. */
async function pullAt(pick: Pick | null): Promise<void> {
  const [pose, body] = [shownPose.peek(), meshedBody.peek()];
  if (!pose || !body || pick?.kind !== "body") return;
  const corners = [...body.arrays["faces"]!.subarray(3 * pick.faceIndex, 3 * pick.faceIndex + 3)];
  const at = (vertices: ArrayLike<number>) =>
    corners.map((corner) => new Vector3().fromArray(vertices, 3 * corner));
  const [a, b, c] = at(shownVertices.peek()) as [Vector3, Vector3, Vector3];
  const [restA, restB, restC] = at(body.arrays["vertices"]!) as [Vector3, Vector3, Vector3];
  const normal = b.clone().sub(a).cross(c.clone().sub(a)).normalize();
  const weights = barycentric(new Vector3().fromArray(pick.point), a, b, c);
  const point = restA
    .multiplyScalar(weights[0])
    .addScaledVector(restB, weights[1])
    .addScaledVector(restC, weights[2]);
  sceneTool.value = "view";
  const count = pose.pulls.length;
  const request = { pose: pose.name, at: point.toArray(), normal: normal.toArray() };
  const answer = await run(connection.send("add-pull", request));
  if (answer !== undefined) chosenGrip.value = { region: "", pull: count };
}

function barycentric(point: Vector3, a: Vector3, b: Vector3, c: Vector3): [number, number, number] {
  const [u, v, w] = [b.clone().sub(a), c.clone().sub(a), point.clone().sub(a)];
  const [uu, uv, vv, wu, wv] = [u.dot(u), u.dot(v), v.dot(v), w.dot(u), w.dot(v)];
  const determinant = uu * vv - uv * uv || 1;
  const s = (vv * wu - uv * wv) / determinant;
  const t = (uu * wv - uv * wu) / determinant;
  return [1 - s - t, s, t];
}
