// The search for the cord that lowers the error most; it simulates the poses first if necessary.
import { computed, effect, signal } from "@preact/signals";
import type { ProposalResult } from "../../protocol/messages";
import { startBuild } from "../../state/building";
import { connection, device, isJobActive, job, prediction } from "../../state/connection";
import { type PageWork, newWork, showWork } from "../../state/page-work";
import { attempt, run, showRefusal } from "../../state/run";
import { select } from "../../state/selection";
import { showToast } from "../../state/toasts";

const LOAD_MS = 30_000; // in which a finished simulation is read
const ANSWER_MS = 2_000; // in which a script that may run starts

let searchCount = 0;
let giveUp: ReturnType<typeof setTimeout> | undefined;

/** The search that runs. */
const search = signal<PageWork | null>(null);

/** Whether a cord is proposed as soon as the poses are simulated. */
const isProposalWaiting = signal(false);

/** Whether a search runs, or waits for the simulation. */
export const isProposing = computed(() => search.value !== null || isProposalWaiting.value);

/** Why no cord can be proposed now; empty if one can. */
export function proposeObstacle(): string {
  if (search.value) return "A search is running";
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
  const noun = device.peek()?.noun ?? "cord";
  const number = ++searchCount;
  const cancel = () => void run(connection.send("cancel-proposal", { search: number }));
  const work = newWork(`Search for another ${noun}`, cancel);
  search.value = work;
  const added = await attempt(showWork(work, connection.send("propose", { search: number })), (problem) => {
    if (problem.code === "cancelled") showToast(`Search canceled: no ${noun} was added`);
    else showRefusal(problem);
  });
  search.value = null;
  if (!added) return;
  select({ kind: "cord", name: added.name });
  showToast(describeAdded(added), { label: "Undo", run: () => void run(connection.send("undo", {})) });
}

function describeAdded({ name, error, errorBefore }: ProposalResult): string {
  if (error === null) return `Added ${name}`;
  const start = errorBefore === null ? "" : `${errorBefore.toFixed(2)} → `;
  return `Added ${name}: ${start}${error.toFixed(2)} mm in the parts`;
}

connection.listen("proposal-progress", ({ share }) => {
  if (share !== null && search.peek()) search.peek()!.share.value = share;
});

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
