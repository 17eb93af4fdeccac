// What the scene's body shows: rest, the shown pose, a share of it, a state or a proposal.
import { effect, signal } from "@preact/signals";
import type { NumberArray } from "../../protocol/connection";
import type { Viewer } from "../../scene/viewer";
import { areCordsShown } from "../../scene/stage";
import { connection } from "../../state/connection";
import { isDark } from "../../state/theme";
import { sceneColors } from "../../scene/theme";
import { attempt } from "../../state/run";
import { showProblem } from "../../state/toasts";
import { hovered, isHidden } from "../../state/selection";
import { type ColoredRegion, PosedBody } from "./posed-body";
import { rampShape, share } from "./ramp";
import { type RegionShape, verticesInside } from "./region-geometry";
import {
  editedRegion,
  meshedBody,
  proposedPoses,
  regions,
  shownPose,
  shownProposal,
  shownState,
} from "./state";

/** Vertices (v, 3) mm that the server has sent last for the shown pose. */
const sentShape = signal<{ pose: string; vertices: NumberArray } | null>(null);
connection.onArrays("pose-shape", ({ arrays, facts }) => {
  const pose: string = facts["pose"];
  const isWhole = facts["share"] === share.peek() || share.peek() === 1;
  if (isWhole || facts["phase"] === "solved") sentShape.value = { pose, vertices: arrays["vertices"]! };
});

const proposedShapes = signal<Map<string, NumberArray>>(new Map());
connection.onArrays("proposed-poses", ({ arrays, facts }) => {
  const names: string[] = facts["poses"];
  proposedShapes.value = new Map(
    names.flatMap((name, k) => {
      const shape = arrays[String(k)];
      return shape ? [[name, shape] as const] : [];
    }),
  );
});

const stateShape = signal<{ state: string; moved: NumberArray } | null>(null);
effect(() => {
  const state = shownState.value;
  if (!state || stateShape.peek()?.state === state) return;
  void attempt(connection.fetch("state-shape", { state }), (problem) => {
    showProblem(problem);
  }).then((answer) => {
    if (answer) stateShape.value = { state, moved: answer.arrays["moved"]! };
  });
});

/** Region whose shape is dragged at present, in place of that of the device. */
export const draggedRegion = signal<{ name: string; shape: RegionShape } | null>(null);

/** The region under the pointer in the scene; empty for none. */
export const hoveredRegion = signal("");

/** The vertices (v, 3) mm that are shown. */
export const shownVertices = signal<NumberArray>(new Float32Array());

/** Show the step's body in the scene; return a function that restores the device's body. */
export function showPosedBody(viewer: Viewer): () => void {
  const colored = new PosedBody(null);
  let body: NumberArray | undefined;
  const replacements = signal(0);
  viewer.scene.add(colored.object);
  areCordsShown.value = false;
  viewer.body.setGrid(true);
  const stops = [
    // The body of the device replaces the meshed one, which is shown again.
    connection.onArrays("body", () => {
      body = undefined;
      replacements.value = replacements.peek() + 1;
    }),
    effect(() => {
      const message = meshedBody.value;
      if (!message) return;
      viewer.body.set(message.arrays);
      body = message.arrays["vertices"];
      colored.set(message.arrays);
    }),
    effect(() => {
      const rest = meshedBody.value?.arrays["vertices"];
      void isDark.value;
      colored.color(coloredRegions(rest, sceneColors().body));
      viewer.refresh();
    }),
    effect(() => {
      void replacements.value;
      const message = meshedBody.value;
      const vertices = currentVertices();
      if (!message || !vertices) return;
      if (body !== message.arrays["vertices"]) {
        viewer.body.set(message.arrays);
        body = message.arrays["vertices"];
      }
      viewer.body.deform(vertices);
      colored.deform(vertices);
      shownVertices.value = vertices;
    }),
  ];
  return () => {
    for (const stop of stops) stop();
    viewer.scene.remove(colored.object);
    colored.dispose();
    areCordsShown.value = true;
    viewer.body.setGrid(false);
    const stop = connection.onArrays("body", ({ arrays }) => viewer.body.set(arrays));
    stop();
  };
}

function coloredRegions(rest: NumberArray | undefined, bodyColor: string): ColoredRegion[] {
  if (!rest) return [];
  const dragged = draggedRegion.value;
  const inTree = hovered.value?.kind === "region" ? hovered.value.name : "";
  const lit = hoveredRegion.value || inTree || (editedRegion.value?.name ?? "");
  const pose = shownPose.value;
  const isUsed = (index: number) => !pose || pose.roles[index] !== "free";
  const all = regions.value.map((region, index) => {
    const shape = dragged?.name === region.name ? dragged.shape : region;
    const color = isUsed(index) ? region.color : mixed(region.color, bodyColor, 0.65);
    const isFirst = isUsed(index) || region.name === lit;
    return {
      isFirst,
      color: region.name === lit ? mixed(color, "#ffffff", 0.35) : color,
      inside: verticesInside(shape, rest),
    };
  });
  const shown = all.filter((_, index) => !isHidden({ kind: "region", name: regions.value[index]!.name }));
  // A face in two regions has the color of the one that the pose uses.
  return [...shown.filter(({ isFirst }) => isFirst), ...shown.filter(({ isFirst }) => !isFirst)];
}

function currentVertices(): NumberArray | null {
  const rest = meshedBody.value?.arrays["vertices"];
  if (!rest) return null;
  const proposed = proposedPoses.value && proposedShapes.value.get(shownProposal.value);
  if (proposed?.length === rest.length) return added(rest, proposed);
  const state = shownState.value;
  if (state && stateShape.value?.state === state && stateShape.value.moved.length === rest.length) {
    return added(rest, stateShape.value.moved);
  }
  const pose = shownPose.value;
  if (!pose) return rest;
  const moved = rampShape.value;
  if (moved?.length === rest.length) return added(rest, moved);
  const sent = sentShape.value;
  return sent?.pose === pose.name && sent.vertices.length === rest.length ? sent.vertices : null;
}

function added(rest: NumberArray, moved: NumberArray): Float32Array {
  const sum = new Float32Array(rest.length);
  for (let i = 0; i < sum.length; i++) sum[i] = rest[i]! + moved[i]!;
  return sum;
}

/** A color "#rrggbb" with a share of another one. */
function mixed(color: string, other: string, part: number): string {
  const channels = [1, 3, 5].map((at) => {
    const [from, to] = [color, other].map((text) => parseInt(text.slice(at, at + 2), 16)) as [number, number];
    return Math.round(from + part * (to - from));
  });
  return `#${channels.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
}
