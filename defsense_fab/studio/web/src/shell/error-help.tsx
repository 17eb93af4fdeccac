// What the errors of the page are: one name for each quantity, explained where it is shown.
import { TermsPopover } from "../ui/popover";

const ERRORS: readonly [name: string, meaning: string][] = [
  [
    "Expected error",
    "How far the sensed surface is from the true one (root mean square), in simulated deformations that cords and decoder were not fitted to, with the noise of the readings. Sensors, Optimize, Make and the report show this number.",
  ],
  [
    "Without the cuts, in the parts",
    "Without the cuts is computed at once, for the paths of the cords alone; the optimizer compares these numbers. In the parts also contains what the parts change: grooves, pockets and strain relief. For it the parts are made on trial, which also shows whether they can be made.",
  ],
  [
    "Error in use",
    "What remains in the hand after training on a recorded session, a third of which is near rest. It also contains the memory of the cords, which depend on how they were stretched before, and the tolerances of built devices. The range is that of 90 of 100 devices.",
  ],
  [
    "Very good, usable, poor",
    "How large an error is, compared with the farthest that the surface moves. The report states the scale, which is a choice of this project.",
  ],
  [
    "Measured error",
    "The error of a trained model in recorded frames that it was not trained on. Measure shows it; compare it with the error in use.",
  ],
];

export function ErrorHelp({ side }: { side?: "below" | "above" }) {
  return <TermsPopover label="About the expected error" side={side} terms={ERRORS} />;
}
