// The step Inside: a section through the body, and where another cord would help.
import { h } from "preact";
import { registerStep } from "../registry";
import "./inside.css";
import { InsideInspector } from "./inspector";
import { SectionLegend } from "./legend";
import { openInside, view } from "./inside-state";
import { StatesStrip } from "./states-strip";
import { InsideToolbar, insideCommands } from "./toolbar";

registerStep("inside", {
  inspector: InsideInspector,
  toolbar: InsideToolbar,
  legend: () => h(SectionLegend, { view }),
  commands: insideCommands,
  scene: openInside,
  bottom: StatesStrip,
  bottomTitle: "States",
});
