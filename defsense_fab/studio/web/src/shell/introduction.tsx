// A walk through the steps, offered once on the first device.
import { signal } from "@preact/signals";
import { isBoolean, storedSignal } from "../state/storage";
import { STEPS, STEP_LABELS, type StepName, enterStep } from "../state/step";
import { Button, IconButton } from "../ui/button";

const TEXTS: Record<StepName, string> = {
  body: "The body is the soft object that deforms. Set its dimensions, its material, the cord and the printer here.",
  poses:
    "Poses are the deformations that the device is to sense: where it is held, and where it is pulled, bent or twisted.",
  inside:
    "Simulated poses show how much each place inside the body stretches. Cut the body anywhere to see where a sensor has something to measure.",
  sensors:
    "Draw conductive cords through the body, or let the studio propose them. The expected error follows while you drag.",
  optimize:
    "Optimize improves the cords and compares layouts with few and many parts. Choose the one you like.",
  make: "Build the parts, print them, cut the cords, and follow the guide step by step to assemble the device.",
  measure:
    "Record a few minutes with the finished device, train its model, and see it move on the screen.",
};

/** Whether it was offered, here or on the start page: it is offered once. */
export const wasOffered = storedSignal("introduction", false, isBoolean);

const OFFER = -1;

/** The shown step of the walk; null while none is. */
const position = signal<number | null>(null);

export function startIntroduction(): void {
  goTo(0);
}

function goTo(index: number): void {
  wasOffered.value = true;
  position.value = index;
  enterStep(STEPS[index]!);
}

function close(): void {
  wasOffered.value = true;
  position.value = null;
}

/** The card of the walk; the rest of the page stays usable. */
export function Introduction() {
  const at = position.value ?? (wasOffered.value ? null : OFFER);
  if (at === null) return null;
  const name = STEPS[at];
  return (
    <section class="introduction" role="dialog" aria-label="Introduction">
      <header>
        <h2>{name ? STEP_LABELS[name] : "New here?"}</h2>
        {name && (
          <span class="introduction-count">
            {at + 1} of {STEPS.length}
          </span>
        )}
        <IconButton icon="close" label="Close the introduction" onClick={close} />
      </header>
      <p aria-live="polite">
        {name
          ? TEXTS[name]
          : "A walk through the seven steps takes five minutes. You find it in the menu later, too."}
      </p>
      {name ? (
        <footer>
          <Button disabled={at === 0} onClick={() => goTo(at - 1)}>
            Back
          </Button>
          {at < STEPS.length - 1 ? (
            <Button onClick={() => goTo(at + 1)}>Next</Button>
          ) : (
            <Button onClick={close}>Close</Button>
          )}
        </footer>
      ) : (
        <footer>
          <Button variant="quiet" onClick={close}>
            Not now
          </Button>
          <Button onClick={startIntroduction}>Show me</Button>
        </footer>
      )}
    </section>
  );
}
