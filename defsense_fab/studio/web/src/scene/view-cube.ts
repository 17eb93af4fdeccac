// The cube in the upper right corner that shows and sets the direction of view.
//
// It has many small parts, so that its picture is kept while the direction is the same.
import {
  Camera,
  Color,
  HalfFloatType,
  Mesh,
  Object3D,
  PlaneGeometry,
  Quaternion,
  Vector3,
  Vector4,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { ViewportGizmo } from "three-viewport-gizmo";
import { pictureMaterial } from "./shading";
import { isDark } from "./theme";
import type { Viewer } from "./viewer";

const SIZE_PX = 92;
/** Narrower scenes leave the room of the cube to tools. */
const MIN_SCENE_PX = 420;
const OFFSET_PX = 8;
/** Pixels of the kept picture per pixel of the page; twice as many smooth its edges. */
const PICTURE_RATIO = 2;
/** Largest difference between the components of equal directions. */
const SAME_DIRECTION = 1e-6;

Object3D.DEFAULT_UP.set(0, 0, 1);

export class ViewCube {
  private readonly gizmo: ViewportGizmo;
  private readonly target = new WebGLRenderTarget(PICTURE_RATIO * SIZE_PX, PICTURE_RATIO * SIZE_PX, {
    type: HalfFloatType,
  });
  private readonly picture = new Mesh(new PlaneGeometry(2, 2), pictureMaterial(this.target.texture));
  private readonly camera = new Camera();
  private readonly direction = new Quaternion(0, 0, 0, 0);
  private readonly viewport = new Vector4();
  private readonly clearColor = new Color();
  private isStale = true;
  private isHidden = false;
  private isClicked = false;
  private before: ReturnType<Viewer["rig"]["view"]> | null = null;

  constructor(private readonly viewer: Viewer) {
    this.gizmo = new ViewportGizmo(
      viewer.rig.camera,
      pictureRenderer(viewer.renderer),
      this.options(),
    );
    this.picture.frustumCulled = false;
    // The rig changes views itself; the cube only names the direction.
    this.gizmo.animated = false;
    this.gizmo.addEventListener("start", () => (this.before = viewer.rig.view()));
    this.gizmo.addEventListener("change", () => {
      this.isClicked ||= this.gizmo.animating;
      viewer.invalidate();
    });
    this.gizmo.addEventListener("end", () => this.onEnd());
    // The side under the pointer is highlighted.
    for (const kind of ["pointermove", "pointerout"] as const) {
      viewer.overlay.addEventListener(kind, ({ target }) => {
        if ((target as Element).closest(".viewer-cube")) this.refresh();
      });
    }
  }

  get isBusy(): boolean {
    return this.gizmo.animating;
  }

  /** Draw the cube over the present frame. */
  render(): void {
    const { rig, renderer, width, height } = this.viewer;
    if (!this.gizmo.enabled) return;
    const { quaternion } = rig.camera;
    if (this.isStale || this.gizmo.animating || !isSame(quaternion, this.direction)) {
      this.direction.copy(quaternion);
      this.isStale = false;
      this.draw();
    }
    renderer.getViewport(this.viewport);
    renderer.autoClear = false;
    const at = SIZE_PX + OFFSET_PX;
    renderer.setViewport(width - at, height - at, SIZE_PX, SIZE_PX);
    renderer.render(this.picture, this.camera);
    renderer.setViewport(this.viewport);
    renderer.autoClear = true;
  }

  setHidden(isHidden: boolean): void {
    this.isHidden = isHidden;
    this.enable();
    this.viewer.invalidate();
  }

  resize(): void {
    this.enable();
    this.gizmo.domUpdate();
  }

  setTheme(): void {
    this.gizmo.set(this.options());
    this.gizmo.animated = false;
    this.refresh();
  }

  dispose(): void {
    this.gizmo.dispose();
    this.target.dispose();
    this.picture.geometry.dispose();
    this.picture.material.dispose();
  }

  private refresh(): void {
    this.isStale = true;
    this.viewer.refresh();
  }

  private draw(): void {
    const { rig, renderer } = this.viewer;
    this.gizmo.camera = rig.camera;
    this.gizmo.target = rig.controls.target;
    if (!this.gizmo.animating) this.gizmo.cameraUpdate();
    renderer.getClearColor(this.clearColor);
    const alpha = renderer.getClearAlpha();
    renderer.setClearColor(0x000000, 0);
    renderer.setRenderTarget(this.target);
    renderer.clear();
    this.gizmo.render();
    renderer.setRenderTarget(null);
    renderer.setClearColor(this.clearColor, alpha);
  }

  private enable(): void {
    this.gizmo.enabled = !this.isHidden && this.viewer.width >= MIN_SCENE_PX;
  }

  private onEnd(): void {
    const { rig } = this.viewer;
    const direction = new Vector3().subVectors(rig.camera.position, rig.controls.target);
    if (this.isClicked && this.before) {
      rig.show(this.before);
      rig.turnTo(direction);
    } else rig.controls.update();
    this.isClicked = false;
  }

  private options(): ConstructorParameters<typeof ViewportGizmo>[2] {
    const [face, text, edge, hover] = isDark()
      ? ["#3a424c", "#e8edf2", "#55606c", "#4b8fe0"]
      : ["#ffffff", "#2b3540", "#c8d0d9", "#5b9bea"];
    const side = (label: string) => ({
      label,
      color: face!,
      labelColor: text!,
      hover: { color: hover!, labelColor: "#ffffff" },
    });
    return {
      container: this.viewer.overlay,
      className: "viewer-cube",
      type: "cube",
      size: SIZE_PX,
      placement: "top-right",
      offset: { top: OFFSET_PX, right: OFFSET_PX },
      font: { family: "system-ui, sans-serif", weight: 600 },
      background: { color: edge!, hover: { color: edge!, opacity: 1 } },
      corners: { color: edge!, hover: { color: hover! } },
      edges: { color: edge!, hover: { color: hover! } },
      x: side("Right"),
      nx: side("Left"),
      y: side("Back"),
      ny: side("Front"),
      z: side("Top"),
      nz: side("Bottom"),
    };
  }
}

/** Return a renderer that draws into the whole picture, wherever the cube is on the page. */
function pictureRenderer(renderer: WebGLRenderer): WebGLRenderer {
  const drawing = Object.create(renderer) as WebGLRenderer;
  drawing.setViewport = () => undefined;
  return drawing;
}

function isSame(a: Quaternion, b: Quaternion): boolean {
  const [dx, dy, dz, dw] = [a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w];
  return Math.max(Math.abs(dx), Math.abs(dy), Math.abs(dz), Math.abs(dw)) < SAME_DIRECTION;
}
