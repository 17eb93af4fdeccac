// All commands of the page: the palette, menus, tooltips and keys read them here.
import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { type StepName, enterStep, step } from "./state/step";

export interface Command {
  /** Stable name, such as "cord.delete". */
  id: string;
  label: string;
  hint?: string;
  /** Heading in the list of keys. */
  group: string;
  /** Key, such as "Mod+Shift+Z", "Delete" or "?"; Mod is Ctrl, or Command on a Mac. */
  shortcut?: string;
  /** A second key, which is not listed. */
  otherShortcut?: string;
  /** Whether its key works while somebody types. */
  worksInFields?: boolean;
  /** Whether its key removes something, and does not work in fields. */
  isRemoving?: boolean;
  /** The step in which its key works, before other commands; the palette enters it first. */
  step?: StepName;
  /** Whether it can run now. */
  when?: () => boolean;
  /** Why it cannot run, when it cannot. */
  reason?: string | (() => string);
  run: () => void;
}

const isMac = /Mac|iPhone|iPad/.test(navigator.userAgent);

export const commands = signal<readonly Command[]>([]);

/** Add commands, which replace those of the same name; return a function that removes them. */
export function registerCommands(added: readonly Command[]): () => void {
  const ids = new Set(added.map(({ id }) => id));
  commands.value = [...commands.value.filter(({ id }) => !ids.has(id)), ...added];
  return () => {
    commands.value = commands.value.filter((command) => !added.includes(command));
  };
}

/** Register commands while a component is mounted; the list is read once. */
export function useCommands(list: () => readonly Command[]): void {
  useEffect(() => registerCommands(list()), []);
}

export function findCommand(id: string): Command | undefined {
  return commands.value.find((command) => command.id === id);
}

export function isAvailable(command: Command): boolean {
  return command.when?.() ?? true;
}

/** Why a command cannot run now. */
export function reasonAgainst({ reason }: Command): string {
  const text = typeof reason === "function" ? reason() : reason;
  return text || "Not possible now";
}

/** In which a step that is entered shows its tools, ms. */
const ENTER_MS = 100;

/** Run a command of any step; its step is entered first. */
export function runAnywhere(command: Command): void {
  if (!command.step || command.step === step.peek()) return command.run();
  enterStep(command.step);
  setTimeout(() => {
    if (isAvailable(command)) command.run();
  }, ENTER_MS);
}

export function runCommand(id: string): void {
  const command = findCommand(id);
  if (command && isAvailable(command)) command.run();
}

const KEY_NAMES: Record<string, string> = {
  ArrowUp: "↑",
  ArrowDown: "↓",
  ArrowLeft: "←",
  ArrowRight: "→",
  Escape: "Esc",
};

/** The keys of a shortcut as they are printed, such as ["Ctrl", "Z"]. */
export function shortcutKeys(shortcut: string): string[] {
  const names: Record<string, string> = isMac
    ? { Mod: "⌘", Shift: "⇧", Alt: "⌥", Delete: "⌫" }
    : { Mod: "Ctrl" };
  return shortcut.split(/\+(?=.)/).map((key) => names[key] ?? KEY_NAMES[key] ?? key);
}

const KEYLESS_INPUTS = new Set(["checkbox", "radio", "range", "button", "color", "file"]);
const OPERATING_KEYS = new Set([" ", "Enter", "Home", "End", "PageUp", "PageDown"]);

/** Whether an element needs a key itself: text fields any, other controls those that set them. */
function needsKey(target: Element, key: string): boolean {
  if (target.matches("textarea, select, [contenteditable]")) return true;
  if (target instanceof HTMLInputElement && !KEYLESS_INPUTS.has(target.type)) return true;
  // A number that is typed on a slider is meant for its field.
  if (/^[\d.,-]$/.test(key) && target.matches("input[type=range]")) return true;
  const isOperating = OPERATING_KEYS.has(key) || key.startsWith("Arrow");
  return isOperating && target.matches("input, button, a[href], summary, [role=treeitem]");
}

function matches(event: KeyboardEvent, shortcut: string): boolean {
  const keys = shortcut.split(/\+(?=.)/);
  const key = keys.at(-1)!;
  if (keys.includes("Mod") !== (isMac ? event.metaKey : event.ctrlKey)) return false;
  if (keys.includes("Alt") !== event.altKey) return false;
  const isLetter = /^[a-z]$/i.test(key);
  // Signs such as "?" need Shift on some keyboards and not on others.
  if ((isLetter || key.length > 1) && keys.includes("Shift") !== event.shiftKey) return false;
  return event.key.toLowerCase() === key.toLowerCase();
}

/** Whether a key that removes something may do so: buttons have no use for it, fields may. */
function canRemove(target: Element): boolean {
  return !target.matches("input, a[href], summary") || Boolean(target.closest(".stage, [role=tree], .pose-cards"));
}

function onKeyDown(event: KeyboardEvent): void {
  if (event.defaultPrevented || event.isComposing) return;
  const target = event.target instanceof Element ? event.target : document.body;
  if (target.closest("dialog, [role=menu]")) return;
  const isTaken = needsKey(target, event.key);
  const matching = commands.value.filter(
    (command) =>
      (!command.step || command.step === step.peek()) &&
      (!isTaken || command.worksInFields) &&
      (!command.isRemoving || canRemove(target)) &&
      [command.shortcut, command.otherShortcut].some((key) => key && matches(event, key)),
  );
  const available = matching.filter(isAvailable);
  const found = available.find((command) => command.step) ?? available[0];
  // The browser's own undo and redo would change a text that was typed earlier, and focus it.
  const hasOwnAction = matching.length > 0 && (event.ctrlKey || event.metaKey);
  if (found || hasOwnAction) event.preventDefault();
  found?.run();
}

/** Run commands by their keys, except while somebody types. */
export function listenForKeys(): () => void {
  document.addEventListener("keydown", onKeyDown);
  return () => document.removeEventListener("keydown", onKeyDown);
}
