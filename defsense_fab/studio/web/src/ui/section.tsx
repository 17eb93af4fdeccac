import type { ComponentChildren } from "preact";
import { panelState } from "../state/layout";
import { Icon } from "./icons";

interface SectionProps {
  title: string;
  /** Name under which this browser keeps whether it is open. */
  name: string;
  isOpenAtFirst?: boolean;
  /** Content at the right of the heading, such as a number. */
  aside?: ComponentChildren;
  children: ComponentChildren;
}

/** A part of a panel under a heading, which opens and closes it. */
export function Section({ title, name, isOpenAtFirst = true, aside, children }: SectionProps) {
  const isOpen = panelState(`section.${name}`, isOpenAtFirst);
  return (
    <details
      class="section"
      data-section={name}
      open={isOpen.value}
      onToggle={(event) => (isOpen.value = event.currentTarget.open)}
    >
      <summary class="section-header">
        <Icon name="chevronRight" />
        <h3>{title}</h3>
        {aside && <span class="section-aside">{aside}</span>}
      </summary>
      <div class="section-content">{children}</div>
    </details>
  );
}

/** In which the section of a step that is entered appears, ms. */
const APPEAR_MS = 100;

/** Open a section and focus its heading. */
export function openSection(name: string): void {
  panelState(`section.${name}`).value = true;
  setTimeout(() => {
    const heading = `[data-section="${CSS.escape(name)}"] > summary`;
    document.querySelector<HTMLElement>(heading)?.focus();
  }, APPEAR_MS);
}
