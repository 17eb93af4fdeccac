// Registers the panels of all steps. A step that has none yet shows its state.
import { STEPS } from "../state/step";
import "./body";
import "./inside";
import "./make";
import "./measure";
import "./optimize";
import "./poses";
import { registerStep, stepPanels } from "./registry";
import "./sensors";
import { StepOverview } from "./step-overview";

for (const name of STEPS) {
  if (!stepPanels(name)) registerStep(name, { inspector: StepOverview });
}
