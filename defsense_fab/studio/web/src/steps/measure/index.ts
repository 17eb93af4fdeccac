import { registerStep } from "../registry";
import { Outline } from "./outline";
import { MeasureStage } from "./stage";

registerStep("measure", { inspector: Outline, stage: MeasureStage });
