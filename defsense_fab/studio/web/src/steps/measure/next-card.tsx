// From card to card in the order of work; only one button of a card is primary.
import { mainVariant } from "../../state/step";
import { Button } from "../../ui/button";
import { card, type CardName, choices, results, status, usableSessions } from "./state";

const NEXT: Partial<Record<CardName, { name: CardName; label: string }>> = {
  check: { name: "record", label: "Next: record" },
  record: { name: "train", label: "Next: train" },
  train: { name: "live", label: "Next: live" },
};

/** Whether the work of a card is done, so that its next one is the main action. */
function isDone(name: CardName): boolean {
  const task = status.value?.[name];
  if ((task && task.state !== "idle") || task?.problem) return false;
  if (name === "check") return results.value?.check?.findings.every(({ code }) => code === "ok") ?? false;
  if (name === "record") return usableSessions.value.length > 0;
  return name === "train" && (choices.value?.models.length ?? 0) > 0;
}

/** Look of the main button of a card: plain once the next card is. */
export function cardVariant(name: CardName): "primary" | "plain" {
  return isDone(name) ? "plain" : mainVariant.value;
}

export function NextCardButton({ name }: { name: CardName }) {
  const next = NEXT[name];
  if (!next) return null;
  return (
    <div class="card-next">
      <Button
        variant={isDone(name) ? mainVariant.value : "quiet"}
        icon="arrowRight"
        onClick={() => (card.value = next.name)}
      >
        {next.label}
      </Button>
    </div>
  );
}
