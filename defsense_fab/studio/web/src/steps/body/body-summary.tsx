import { connection, job, pipeline } from "../../state/connection";
import { run } from "../../state/run";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { formatNumber } from "../../ui/number";
import { bodyParameters, bodyStatus } from "./events";

const MM3_PER_CM3 = 1000;

/** The size of the newest body, whether it is up to date, and the button that makes it. */
export function BodySummary() {
  const status = bodyStatus.value;
  if (!status) return null;
  const { state, size, volume, problem, isPreview } = status;
  const isMaking = state === "making" || state === "waiting";
  const isNeeded = state === "not-agreed" || state === "stopped" || !size;
  const isScript = bodyParameters.value?.source === "script";
  const isNext = pipeline.value?.next.step === "body";
  return (
    <section class="body-summary" aria-label="Body">
      <div class="body-size">
        {size ? (
          <>
            <strong>{size.map((x) => formatNumber(x, 4)).join(" × ")} mm</strong>
            <span>{formatNumber(volume / MM3_PER_CM3, 4)} cm³</span>
          </>
        ) : (
          <strong>{isMaking ? "Making the body" : "No body yet"}</strong>
        )}
      </div>
      <StatusLine />
      {problem && (
        <p class="field-error" role="alert">
          <Icon name="error" size={14} /> <span class="body-problem">{problem.text}</span>
        </p>
      )}
      {isPreview && !isMaking && (
        <p class="field-help">Not built yet: Inside, Optimize and Make show the body of the last build.</p>
      )}
      <div class="body-actions">
        {isMaking ? (
          <Button icon="stop" onClick={() => void run(connection.send("stop-body", {}))}>
            Stop
          </Button>
        ) : (
          <Button
            icon={size ? "refresh" : "play"}
            variant={isNeeded && isNext ? "plain" : "quiet"}
            hint={isScript ? "Run the script with these parameters" : "Read the file of the body again"}
            onClick={() => void run(connection.send("make-body", {}))}
          >
            {size ? "Make the body again" : "Make the body"}
          </Button>
        )}
      </div>
    </section>
  );
}

function StatusLine() {
  const { state = "idle", text = "" } = bodyStatus.value ?? {};
  if (!text) return null;
  const isMaking = state === "making";
  const progress = isMaking && job.value?.name === "body" ? job.value.message : "";
  return (
    <p class={`body-state ${isMaking ? "" : "warning"}`} role="status">
      {isMaking ? <span class="spinner" aria-hidden="true" /> : <Icon name="warning" size={14} />}
      <span>
        {text}
        {progress && `: ${progress.replace(/^body: /, "")}`}
        {isMaking ? " …" : "."}
      </span>
    </p>
  );
}
