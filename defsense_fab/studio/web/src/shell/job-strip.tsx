// The strip at the bottom: the running job, or how the last one ended.
import { effect, signal } from "@preact/signals";
import { connection, job } from "../state/connection";
import { isPhone } from "../state/layout";
import { stateWords } from "../state/page-words";
import { cancelWork, pageWork } from "../state/page-work";
import { run } from "../state/run";
import { screen } from "../state/step";
import { Button, IconButton } from "../ui/button";
import { confirm } from "../ui/dialog";
import { ProgressBar } from "../ui/feedback";
import { Icon } from "../ui/icons";
import { RemedyButton } from "./remedy-button";

const LONG_JOB_MS = 60_000; // after which Cancel asks first
const DONE_MS = 10_000;

const startedAt = signal<number | null>(null);
const isResultShown = signal(false);

let timer: ReturnType<typeof setTimeout> | undefined;

// The end of a job is shown for a while where its run was seen; an error until it is dismissed.
effect(() => {
  const current = job.value;
  if (!current) return;
  clearTimeout(timer);
  if (current.state !== "idle") {
    startedAt.value ??= Date.now();
    isResultShown.value = false;
    return;
  }
  const wasSeen = startedAt.peek() !== null;
  startedAt.value = null;
  isResultShown.value = current.problem !== null || wasSeen;
  if (!current.problem) timer = setTimeout(() => (isResultShown.value = false), DONE_MS);
});

/** Cancel the job; a long one only after a question. */
export async function cancelJob(): Promise<void> {
  const title = job.value?.title ?? "";
  const isLong = Date.now() - (startedAt.value ?? Date.now()) > LONG_JOB_MS;
  const isConfirmed =
    !isLong ||
    (await confirm({
      title: "Cancel the job?",
      text: `“${title}” has run for more than a minute. Completed stages are kept.`,
      action: "Cancel the job",
      refusal: "Keep it running",
      isDanger: true,
    }));
  if (isConfirmed) await run(connection.send("cancel-job", {}));
}

export function JobStrip() {
  const current = job.value;
  const isActive = current !== null && current.state !== "idle";
  const isWorking = pageWork.value !== null;
  const isShown = isActive || isWorking || (isResultShown.value && Boolean(current?.title));
  // The strip keeps its place where there is room, so that nothing moves under the pointer.
  const isKept = screen.value === "device" && !isPhone.value;
  return (
    <footer class="job-strip" aria-label="Job" hidden={!isShown && !isKept}>
      {isActive && <RunningJob />}
      {isWorking && <RunningWork />}
      {!isActive && !isWorking && isShown && <EndedJob />}
      {!isShown && <span class="job-message">No job is running</span>}
    </footer>
  );
}

function RunningJob() {
  const { title, message, share, canPause, state } = job.value!;
  const isPaused = state === "paused";
  const percent = Math.round(share * 100);
  return (
    <>
      {isPaused ? <Icon name="pause" /> : <span class="spinner" aria-hidden="true" />}
      <strong>{title}</strong>
      <span class="job-message">{isPaused ? "paused" : stateWords(message)}</span>
      <ProgressBar label={title} share={share} />
      <span class="job-percent">{percent} %</span>
      {canPause && (
        <Button
          variant="quiet"
          icon={isPaused ? "play" : "pause"}
          onClick={() => void run(connection.send(isPaused ? "resume-job" : "pause-job", {}))}
        >
          {isPaused ? "Resume" : "Pause"}
        </Button>
      )}
      <Button variant="quiet" icon="stop" onClick={() => void cancelJob()}>
        Cancel
      </Button>
    </>
  );
}

/** What this page waits for. */
function RunningWork() {
  const { title, cancel, ...work } = pageWork.value!;
  const [share, isCanceled] = [work.share.value, work.isCanceled.value];
  return (
    <>
      <span class="spinner" aria-hidden="true" />
      <strong>{title}</strong>
      <span class="job-message">{isCanceled ? "Canceling" : ""}</span>
      <ProgressBar label={title} share={share} />
      {share !== null && <span class="job-percent">{Math.round(share * 100)} %</span>}
      {cancel && (
        <Button variant="quiet" icon="stop" isBusy={isCanceled} onClick={cancelWork}>
          Cancel
        </Button>
      )}
    </>
  );
}

function EndedJob() {
  const { title, message, problem, share } = job.value!;
  const isCanceled = !problem && share < 1;
  return (
    <>
      <span class={problem ? "job-failed" : isCanceled ? "job-canceled" : "job-done"}>
        <Icon name={problem ? "error" : isCanceled ? "stop" : "check"} />
      </span>
      <strong>{title}</strong>
      <span class="job-message ended" role={problem ? "alert" : "status"}>
        {problem ? problem.text : message || "done"}
      </span>
      {problem && <RemedyButton problem={problem} />}
      <IconButton icon="close" label="Dismiss" onClick={() => (isResultShown.value = false)} />
    </>
  );
}
