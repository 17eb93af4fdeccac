import type { FrameFacts } from "../protocol/messages";

const UNSURE = 0.5; // confidence below which a value is shown pale

/** The named values of the device, which outputs send to other programs. */
export function ControlList({ facts }: { facts: FrameFacts | null }) {
  const values = Object.entries(facts?.controls ?? {});
  if (values.length === 0) return <p class="live-empty">No values yet.</p>;
  return (
    <ul class="control-list">
      {values.map(([name, value]) => (
        <li key={name} class={(facts?.confidence[name] ?? 1) < UNSURE ? "unsure" : ""}>
          <span class="control-name">{name}</span>
          <span class="control-value">{value.toFixed(2)}</span>
          <ControlBar name={name} value={value} />
        </li>
      ))}
    </ul>
  );
}

/** A bar from zero, which is in the middle. */
function ControlBar({ name, value }: { name: string; value: number }) {
  const share = Math.min(1, Math.max(-1, value));
  return (
    <span
      class="control-bar"
      role="meter"
      aria-label={name}
      aria-valuemin={-1}
      aria-valuemax={1}
      aria-valuenow={Number(share.toFixed(2))}
    >
      <i
        style={{
          left: `${share < 0 ? 50 + 50 * share : 50}%`,
          width: `${50 * Math.abs(share)}%`,
        }}
      />
    </span>
  );
}
