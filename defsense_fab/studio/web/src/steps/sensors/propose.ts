// The search for the cord that lowers the error most; it simulates the poses first if necessary.
import { effect, signal } from "@preact/signals";
import { startBuild } from "../../state/building";
import { connection, device, isJobActive, job, prediction } from "../../state/connection";
import { run } from "../../state/run";
import { select } from "../../state/selection";
import { proposalShare } from "./state";

const LOAD_MS = 30_000; // in which a finished simulation is read
const ANSWER_MS = 2_000; // in which a script that may run starts

let giveUp: ReturnType<typeof setTimeout> | undefined;

/** Whether a cord is proposed as soon as the poses are simulated. */
export const isProposalWaiting = signal(false);

/** Why no cord can be proposed now; empty if one can. */
export function proposeObstacle(): string {
  if (proposalShare.value !== null) return "A search is running";
  if (isProposalWaiting.value) return "The poses are simulated first";
  if (prediction.value?.isReady) return "";
  if ((device.value?.poses.length ?? 0) === 0) return "Add a pose first";
  return isJobActive.value && job.value?.name !== "build" ? "Wait until the running job has ended" : "";
}

/** Add the cord that lowers the error most. */
export async function propose(): Promise<void> {
  if (!prediction.peek()?.isReady) {
    isProposalWaiting.value = true;
    clearTimeout(giveUp);
    if (!isJobActive.peek() && !(await startBuild("simulate"))) isProposalWaiting.value = false;
    return;
  }
  const added = await run(connection.send("propose", {}));
  if (added) select({ kind: "cord", name: added.name });
}

effect(() => {
  if (!isProposalWaiting.value || !prediction.value?.isReady || isJobActive.value) return;
  isProposalWaiting.value = false;
  void propose();
});

function stopWaiting(): void {
  isProposalWaiting.value = false;
}

// A simulation that fails, is canceled, or whose script may not run, ends the wait.
connection.listen("job", ({ state, share, givesWay }) => {
  if (state !== "idle" || givesWay || !isProposalWaiting.peek()) return;
  if (share < 1) stopWaiting();
  else giveUp = setTimeout(stopWaiting, LOAD_MS);
});
connection.listen("question", ({ path }) => {
  if (path || !isProposalWaiting.peek()) return;
  giveUp = setTimeout(() => {
    if (!isJobActive.peek()) stopWaiting();
  }, ANSWER_MS);
});
