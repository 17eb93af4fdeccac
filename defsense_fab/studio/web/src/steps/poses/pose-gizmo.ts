// The gizmo of the shown pose: it previews while it is dragged, and writes once it is released.
import { effect } from "@preact/signals";
import { Vector3 } from "three";
import type { HandleState, PoseState } from "../../protocol/messages";
import type { Viewer } from "../../scene/viewer";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { Gizmo } from "./gizmo";
import { LatestRequest } from "../sensors/latest-request";
import { handleRotation, plain, rotationText, turned } from "./rotations";
import { isLoading, share, showWhole } from "./ramp";
import { centers, findPose, type Grip, grip, isMeshed, shownPose, shownProposal, shownState } from "./state";

/** Time after the last press of a key at which its turns are written as one edit. */
const KEY_PAUSE_MS = 600;

interface Motion {
  pose: string;
  region: string;
  pull: number;
  position: number[];
  rotation: Vector3;
}

const requests = new LatestRequest<unknown>();
const ignore = () => undefined;

function preview(motion: Motion): void {
  const request = { ...content(motion), write: false };
  requests.ask(() => connection.send("move-grip", request), ignore, ignore);
}

function content({ pose, region, pull, position, rotation }: Motion) {
  return { pose, region, pull, position, rotation: rotation.toArray() };
}

/** Where a grip of a pose is at present. */
function motionOf(pose: PoseState, { region, pull }: Grip): Motion | null {
  const base = { pose: pose.name, region, pull };
  if (pull >= 0) {
    const found = pose.pulls[pull];
    if (!found) return null;
    return { ...base, position: sum(found.at, found.by), rotation: new Vector3() };
  }
  const handle = pose.handles.find((other) => other.region === region);
  if (!handle) return null;
  const shift = handle.shift.map((value) => value ?? 0);
  return { ...base, position: sum(handle.center, shift), rotation: handleRotation(handle) };
}

export const isFree = ({ shift }: HandleState): boolean => shift.some((value) => value === null);

/** Change what a grip does by keys or by a slider; the pose is written after a pause. */
class PendingMotion {
  private motion: Motion | null = null;
  private timer = 0;

  change(pose: PoseState, chosen: Grip, apply: (motion: Motion) => Motion): void {
    const known = this.motion;
    const isSame = known?.pose === pose.name && known.region === chosen.region && known.pull === chosen.pull;
    const from = isSame ? known : motionOf(pose, chosen);
    if (!from) return;
    this.motion = apply(from);
    preview(this.motion);
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.write(), KEY_PAUSE_MS);
  }

  write(): void {
    clearTimeout(this.timer);
    const { motion } = this;
    this.motion = null;
    if (motion) void writeMotion(motion);
  }
}

const pending = new PendingMotion();

async function writeMotion(motion: Motion): Promise<void> {
  requests.drop();
  await run(connection.send("move-grip", { ...content(motion), write: true }));
}

/** Turn the chosen region about an axis of the world by radians, or move it by mm, by a key. */
function stepChosen(kind: "ring" | "arrow", axis: Vector3, value: number): void {
  const [pose, chosen] = [shownPose.peek(), grip.peek()];
  if (!pose || !chosen) return;
  showWhole();
  pending.change(pose, chosen, (motion) =>
    kind === "ring"
      ? { ...motion, rotation: turned(motion.rotation, axis, value) }
      : { ...motion, position: sum(motion.position, axis.multiplyScalar(value).toArray()) },
  );
}

/** Turn the chosen region about an axis of the world by an angle, by a key. */
export function turnChosen(axis: "x" | "y" | "z", degrees: number): void {
  if ((grip.peek()?.pull ?? 0) >= 0) return;
  stepChosen("ring", new Vector3().setComponent("xyz".indexOf(axis), 1), (degrees * Math.PI) / 180);
}

/** Preview an angle about an axis while a slider is dragged. */
export function previewTurn(pose: string, handle: HandleState, degrees: number): void {
  const shown = findPose(pose);
  const motion = shown && motionOf(shown, { region: handle.region, pull: -1 });
  if (!motion) return;
  preview({ ...motion, rotation: handleRotation({ axis: handle.axis, degrees }) });
}

/** Show the gizmo of the chosen grip; return a function that removes it. */
export function showPoseGizmo(viewer: Viewer): () => void {
  let start: Motion | null = null;
  let motion: Motion | null = null;
  const begin = (): Motion | null => {
    const [pose, chosen] = [shownPose.peek(), grip.peek()];
    if (!start && pose && chosen) {
      showWhole();
      start = motionOf(pose, chosen);
    }
    return start;
  };
  const end = () => {
    start = motion = null;
    place();
  };
  const gizmo = new Gizmo(viewer, {
    onTurn: (axis, radians) => {
      const from = begin();
      if (!from) return;
      motion = { ...from, rotation: turned(from.rotation, axis, radians) };
      preview(motion);
    },
    onShift: (by) => {
      const from = begin();
      if (!from) return;
      motion = { ...from, position: sum(from.position, by.toArray()) };
      preview(motion);
    },
    onDrop: () => {
      if (motion) void writeMotion(motion);
      end();
    },
    onCancel: () => {
      requests.drop();
      const pose = shownPose.peek();
      if (pose) void run(connection.send("show-pose", { pose: pose.name, share: 1 }));
      end();
    },
    onStep: stepChosen,
    describe: () => describe(motion),
  });
  const place = () => {
    const [pose, chosen] = [shownPose.value, grip.value];
    const isWhole = share.value === 1 && !shownProposal.value && !shownState.value;
    const isShown = isMeshed.value && isWhole && (!isLoading.value || gizmo.isDragged);
    const base = pose && chosen && isShown ? motionOf(pose, chosen) : null;
    if (!base || !pose || !chosen) {
      gizmo.show(null);
      return;
    }
    const handle = pose.handles.find(({ region }) => region === chosen.region);
    const free = handle ? isFree(handle) : false;
    const center = (free && centers.value[chosen.region]) || base.position;
    if (gizmo.isDragged) return;
    gizmo.show({
      name: chosen.pull >= 0 ? `pull ${chosen.pull + 1}` : chosen.region,
      center,
      canTurn: handle?.turn === "angle",
      canShift: !free,
      title: titleOf(pose, chosen),
    });
  };
  const stop = effect(place);
  return () => {
    stop();
    pending.write();
    gizmo.dispose();
  };
}

/** What a pose does with a region or a pulled point, in one line. */
export function titleOf(pose: PoseState, { region, pull }: Grip): string {
  if (pull >= 0) return `Pull ${pull + 1}: ${pose.pulls[pull]!.by.map(plain).join(", ")} mm`;
  const handle = pose.handles.find((other) => other.region === region);
  if (!handle) return region;
  const turn =
    handle.turn === "angle" ? rotationText(handleRotation(handle)) : `turns freely (${handle.turn})`;
  const shift = handle.shift.map((value) => value ?? 0);
  const moved = !isFree(handle) && shift.some(Boolean) ? `, ${shift.map(plain).join(", ")} mm` : "";
  return `${region}: ${turn}${moved}`;
}

/** Rotation and translation that a motion has, in words. */
function describe(motion: Motion | null): string {
  const pose = shownPose.peek();
  const chosen = grip.peek();
  const now = motion ?? (pose && chosen ? motionOf(pose, chosen) : null);
  if (!now || !pose) return "";
  const handle = pose.handles.find(({ region }) => region === now.region);
  if (now.pull >= 0) {
    const by = now.position.map((value, k) => value - pose.pulls[now.pull]!.at[k]!);
    return `Total ${by.map(plain).join(", ")} mm`;
  }
  if (!handle) return "";
  const turn = `Total ${rotationText(now.rotation)}`;
  if (isFree(handle)) return turn;
  const shift = now.position.map((value, k) => value - handle.center[k]!);
  return `${turn}\nMoved ${shift.map(plain).join(", ")} mm`;
}

function sum(a: readonly number[], b: readonly number[]): number[] {
  return a.map((value, k) => value + b[k]!);
}
