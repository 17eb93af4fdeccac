// The step Poses: regions, poses that hold and move them, and the body that follows.
import { registerStep } from "../registry";
import { posesCommands } from "./commands";
import { PosesInspector } from "./inspector";
import "./inspector.css";
import { showPoses } from "./pose-scene";
import "./poses.css";
import { StateStrip } from "./state-strip";
import { PosesLegend, PosesToolbar } from "./toolbar";

registerStep("poses", {
  inspector: PosesInspector,
  toolbar: PosesToolbar,
  legend: PosesLegend,
  commands: posesCommands,
  bottom: StateStrip,
  bottomTitle: "States",
  scene: showPoses,
});
