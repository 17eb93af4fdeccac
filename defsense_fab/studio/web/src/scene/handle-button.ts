// A handle: a button at a place of the scene that is dragged, or moved by the arrow keys.
import type { Viewer } from "./viewer";

export interface HandleActions {
  onSelect?: () => void;
  /** The pointer is at a pixel; called at most once a frame. */
  onDrag: (x: number, y: number) => void;
  onDrop: () => void;
  /** Escape was pressed during a drag, or the system ended it. */
  onCancel: () => void;
  /** An arrow key was pressed: one of -1, 0 and 1 to the right and upward. */
  onArrow: (right: number, up: number, isLarge: boolean) => void;
  onDelete?: () => void;
  /** A menu is requested at a place of the window. */
  onMenu?: (x: number, y: number) => void;
}

const DRAG_PX = 3;
const ARROWS: Record<string, [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowDown: [0, -1],
  ArrowUp: [0, 1],
};

export class HandleButton {
  readonly element = document.createElement("button");
  /** Where the button was pressed, and how far from its middle. */
  private start: { x: number; y: number; dx: number; dy: number; pointer: number } | null = null;
  private isDragged = false;
  private last: [number, number] = [0, 0];
  private frame = 0;

  constructor(
    private readonly viewer: Viewer,
    kind: "point" | "tangent" | "shift" | "turn",
    private readonly actions: HandleActions,
  ) {
    const { element } = this;
    element.type = "button";
    element.className = `viewer-handle ${kind}`;
    element.addEventListener("pointerdown", (event) => this.press(event));
    element.addEventListener("pointermove", (event) => this.move(event));
    element.addEventListener("pointerup", () => this.release());
    element.addEventListener("pointercancel", () => this.cancel());
    element.addEventListener("click", () => actions.onSelect?.());
    element.addEventListener("keydown", (event) => this.onKey(event));
    element.addEventListener("contextmenu", (event) => {
      event.preventDefault();
      const { left, bottom } = element.getBoundingClientRect();
      const isByKey = event.clientX === 0 && event.clientY === 0;
      actions.onMenu?.(isByKey ? left : event.clientX, isByKey ? bottom : event.clientY);
    });
    viewer.overlay.append(element);
  }

  setName(name: string): void {
    if (this.element.ariaLabel !== name) this.element.ariaLabel = name;
  }

  place([x, y]: [number, number]): void {
    this.element.style.transform = `translate(${x}px, ${y}px)`;
  }

  dispose(): void {
    cancelAnimationFrame(this.frame);
    this.element.remove();
  }

  private press(event: PointerEvent): void {
    if (event.button !== 0) return;
    event.preventDefault();
    event.stopPropagation();
    this.element.focus({ preventScroll: true, focusVisible: false } as FocusOptions);
    this.element.setPointerCapture(event.pointerId);
    const { left, top, width, height } = this.element.getBoundingClientRect();
    const [x, y] = [event.clientX, event.clientY];
    const [dx, dy] = [x - left - width / 2, y - top - height / 2];
    this.start = { x, y, dx, dy, pointer: event.pointerId };
    this.actions.onSelect?.();
  }

  private move(event: PointerEvent): void {
    if (!this.start) return;
    const distance = Math.hypot(event.clientX - this.start.x, event.clientY - this.start.y);
    if (!this.isDragged && distance < DRAG_PX) return;
    this.isDragged = true;
    this.element.classList.add("dragged");
    const [x, y] = this.viewer.local(event);
    this.last = [x - this.start.dx, y - this.start.dy];
    this.frame ||= requestAnimationFrame(() => this.report());
  }

  private report(): void {
    this.frame = 0;
    if (this.isDragged) this.actions.onDrag(...this.last);
  }

  private release(): void {
    if (this.isDragged) {
      cancelAnimationFrame(this.frame);
      this.report();
      this.actions.onDrop();
    }
    this.end();
  }

  private cancel(): void {
    if (this.isDragged) this.actions.onCancel();
    this.end();
  }

  private end(): void {
    if (this.start && this.element.hasPointerCapture(this.start.pointer)) {
      this.element.releasePointerCapture(this.start.pointer);
    }
    this.start = null;
    this.isDragged = false;
    this.element.classList.remove("dragged");
    cancelAnimationFrame(this.frame);
    this.frame = 0;
  }

  private onKey(event: KeyboardEvent): void {
    const arrow = ARROWS[event.key];
    if (event.key === "Escape" && this.start) this.cancel();
    else if (arrow) this.actions.onArrow(...arrow, event.shiftKey);
    else if (event.key === "Delete" && this.actions.onDelete) this.actions.onDelete();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
