// Dragging sideways on the label of a number changes the number.
import { useRef } from "preact/hooks";

const PIXELS_PER_STEP = 4;

interface ScrubHandlers {
  onPointerDown: (event: PointerEvent) => void;
  onPointerMove: (event: PointerEvent) => void;
  onPointerUp: (event: PointerEvent) => void;
  onPointerCancel: () => void;
  onClick: (event: MouseEvent) => void;
}

/**
 * Handlers for a label: `onSteps` gets the steps since the drag started, ten times as many with
 * Shift, and `onEnd` is called when it ends. A press without a drag focuses the field.
 */
export function useScrub(onSteps: (steps: number) => void, onEnd: () => void): ScrubHandlers {
  const start = useRef<number | null>(null);
  const hasMoved = useRef(false);
  return {
    onPointerDown: (event) => {
      if (event.button !== 0 || event.pointerType !== "mouse") return;
      start.current = event.clientX;
      hasMoved.current = false;
      (event.currentTarget as Element).setPointerCapture(event.pointerId);
    },
    onPointerMove: (event) => {
      if (start.current === null) return;
      const steps = Math.trunc((event.clientX - start.current) / PIXELS_PER_STEP);
      if (steps === 0 && !hasMoved.current) return;
      hasMoved.current = true;
      onSteps(steps * (event.shiftKey ? 10 : 1));
    },
    onPointerUp: () => {
      start.current = null;
      if (hasMoved.current) onEnd();
    },
    onPointerCancel: () => {
      start.current = null;
    },
    onClick: (event) => {
      if (hasMoved.current) event.preventDefault();
      hasMoved.current = false;
    },
  };
}
