import { registerStep } from "../registry";
import { FilmStrip } from "./film-strip";
import { MakeInspector } from "./inspector";
import { attachParts } from "./make-scene";
import { MakeToolbar } from "./toolbar";
import "./make.css";

registerStep("make", {
  inspector: MakeInspector,
  toolbar: MakeToolbar,
  bottom: FilmStrip,
  bottomTitle: "Assembly",
  scene: attachParts,
});
