import type { LayoutRow } from "../../protocol/messages";
import { inPageWords } from "../../state/page-words";
import { Button } from "../../ui/button";
import { tooltip } from "../../ui/tooltip";
import { Table } from "../../ui/table";
import type { Tone } from "./charts/scatter";
import {
  applyLayout,
  choose,
  chosenName,
  inParts,
  layoutLabel,
  layoutName,
  mm,
  printTime,
  rows,
  useHint,
} from "./state";

/** All layouts side by side, with the same numbers for each. */
export function LayoutTable() {
  return (
    <Table
      caption="Layouts; errors in mm"
      columns={[
        { title: "Layout", cell: name },
        { title: "Error without cuts", cell: ({ drawnError }) => mm(drawnError), isNumber: true },
        { title: "Error in parts", cell: inParts, isNumber: true },
        { title: "Parts", cell: parts, isNumber: true },
        { title: "Print time", cell: time, isNumber: true },
        { title: "Error in use (90 %)", cell: trained, isNumber: true },
        { title: "Cord", cell: ({ length }) => unit(length && length / 10, 0, "cm"), isNumber: true },
        { title: "Use", cell: use },
      ]}
      rows={rows.value}
      rowKey={(row) => row.name}
      onChoose={(row) => choose(row.name)}
      isChosen={(row) => row.name === chosenName.value}
    />
  );
}

const MEANINGS: Partial<Record<LayoutRow["role"], string>> = {
  candidate: "Another layout that the optimizer has tried",
  straight: "Straight cords where the strain is largest, placed without the optimizer",
  earlier: "Of an earlier design: its numbers may differ now",
};

function name(row: LayoutRow) {
  return (
    <span
      class="layout-name"
      {...tooltip(MEANINGS[row.role])}
    >
      <i class={`chart-mark ${dotTone(row)}`} aria-hidden="true" />
      {layoutName(row)}
    </span>
  );
}

function trained({ trained: middle, trainedLow: low, trainedHigh: high }: LayoutRow) {
  if (low === null || high === null) return mm(middle);
  return (
    <>
      {mm(middle)} <span class="range-text">({mm(low)}–{mm(high)})</span>
    </>
  );
}

function time({ printHours }: LayoutRow): string {
  return printHours === null ? "–" : printTime(printHours);
}

function unit(value: number | null, digits: number, name: string): string {
  return value === null ? "–" : `${value.toFixed(digits)} ${name}`;
}

function parts({ parts: count, problem }: LayoutRow) {
  return problem ? <span class="cannot-make" data-tooltip={inPageWords(problem)}>cannot be made</span> : (count ?? "–");
}

function use(row: LayoutRow) {
  if (row.isDrawn) return <span class="muted">in use</span>;
  return (
    <Button
      variant="quiet"
      aria-label={`Use ${layoutLabel(row)}`}
      disabled={Boolean(row.problem)}
      hint={useHint(row)}
      onClick={(event) => {
        event.stopPropagation();
        void applyLayout(row.name);
      }}
    >
      Use
    </Button>
  );
}

export function dotTone({ role, isDrawn }: LayoutRow): Tone {
  if (role === "earlier") return "earlier";
  if (role === "built") return "built";
  return isDrawn || role === "drawn" ? "drawn" : "other";
}
