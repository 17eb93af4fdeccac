// What the step Poses shows in this browser, and the requests that it sends.
import { computed, effect, signal } from "@preact/signals";
import type { ArrayMessage } from "../../protocol/connection";
import type { PoseState, RegionState } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { select, selectedNames, selection } from "../../state/selection";
import { step } from "../../state/step";

export const posesState = connection.event("poses-state");
export const simulatedStates = connection.event("simulated-states");
export const proposedPoses = connection.event("proposed-poses");
export const poseShape = connection.event("pose-shape");
export const picturesState = connection.event("pose-pictures");

export const regions = computed(() => posesState.value?.regions ?? []);
export const isMeshed = computed(() => (posesState.value?.mesh ?? "missing") !== "missing");

/** The meshed body at rest, or null before it is meshed. */
export const meshedBody = signal<ArrayMessage | null>(null);
connection.onArrays("pose-body", (message) => {
  meshedBody.value = message.arrays["vertices"]?.length ? message : null;
});

/** The region that is edited: the one that was selected last, if nothing else was. */
export const editedRegion = computed(() => {
  const last = selection.value.at(-1);
  return last?.kind === "region" ? findRegion(last.name) : undefined;
});

/** The pose that is shown. */
export const shownPose = computed(() => {
  if (editedRegion.value) return undefined;
  const last = selection.value.findLast(({ kind }) => kind === "pose");
  return posesState.value?.poses.find(({ name }) => name === last?.name);
});

function findRegion(name: string): RegionState | undefined {
  return regions.value.find((region) => region.name === name);
}

export function findPose(name: string): PoseState | undefined {
  return posesState.value?.poses.find((pose) => pose.name === name);
}

/** What the gizmo moves in the shown pose: a region, or a pull by its index. */
export interface Grip {
  region: string;
  pull: number;
}

export const chosenGrip = signal<Grip | null>(null);

/** The chosen grip, or else the first thing that the pose moves. */
export const grip = computed<Grip | null>(() => {
  const pose = shownPose.value;
  if (!pose) return null;
  const { region, pull } = chosenGrip.value ?? { region: "", pull: -1 };
  if (pose.handles.some((handle) => handle.region === region)) return { region, pull: -1 };
  if (region === "" && pull >= 0 && pull < pose.pulls.length) return { region: "", pull };
  const first = pose.handles.find(({ turn }) => turn === "angle") ?? pose.handles[0];
  if (first) return { region: first.region, pull: -1 };
  return pose.pulls.length ? { region: "", pull: 0 } : null;
});

/** What a press on the scene does: turn the view, select points, or pull at the body. */
export const sceneTool = signal<"view" | "rectangle" | "pull">("view");

/** The proposed pose and the simulated state that the body shows, by name; empty for none. */
export const shownProposal = signal("");
export const shownState = signal("");

/** Centers of moved regions in the shown pose, by region, mm. */
export const centers = signal<Record<string, number[]>>({});
connection.listen("pose-shape", (event) => {
  if (Object.keys(event.centers).length) centers.value = event.centers;
});

export type ShapeStatus = "none" | "solving" | "coarse" | "solved" | "checked" | "stopped" | "failed";

/** How far the shape of the shown pose is. */
export const shapeStatus = computed<ShapeStatus>(() => {
  const event = poseShape.value;
  if (!event || event.pose !== shownPose.value?.name) return "none";
  if (event.phase === "canceled") return "stopped";
  if (event.phase === "not-reached" || event.phase === "invalid" || event.phase === "failed") {
    return "failed";
  }
  return event.phase;
});

/** Whether the pose shown is solved at present. */
export const isSolving = computed(
  () => shapeStatus.value === "solving" || shapeStatus.value === "coarse",
);

/** Select the first pose when the step is entered, so that there is something to change. */
function selectFirst(): void {
  const kinds = selection.peek().map(({ kind }) => kind);
  const first = posesState.value?.poses[0];
  if (!first || kinds.includes("pose") || kinds.includes("region")) return;
  select({ kind: "pose", name: first.name });
}

let isEntered = false;
effect(() => {
  const isHere = step.value === "poses";
  if (!isHere) isEntered = false;
  else if (!isEntered && posesState.value) {
    isEntered = true;
    setTimeout(selectFirst);
  }
});

// Another selection ends what was shown instead of it.
effect(() => {
  void selection.value;
  chosenGrip.value = null;
  shownProposal.value = "";
  shownState.value = "";
});

let followed = "";

/** Ask for the shape of the shown pose, and stop when none is shown. */
export function followShownPose(): () => void {
  const stop = effect(() => {
    const name = isMeshed.value ? (shownPose.value?.name ?? "") : "";
    if (!connection.isOpen.value) {
      followed = ""; // a new connection knows nothing of what this browser shows
      return;
    }
    if (name === followed) return;
    followed = name;
    centers.value = {};
    if (name) void connection.send("show-pose", { pose: name, share: 1 }).catch(() => undefined);
    else void connection.send("hide-pose", {}).catch(() => undefined);
  });
  return () => {
    stop();
    if (followed) void connection.send("hide-pose", {}).catch(() => undefined);
    followed = "";
  };
}

/** Names of the selected poses or regions. */
export const selectedPoses = (): string[] => selectedNames("pose");
export const selectedRegions = (): string[] => selectedNames("region");
