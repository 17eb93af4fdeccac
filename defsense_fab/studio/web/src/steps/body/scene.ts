// The newest body in the scene, which the last build may not have.
import type { ArrayMessage } from "../../protocol/connection";
import type { Viewer } from "../../scene/viewer";
import { connection } from "../../state/connection";

const SIZE_CHANGE = 1.3; // after which the whole body is shown again

/** Show the newest body; return a function that shows that of the build again. */
export function showNewestBody(viewer: Viewer): () => void {
  let built: ArrayMessage | null = null;
  let preview: ArrayMessage | null = null;
  let seenSize = 0;
  const update = () => {
    const shown = preview ?? built;
    if (!shown) return;
    viewer.body.set(shown.arrays);
    const size = viewer.body.box.max.distanceTo(viewer.body.box.min);
    const ratio = seenSize > 0 ? size / seenSize : 1;
    if (ratio > SIZE_CHANGE || ratio < 1 / SIZE_CHANGE) viewer.rig.look("home");
    if (seenSize === 0 || ratio > SIZE_CHANGE || ratio < 1 / SIZE_CHANGE) seenSize = size;
  };
  const stops = [
    connection.onArrays("body", (message) => {
      built = message;
      update();
    }),
    connection.onArrays("body-preview", (message) => {
      preview = message.arrays["faces"] ? message : null;
      update();
    }),
  ];
  return () => {
    for (const stop of stops) stop();
    if (preview && built) viewer.body.set(built.arrays);
  };
}
