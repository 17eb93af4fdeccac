import { isPhone, sheet } from "../state/layout";
import { STEP_LABELS, step } from "../state/step";
import { stepPanels } from "../steps/registry";
import { IconButton } from "../ui/button";
import { BottomSection } from "./bottom-panel";
import { NextButton } from "./next-button";

/** The entered step's inspector: at the right, or in a sheet below the scene on a phone. */
export function Inspector() {
  const Content = stepPanels(step.value)?.inspector;
  return (
    <aside
      class={`inspector ${isPhone.value ? `sheet ${sheet.value}` : ""}`}
      aria-label={STEP_LABELS[step.value]}
    >
      {isPhone.value ? (
        <SheetHeader />
      ) : (
        <h2 class="visually-hidden step-heading">{STEP_LABELS[step.value]}</h2>
      )}
      <div class="inspector-content" hidden={isPhone.value && sheet.value === "closed"}>
        {Content && <Content />}
        {isPhone.value && <BottomSection />}
      </div>
    </aside>
  );
}

const LARGER = { closed: "half", half: "full", full: "half" } as const;
/** Heights of the sheet as shares of the workspace, as in phone.css; 0 is the header alone. */
const HEIGHTS = { closed: 0, half: 0.46, full: 0.88 } as const;
const SWIPE_PX = 16; // of the finger; less is a tap

function SheetHeader() {
  const isLargest = sheet.value === "full";
  return (
    <header class="sheet-header" onPointerDown={swipeSheet}>
      <IconButton
        icon={isLargest ? "chevronDown" : "chevronUp"}
        label={isLargest ? "Make the panel smaller" : "Make the panel larger"}
        onClick={() => (sheet.value = LARGER[sheet.value])}
      />
      <h2 class="step-heading">{STEP_LABELS[step.value]}</h2>
      <NextButton />
      <IconButton
        icon="close"
        label="Close the panel"
        disabled={sheet.value === "closed"}
        onClick={() => (sheet.value = "closed")}
      />
    </header>
  );
}

/** Let the sheet follow the finger, and settle at the nearest other height in its direction. */
function swipeSheet(down: PointerEvent): void {
  const header = down.currentTarget as HTMLElement;
  const panel = header.parentElement!;
  if (!down.isPrimary || (down.target as Element).closest("button")) return;
  const workspace = panel.parentElement!.clientHeight;
  const height = panel.offsetHeight;
  let swiped = 0;
  const move = ({ clientY }: PointerEvent) => {
    swiped = down.clientY - clientY;
    if (Math.abs(swiped) < SWIPE_PX) return;
    panel.style.transition = "none";
    panel.style.height = `${Math.max(header.offsetHeight, height + swiped)}px`;
  };
  const end = (event: PointerEvent) => {
    header.removeEventListener("pointermove", move);
    const share = panel.offsetHeight / workspace;
    panel.style.transition = panel.style.height = "";
    if (event.type !== "pointerup" || Math.abs(swiped) < SWIPE_PX) return;
    const names = (["closed", "half", "full"] as const).filter(
      (name) => (HEIGHTS[name] - HEIGHTS[sheet.value]) * swiped > 0,
    );
    const distance = (name: keyof typeof HEIGHTS) => Math.abs(HEIGHTS[name] - share);
    names.sort((a, b) => distance(a) - distance(b));
    sheet.value = names[0] ?? sheet.value;
  };
  header.setPointerCapture(down.pointerId);
  header.addEventListener("pointermove", move);
  header.addEventListener("pointerup", end, { once: true });
  header.addEventListener("pointercancel", end, { once: true });
}
