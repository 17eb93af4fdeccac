// Progress, messages and empty places.
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { step } from "../state/step";
import { type Toast, dismissToast, toasts } from "../state/toasts";
import { Button, IconButton } from "./button";
import { moveToFreePlace } from "./free-place";
import { Icon, type IconName } from "./icons";

const TOAST_MS = 6000;
const ERROR_TOAST_MS = 20_000;
const SETTLE_MS = 400;

interface ProgressBarProps {
  label: string;
  /** Completed share, 0 to 1; null while it is unknown. */
  share: number | null;
}

/** A bar of the completed share. */
export function ProgressBar({ label, share }: ProgressBarProps) {
  const percent = share === null ? undefined : Math.round(share * 100);
  return (
    <div
      class={`progress ${share === null ? "unknown" : ""}`}
      role="progressbar"
      aria-label={label}
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={percent}
    >
      <span style={{ transform: `scaleX(${share ?? 0.3})` }} />
    </div>
  );
}

/** The layer of messages; each disappears after a while, unless the pointer is on it. */
export function ToastLayer() {
  const layer = useRef<HTMLElement>(null);
  const shown = toasts.value;
  useEffect(() => {
    const element = layer.current;
    if (!element) return;
    if (element.matches(":popover-open")) element.hidePopover();
    if (shown.length === 0) return undefined;
    element.showPopover(); // above a dialog that was opened meanwhile
    const place = () => {
      const stage = document.querySelector(".stage") ?? document.documentElement;
      moveToFreePlace(element, stage.getBoundingClientRect());
    };
    place();
    // What the message is about may still appear or disappear.
    const later = setTimeout(place, SETTLE_MS);
    addEventListener("resize", place);
    return () => {
      clearTimeout(later);
      removeEventListener("resize", place);
    };
  }, [shown, step.value]);
  return (
    <section ref={layer} class="toasts" aria-label="Messages" popover="manual">
      {shown.map((toast) => (
        <ToastCard key={toast.id} toast={toast} />
      ))}
    </section>
  );
}

function ToastCard({ toast: { id, text, isError, action } }: { toast: Toast }) {
  const timer = useRef<ReturnType<typeof setTimeout>>(undefined);
  const pause = () => clearTimeout(timer.current);
  const resume = () => {
    pause();
    timer.current = setTimeout(() => dismissToast(id), isError ? ERROR_TOAST_MS : TOAST_MS);
  };
  useEffect(() => {
    resume();
    return pause;
  }, []);
  return (
    <div
      class={`toast ${isError ? "error" : ""}`}
      role={isError ? "alert" : "status"}
      onPointerEnter={pause}
      onPointerLeave={resume}
      onFocusCapture={pause}
      onBlurCapture={resume}
      onKeyDown={(event) => {
        if (event.key !== "Escape") return;
        event.stopPropagation();
        dismissToast(id);
      }}
    >
      <Icon name={isError ? "error" : "check"} />
      <p>{text}</p>
      {action && (
        <Button
          variant="quiet"
          onClick={() => {
            dismissToast(id);
            action.run();
          }}
        >
          {action.label}
        </Button>
      )}
      <IconButton icon="close" label="Dismiss" shortcut="Escape" onClick={() => dismissToast(id)} />
    </div>
  );
}

interface EmptyStateProps {
  icon: IconName;
  /** One sentence with the missing thing and the reason. */
  text: string;
  /** One button. */
  action?: ComponentChildren;
}

/** A panel without content, and a button that adds some. */
export function EmptyState({ icon, text, action }: EmptyStateProps) {
  return (
    <div class="empty-state">
      <span class="empty-icon">
        <Icon name={icon} size={24} />
      </span>
      <p>{text}</p>
      {action}
    </div>
  );
}
