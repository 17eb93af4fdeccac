// The search for another cord: its switch with its progress, and what adds a cord.
import { useId } from "preact/hooks";
import { device } from "../../state/connection";
import { isPhone } from "../../state/layout";
import { Button } from "../../ui/button";
import { SegmentedControl } from "../../ui/choices";
import { ProgressBar } from "../../ui/feedback";
import { NumberField } from "../../ui/number-field";
import { type NextCordTool, search } from "./next-cord";
import { inside, type SectionView } from "./section-view";

const SHORTEST_MM = 10;
const LONGEST_MM = 1000;

interface Props {
  tool: NextCordTool;
  view: SectionView;
}

const isSearching = () => search.value?.state === "searching";

/** The switch of the search; its fill shows the progress. */
export function NextCordToggle({ tool }: { tool: NextCordTool }) {
  const noun = device.value?.noun ?? "cord";
  const isOn = tool.isOn.value;
  const share = isOn && isSearching() ? (search.value?.share ?? 0) : null;
  return (
    <span class="next-cord-toggle">
      <Button
        variant="quiet"
        icon="idea"
        aria-pressed={isOn}
        hint={`Color the section by how much one more ${noun} would lower the expected error`}
        shortcut="W"
        disabled={!inside.value?.isReady}
        onClick={() => tool.turn(!isOn)}
      >
        Where a {noun} would help
      </Button>
      {share !== null && <ProgressBar label={`Search for the best place of a ${noun}`} share={share} />}
    </span>
  );
}

/** The buttons that add a cord of the map. */
export function NextCordActions({ tool, view }: Props) {
  const noun = device.value?.noun ?? "cord";
  if (!tool.isOn.value) return null;
  const picked = view.picked.value;
  const isKnown = !tool.isDue.value;
  const fits = isKnown && picked !== null && tool.map.value !== null && tool.dropAt(picked.rest) !== null;
  const hasBest = Boolean(isKnown && tool.map.value && search.value?.ends.length);
  return (
    <>
      <Button
        icon="plus"
        hint={fits ? `Add the best ${noun} through the point` : "Click a colored point first"}
        disabled={!fits || tool.isAdding.value}
        onClick={() => void tool.add(picked!.rest)}
      >
        Propose a {noun} here
      </Button>
      <Button
        icon="check"
        hint={hasBest ? `Add the orange ${noun}` : "Wait until the search has found a place"}
        disabled={!hasBest || tool.isAdding.value}
        onClick={() => void tool.add(null)}
      >
        Add the best
      </Button>
    </>
  );
}

/** Which cords are tried, and what the best one would change. */
export function NextCordPanel({ tool, view }: Props) {
  const id = useId();
  const length = tool.length.value;
  const short = inside.value?.shortCord ?? 30;
  return (
    <div class="next-cord">
      <div class="field stack">
        <span id={id} class="field-label">
          Cords to try
        </span>
        <SegmentedControl
          label="Cords to try"
          value={length === null ? "through" : "short"}
          segments={[
            { value: "through", label: "Surface to surface", hint: "Cords that can be made" },
            { value: "short", label: "Short", hint: "Short cords show the best place" },
          ]}
          onChange={(kind) => (tool.length.value = kind === "short" ? short : null)}
        />
      </div>
      {length !== null && (
        <NumberField
          label="Length"
          unit="mm"
          value={length}
          min={SHORTEST_MM}
          max={LONGEST_MM}
          onCommit={(value) => {
            tool.length.value = value;
          }}
        />
      )}
      {tool.isOn.value && <SearchResult />}
      {isPhone.value && <NextCordActions tool={tool} view={view} />}
      {tool.isOn.value && isSearching() && (
        <Button icon="stop" onClick={() => tool.cancel()}>
          Cancel the search
        </Button>
      )}
    </div>
  );
}

function SearchResult() {
  const state = search.value;
  const noun = device.value?.noun ?? "cord";
  if (!state || state.state === "none") return null;
  if (state.problem) return <p class="field-error">{state.problem.message}</p>;
  if (state.state === "canceled") {
    return <p class="field-help">Canceled. Move the plane to search again.</p>;
  }
  if (!state.hasMap) return <p class="field-help">Searching the plane...</p>;
  if (state.drop <= 0) {
    const found = state.tried ? `lowers the error of ${state.error.toFixed(2)} mm` : "fits";
    return <p class="field-help">{`No ${noun} in this plane ${found}. Move the plane.`}</p>;
  }
  const best = state.error - state.drop;
  return (
    <dl class="section-numbers">
      <div>
        <dt>Expected error now</dt>
        <dd>{state.error.toFixed(2)} mm</dd>
      </div>
      <div>
        <dt>With the best {noun}</dt>
        <dd>
          <strong>{best.toFixed(2)} mm</strong>
        </dd>
      </div>
      <div>
        <dt>{state.state === "searching" ? "Tried so far" : "Tried"}</dt>
        <dd>
          {state.tried} {noun}s
        </dd>
      </div>
    </dl>
  );
}
