// The scene: it renders only when something has changed, and owns camera, layers and overlay.
import {
  Box3,
  type Color,
  LinearSRGBColorSpace,
  Mesh,
  NoToneMapping,
  PlaneGeometry,
  Ray,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { BodyLayer } from "./body-layer";
import { listenForCameraKeys } from "./camera-keys";
import { CameraRig } from "./camera-rig";
import { ContactShadow } from "./contact-shadow";
import { CoveredPlaces } from "./covered-places";
import { CordLayer } from "./cord-layer";
import { LabelLayer } from "./label-layer";
import { ORDER } from "./order";
import { Picker } from "./picker";
import { isSoftwareRendered, Resolution } from "./resolution";
import { ScaleBar } from "./scale-bar";
import "./scene.css";
import { backgroundMaterial } from "./shading";
import { onThemeChange, type SceneColors, sceneColors } from "./theme";
import { ViewCube } from "./view-cube";

/** Smallest time between two shadows of a body that moves, ms; longer on slow machines. */
const SHADOW_INTERVAL_MS = 200;
const SLOW_SHADOW_INTERVAL_MS = 1000;

export class Viewer {
  readonly scene = new Scene();
  readonly renderer: WebGLRenderer;
  readonly canvas: HTMLCanvasElement;
  /** Elements over the picture: labels, handles, scale. */
  readonly overlay = document.createElement("div");
  readonly rig: CameraRig;
  readonly body: BodyLayer;
  readonly cords: CordLayer;
  readonly labels: LabelLayer;
  readonly picker: Picker;
  readonly cube: ViewCube;
  /** What floats over the picture. */
  readonly covered: CoveredPlaces;
  readonly resolution: Resolution;
  colors: SceneColors = sceneColors();
  width = 1;
  height = 1;
  private readonly background = new Mesh(new PlaneGeometry(2, 2), backgroundMaterial());
  private readonly shadow = new ContactShadow();
  private readonly scale: ScaleBar;
  private readonly frameListeners = new Set<() => void>();
  private readonly nextFrameListeners = new Set<() => void>();
  private readonly themeListeners = new Set<(colors: SceneColors) => void>();
  private readonly observer: ResizeObserver;
  private readonly stopTheme: () => void;
  private readonly projected = new Vector3();
  private frame = 0;
  private stillTimer = 0;
  private shadowAt = -Infinity;
  /** What the camera was fitted to. */
  private shown: "nothing" | "cords" | "body" = "nothing";
  private isMoving = false;
  /** Whether a pointer is down: the view stays as it is under it. */
  private isPressed = false;
  private readonly onPointer = ({ buttons }: PointerEvent) => {
    this.isPressed = buttons !== 0;
    if (!this.isPressed && this.shown === "body") this.rig.keepInView();
  };

  constructor(private readonly host: HTMLElement) {
    const isSoftware = isSoftwareRendered();
    this.resolution = new Resolution(isSoftware);
    this.renderer = new WebGLRenderer({ antialias: !isSoftware, stencil: true });
    this.renderer.toneMapping = NoToneMapping;
    this.renderer.setPixelRatio(this.resolution.ratio);
    this.canvas = this.renderer.domElement;
    this.canvas.className = "viewer-canvas";
    this.canvas.tabIndex = 0;
    this.covered = new CoveredPlaces(this.canvas);
    this.canvas.setAttribute("role", "application");
    this.nameCanvas(null);
    this.overlay.className = "viewer-overlay";
    // Handles and labels do not keep the wheel from the camera.
    this.overlay.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.canvas.dispatchEvent(new WheelEvent("wheel", event));
    });
    host.classList.add("viewer");
    host.append(this.canvas, this.overlay);
    this.rig = new CameraRig(this.canvas, () => this.invalidate());
    listenForCameraKeys(this.canvas, this.rig);
    this.body = new BodyLayer(
      () => this.invalidate(),
      () => this.onBodyShape(),
    );
    this.cords = new CordLayer(
      () => this.onCordChange(),
      () => this.invalidate(),
    );
    this.background.frustumCulled = false;
    this.background.renderOrder = ORDER.background;
    this.scene.add(this.background, this.shadow.object, this.body.object, this.cords.object);
    this.labels = new LabelLayer(this);
    this.scale = new ScaleBar(this);
    this.picker = new Picker(this);
    this.cube = new ViewCube(this);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(host);
    host.addEventListener("pointerdown", this.onPointer, true);
    for (const type of ["pointerup", "pointercancel"] as const) {
      window.addEventListener(type, this.onPointer);
    }
    this.stopTheme = onThemeChange(() => this.applyTheme());
    this.applyTheme();
    this.resize();
  }

  /** Give the picture another name for assistive technology, or its usual one. */
  nameCanvas(name: string | null): void {
    this.canvas.ariaLabel = name ?? "Scene; arrow keys turn the view, with Shift they move it";
  }

  /** Render a frame of something that moves. */
  invalidate(): void {
    this.isMoving = true;
    this.refresh();
  }

  /** Render a frame after a single change. */
  refresh(): void {
    this.frame ||= requestAnimationFrame((now) => this.render(now));
  }

  /** Call a function before each frame, in which it may still move things. */
  onNextFrame(action: () => void): () => void {
    this.nextFrameListeners.add(action);
    return () => this.nextFrameListeners.delete(action);
  }

  /** Call a function after each frame; return a function to stop. */
  onFrame(action: () => void): () => void {
    this.frameListeners.add(action);
    return () => this.frameListeners.delete(action);
  }

  /** Call a function with the colors now and when they change; return a function to stop. */
  onTheme(action: (colors: SceneColors) => void): () => void {
    action(this.colors);
    this.themeListeners.add(action);
    return () => this.themeListeners.delete(action);
  }

  /** Return the pixel of a point in the scene. */
  project(point: Vector3): [number, number] {
    const { x, y, z } = this.projected.copy(point).project(this.rig.camera);
    if (z > 1) return [-1e4, -1e4];
    return [((x + 1) / 2) * this.width, ((1 - y) / 2) * this.height];
  }

  /** Return the pixel of a place in the scene, mm. */
  projectAt(x: number, y: number, z: number): [number, number] {
    return this.project(new Vector3(x, y, z));
  }

  /** Return the ray of view through a pixel. */
  rayAt(x: number, y: number): Ray {
    const [u, v] = [(2 * x) / this.width - 1, 1 - (2 * y) / this.height];
    const near = new Vector3(u, v, -1).unproject(this.rig.camera);
    const far = new Vector3(u, v, 1).unproject(this.rig.camera);
    return new Ray(near, far.sub(near).normalize());
  }

  /** Return the pixel of a pointer event. */
  local(event: { clientX: number; clientY: number }): [number, number] {
    const { left, top } = this.canvas.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  /** Hide the shadow, the cube and the scale, as for drawing in a plane. */
  setPlain(isPlain: boolean): void {
    this.shadow.object.visible = !isPlain;
    this.cube.setHidden(isPlain);
    this.scale.setHidden(isPlain);
  }

  /** Show or hide the shadow; it is that of the body as the layer shows it. */
  setShadowVisible(isVisible: boolean): void {
    this.shadow.object.visible = isVisible;
    this.invalidate();
  }

  /** Show the shadow of the body, or hide it where other things take its place. */
  setShadow(isShown: boolean): void {
    this.shadow.object.visible = isShown;
    this.refresh();
  }

  /** Render the scene without the cube, for a function that copies the picture at once. */
  copyPicture(copy: (canvas: HTMLCanvasElement) => void): void {
    this.renderer.render(this.scene, this.rig.camera);
    copy(this.canvas);
    this.cube.render();
  }

  dispose(): void {
    cancelAnimationFrame(this.frame);
    clearTimeout(this.stillTimer);
    this.observer.disconnect();
    this.stopTheme();
    this.host.removeEventListener("pointerdown", this.onPointer, true);
    for (const type of ["pointerup", "pointercancel"] as const) {
      window.removeEventListener(type, this.onPointer);
    }
    for (const part of [this.picker, this.labels, this.scale, this.cube]) part.dispose();
    for (const part of [this.rig, this.body, this.cords, this.shadow]) part.dispose();
    this.background.geometry.dispose();
    this.background.material.dispose();
    this.renderer.dispose();
    this.canvas.remove();
    this.overlay.remove();
  }

  private render(now: number): void {
    for (const action of this.nextFrameListeners) action();
    this.frame = 0;
    if (this.width < 2 || this.height < 2) return;
    this.resolution.record(now);
    this.setMoving(this.isMoving);
    this.draw(now);
    if (this.rig.isChanging || this.cube.isBusy) this.invalidate();
    clearTimeout(this.stillTimer);
    this.stillTimer = window.setTimeout(() => this.onStill(), this.resolution.stillDelay);
  }

  private draw(now: number): void {
    this.rig.update(now);
    if (this.isShadowDue(now)) {
      this.shadowAt = now;
      this.shadow.render(this.renderer, this.scene, this.body.object, this.body.box);
    }
    this.renderer.render(this.scene, this.rig.camera);
    this.cube.render();
    for (const action of this.frameListeners) action();
  }

  private isShadowDue(now: number): boolean {
    const { shadow, body, resolution } = this;
    if (!shadow.isStale || body.isEmpty || !shadow.object.visible) return false;
    const interval = resolution.isSlow ? SLOW_SHADOW_INTERVAL_MS : SHADOW_INTERVAL_MS;
    return !this.isMoving || now - this.shadowAt > interval;
  }

  private onStill(): void {
    // The browser has not drawn the next frame yet: the picture moves, slowly.
    if (this.frame !== 0) return;
    this.isMoving = false;
    if (this.setMoving(false) || this.shadow.isStale) this.draw(performance.now());
  }

  private setMoving(isMoving: boolean): boolean {
    const isChanged = this.resolution.setMoving(isMoving);
    if (isChanged) this.renderer.setPixelRatio(this.resolution.ratio);
    this.body.setCoarse(this.resolution.isCoarse);
    return isChanged;
  }

  private onBodyShape(): void {
    this.shadow.isStale = true;
    this.rig.setBounds(this.body.box);
    if (this.shown !== "body") this.rig.look("home", false);
    else if (!this.isPressed) this.rig.keepInView();
    this.shown = "body";
    this.invalidate();
  }

  private onCordChange(): void {
    const points = this.cords.cords.flatMap(({ path }) => path);
    if (this.shown === "nothing" && points.length > 0) {
      this.rig.setBounds(new Box3().setFromArray(points.flat()));
      this.rig.look("home", false);
      this.shown = "cords";
    }
    this.refresh();
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.host;
    if (clientWidth < 2 || clientHeight < 2) return;
    [this.width, this.height] = [clientWidth, clientHeight];
    this.renderer.setSize(clientWidth, clientHeight);
    this.rig.resize(clientWidth, clientHeight);
    this.cords.setViewport(clientWidth, clientHeight);
    this.cube.resize();
    // The canvas is empty after a change of its size.
    this.draw(performance.now());
  }

  private applyTheme(): void {
    this.colors = sceneColors();
    this.body.setTheme(this.colors);
    this.cords.setTheme(this.colors);
    this.shadow.strength = this.colors.shadow;
    this.cube.setTheme();
    // The gradient is not lit, so that its colors are those of the page.
    for (const name of ["sky", "ground"] as const) {
      const color = this.background.material.uniforms[name]!.value as Color;
      color.setStyle(this.colors[name], LinearSRGBColorSpace);
    }
    for (const action of this.themeListeners) action(this.colors);
    this.invalidate();
  }
}
