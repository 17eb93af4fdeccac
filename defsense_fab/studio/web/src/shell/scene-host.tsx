import { useEffect, useRef } from "preact/hooks";
import { step } from "../state/step";
import { stepPanels } from "../steps/registry";
import { openStage, viewer } from "../scene/stage";

/** The 3D scene, with what the entered step shows in it. */
export function SceneHost() {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => openStage(host.current!), []);
  const shown = viewer.value;
  const scene = stepPanels(step.value)?.scene;
  useEffect(() => (shown && scene ? scene(shown) : undefined), [shown, scene]);
  return <div class="scene-host" ref={host} />;
}
