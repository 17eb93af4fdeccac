// Registers the panels of all steps. A step that has none yet shows its state.
import { STEPS } from "../state/step";
import { StepOverview } from "./step-overview";
import "./poses";
import { registerStep, stepPanels } from "./registry";

for (const name of STEPS) if (!stepPanels(name)) registerStep(name, { inspector: StepOverview });
