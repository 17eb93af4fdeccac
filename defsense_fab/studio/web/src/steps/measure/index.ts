import { registerStep } from "../registry";
import { measureCommands } from "./measure-commands";
import { Outline } from "./outline";
import { MeasureStage } from "./stage";

registerStep("measure", { commands: measureCommands, inspector: Outline, stage: MeasureStage });
