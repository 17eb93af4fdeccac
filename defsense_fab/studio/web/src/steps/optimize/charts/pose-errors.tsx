import type { Search } from "../../../protocol/messages";

/** The error in each pose as bars: of the drawn cords, and of the best ones. */
export function PoseErrors({ poses }: { poses: Search["poses"] }) {
  const largest = Math.max(...poses.flatMap(({ drawn, best }) => [drawn ?? 0, best ?? 0]), 1e-9);
  return (
    <table class="pose-errors">
      <caption>Error by pose, at its largest level, without the cuts</caption>
      <thead class="visually-hidden">
        <tr>
          <th scope="col">Pose</th>
          <th scope="col">Drawn, mm</th>
          <th scope="col">Best, mm</th>
        </tr>
      </thead>
      <tbody>
        {poses.map(({ pose, drawn, best }) => (
          <tr key={pose}>
            <th scope="row" title={pose}>
              {pose}
            </th>
            <Bar tone="drawn" error={drawn} largest={largest} />
            <Bar tone="best" error={best} largest={largest} />
          </tr>
        ))}
      </tbody>
    </table>
  );
}

interface BarProps {
  tone: "drawn" | "best";
  error: number | null;
  largest: number;
}

function Bar({ tone, error, largest }: BarProps) {
  return (
    <td>
      <span class={`pose-bar ${tone}`} style={{ width: `${(100 * (error ?? 0)) / largest}%` }} aria-hidden="true" />
      <span class="pose-bar-value">{error === null ? "–" : error.toFixed(2)}</span>
    </td>
  );
}
