// The regions of the page in their visual order, and moving the focus between them.

/** Bar, tree, scene, inspector, the panel below, running job, and messages. */
const REGIONS = [
  ".top-bar",
  ".left-panel",
  ".stage",
  ".inspector",
  ".bottom-panel",
  ".job-strip",
  ".toasts",
];
const FOCUSABLE =
  "button, [href], input, select, textarea, canvas, summary, [tabindex]:not([tabindex='-1'])";

/** Whether an element is shown and not disabled. */
export function isUsable(element: Element): boolean {
  const isShown = element.checkVisibility({ visibilityProperty: true });
  return isShown && !element.closest("[inert], :disabled");
}

/** The elements within one that Tab reaches, in order, without the link that skips to the scene. */
export function focusableIn(element: Element): HTMLElement[] {
  const items = [...element.querySelectorAll<HTMLElement>(FOCUSABLE)];
  if (element instanceof HTMLElement && element.matches(FOCUSABLE)) items.unshift(element);
  return items.filter((item) => item.tabIndex >= 0 && isUsable(item) && !item.closest(".skip-link"));
}

/** Focus the first control of the next region, or of the one before. */
export function enterRegion(change: 1 | -1): void {
  const regions = REGIONS.map((name) => document.querySelector(name)).filter((r) => r !== null);
  const at = regions.findIndex((region) => region.contains(document.activeElement));
  const from = at < 0 && change < 0 ? 0 : at;
  for (let k = 1; k <= regions.length; k++) {
    const index = (from + k * change + regions.length * 2) % regions.length;
    const items = focusableIn(regions[index]!);
    const scene = items.find((item) => item instanceof HTMLCanvasElement);
    const first = scene ?? items[0];
    if (first) return first.focus();
  }
}

/** Focus the scene, or what is shown in its place; return whether there is one. */
export function focusScene(): boolean {
  const stage = document.querySelector(".stage");
  const items = stage ? focusableIn(stage) : [];
  const first = items.find((item) => item instanceof HTMLCanvasElement) ?? items[0];
  first?.focus();
  return first !== undefined;
}

/** Focus the heading of the entered step, or that of another page. */
export function focusHeading(): boolean {
  const heading =
    document.querySelector<HTMLElement>(".step-heading") ??
    document.querySelector<HTMLElement>("h1:not(.visually-hidden)");
  if (!heading) return false;
  heading.tabIndex = -1;
  heading.focus();
  return true;
}

/** Whether the focus is in a field in which text is typed or a value is chosen. */
export function isInField(): boolean {
  const element = document.activeElement;
  if (element?.closest("dialog")) return false;
  const isTyped = element instanceof HTMLInputElement && !["checkbox", "radio"].includes(element.type);
  return isTyped || Boolean(element?.matches("select, textarea"));
}

/** Leave a field, to the scene. */
export function leaveField(): void {
  if (!focusScene()) (document.activeElement as HTMLElement | null)?.blur();
}
