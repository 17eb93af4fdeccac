import { registerStep } from "../registry";
import { OptimizeBottom } from "./bottom";
import { attachErrorMap } from "./error-map";
import { attachGhosts } from "./ghosts";
import { OptimizeInspector } from "./inspector";
import { OptimizeLegend } from "./legend";
import { optimizeCommands } from "./optimize-commands";
import "./charts/charts.css";
import "./optimize.css";

registerStep("optimize", {
  inspector: OptimizeInspector,
  legend: OptimizeLegend,
  commands: optimizeCommands,
  bottom: OptimizeBottom,
  bottomTitle: "Layouts and progress",
  scene: (viewer) => {
    const stops = [attachGhosts(viewer), attachErrorMap(viewer)];
    return () => {
      for (const stop of stops) stop();
    };
  },
});
