// Labels on the regions of the shown pose, axes of hinges, and lines to where points are pulled.
import { effect } from "@preact/signals";
import { Vector3 } from "three";
import type { PoseState } from "../../protocol/messages";
import type { Label } from "../../scene/label-layer";
import type { Viewer } from "../../scene/viewer";
import { isHidden, select } from "../../state/selection";
import { titleOf } from "./pose-gizmo";
import { shownVertices } from "./display";
import { centers, chosenGrip, editedRegion, grip, meshedBody, posesState, regions, shownPose, shownProposal } from "./state";
import { poseProblem } from "./warnings";

/** Half the length of a hinge's axis, times the body's size. */
const HINGE_SHARE = 0.25;
const SVG = "http://www.w3.org/2000/svg";

/** Show labels and pulls; return a function that removes them. */
export function showPoseMarks(viewer: Viewer): () => void {
  const stopLabels = effect(() => {
    const pose = shownPose.value;
    const isEmpty = Boolean(shownProposal.value) || !meshedBody.value;
    viewer.labels.set("poses", isEmpty ? [] : pose ? poseLabels(pose) : regionLabels());
  });
  const stopPulls = showLines(viewer);
  return () => {
    stopLabels();
    stopPulls();
    viewer.labels.set("poses", []);
  };
}

function poseLabels(pose: PoseState): Label[] {
  const problem = poseProblem(pose);
  const labels = regions.value.flatMap((region, k): Label[] => {
    const role = pose.roles[k];
    const handle = pose.handles.find((other) => other.region === region.name);
    if (role === "free" || role === undefined) return [];
    if (isHidden({ kind: "region", name: region.name })) return [];
    const at = (handle && centers.value[region.name]) || region.center;
    const label = { id: `region:${region.name}`, at, tone: "plain" as const, priority: 1 };
    if (!handle) return [{ ...label, text: `${region.name}: held` }];
    if (grip.value?.region === region.name) return []; // the gizmo has a title
    const moved = { region: region.name, pull: -1 };
    const onClick = () => (chosenGrip.value = moved);
    return [{ ...label, text: titleOf(pose, moved), priority: 2, onClick }];
  });
  if (problem) {
    const at = pose.handles[0] ? (centers.value[pose.handles[0].region] ?? pose.handles[0].center) : [0, 0, 0];
    labels.push({ id: "pose-problem", text: problem.short, at, tone: "alarm", priority: 3 });
  }
  return labels;
}

function regionLabels(): Label[] {
  const edited = editedRegion.value?.name; // its handles are there
  const shown = regions.value.filter(
    ({ name, problems }) =>
      (name !== edited || problems.length) && !isHidden({ kind: "region", name }),
  );
  return shown.map(({ name, center, problems }) => ({
    id: `region:${name}`,
    text: problems.length ? `${name}: ${problems[0]}` : name,
    at: center,
    tone: problems.length ? "alarm" : "plain",
    priority: problems.length ? 2 : 1,
    onClick: () => select({ kind: "region", name }),
  }));
}

/** A line in the scene between two points (3,), mm. */
interface Line {
  kind: "pull" | "hinge";
  from: Vector3;
  to: Vector3;
}

function poseLines(): Line[] {
  const pose = shownPose.peek();
  if (!pose || !meshedBody.peek() || shownProposal.peek()) return [];
  const reach = HINGE_SHARE * (posesState.peek()?.size ?? 100);
  const hinges = pose.handles.filter(({ turn }) => turn === "hinge");
  return [
    ...pose.pulls.map(({ at, by }): Line => {
      const goal = new Vector3().fromArray(at.map((value, i) => value + by[i]!));
      return { kind: "pull", from: movedPoint(at), to: goal };
    }),
    ...hinges.map(({ region, axis, center, about }): Line => {
      const middle = about ?? centers.peek()[region] ?? center;
      const end = (sign: number) =>
        new Vector3().fromArray(middle).addScaledVector(new Vector3().fromArray(axis), sign * reach);
      return { kind: "hinge", from: end(-1), to: end(1) };
    }),
  ];
}

function showLines(viewer: Viewer): () => void {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("class", "pose-lines");
  svg.setAttribute("aria-hidden", "true");
  viewer.overlay.prepend(svg);
  const lines: SVGLineElement[] = [];
  const place = () => {
    const shown = poseLines();
    while (lines.length > shown.length) lines.pop()!.remove();
    while (lines.length < shown.length) {
      const line = document.createElementNS(SVG, "line");
      svg.append(line);
      lines.push(line);
    }
    shown.forEach(({ kind, from, to }, k) => {
      const [x1, y1] = viewer.project(from);
      const [x2, y2] = viewer.project(to);
      lines[k]!.setAttribute("class", kind);
      for (const [key, value] of Object.entries({ x1, y1, x2, y2 })) {
        lines[k]!.setAttribute(key, value.toFixed(1));
      }
    });
  };
  const stop = viewer.onFrame(place);
  return () => {
    stop();
    svg.remove();
  };
}

/** Where the surface point next to a place at rest is at present. */
function movedPoint(at: number[]): Vector3 {
  const rest = meshedBody.peek()?.arrays["vertices"];
  const now = shownVertices.peek();
  const point = new Vector3().fromArray(at);
  if (!rest || rest.length !== now.length) return point;
  let [best, nearest] = [0, Infinity];
  for (let i = 0; i < rest.length; i += 3) {
    const distance = (rest[i]! - at[0]!) ** 2 + (rest[i + 1]! - at[1]!) ** 2 + (rest[i + 2]! - at[2]!) ** 2;
    if (distance < nearest) [best, nearest] = [i, distance];
  }
  point.x += now[best]! - rest[best]!;
  point.y += now[best + 1]! - rest[best + 1]!;
  point.z += now[best + 2]! - rest[best + 2]!;
  return point;
}
