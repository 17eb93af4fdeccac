// Two selected cords next to each other.
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Comparison } from "../../protocol/messages";
import { connection, device, prediction } from "../../state/connection";
import { attempt } from "../../state/run";
import { Table } from "../../ui/table";
import { percent } from "./bars";

interface Row {
  name: string;
  errorWithout: number | null;
  largestSignal: number;
}

export function CordComparison({ first, second }: { first: string; second: string }) {
  const comparison = useSignal<Comparison | null>(null);
  const problem = useSignal("");
  const { drawn } = prediction.value ?? {};
  useEffect(() => {
    let isCurrent = true;
    const request = attempt(connection.send("compare-cords", { first, second }), (refused) => {
      if (isCurrent) problem.value = refused.text;
    });
    void request.then((answer) => {
      if (!isCurrent || !answer) return;
      comparison.value = answer;
      problem.value = "";
    });
    return () => {
      isCurrent = false;
    };
  }, [first, second, drawn]);

  const result = comparison.value;
  return (
    <div class="panel-body">
      <h2>
        {first} and {second}
      </h2>
      {problem.value && <p class="muted">{problem.value}</p>}
      {!result && !problem.value && <p class="muted">Comparing the cords ...</p>}
      {result && !problem.value && <Result result={result} />}
    </div>
  );
}

function Result({ result }: { result: Comparison }) {
  const rows: Row[] = result.names.map((name, i) => ({
    name,
    errorWithout: result.errorsWithout[i] ?? null,
    largestSignal: result.largestSignals[i]!,
  }));
  const colorOf = (name: string) => device.value?.cords.find((cord) => cord.name === name)?.color;
  return (
    <>
      <Table
        caption="The two cords"
        rows={rows}
        rowKey={({ name }) => name}
        columns={[
          {
            title: "Cord",
            cell: ({ name }) => (
              <>
                <span class="swatch" style={{ background: colorOf(name) }} /> {name}
              </>
            ),
          },
          {
            title: "Expected error without it",
            isNumber: true,
            cell: ({ errorWithout }) =>
              errorWithout === null ? "Unknown" : `${errorWithout.toFixed(2)} mm`,
          },
          {
            title: "Largest signal",
            isNumber: true,
            cell: ({ largestSignal }) => percent(largestSignal),
          },
        ]}
      />
      <dl class="cord-numbers">
        <div>
          <dt>Expected error with both</dt>
          <dd>{result.error.toFixed(2)} mm</dd>
        </div>
        <div>
          <dt>Correlation of their signals</dt>
          <dd>{result.correlation.toFixed(2)}</dd>
        </div>
      </dl>
      {result.isRedundant && (
        <p class="muted">They sense nearly the same; one of them can be deleted.</p>
      )}
    </>
  );
}
