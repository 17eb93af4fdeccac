// The step Body: the body and its parameters, materials, and fields of the device.
import { registerStep } from "../registry";
import "./body.css";
import { BodyInspector } from "./inspector";
import { showNewestBody } from "./scene";

registerStep("body", { inspector: BodyInspector, scene: showNewestBody });
