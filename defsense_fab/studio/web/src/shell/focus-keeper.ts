// Keeps the focus in the page: if its element disappears or is disabled, a nearby one gets it.
import { effect } from "@preact/signals";
import { step } from "../state/step";
import { focusableIn, focusHeading, focusScene, isUsable } from "./regions";

/** In which the page may move the focus itself, ms. */
const DELAY_MS = 30;
const LAYERS = "dialog, [role=menu], [popover]";
/** Elements whose content is that of a step: when it is replaced, the focus goes to the heading. */
const FRAMES = "body, body > *, .inspector, .inspector-content, .bottom-panel, .bottom-content, .workspace, .shell";

interface Place {
  element: HTMLElement;
  /** The ancestors, from the parent up, and where in each the element was. */
  trail: { parent: Element; index: number }[];
  step: string;
  isInScene: boolean;
}

/** The place of the focus, and the layer that contains it; null after it was left on purpose. */
let current: { element: HTMLElement; layer: HTMLElement | null } | null = null;
/** The last place that is not in a layer over the page. */
let place: Place | null = null;

function remember(element: HTMLElement): void {
  const layer = element.closest<HTMLElement>(LAYERS);
  current = { element, layer };
  if (layer) return;
  const trail: Place["trail"] = [];
  for (let child: Element = element; child.parentElement; child = child.parentElement) {
    trail.push({ parent: child.parentElement, index: [...child.parentElement.children].indexOf(child) });
  }
  const isInScene = element.closest(".stage") !== null;
  place = { element, trail, step: step.peek(), isInScene };
}

/** Move the focus to what took the place of the lost element, or to the heading of the step. */
function restore(): void {
  if (place && isUsable(place.element)) return place.element.focus();
  if (place?.step === step.peek()) {
    if (place.isInScene && focusScene()) return;
    for (const { parent, index } of place.trail) {
      if (parent.matches(FRAMES)) break;
      if (parent.isConnected && focusNear(parent, index)) return;
    }
  }
  focusHeading();
}

/** Focus the first control of an open layer; return whether there is one. */
function focusLayer(layer: HTMLElement | null): boolean {
  const first = layer && isUsable(layer) ? focusableIn(layer)[0] : undefined;
  first?.focus();
  return first !== undefined;
}

/** Focus the first control at or after an index among the children, or else the last before it. */
function focusNear(parent: Element, index: number): boolean {
  const children = [...parent.children];
  const after = children.slice(index).flatMap(focusableIn)[0];
  const next = after ?? children.slice(0, index).flatMap(focusableIn).at(-1);
  next?.focus();
  return next !== undefined;
}

function check(): void {
  if (!current || (document.activeElement && document.activeElement !== document.body)) return;
  if (isUsable(current.element)) current = null;
  else if (!focusLayer(current.layer)) restore();
}

/** Watch the focus until the returned function is called. */
export function keepFocus(): () => void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  const checkSoon = () => {
    clearTimeout(timer);
    timer = setTimeout(check, DELAY_MS);
  };
  const onFocusIn = ({ target }: FocusEvent) => {
    if (target instanceof HTMLElement) remember(target);
  };
  const observer = new MutationObserver(() => {
    if (current && !current.element.isConnected) checkSoon();
  });
  document.addEventListener("focusin", onFocusIn);
  document.addEventListener("focusout", checkSoon);
  observer.observe(document.body, { childList: true, subtree: true });
  let isUsed = false;
  const onUse = () => (isUsed = true);
  document.addEventListener("keydown", onUse, { once: true, capture: true });
  document.addEventListener("pointerdown", onUse, { once: true, capture: true });
  const stopStep = effect(() => {
    void step.value;
    if (!isUsed) return;
    setTimeout(() => {
      if (document.activeElement === document.body && !current) focusHeading();
    }, DELAY_MS);
  });
  return () => {
    clearTimeout(timer);
    document.removeEventListener("focusin", onFocusIn);
    document.removeEventListener("focusout", checkSoon);
    observer.disconnect();
    stopStep();
  };
}
