import { isPhone, sheet } from "../state/layout";
import { STEP_LABELS, step } from "../state/step";
import { stepPanels } from "../steps/registry";
import { IconButton } from "../ui/button";
import { BottomSection } from "./bottom-panel";
import { NextButton } from "./next-button";

/** The entered step's inspector: at the right, or in a sheet below the scene on a phone. */
export function Inspector() {
  const Content = stepPanels(step.value)?.inspector;
  return (
    <aside
      class={`inspector ${isPhone.value ? `sheet ${sheet.value}` : ""}`}
      aria-label={STEP_LABELS[step.value]}
    >
      {isPhone.value ? (
        <SheetHeader />
      ) : (
        <h2 class="visually-hidden step-heading">{STEP_LABELS[step.value]}</h2>
      )}
      <div class="inspector-content" hidden={isPhone.value && sheet.value === "closed"}>
        {Content && <Content />}
        {isPhone.value && <BottomSection />}
      </div>
    </aside>
  );
}

const LARGER = { closed: "half", half: "full", full: "half" } as const;

function SheetHeader() {
  const isLargest = sheet.value === "full";
  return (
    <header class="sheet-header">
      <IconButton
        icon={isLargest ? "chevronDown" : "chevronUp"}
        label={isLargest ? "Make the panel smaller" : "Make the panel larger"}
        onClick={() => (sheet.value = LARGER[sheet.value])}
      />
      <h2 class="step-heading">{STEP_LABELS[step.value]}</h2>
      <NextButton />
      <IconButton
        icon="close"
        label="Close the panel"
        disabled={sheet.value === "closed"}
        onClick={() => (sheet.value = "closed")}
      />
    </header>
  );
}
