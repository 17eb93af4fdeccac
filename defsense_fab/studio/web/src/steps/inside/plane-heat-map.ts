// Where another cord would help, in a plane of the body at rest: for the step that draws cords.
import { effect, signal } from "@preact/signals";
import type { Frame } from "../../scene/types";
import type { Viewer } from "../../scene/viewer";
import { NextCordTool } from "./next-cord";
import { SectionLayer } from "./section-layer";
import { SectionView } from "./section-view";

/**
 * A heat map of the next cord in the plane where somebody draws.
 *
 * Show `NextCordToggle` and `NextCordActions` with its `tool` and `view` among the tools, and
 * `SectionLegend` with its `view` as the legend. Set `plane` to the plane, or to null while nobody
 * draws; `open` it while the step is entered.
 */
export class PlaneHeatMap {
  readonly plane = signal<Frame | null>(null);
  readonly view = new SectionView(() => undefined, false);
  readonly tool = new NextCordTool(this.view);

  /** Show the map in a scene; return a function to stop. */
  open(viewer: Viewer): () => void {
    const options = { hasBody: false, isPicking: true };
    const layer = new SectionLayer(viewer, this.view, this.tool, options);
    const stops = [
      this.view.open(),
      this.tool.open(),
      effect(() => {
        this.view.plane.value = this.tool.isOn.value ? this.plane.value : null;
      }),
    ];
    return () => {
      for (const stop of stops) stop();
      layer.dispose();
    };
  }
}
