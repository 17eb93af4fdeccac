// Where another cord would help, in the plane that is drawn in.
import { NextCordActions, NextCordToggle } from "../inside/next-cord-tools";
import { PlaneHeatMap } from "../inside/plane-heat-map";
import { SectionLegend } from "../inside/legend";

export const heatMap = new PlaneHeatMap();

/** The switch of the map, and what adds a cord of it. */
export function HeatMapTools() {
  return (
    <span class="heat-map-tools">
      <NextCordToggle tool={heatMap.tool} />
      <NextCordActions tool={heatMap.tool} view={heatMap.view} />
    </span>
  );
}

export function HeatMapLegend() {
  if (!heatMap.view.plane.value) return null;
  return <SectionLegend view={heatMap.view} tool={heatMap.tool} />;
}
