// The cube in the upper right corner that shows and sets the direction of view.
import { Object3D, Vector3 } from "three";
import { ViewportGizmo } from "three-viewport-gizmo";
import { isDark } from "./theme";
import type { Viewer } from "./viewer";

const SIZE_PX = 92;
/** Narrower scenes leave the room of the cube to tools. */
const MIN_SCENE_PX = 420;

Object3D.DEFAULT_UP.set(0, 0, 1);

export class ViewCube {
  private readonly gizmo: ViewportGizmo;
  private isHidden = false;
  private isClicked = false;
  private before: ReturnType<Viewer["rig"]["view"]> | null = null;

  constructor(private readonly viewer: Viewer) {
    this.gizmo = new ViewportGizmo(viewer.rig.camera, viewer.renderer, this.options());
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
        if ((target as Element).closest(".viewer-cube")) viewer.refresh();
      });
    }
  }

  get isBusy(): boolean {
    return this.gizmo.animating;
  }

  /** Draw the cube over the present frame. */
  render(): void {
    const { rig } = this.viewer;
    if (!this.gizmo.enabled) return;
    this.gizmo.camera = rig.camera;
    this.gizmo.target = rig.controls.target;
    if (!this.gizmo.animating) this.gizmo.cameraUpdate();
    this.gizmo.render();
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
    this.viewer.invalidate();
  }

  dispose(): void {
    this.gizmo.dispose();
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
      offset: { top: 8, right: 8 },
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
