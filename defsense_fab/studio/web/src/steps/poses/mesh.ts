// The mesh that poses need: it is made when the step is entered.
import { computed, effect } from "@preact/signals";
import { bodyFit, connection, job, pipeline } from "../../state/connection";
import { attempt } from "../../state/run";
import { bodyStatus } from "../body/events";
import { posesState } from "./state";

/** Whether the mesh is missing, or that of an earlier body. */
export const isMeshNeeded = computed(() => (posesState.value?.mesh ?? "current") !== "current");

export const isMeshing = computed(
  () => job.value?.name === "build" && job.value.state !== "idle" && isMeshNeeded.value,
);

/** Whether a mesh would replace simulated poses, which the user may want to return to. */
export const isSimulated = computed(
  () => pipeline.value?.steps.some(({ name, state }) => name === "inside" && state !== "blocked") ?? true,
);

const canMesh = computed(
  () =>
    isMeshNeeded.value &&
    !isSimulated.value &&
    bodyStatus.value?.state === "idle" &&
    bodyStatus.value.size !== null &&
    !bodyFit.value?.text &&
    (job.value?.state ?? "idle") === "idle",
);

export function makeMesh(onRefused: (text: string) => void = () => undefined): void {
  void attempt(connection.send("start-build", { stage: "mesh", cords: "ask" }), ({ text }) => onRefused(text));
}

/** Mesh each new body once, unless that replaces a simulation, as long as the step is entered; return a function to stop. */
export function followMesh(): () => void {
  let tried = "";
  return effect(() => {
    if (!canMesh.value) return;
    const { size, volume } = bodyStatus.value!;
    const body = JSON.stringify([size, volume]);
    if (body === tried) return;
    tried = body;
    makeMesh();
  });
}
