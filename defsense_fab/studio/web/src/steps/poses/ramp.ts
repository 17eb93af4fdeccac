// The ramp of the shown pose: any share of it, and all of it as a film.
import { computed, effect, signal } from "@preact/signals";
import { connection } from "../../state/connection";
import { attempt, run } from "../../state/run";
import { showProblem } from "../../state/toasts";
import { LatestRequest } from "../sensors/latest-request";
import { isMeshed, meshedBody, shownPose, shownState, simulatedStates } from "./state";

const FILM_MS = 2000;

interface Ramp {
  pose: string;
  /** Digest of the pose that it belongs to. */
  digest: string;
  /** Displacements (v, 3) mm at equal shares from rest to `end`. */
  frames: Float32Array[];
  end: number;
  remark: string;
  isSimulated: boolean;
}

const loaded = signal<Ramp | null>(null);

/** Share of the pose that is shown, 0 to 1. */
export const share = signal(1);
export const isPlaying = signal(false);
export const isLoading = signal(false);

/** The ramp of the shown pose, once it is known. */
export const ramp = computed(() => {
  const pose = shownPose.value;
  const known = loaded.value;
  return known && pose && known.digest === pose.picture ? known : null;
});

// Another pose, or another version of it, is shown whole.
let shownDigest = "";
effect(() => {
  const digest = shownPose.value?.picture ?? "";
  if (digest === shownDigest) return;
  shownDigest = digest;
  stopFilm();
  share.value = 1;
});

const partial = new LatestRequest<unknown>();
const ignore = () => undefined;

/** Show a share of the pose: from the ramp if it is known, else solved now. */
export function setShare(value: number): void {
  stopFilm();
  shownState.value = "";
  showShare(value);
}

/** Show all of the pose, as before it is dragged; the ramp is not needed for that. */
export function showWhole(): void {
  if (share.peek() < 1) setShare(1);
  else {
    stopFilm();
    shownState.value = "";
  }
}

function showShare(value: number): void {
  share.value = value;
  const pose = shownPose.peek();
  if (ramp.peek() || !pose) return;
  if (simulatedStates.peek()?.isCurrent && !isLoading.peek()) void load(); // takes no solver
  else if (value > 0) {
    const request = { pose: pose.name, share: value };
    partial.ask(() => connection.send("show-pose", request), ignore, ignore);
  }
}

/** Displacements (v, 3) mm at the shown share; null to show the shape that the server sends. */
export const rampShape = computed(() => {
  if (share.value === 0 && shownPose.value) return zero();
  const known = ramp.value;
  if (!known || (share.value === 1 && known.end === 1)) return null;
  return between(known, Math.min(share.value, known.end));
});

function zero(): Float32Array {
  return new Float32Array(meshedBody.value?.arrays["vertices"]?.length ?? 0);
}

function between({ frames, end }: Ramp, value: number): Float32Array {
  const at = (value / end) * (frames.length - 1);
  const index = Math.min(Math.floor(at), frames.length - 2);
  const [from, to, part] = [frames[index]!, frames[index + 1]!, at - index];
  const shape = new Float32Array(from.length);
  for (let i = 0; i < shape.length; i++) shape[i] = from[i]! + part * (to[i]! - from[i]!);
  return shape;
}

async function load(): Promise<Ramp | null> {
  const pose = shownPose.peek();
  if (!pose || !isMeshed.peek()) return null;
  isLoading.value = true;
  const answer = await attempt(connection.fetch("follow-ramp", { pose: pose.name }), (problem) => {
    if (problem.code !== "canceled") showProblem(problem);
  });
  isLoading.value = false;
  if (!answer) {
    // Shapes on the way were shown while it was solved.
    void connection.send("show-pose", { pose: pose.name, share: 1 }).catch(ignore);
    return null;
  }
  const values = answer.arrays["frames"] as Float32Array;
  const [count, vertices] = answer.shapes["frames"]! as [number, number];
  const frames = Array.from({ length: count }, (_, k) =>
    values.subarray(3 * vertices * k, 3 * vertices * (k + 1)),
  );
  const { end, remark, isSimulated } = answer.facts;
  loaded.value = { pose: pose.name, digest: pose.picture, frames, end, remark, isSimulated };
  return ramp.peek();
}

let film = 0;

/** Show the pose from rest to its end, or stop that. */
export async function playRamp(): Promise<void> {
  if (isPlaying.peek() || isLoading.peek()) {
    if (isLoading.peek()) await run(connection.send("stop-solving", {}));
    stopFilm();
    return;
  }
  isPlaying.value = true;
  const known = ramp.peek() ?? (await load());
  if (!known || !isPlaying.peek()) {
    isPlaying.value = false;
    return;
  }
  shownState.value = "";
  const started = performance.now();
  const show = (now: number) => {
    if (!isPlaying.peek()) return;
    const done = Math.min(1, Math.max(0, (now - started) / FILM_MS));
    share.value = done;
    if (done < 1) film = requestAnimationFrame(show);
    else isPlaying.value = false;
  };
  film = requestAnimationFrame(show);
}

function stopFilm(): void {
  cancelAnimationFrame(film);
  if (isPlaying.peek()) isPlaying.value = false;
}
