// The question which cords the parts contain, if a build would move the drawn ones.
import { useId } from "preact/hooks";
import { isAskingForCords, startBuild } from "../state/building";
import { connection, device, prediction } from "../state/connection";
import { run } from "../state/run";
import { enterStep } from "../state/step";
import { Dialog } from "../ui/dialog";

const standing = connection.event("optimize-state");
const layouts = connection.event("layouts");

export function CordQuestion() {
  const isOpen = isAskingForCords.value;
  if (!isOpen || !device.value) return null;
  const { drawn = null, built = null, standing: code, obstacle = "" } = standing.value ?? {};
  const found = layouts.value?.rows.find(({ role }) => role === "built");
  const canBuild = found !== undefined && !found.problem;
  const hasFound = code === "drawn-differ" && Boolean(standing.value?.isBuiltMoved) && canBuild;
  const problem = prediction.value?.check.problem?.text;
  const place = standing.value?.isDrawnInParts ? "in the parts" : "without the cuts";
  const nouns = `${device.value.noun}s`;
  return (
    <Dialog title={`Which ${nouns} should the parts contain?`} onClose={close}>
      <p>
        The {nouns} in Sensors are not the optimized ones, and they are not locked.
      </p>
      <div class="choice-list">
        <Choice
          title={`Build these ${nouns} as drawn`}
          text={
            problem
              ? `They cannot be made: ${problem}`
              : `${expected(drawn, place)}They are locked: nothing moves them, and none is added.`
          }
          onChoose={() => void startBuild("report", "as-drawn")}
        />
        {hasFound && (
          <Choice
            title={`Build the optimized ${nouns}`}
            text={`${expected(built, "in the parts")}They replace the drawn ${nouns}; Undo brings those back.`}
            onChoose={() => void buildLayout(found.name)}
          />
        )}
        {!obstacle && (
          <Choice
            title={hasFound ? "Optimize again first" : "Optimize first"}
            text={`The optimizer moves the ${nouns} to reduce the error. Then choose a layout and build it.`}
            onChoose={() => {
              enterStep("optimize");
              void startBuild("optimize");
            }}
          />
        )}
      </div>
    </Dialog>
  );
}

function Choice({ title, text, onChoose }: { title: string; text: string; onChoose: () => void }) {
  const id = useId();
  return (
    <button
      type="button"
      class="choice-card"
      aria-labelledby={id}
      aria-describedby={`${id}-text`}
      onClick={() => {
        close();
        onChoose();
      }}
    >
      <b id={id}>{title}</b>
      <span id={`${id}-text`}>{text}</span>
    </button>
  );
}

function close(): void {
  isAskingForCords.value = false;
}

async function buildLayout(name: string): Promise<void> {
  const answer = await run(connection.send("use-layout", { name }));
  if (answer !== undefined) await startBuild("report");
}

const expected = (error: number | null, place: string): string =>
  error === null ? "" : `Expected error ${error.toFixed(2)} mm ${place}. `;
