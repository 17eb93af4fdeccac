// Small pictures of deformed bodies, drawn off screen by the renderer of the scene.
import { effect, signal } from "@preact/signals";
import {
  Box3,
  Color,
  OrthographicCamera,
  Scene,
  UnsignedByteType,
  Vector3,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import type { NumberArray } from "../../protocol/connection";
import { viewer } from "../../scene/stage";
import { sceneColors } from "../../scene/theme";
import { connection } from "../../state/connection";
import { posePictures } from "../../state/pose-pictures";
import { isDark } from "../../state/theme";
import { PosedBody } from "./posed-body";
import { verticesInside } from "./region-geometry";
import { meshedBody, regions } from "./state";

const WIDTH = 192;
const HEIGHT = 120;
const MARGIN = 1.12;
const DIRECTION = new Vector3(0.5, -0.85, 0.5).normalize();

/** Addresses of pictures of the proposed poses by their names. */
export const proposedPictures = signal<ReadonlyMap<string, string>>(new Map());

const shapes = signal<{ poses: string[]; digests: string[]; moved: NumberArray[] } | null>(null);
connection.onArrays("pose-pictures", ({ arrays, facts }) => {
  const poses: string[] = facts["poses"];
  const digests: string[] = facts["digests"];
  shapes.value = { poses, digests, moved: poses.map((_, k) => arrays[String(k)]!) };
});

const proposed = signal<{ poses: string[]; moved: (NumberArray | undefined)[] }>({ poses: [], moved: [] });
connection.onArrays("proposed-poses", ({ arrays, facts }) => {
  const poses: string[] = facts["poses"];
  proposed.value = { poses, moved: poses.map((_, k) => arrays[String(k)]) };
});

/** Pictures that are drawn, by the array that they show. */
let drawn = new WeakMap<NumberArray, string>();
let drawnFor = "";

effect(() => {
  const body = meshedBody.value;
  const shown = viewer.value;
  const list = shapes.value;
  const suggestions = proposed.value;
  const look = JSON.stringify([isDark.value, regions.value.map(({ points, radius, color }) => [points, radius, color])]);
  if (!body || !shown) {
    if (!body) posePictures.value = new Map();
    return;
  }
  if (look !== drawnFor) drawn = new WeakMap();
  drawnFor = look;
  const rest = body.arrays["vertices"]!;
  const wanted: [string, NumberArray, NumberArray | null][] = [["", rest, null]];
  list?.poses.forEach((name, k) => wanted.push([name, list.moved[k]!, list.moved[k]!]));
  const painter = new Painter(shown.renderer);
  const draw = (key: NumberArray, moved: NumberArray | null): string | null => {
    if (moved && moved.length !== rest.length) return null;
    let address = drawn.get(key);
    if (!address) drawn.set(key, (address = painter.draw(moved)));
    return address;
  };
  // A pose that was changed keeps its last picture until the next one is known.
  const pictures = new Map(posePictures.peek());
  for (const [name, key, moved] of wanted) {
    const address = draw(key, moved);
    if (address) pictures.set(name, address);
  }
  posePictures.value = pictures;
  proposedPictures.value = new Map(
    suggestions.poses.flatMap((name, k) => {
      const moved = suggestions.moved[k];
      const address = moved ? draw(moved, moved) : null;
      return address ? [[name, address] as const] : [];
    }),
  );
  painter.dispose();
});

/** Draws the meshed body with its regions, deformed. */
class Painter {
  private readonly scene = new Scene();
  private readonly camera = new OrthographicCamera();
  private body: PosedBody | null = null;
  private target: WebGLRenderTarget | null = null;

  constructor(private readonly renderer: WebGLRenderer) {}

  draw(moved: NumberArray | null): string {
    const arrays = meshedBody.peek()!.arrays;
    const rest = arrays["vertices"]!;
    if (!this.body) {
      this.body = new PosedBody(sceneColors().body);
      this.body.set(arrays);
      this.body.color(
        regions.peek().map((region) => ({ color: region.color, inside: verticesInside(region, rest) })),
      );
      this.scene.add(this.body.object);
      this.target = new WebGLRenderTarget(WIDTH, HEIGHT, { samples: 4, type: UnsignedByteType, stencilBuffer: true });
    }
    const vertices = Float32Array.from(rest, (value, i) => value + (moved ? moved[i]! : 0));
    this.body.deform(vertices);
    this.aim(vertices);
    return this.render();
  }

  dispose(): void {
    this.body?.dispose();
    this.target?.dispose();
  }

  private aim(vertices: Float32Array): void {
    const { camera } = this;
    const box = new Box3().setFromArray(vertices);
    const center = box.getCenter(new Vector3());
    const size = box.getSize(new Vector3()).length();
    camera.up.set(0, 0, 1);
    camera.position.copy(center).addScaledVector(DIRECTION, 2 * size);
    camera.lookAt(center);
    camera.updateMatrixWorld();
    let [half, across] = [1e-3, 1e-3];
    const point = new Vector3();
    const middle = new Box3();
    for (let i = 0; i < vertices.length; i += 3) {
      middle.expandByPoint(point.fromArray(vertices, i).applyMatrix4(camera.matrixWorldInverse));
    }
    const view = middle.getCenter(new Vector3());
    across = (MARGIN * (middle.max.x - middle.min.x)) / 2;
    half = (MARGIN * (middle.max.y - middle.min.y)) / 2;
    half = Math.max(half, (across * HEIGHT) / WIDTH);
    across = (half * WIDTH) / HEIGHT;
    [camera.left, camera.right] = [view.x - across, view.x + across];
    [camera.bottom, camera.top] = [view.y - half, view.y + half];
    camera.near = 0.01;
    camera.far = 5 * size;
    camera.updateProjectionMatrix();
  }

  private render(): string {
    const { renderer } = this;
    const before = renderer.getRenderTarget();
    const color = renderer.getClearColor(new Color());
    const alpha = renderer.getClearAlpha();
    renderer.setClearColor(0x000000, 0);
    renderer.setRenderTarget(this.target);
    renderer.clear();
    renderer.render(this.scene, this.camera);
    const pixels = new Uint8Array(4 * WIDTH * HEIGHT);
    renderer.readRenderTargetPixels(this.target!, 0, 0, WIDTH, HEIGHT, pixels);
    renderer.setRenderTarget(before);
    renderer.setClearColor(color, alpha);
    return toAddress(pixels);
  }
}

/** Return linear pixels, bottom row first, as the address of a picture. */
function toAddress(pixels: Uint8Array): string {
  const canvas = document.createElement("canvas");
  canvas.width = WIDTH;
  canvas.height = HEIGHT;
  const context = canvas.getContext("2d")!;
  const image = context.createImageData(WIDTH, HEIGHT);
  for (let row = 0; row < HEIGHT; row++) {
    const from = 4 * WIDTH * (HEIGHT - 1 - row);
    const to = 4 * WIDTH * row;
    for (let i = 0; i < 4 * WIDTH; i++) {
      const value = pixels[from + i]!;
      image.data[to + i] = i % 4 === 3 ? value : SRGB[value]!;
    }
  }
  context.putImageData(image, 0, 0);
  return canvas.toDataURL();
}

const SRGB = Uint8Array.from({ length: 256 }, (_, i) => {
  const linear = i / 255;
  const encoded = linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055;
  return Math.round(255 * encoded);
});
