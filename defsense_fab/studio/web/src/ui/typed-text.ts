// A text that is typed until it is committed; a refused one stays, so that it can be corrected.
import { type Signal, useSignal } from "@preact/signals";
import { useLayoutEffect } from "preact/hooks";
import { corrections } from "../state/connection";

interface TypedText {
  /** The text, or null while the field shows its value. */
  typed: Signal<string | null>;
  /** Take over the text unless it is the one that was refused last. */
  take: () => string | null;
  /** Keep a text that is refused, unless another one was typed meanwhile. */
  refuse: (text: string) => void;
  /** Show the value again; return whether anything else was shown. */
  restore: () => boolean;
}

/** The typed text of a field; a new value replaces it, and a corrected file a refused one. */
export function useTypedText(value: unknown, onValue: () => void): TypedText {
  const typed = useSignal<string | null>(null);
  const refused = useSignal<string | null>(null);
  useLayoutEffect(() => {
    typed.value = null;
    onValue();
  }, [value]);
  useLayoutEffect(() => {
    if (refused.peek() === null) return;
    typed.value = refused.value = null;
    onValue();
  }, [corrections.value]);
  return {
    typed,
    take: () => {
      const text = typed.peek();
      if (text === null || text === refused.peek()) return null;
      typed.value = refused.value = null;
      return text;
    },
    refuse: (text) => {
      if (typed.peek() !== null) return;
      typed.value = refused.value = text;
    },
    restore: () => {
      const wasTyped = typed.peek() !== null;
      typed.value = refused.value = null;
      return wasTyped;
    },
  };
}
