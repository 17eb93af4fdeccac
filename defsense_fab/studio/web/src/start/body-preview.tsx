import { useEffect, useRef } from "preact/hooks";
import type { ArrayMessage } from "../protocol/connection";
import { Viewer } from "../scene/viewer";
import { connection } from "../state/connection";
import { run } from "../state/run";

/** The uploaded body in a scene of its own, scaled to mm. */
export function BodyPreview({ scale }: { scale: number }) {
  const host = useRef<HTMLDivElement>(null);
  const viewer = useRef<Viewer | null>(null);
  const surface = useRef<ArrayMessage | null>(null);
  const latestScale = useRef(scale);
  latestScale.current = scale;

  const show = () => {
    const message = surface.current;
    if (!viewer.current || !message) return;
    const vertices = message.arrays["vertices"]!.map((x) => x * latestScale.current);
    viewer.current.body.set({ ...message.arrays, vertices });
    viewer.current.rig.look("home", false);
  };

  useEffect(() => {
    const shown = new Viewer(host.current!);
    viewer.current = shown;
    shown.canvas.setAttribute("aria-label", "The uploaded body");
    void run(connection.fetch("uploaded-surface", {})).then((message) => {
      surface.current = message ?? null;
      show();
    });
    return () => {
      viewer.current = null;
      shown.dispose();
    };
  }, []);
  useEffect(show, [scale]);

  return <div class="body-preview" ref={host} />;
}
