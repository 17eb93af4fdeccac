// Which parts of the page are open, and whether the window is that of a phone.
import { type Signal, signal } from "@preact/signals";
import { isBoolean, storedSignal } from "./storage";

const PHONE = "(max-width: 700px)"; // as in styles/phone.css
const WIDE_PX = 1000; // at which both side panels leave room for the scene

const panels = new Map<string, Signal<boolean>>();

/** Whether a panel or section is open; kept in this browser. */
export function panelState(name: string, isOpen = true): Signal<boolean> {
  const state = panels.get(name) ?? storedSignal(`panel.${name}`, isOpen, isBoolean);
  panels.set(name, state);
  return state;
}

export const isLeftPanelOpen = panelState("left", innerWidth > WIDE_PX);
export const isBottomPanelOpen = panelState("bottom");

/** Whether the drawer with the tree is open; only on a phone. */
export const isDrawerOpen = signal(false);

/** Height of the sheet of a phone. */
export const sheet = signal<"closed" | "half" | "full">("half");

const query = matchMedia(PHONE);
export const isPhone = signal(query.matches);
query.addEventListener("change", () => (isPhone.value = query.matches));
