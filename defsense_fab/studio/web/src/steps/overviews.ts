// A step that has no panels of its own shows its state.
import { STEPS } from "../state/step";
import { registerStep } from "./registry";
import { StepOverview } from "./step-overview";

for (const name of STEPS) registerStep(name, { inspector: StepOverview });
