import { registerStep } from "../registry";
import { FilmStrip } from "./film-strip";
import { MakeInspector } from "./inspector";
import { makeCommands } from "./make-commands";
import { attachParts } from "./make-scene";
import { MakeToolbar } from "./toolbar";
import "./make.css";

registerStep("make", {
  inspector: MakeInspector,
  toolbar: MakeToolbar,
  commands: makeCommands,
  bottom: FilmStrip,
  bottomTitle: "Assembly",
  scene: attachParts,
});
