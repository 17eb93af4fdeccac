import type { LayoutRow } from "../../protocol/messages";
import { inPageWords } from "../../state/page-words";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { applyLayout, inParts, layoutLabel, mm, printTime, useHint } from "./state";
import { mainVariant } from "../../state/step";

const unit = (value: number | null): string => (value === null ? "not computed" : `${mm(value)} mm`);

/** The numbers and the notes of a layout, and the button that uses it. */
export function LayoutDetails({ row }: { row: LayoutRow }) {
  const { trained, trainedLow, trainedHigh, printHours, length, problem, notes } = row;
  const range = trainedLow === null ? "" : ` (90 %: ${mm(trainedLow)} to ${mm(trainedHigh)})`;
  const facts: [string, string][] = [
    ["Expected error, without the cuts", unit(row.drawnError)],
    ["Expected error, in the parts", inParts(row)],
    ["Error in use", trained === null ? "not computed" : `${mm(trained)} mm${range}`],
    ["Parts", row.parts === null ? "not computed" : String(row.parts)],
    ["Print time", printHours === null ? "no estimate" : `about ${printTime(printHours)}`],
    ["Cords", `${row.cords.length}, ${length === null ? "–" : length.toFixed(0)} mm in all`],
    ["Planes", String(row.planes)],
  ];
  return (
    <div class="layout-details">
      <h4>{layoutLabel(row)}</h4>
      <dl class="fact-list">
        {facts.map(([term, value]) => (
          <div key={term}>
            <dt>{term}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {row.role === "earlier" && (
        <p class="note">
          <Icon name="info" /> Of an earlier design: its numbers may differ now.
        </p>
      )}
      {problem && (
        <p class="note danger">
          <Icon name="error" /> {inPageWords(problem)}
        </p>
      )}
      <Button
        variant={mainVariant.value}
        disabled={row.isDrawn || Boolean(problem)}
        hint={useHint(row)}
        onClick={() => void applyLayout(row.name)}
      >
        Use this
      </Button>
      {notes.length > 0 && (
        <details class="layout-notes" open={notes.length <= 2}>
          <summary>
            {notes.length === 1 ? "1 warning" : `${notes.length} warnings`} about the parts
          </summary>
          <ul>
            {notes.map((note) => (
              <li key={note}>{inPageWords(note)}</li>
            ))}
          </ul>
        </details>
      )}
    </div>
  );
}
