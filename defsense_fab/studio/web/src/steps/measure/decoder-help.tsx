// What the names of decoders mean, explained where they are shown.
import { TermsPopover } from "../../ui/popover";

const PARTS: readonly [name: string, meaning: string][] = [
  ["affine", "A linear map from signals to positions. It needs the fewest data."],
  ["quadratic", "Squares and products of the signals are used in addition."],
  ["kernel", "A smooth nonlinear map through about 200 of the recorded states."],
  ["simulated", "The map of the simulation, fitted to this device by a gain and an offset of each cord."],
  ["+ memory", "The decoder also uses how far each signal is from its recent mean, because cords react late."],
  ["+ work", "The decoder also uses how much each signal has moved recently, because stretched cords soften."],
];

export function DecoderHelp() {
  return <TermsPopover label="About the decoders" terms={PARTS} />;
}
