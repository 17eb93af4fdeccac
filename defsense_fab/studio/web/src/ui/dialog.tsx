// Modal dialogs, and the question whether to do something.
import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useId, useLayoutEffect, useRef } from "preact/hooks";
import { Button, IconButton } from "./button";

interface DialogProps {
  title: string;
  children: ComponentChildren;
  /** Buttons below the content; one with `autofocus` gets the focus. */
  actions?: ComponentChildren;
  size?: "small" | "medium" | "large";
  /** Whether only screen readers get the title. */
  isTitleHidden?: boolean;
  /** Whether a click outside closes it. */
  closesOutside?: boolean;
  /** Whether the content is only read, so that keys must be able to scroll it. */
  isText?: boolean;
  onClose: () => void;
}

/** A modal dialog that is open while it is mounted; Escape and the close button end it. */
export function Dialog(props: DialogProps) {
  const {
    title,
    children,
    actions,
    size = "medium",
    isTitleHidden,
    closesOutside,
    isText,
    onClose,
  } = props;
  const dialog = useRef<HTMLDialogElement>(null);
  const id = useId();
  useLayoutEffect(() => {
    const element = dialog.current!;
    const focused = document.activeElement;
    element.showModal();
    if (isText) element.querySelector<HTMLElement>(".dialog-content")?.focus(); // keys scroll it
    return () => {
      element.close();
      if (focused instanceof HTMLElement && focused.isConnected) focused.focus();
    };
  }, []);
  return (
    <dialog
      ref={dialog}
      class={`dialog ${size}`}
      aria-labelledby={id}
      onCancel={(event) => {
        event.preventDefault();
        onClose();
      }}
      onPointerDown={(event) => {
        if (closesOutside && event.target === dialog.current) onClose();
      }}
    >
      <div class="dialog-frame">
        <header class={isTitleHidden ? "visually-hidden" : "dialog-header"}>
          <h2 id={id}>{title}</h2>
          {!isTitleHidden && <IconButton icon="close" label="Close" onClick={onClose} />}
        </header>
        <div class="dialog-content" tabIndex={isText ? 0 : undefined}>{children}</div>
        {actions && <footer class="dialog-actions">{actions}</footer>}
      </div>
    </dialog>
  );
}

interface Confirmation {
  title: string;
  text: string;
  /** Label of the button that does it. */
  action: string;
  /** Label of the button that does not. */
  refusal?: string;
  isDanger?: boolean;
}

const pending = signal<(Confirmation & { answer: (isConfirmed: boolean) => void }) | null>(null);

/** Ask whether to do something, and return whether it is confirmed. */
export function confirm(confirmation: Confirmation): Promise<boolean> {
  pending.value?.answer(false);
  return new Promise((resolve) => {
    const answer = (isConfirmed: boolean) => {
      pending.value = null;
      resolve(isConfirmed);
    };
    pending.value = { ...confirmation, answer };
  });
}

/** The layer of the question of `confirm`. */
export function ConfirmLayer() {
  const current = pending.value;
  if (!current) return null;
  const { title, text, action, refusal = "Cancel", isDanger, answer } = current;
  return (
    <Dialog
      title={title}
      size="small"
      onClose={() => answer(false)}
      actions={
        <>
          <Button onClick={() => answer(false)} autofocus>
            {refusal}
          </Button>
          <Button variant={isDanger ? "danger" : "primary"} onClick={() => answer(true)}>
            {action}
          </Button>
        </>
      }
    >
      <p>{text}</p>
    </Dialog>
  );
}
