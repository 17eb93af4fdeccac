// The four cards in the order of work, with the state of each; at the right of the page.
import type { TaskStatus } from "../../protocol/messages";
import { Icon, type IconName } from "../../ui/icons";
import { CARD_LABELS, type CardName, card, choices, results, status, usableSessions } from "./state";

const STEPS: readonly CardName[] = ["check", "record", "train", "live"];

/** Which card is shown, and how far each one is. */
export function Outline() {
  return (
    <nav class="measure-outline" aria-label="Work with the finished device">
      <ol>
        {STEPS.map((name, k) => (
          <li key={name}>
            <CardButton name={name} number={k + 1} />
          </li>
        ))}
      </ol>
      <h3>Optional</h3>
      <CardButton name="specimen" />
    </nav>
  );
}

function CardButton({ name, number }: { name: CardName; number?: number }) {
  const { text, mark } = summary(name, status.value?.[name]);
  const icon = MARKS[mark] ?? (number === undefined ? "ruler" : null);
  return (
    <button
      type="button"
      class={`outline-item ${mark}`}
      aria-current={card.value === name ? "step" : undefined}
      onClick={() => (card.value = name)}
    >
      <span class="outline-number" aria-hidden="true">
        {mark === "running" ? <span class="spinner" /> : icon ? <Icon name={icon} size={14} /> : number}
      </span>
      <span class="outline-label">{CARD_LABELS[name]}</span>
      <span class="outline-text">{text}</span>
    </button>
  );
}

type Mark = "open" | "done" | "faulty" | "running";
const MARKS: Record<Mark, IconName | null> = { open: null, done: "check", faulty: "warning", running: null };

function summary(name: CardName, task: TaskStatus | undefined): { text: string; mark: Mark } {
  if (task?.state === "running") return { text: task.text || "Running", mark: "running" };
  if (task?.problem) return { text: task.problem.message, mark: "faulty" };
  const { check, training, response } = results.value ?? {};
  switch (name) {
    case "check": {
      if (!check) return { text: "Not checked yet", mark: "open" };
      const faults = check.findings.filter(({ code }) => code !== "ok").length;
      const text = faults === 1 ? "1 channel needs attention" : `${faults} channels need attention`;
      return faults ? { text, mark: "faulty" } : { text: "All channels are in order", mark: "done" };
    }
    case "record": {
      const count = usableSessions.value.length;
      const text = count === 1 ? "1 session" : `${count || "No"} sessions`;
      return { text, mark: count ? "done" : "open" };
    }
    case "train": {
      const chosen = training?.decoders.find(({ isChosen }) => isChosen);
      if (!training) return { text: "No model yet", mark: "open" };
      const error = chosen?.test ?? chosen?.folds;
      const text = error === undefined ? training.model : `${chosen!.decoder}, ${error.toFixed(2)} mm`;
      return { text, mark: training.warning ? "faulty" : "done" };
    }
    case "live":
      return { text: choices.value?.models.length ? "Ready" : "Needs a model", mark: "open" };
    case "specimen":
      return response
        ? { text: `Response k = ${response.kRes.toFixed(2)}`, mark: "done" }
        : { text: "The data sheet is used", mark: "open" };
  }
}
