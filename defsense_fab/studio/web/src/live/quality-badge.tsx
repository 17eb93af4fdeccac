import type { FrameFacts } from "../protocol/messages";
import { Icon, type IconName } from "../ui/icons";
import { tooltip } from "../ui/tooltip";

const LABELS: Record<FrameFacts["quality"], [string, IconName]> = {
  trusted: ["Trusted", "check"],
  untrained: ["Untrained", "warning"],
  fallback: ["Fallback", "warning"],
  lost: ["Lost", "error"],
  starting: ["Starting", "refresh"],
};

/** How far the shown frame can be trusted. */
export function QualityBadge({ facts }: { facts: FrameFacts | null }) {
  if (!facts) {
    return (
      <span class="quality-badge" role="status">
        <span class="spinner" aria-hidden="true" /> Waiting for readings
      </span>
    );
  }
  const [label, icon] = LABELS[facts.quality];
  return (
    <span class={`quality-badge ${facts.quality}`} role="status" {...tooltip(facts.qualityText)}>
      <Icon name={icon} /> {label}
    </span>
  );
}
