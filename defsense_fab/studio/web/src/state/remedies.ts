// The one button that cures a problem, or leads to where it is cured.
import { findCommand, runAnywhere } from "../commands";
import type { Problem } from "../protocol/messages";
import { startBuild } from "./building";
import { bodyFit, connection, device } from "./connection";
import { fieldLabel, findField } from "./page-words";
import { run } from "./run";
import { type ItemKind, select } from "./selection";
import { type StepName, enterStep } from "./step";

export interface Remedy {
  label: string;
  run: () => void;
}

const BY_CODE: Record<string, Remedy> = {
  "no-body": { label: "Make the body", run: () => void run(connection.send("make-body", {})) },
  "not-simulated": { label: "Simulate the poses", run: () => void startBuild("simulate") },
  "build-outdated": { label: "Optimize", run: () => void startBuild("optimize") },
  "not-built": { label: "Build the parts", run: () => void startBuild("report") },
};

const DRAW: Remedy = { label: "Draw a cord", run: draw };

/** Start to draw a cord; the step is entered first. */
export function draw(): void {
  const command = findCommand("sensor.draw");
  if (command) runAnywhere(command);
}

/** Whether a field takes a value: there are not fewer cords than drawn ones. */
function canSuggest(field: string, value: number): boolean {
  return field !== "design.sensors" || value >= (device.peek()?.cords.length ?? 0);
}

const REGIONS = "regions.";

/** A region follows the body that has changed, or is moved by hand. */
function regionRemedy(name: string): Remedy {
  if (bodyFit.peek()?.canFit) {
    return { label: "Fit to the body", run: () => void run(connection.send("fit-to-body", {})) };
  }
  return { label: `Select ${name}`, run: () => selectIn("poses", "region", name) };
}

function selectIn(step: StepName, kind: ItemKind, name: string): void {
  enterStep(step);
  select({ kind, name });
}

/** The button for a problem, or null. */
export function remedyOf({ code, cord, field, text, suggestion }: Problem): Remedy | null {
  if (cord && device.peek()?.cords.some(({ name }) => name === cord)) {
    return { label: `Show ${cord} in Sensors`, run: () => selectIn("sensors", "cord", cord) };
  }
  if (field.startsWith(REGIONS)) return regionRemedy(field.slice(REGIONS.length));
  const known = BY_CODE[code];
  if (known) return known;
  const label = fieldLabel(field);
  if (label && suggestion !== null && canSuggest(field, suggestion)) {
    return {
      label: `Set “${label}” to ${suggestion}`,
      run: () => void run(connection.send("set-field", { key: field, value: suggestion })),
    };
  }
  if (code === "no-room-for-cords") return DRAW;
  const shown = label ? { key: field, label } : findField(text);
  return shown && { label: `Show “${shown.label}”`, run: () => showField(shown.key) };
}

const FRAMES = 20; // in which the step appears

/** Enter the step of a field, open what it is in, and put the focus in it. */
function showField(key: string, frames = FRAMES): void {
  enterStep("body");
  requestAnimationFrame(() => {
    const row = document.querySelector<HTMLElement>(`[data-field="${key}"]`);
    if (!row) {
      if (frames > 0) showField(key, frames - 1);
      return;
    }
    for (let at = row.closest("details"); at; at = at.parentElement?.closest("details") ?? null) {
      at.open = true;
    }
    row.scrollIntoView({ block: "center" });
    row.querySelector<HTMLElement>("input, select")?.focus();
  });
}
