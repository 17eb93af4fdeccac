// The step Sensors: cords are drawn, dragged and judged.
import { registerStep } from "../registry";
import { showNewestBody } from "../body/scene";
import { HeatMapLegend } from "./heat-map";
import { SensorsInspector } from "./inspector";
import { PredictionPanel } from "./prediction-panel";
import { sensorCommands } from "./sensor-commands";
import "./sensors.css";
import { SensorsToolbar } from "./toolbar";

registerStep("sensors", {
  inspector: SensorsInspector,
  toolbar: SensorsToolbar,
  scene: showNewestBody,
  legend: HeatMapLegend,
  commands: sensorCommands,
  bottom: PredictionPanel,
  bottomTitle: "Expected error and signals",
});
