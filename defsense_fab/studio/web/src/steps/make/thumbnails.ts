// Small pictures of the steps, rendered in this browser one after another.
import { effect, signal } from "@preact/signals";
import { type Box3, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import type { ArrayMessage } from "../../protocol/connection";
import type { Guide, PartState } from "../../protocol/messages";
import { isDark, onThemeChange, sceneColors } from "../../scene/theme";
import { arrange, viewDirection } from "./arrangement";
import { meshes } from "./make-scene";
import { PartsLayer } from "./parts-layer";
import { guide, parts, partsEvent } from "./state";

const WIDTH_PX = 132;
const HEIGHT_PX = 78;
const FIELD_OF_VIEW_DEG = 24;
/** Picture of all parts, next to those of the steps. */
export const ALL_PARTS = "all";

/** Address of each picture, by the identifier of its step. */
export const thumbnails = signal<ReadonlyMap<string, string>>(new Map());

const theme = signal(isDark());
onThemeChange(() => (theme.value = isDark()));

let run = 0;
effect(() => {
  const number = ++run;
  void theme.value;
  const [shapes, shown, list] = [meshes.value, guide.value, parts.value];
  thumbnails.value = new Map();
  if (!shapes || !shown || shapes.facts.id !== shown.id || partsEvent.value?.id !== shown.id) return;
  void renderAll(shapes, shown, list, () => number === run);
});

async function renderAll(
  shapes: ArrayMessage,
  shown: Guide,
  list: readonly PartState[],
  isCurrent: () => boolean,
): Promise<void> {
  const renderer = new WebGLRenderer({ alpha: true, antialias: true, stencil: true });
  renderer.setPixelRatio(2);
  renderer.setSize(WIDTH_PX, HEIGHT_PX, false);
  const layer = new PartsLayer(() => undefined);
  layer.setMeshes(shapes, list);
  layer.setTheme(sceneColors());
  const scene = new Scene();
  scene.add(layer.object);
  const camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, WIDTH_PX / HEIGHT_PX);
  camera.up.set(0, 0, 1);
  const radii = { cord: shown.cordRadius, wire: shown.wireRadius };
  try {
    for (const stage of [null, ...shown.stages]) {
      await new Promise((resolve) => setTimeout(resolve)); // the page stays responsive
      if (!isCurrent()) return;
      layer.apply(arrange(shown, list, stage, 1), radii, new Set());
      fit(camera, layer.box(), viewDirection(stage));
      renderer.render(scene, camera);
      const picture = renderer.domElement.toDataURL("image/png");
      thumbnails.value = new Map(thumbnails.value).set(stage?.id ?? ALL_PARTS, picture);
    }
  } finally {
    layer.dispose();
    renderer.dispose();
    renderer.forceContextLoss();
  }
}

/** Place a camera so that a box fills the picture. */
function fit(camera: PerspectiveCamera, box: Box3, direction: Vector3): void {
  const center = box.getCenter(new Vector3());
  camera.position.copy(center).addScaledVector(direction, 1000);
  camera.lookAt(center);
  camera.updateMatrixWorld();
  const slope = Math.tan((FIELD_OF_VIEW_DEG * Math.PI) / 360) * 0.94;
  const corner = new Vector3();
  let distance = 1;
  for (let i = 0; i < 8; i++) {
    corner.set(
      i & 1 ? box.max.x : box.min.x,
      i & 2 ? box.max.y : box.min.y,
      i & 4 ? box.max.z : box.min.z,
    );
    const seen = corner.applyMatrix4(camera.matrixWorldInverse.copy(camera.matrixWorld).invert());
    const half = Math.max(Math.abs(seen.y), Math.abs(seen.x) / camera.aspect);
    distance = Math.max(distance, half / slope + seen.z + 1000);
  }
  camera.position.copy(center).addScaledVector(direction, distance);
  camera.near = distance / 20;
  camera.far = distance * 4;
  camera.updateProjectionMatrix();
}
