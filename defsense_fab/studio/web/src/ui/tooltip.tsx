// Tooltips: elements carry the text, and one layer above the page shows it.
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { shortcutKeys } from "../commands";
import { placeNextTo } from "./place";

const DELAY_MS = 500;

/** Attributes that give an element a tooltip. */
export function tooltip(text: string | undefined, shortcut?: string): Record<string, string> {
  if (!text && !shortcut) return {};
  return { "data-tooltip": text ?? "", ...(shortcut ? { "data-shortcut": shortcut } : {}) };
}

/** The layer that shows the tooltip of the element under the pointer or in focus. */
export function TooltipLayer() {
  const [anchor, setAnchor] = useState<HTMLElement | null>(null);
  const [, setRevision] = useState(0);
  const layer = useRef<HTMLDivElement>(null);

  useEffect(() => followPointerAndFocus(setAnchor), []);

  // The text may change while it is shown, and its element may go away.
  useEffect(() => {
    if (!anchor) return undefined;
    const observer = new MutationObserver(() => {
      if (anchor.isConnected) setRevision((revision) => revision + 1);
      else setAnchor(null);
    });
    observer.observe(anchor, { attributeFilter: ["data-tooltip", "data-shortcut"] });
    for (let above = anchor.parentNode; above; above = above.parentNode) {
      observer.observe(above, { childList: true });
    }
    return () => observer.disconnect();
  }, [anchor]);

  const { tooltip: text = "", shortcut } = anchor?.dataset ?? {};
  const isEmpty = !text && !shortcut; // also if the shown element loses its text
  // In the same step as the text, so that no frame shows the layer without its text.
  useLayoutEffect(() => {
    const element = layer.current;
    if (!element || !anchor || isEmpty) return undefined;
    element.showPopover();
    placeNextTo(element, anchor.getBoundingClientRect(), "below");
    return () => element.hidePopover();
  }, [anchor, isEmpty]);

  return (
    <div ref={layer} class="tooltip" role="tooltip" popover="manual">
      {text}
      {shortcut && <Keys shortcut={shortcut} />}
    </div>
  );
}

/** The keys of a shortcut. */
export function Keys({ shortcut }: { shortcut: string }) {
  return (
    <span class="keys">
      {shortcutKeys(shortcut).map((key) => (
        <kbd key={key}>{key}</kbd>
      ))}
    </span>
  );
}

function followPointerAndFocus(show: (anchor: HTMLElement | null) => void): () => void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  let current: HTMLElement | null = null;
  const hide = () => {
    clearTimeout(timer);
    current = null;
    show(null);
  };
  const showLater = (element: HTMLElement | null, delay: number) => {
    if (element === current) return;
    hide();
    current = element;
    if (element) timer = setTimeout(() => element.isConnected && show(element), delay);
  };
  const onOver = (event: PointerEvent) => {
    if (event.pointerType === "mouse") showLater(anchorOf(event.target), DELAY_MS);
  };
  const onFocus = (event: FocusEvent) => {
    const element = anchorOf(event.target);
    if (element?.matches(":focus-visible")) showLater(element, DELAY_MS);
    else hide();
  };
  const events = ["pointerdown", "keydown", "scroll", "focusout"] as const;
  document.addEventListener("pointerover", onOver);
  document.addEventListener("focusin", onFocus);
  for (const event of events) document.addEventListener(event, hide, true);
  return () => {
    hide();
    document.removeEventListener("pointerover", onOver);
    document.removeEventListener("focusin", onFocus);
    for (const event of events) document.removeEventListener(event, hide, true);
  };
}

function anchorOf(target: EventTarget | null): HTMLElement | null {
  return target instanceof Element ? target.closest<HTMLElement>("[data-tooltip]") : null;
}
