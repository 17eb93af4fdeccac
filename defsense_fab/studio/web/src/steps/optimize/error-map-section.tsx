import { Checkbox } from "../../ui/choices";
import { SelectField } from "../../ui/select-field";
import { stateWords } from "../../state/page-words";
import { errorMap } from "./error-map";
import { errorStates, isMapDeformed, mappedState } from "./state";

/** Choose the state whose error is shown on the surface. */
export function ErrorMapSection() {
  const states = errorStates.value?.states ?? [];
  if (states.length === 0) {
    return <p class="muted">Optimize the cords first. The map shows the error of the optimized ones.</p>;
  }
  const shown = states.find(({ name }) => name === mappedState.value);
  const map = errorMap.value;
  return (
    <>
      <SelectField
        label="State"
        value={mappedState.value}
        choices={[
          { value: "", label: "Off" },
          ...states.map(({ name, isHeldOut }) => ({
            value: name,
            label: `${stateWords(name)}${isHeldOut ? " (only tested)" : ""}`,
          })),
        ]}
        onCommit={async (value) => void (mappedState.value = value)}
      />
      {shown && (
        <>
          <Checkbox label="Deformed" isOn={isMapDeformed.value} onChange={(isOn) => (isMapDeformed.value = isOn)} />
          <dl class="fact-list">
            <Fact term="Over the surface, without noise" value={map ? `${map.mean.toFixed(2)} mm` : "…"} />
            <Fact term="Largest, without noise" value={map ? `${map.largest.toFixed(2)} mm` : "…"} />
            <Fact term="Expected error in this state" value={`${shown.expected.toFixed(2)} mm`} />
          </dl>
        </>
      )}
    </>
  );
}

function Fact({ term, value }: { term: string; value: string }) {
  return (
    <div>
      <dt>{term}</dt>
      <dd>{value}</dd>
    </div>
  );
}
