// The step Body: the body and its parameters, materials, and fields of the device.
import { registerStep } from "../registry";
import { bodyCommands } from "./body-commands";
import "./body.css";
import { BodyInspector } from "./inspector";
import { showNewestBody } from "./scene";

registerStep("body", { commands: bodyCommands, inspector: BodyInspector, scene: showNewestBody });
