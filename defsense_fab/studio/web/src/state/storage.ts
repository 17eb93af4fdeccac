// Signals whose values this browser keeps.
import { type Signal, effect, signal } from "@preact/signals";

const PREFIX = "defsense.";

/** A signal that is stored under a name; browsers without storage forget it on reload. */
export function storedSignal<T extends string | boolean>(
  name: string,
  initial: T,
  isValid: (value: unknown) => value is T,
): Signal<T> {
  const stored = signal<T>(read(name, initial, isValid));
  effect(() => write(name, stored.value));
  return stored;
}

export function isBoolean(value: unknown): value is boolean {
  return typeof value === "boolean";
}

function read<T>(name: string, initial: T, isValid: (value: unknown) => value is T): T {
  try {
    const value: unknown = JSON.parse(localStorage.getItem(PREFIX + name) ?? "null");
    return isValid(value) ? value : initial;
  } catch {
    return initial;
  }
}

function write(name: string, value: unknown): void {
  try {
    localStorage.setItem(PREFIX + name, JSON.stringify(value));
  } catch {
    // Storage is full or forbidden: the value lasts until the page is closed.
  }
}
