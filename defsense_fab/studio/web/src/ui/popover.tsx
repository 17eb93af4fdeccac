import type { ComponentChildren } from "preact";
import { useId, useRef, useState } from "preact/hooks";
import { Icon, type IconName } from "./icons";
import { placeNextTo } from "./place";
import { tooltip } from "./tooltip";

interface PopoverProps {
  /** Name of the button and of the panel. */
  label: string;
  icon?: IconName;
  /** Text of the button; without it, it is an icon. */
  text?: string;
  side?: "below" | "above";
  children: ComponentChildren;
}

/** A button that opens a small panel; Escape and a click outside close it. */
export function Popover({ label, icon = "info", text, side = "below", children }: PopoverProps) {
  const id = useId();
  const button = useRef<HTMLButtonElement>(null);
  const [isOpen, setOpen] = useState(false);
  return (
    <>
      <button
        ref={button}
        type="button"
        class={text ? "button plain" : "icon-button"}
        popoverTarget={id}
        aria-label={text ? undefined : label}
        aria-expanded={isOpen}
        aria-haspopup="dialog"
        {...tooltip(isOpen ? undefined : label)}
      >
        <Icon name={icon} />
        {text}
      </button>
      <div
        id={id}
        class="popover"
        role="dialog"
        aria-label={label}
        popover="auto"
        onToggle={(event) => {
          const isNowOpen = event.newState === "open";
          setOpen(isNowOpen);
          if (isNowOpen)
            placeNextTo(event.currentTarget, button.current!.getBoundingClientRect(), side);
        }}
      >
        {children}
      </div>
    </>
  );
}

/** A button that explains terms: pairs of a name and its meaning. */
export function TermsPopover({ terms, ...popover }: { terms: readonly [string, string][] } & Omit<PopoverProps, "children">) {
  return (
    <Popover {...popover}>
      <dl class="terms">
        {terms.map(([name, meaning]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{meaning}</dd>
          </div>
        ))}
      </dl>
    </Popover>
  );
}
