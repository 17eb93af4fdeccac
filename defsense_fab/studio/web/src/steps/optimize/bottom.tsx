// The panel below the scene: the search while it runs, or the layouts side by side.
import type { LayoutRow } from "../../protocol/messages";
import { isJobActive } from "../../state/connection";
import { Button } from "../../ui/button";
import { SegmentedControl } from "../../ui/choices";
import { EmptyState } from "../../ui/feedback";
import { ErrorCurve } from "./charts/error-curve";
import { PoseErrors } from "./charts/pose-errors";
import { type Dot, Scatter } from "./charts/scatter";
import { LayoutTable, dotTone } from "./layout-table";
import {
  COSTS,
  type Cost,
  choose,
  chosenName,
  compareLayouts,
  cost,
  hoveredName,
  isComparing,
  layoutLabel,
  layouts,
  rows,
  search,
  view,
} from "./state";

export function OptimizeBottom() {
  return (
    <div class="optimize-bottom">
      <div class="optimize-views">
        <SegmentedControl
          label="Panel"
          value={view.value}
          segments={[
            { value: "layouts", label: "Layouts" },
            { value: "search", label: "Progress" },
          ]}
          onChange={(value) => (view.value = value)}
        />
        {view.value === "layouts" && rows.value.length > 0 && (
          <>
            <SegmentedControl<Cost>
              label="Compare the error with"
              value={cost.value}
              segments={(["parts", "hours", "cords"] as const).map((value) => ({
                value,
                label: COSTS[value].label,
              }))}
              onChange={(value) => (cost.value = value)}
            />
            <CompareButton />
          </>
        )}
      </div>
      {view.value === "search" ? <SearchCharts /> : <Comparison />}
    </div>
  );
}

function SearchCharts() {
  const current = search.value;
  if (!current || current.state === "none") {
    return <EmptyState icon="optimize" text="Nothing has been optimized since the studio was opened." />;
  }
  return (
    <div class="optimize-charts halves">
      <ErrorCurve search={current} />
      <PoseErrors poses={current.poses} />
    </div>
  );
}

function Comparison() {
  if (rows.value.length === 0) {
    return <EmptyState icon="cord" text="There are no layouts yet. Draw cords, or optimize them." />;
  }
  const { of, title } = COSTS[cost.value];
  const dots = rows.value.flatMap((row) => dot(row, of(row)));
  return (
    <div class="optimize-charts">
      {dots.length > 0 ? (
        <Scatter
          dots={dots}
          xTitle={dots.length < rows.value.length ? `${title}, known for ${dots.length} of ${rows.value.length}` : title}
          yTitle={`Expected error ${PLACES[cost.value]}, mm`}
          areCounts={cost.value !== "hours"}
          onChoose={choose}
          onHover={(name) => (hoveredName.value = name)}
        />
      ) : (
        <p class="chart-empty">
          {rows.value.some(({ role }) => role === "built")
            ? "Compare all to compute these numbers."
            : "These numbers are known after “Optimize”."}
        </p>
      )}
      <div class="layout-table">
        <LayoutTable />
      </div>
    </div>
  );
}

/** Which error is compared: layouts without parts have none in them. */
const PLACES: Record<Cost, string> = {
  parts: "in the parts",
  hours: "in the parts",
  cords: "without the cuts",
};

function dot(row: LayoutRow, x: number | null): Dot[] {
  const { name, trainedLow: low, trainedHigh: high } = row;
  const error = cost.value === "cords" ? row.drawnError : row.error;
  if (x === null || error === null) return [];
  const costs = `${COSTS[cost.value].label.toLowerCase()}: ${x.toFixed(Number.isInteger(x) ? 0 : 1)}`;
  const range = low === null || high === null ? "" : `; in use ${low.toFixed(2)} to ${high.toFixed(2)} mm`;
  return [
    {
      name,
      label: `${layoutLabel(row)}: ${error.toFixed(2)} mm ${PLACES[cost.value]}; ${costs}${range}`,
      x,
      y: error,
      tone: dotTone(row),
      isChosen: name === chosenName.value,
    },
  ];
}

function CompareButton() {
  const { compareSeconds = 0, obstacle = "" } = layouts.value ?? {};
  if (compareSeconds === 0 && !obstacle && !isComparing.value) return null;
  const hint = obstacle
    ? `${obstacle[0]!.toUpperCase()}${obstacle.slice(1)}`
    : "Make the parts of all layouts on trial, and predict their errors in use";
  return (
    <Button
      class="compare"
      hint={isJobActive.value && !isComparing.value ? "Wait until the running job has ended" : hint}
      isBusy={isComparing.value}
      disabled={Boolean(obstacle) || isJobActive.value}
      onClick={() => void compareLayouts()}
    >
      Compare all{compareSeconds > 0 ? ` (about ${compareSeconds} s)` : ""}
    </Button>
  );
}
