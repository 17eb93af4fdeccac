// Keeps a small picture of the device, as it was seen last, for the list of devices.
import { effect } from "@preact/signals";
import { viewer } from "../scene/stage";
import type { Viewer } from "../scene/viewer";
import { connection } from "../state/connection";

const WIDTH = 320;
const HEIGHT = 200;
/** Time without a new frame after which a picture is taken, ms. */
const REST_MS = 3000;
/** Smallest time between two pictures of a scene that stays open, ms. */
const INTERVAL_MS = 60_000;

effect(() => {
  const shown = viewer.value;
  if (!shown) return undefined;
  let timer: ReturnType<typeof setTimeout> | undefined;
  let takenAt = -Infinity;
  const keep = () => {
    takenAt = performance.now();
    take(shown);
  };
  const stop = shown.onFrame(() => {
    clearTimeout(timer);
    if (performance.now() - takenAt > INTERVAL_MS) timer = setTimeout(keep, REST_MS);
  });
  return () => {
    clearTimeout(timer);
    stop();
    keep(); // the scene is left, and still exists
  };
});

function take(shown: Viewer): void {
  if (shown.body.isEmpty || document.hidden || !connection.isOpen.value) return;
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [WIDTH, HEIGHT];
  const context = canvas.getContext("2d");
  if (!context) return;
  context.imageSmoothingQuality = "high";
  shown.copyPicture((source) => {
    const scale = Math.max(WIDTH / source.width, HEIGHT / source.height);
    const [width, height] = [source.width * scale, source.height * scale];
    context.drawImage(source, (WIDTH - width) / 2, (HEIGHT - height) / 2, width, height);
  });
  const picture = canvas.toDataURL("image/webp", 0.85);
  // A picture that is not kept is no loss.
  connection.send("keep-picture", { picture }).catch(() => undefined);
}
