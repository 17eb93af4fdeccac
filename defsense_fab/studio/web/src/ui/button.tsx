// Buttons with text, with an icon, and those that stay pressed.
import type { ComponentChildren, JSX } from "preact";
import { Icon, type IconName } from "./icons";
import { tooltip } from "./tooltip";

type Attributes = Omit<JSX.IntrinsicElements["button"], "icon" | "onClick" | "ref" | "disabled">;

interface Common {
  onClick?: (event: MouseEvent) => void;
  disabled?: boolean;
  /** Effect of the button, or the reason why it is disabled. */
  hint?: string;
  shortcut?: string;
}

interface ButtonProps extends Common {
  children: ComponentChildren;
  variant?: "primary" | "plain" | "quiet" | "danger";
  icon?: IconName;
  /** Whether its work runs; it cannot be pressed again meanwhile. */
  isBusy?: boolean;
}

/** A button; a disabled one stays in the order of focus, so that its hint can be read. */
export function Button({
  children,
  variant = "plain",
  icon,
  isBusy = false,
  onClick,
  disabled = false,
  hint,
  shortcut,
  class: added,
  ...rest
}: ButtonProps & Attributes) {
  const isOff = disabled || isBusy;
  return (
    <button
      type="button"
      {...rest}
      class={`button ${variant} ${String(added ?? "")}`}
      aria-disabled={isOff || undefined}
      aria-busy={isBusy || undefined}
      aria-description={hint}
      onClick={isOff ? refuse : onClick}
      {...tooltip(hint, shortcut)}
    >
      {isBusy ? <span class="spinner" aria-hidden="true" /> : icon && <Icon name={icon} />}
      <span class="button-text">{children}</span>
    </button>
  );
}

interface IconButtonProps extends Common {
  icon: IconName;
  /** Its name, also shown as its tooltip. */
  label: string;
  /** For a button that stays pressed: whether it is. */
  isPressed?: boolean;
  tone?: "danger" | "warning";
}

/** A button with an icon, whose name is its tooltip. */
export function IconButton({
  icon,
  label,
  isPressed,
  tone,
  onClick,
  disabled = false,
  hint,
  shortcut,
  class: added,
  ...rest
}: IconButtonProps & Attributes) {
  return (
    <button
      type="button"
      {...rest}
      class={`icon-button ${tone ?? ""} ${String(added ?? "")}`}
      aria-label={label}
      aria-pressed={isPressed}
      aria-disabled={disabled || undefined}
      aria-description={hint}
      onClick={disabled ? refuse : onClick}
      {...tooltip(hint ?? label, shortcut)}
    >
      <Icon name={icon} />
    </button>
  );
}

function refuse(event: Event): void {
  event.preventDefault();
  event.stopPropagation();
}
