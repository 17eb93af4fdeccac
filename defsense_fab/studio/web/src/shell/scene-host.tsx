import { useEffect, useRef } from "preact/hooks";
import { openStage, viewer } from "../scene/stage";
import { ViewTools } from "../scene/view-tools";
import { step } from "../state/step";
import { stepPanels } from "../steps/registry";

const SHAPE_MS = 400; // in which the entered step shows its shape

/** The 3D scene, with what the entered step shows in it; keys do not reach a covered one. */
export function SceneHost({ isCovered }: { isCovered: boolean }) {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => openStage(host.current!), []);
  const shown = viewer.value;
  const scene = stepPanels(step.value)?.scene;
  useEffect(() => (shown && scene ? scene(shown) : undefined), [shown, scene]);
  useEffect(() => {
    const timer = setTimeout(() => shown?.rig.fitAgain(), SHAPE_MS);
    return () => clearTimeout(timer);
  }, [shown, scene]);
  return (
    <>
      <div class="scene-host" ref={host} inert={isCovered} />
      {shown && <ViewTools viewer={shown} isCovered={isCovered} />}
    </>
  );
}
