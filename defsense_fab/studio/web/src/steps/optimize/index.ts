import { registerStep } from "../registry";
import { OptimizeBottom } from "./bottom";
import { attachErrorMap } from "./error-map";
import { attachGhosts } from "./ghosts";
import { OptimizeInspector } from "./inspector";
import { OptimizeLegend } from "./legend";
import "./charts/charts.css";
import "./optimize.css";

registerStep("optimize", {
  inspector: OptimizeInspector,
  legend: OptimizeLegend,
  bottom: OptimizeBottom,
  bottomTitle: "Layouts and progress",
  scene: (viewer) => {
    const stops = [attachGhosts(viewer), attachErrorMap(viewer)];
    return () => {
      for (const stop of stops) stop();
    };
  },
});
