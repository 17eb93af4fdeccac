import { isBottomPanelOpen } from "../state/layout";
import { step } from "../state/step";
import { stepPanels } from "../steps/registry";
import { IconButton } from "../ui/button";
import { Section } from "../ui/section";

const DEFAULT_TITLE = "States";

/** The entered step's panel below the scene, if it has one. */
export function BottomPanel() {
  const panels = stepPanels(step.value);
  if (!panels?.bottom) return null;
  const isOpen = isBottomPanelOpen.value;
  const title = panels.bottomTitle ?? DEFAULT_TITLE;
  return (
    <section class={`bottom-panel ${isOpen ? "" : "closed"}`} aria-label={title}>
      <header class="panel-header">
        <h2>{title}</h2>
        <IconButton
          icon={isOpen ? "chevronDown" : "chevronUp"}
          label={isOpen ? "Close the bottom panel" : "Open the bottom panel"}
          aria-expanded={isOpen}
          shortcut="Mod+J"
          onClick={() => (isBottomPanelOpen.value = !isOpen)}
        />
      </header>
      {isOpen && (
        <div class="bottom-content">
          <panels.bottom />
        </div>
      )}
    </section>
  );
}

/** The same panel as a section of a phone's sheet. */
export function BottomSection() {
  const panels = stepPanels(step.value);
  if (!panels?.bottom) return null;
  return (
    <Section title={panels.bottomTitle ?? DEFAULT_TITLE} name="bottom">
      <panels.bottom />
    </Section>
  );
}
