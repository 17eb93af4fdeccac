// Where another cord would help, in a plane of the body at rest: for the step that draws cords.
import { effect, signal } from "@preact/signals";
import type { Frame } from "../../scene/types";
import { isBodyShown } from "../../scene/stage";
import type { Viewer } from "../../scene/viewer";
import { NextCordTool } from "./next-cord";
import { SectionLayer } from "./section-layer";
import { SectionView } from "./section-view";

/**
 * A heat map of the next cord in the plane where somebody draws.
 *
 * Show `NextCordToggle` and `NextCordActions` with its `tool` and `view` among the tools, and
 * `SectionLegend` with both as the legend. Set `plane` to the plane, or to null while nobody
 * draws; `open` it while the step is entered.
 */
export class PlaneHeatMap {
  readonly plane = signal<Frame | null>(null);
  readonly view = new SectionView(() => undefined, false);
  readonly tool = new NextCordTool(this.view);

  /** Show the map in a scene; return a function to stop. */
  open(viewer: Viewer): () => void {
    const layer = new SectionLayer(viewer, this.view, this.tool, { hasBody: false });
    const stops = [
      this.view.open(),
      this.tool.open(),
      effect(() => {
        this.view.plane.value = this.tool.isOn.value ? this.plane.value : null;
      }),
      effect(() => {
        isBodyShown.value = this.view.plane.value === null; // it would tint the colors
      }),
    ];
    return () => {
      for (const stop of stops) stop();
      isBodyShown.value = true;
      layer.dispose();
    };
  }
}
