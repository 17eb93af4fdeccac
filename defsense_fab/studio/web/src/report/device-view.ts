// The view: everything that is visible, its state (how far open, which pose, visible kinds), and
// how it is drawn.
import {
  Box3,
  type Color,
  Group,
  LinearSRGBColorSpace,
  Matrix4,
  Mesh,
  NoToneMapping,
  PlaneGeometry,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { CameraRig } from "../scene/camera-rig";
import { ContactShadow } from "../scene/contact-shadow";
import { ORDER } from "../scene/order";
import { backgroundMaterial } from "../scene/shading";
import { onThemeChange, sceneColors } from "../scene/theme";
import type { ViewName } from "../scene/types";
import type { Quantity } from "./color-maps";
import type { Content, Contents, FollowerKind } from "./content";
import { Follower } from "./followers";
import { weightsAt } from "./interpolation";
import { Part, PosedSurface, type Prediction } from "./surfaces";

/** Height of the hint at the lower edge. */
const HINT_PX = 24;
const LARGEST_PIXEL_RATIO = 2;
/** Time between changes of the shadow while something moves, ms. */
const SHADOW_INTERVAL_MS = 120;
/** Gap between the simulated and the predicted surface, as a share of the device's size. */
const GAP = 0.05;

export type Item = Part | Follower | PosedSurface;
export type VisibleKind = "body" | FollowerKind;

export interface ViewState {
  /** How far the joints are open, one after the other, from 0 to 1. */
  open: number;
  /** Index of the pose, or null for the parts at rest. */
  pose: number | null;
  /** Share of the pose. */
  amount: number;
  colors: Quantity | "none";
  predicted: Prediction;
  isTransparent: boolean;
}

export class DeviceView {
  readonly content: Content;
  readonly rig: CameraRig;
  readonly renderer: WebGLRenderer;
  readonly parts: Part[];
  readonly followers: Follower[];
  readonly surface: PosedSurface;
  readonly state: ViewState;
  readonly hiddenKinds = new Set<VisibleKind>();
  /** Number of frames drawn. */
  frames = 0;
  private readonly scene = new Scene();
  private readonly surfaces = new Group();
  private readonly turn = new Matrix4();
  private readonly shadow = new ContactShadow();
  private readonly background = new Mesh(new PlaneGeometry(2, 2), backgroundMaterial());
  private shownBox = new Box3();
  private marked: Item | null = null;
  private frame = 0;
  private shadowTime = 0;

  constructor(
    readonly canvas: HTMLCanvasElement,
    contents: Contents,
  ) {
    this.content = contents.content;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, stencil: true });
    this.renderer.toneMapping = NoToneMapping;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, LARGEST_PIXEL_RATIO));
    this.rig = new CameraRig(canvas, () => this.draw());
    this.rig.marginHeight = HINT_PX;
    this.rig.controls.minDistance = 0.05 * this.content.size;
    this.rig.controls.maxDistance = 50 * this.content.size;
    this.parts = this.content.parts.map((part, k) => new Part(part, k, contents));
    this.followers = this.content.followers.map((record) => new Follower(record, contents));
    this.surface = new PosedSurface(contents);
    this.state = {
      open: 0,
      pose: null,
      amount: 1,
      colors: "error",
      predicted: "hidden",
      // Printed traces are inside a body that no joint opens.
      isTransparent: this.content.noun === "trace",
    };
    this.build();
    onThemeChange(() => this.style());
    this.style();
    this.apply();
    this.resize();
    this.rig.setBounds(this.shownBox);
    this.rig.look("home", false);
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  /** Change the state and show it. */
  set(changes: Partial<ViewState>): void {
    Object.assign(this.state, changes);
    const before = this.shownBox;
    this.apply();
    if (!before.equals(this.shownBox)) this.rig.follow(this.shownBox);
    this.draw();
  }

  /** Show a kind of item, or hide it. */
  setKindVisible(kind: VisibleKind, isVisible: boolean): void {
    if (isVisible) this.hiddenKinds.delete(kind);
    else this.hiddenKinds.add(kind);
    this.set({});
  }

  /** Show everything from a side. */
  look(name: ViewName): void {
    this.rig.look(name);
    // A press before the next frame must not cancel a change without motion.
    this.rig.update(performance.now());
  }

  /** Highlight an item, or none. */
  mark(item: Item | null): void {
    this.marked = item;
    this.style();
  }

  /** Return how far each joint is open: the joint that is closed last opens first. */
  shares(): number[] {
    const n = this.content.joints.length;
    return this.content.joints.map((_, k) =>
      Math.min(Math.max(n * this.state.open - (n - 1 - k), 0), 1),
    );
  }

  /** Return the resistance of each cord in the pose shown, ohm. */
  resistances(): number[] {
    const weights = this.state.pose === null ? [] : this.weights();
    return this.content.resistances.map((rest, cord) => {
      const change = weights.reduce(
        (sum, weight, k) => sum + weight * this.content.states[k]!.signals[cord]!,
        0,
      );
      return rest * (1 + change);
    });
  }

  /** Return the item at a place of the window, or null. */
  itemAt(x: number, y: number): Item | null {
    const edge = this.canvas.getBoundingClientRect();
    const [u, v] = [(2 * (x - edge.left)) / edge.width - 1, 1 - (2 * (y - edge.top)) / edge.height];
    this.rig.update(performance.now()); // the last change may not have been drawn yet
    const inverse = this.turn.clone().invert();
    const near = new Vector3(u, v, -1).unproject(this.rig.camera).applyMatrix4(inverse);
    const far = new Vector3(u, v, 1).unproject(this.rig.camera).applyMatrix4(inverse);
    const direction = far.sub(near).normalize();
    const hits = [...this.followers, ...this.parts, this.surface]
      .map((item) => ({ item, distance: item.intersect(near, direction) }))
      .filter(({ distance }) => distance < Infinity)
      .sort((a, b) => a.distance - b.distance);
    const first = hits[0]?.item ?? null;
    const isCovering = first?.kind === "part" || first?.kind === "surface";
    // Cords shine through the body.
    const cord = hits.find(({ item }) => item.kind === "cord")?.item;
    return (isCovering && cord) || first;
  }

  /** Draw with the next frame. */
  draw(): void {
    this.frame ||= requestAnimationFrame((now) => {
      this.frame = 0;
      this.rig.update(now);
      // The first picture does not wait for the shadow.
      if (this.frames > 0) this.updateShadow(now);
      this.renderer.render(this.scene, this.rig.camera);
      this.frames += 1;
      if (this.rig.isChanging || this.shadow.isStale) this.draw();
    });
  }

  private updateShadow(now: number): void {
    if (!this.shadow.isStale || now - this.shadowTime < SHADOW_INTERVAL_MS) return;
    this.shadowTime = now;
    this.shadow.object.visible = true;
    this.shadow.render(this.renderer, this.scene, this.surfaces, this.shownBox);
  }

  private build(): void {
    const [right, up, front] = this.content.frame.map((axis) => new Vector3(...axis).normalize());
    this.turn.makeBasis(right!, front!.negate(), up!).transpose();
    const tubes = new Group();
    for (const group of [this.surfaces, tubes]) group.quaternion.setFromRotationMatrix(this.turn);
    this.surfaces.add(...this.parts.map(({ object }) => object), this.surface.object);
    tubes.add(...this.followers.map(({ object }) => object));
    this.background.frustumCulled = false;
    this.background.renderOrder = ORDER.background;
    this.shadow.object.visible = false;
    this.scene.add(this.background, this.shadow.object, this.surfaces, tubes);
  }

  /** Show the state. */
  private apply(): void {
    const { pose, colors, predicted, isTransparent } = this.state;
    const isPosed = pose !== null;
    if (isPosed) {
      const weights = this.weights();
      this.surface.pose(weights, colors, predicted);
      for (const follower of this.followers) follower.pose(weights);
    } else {
      const shares = this.shares();
      for (const item of [...this.parts, ...this.followers]) item.open(shares);
    }
    const isBodyVisible = !this.hiddenKinds.has("body");
    for (const part of this.parts) part.show(!isPosed && isBodyVisible, isTransparent);
    const prediction = isPosed ? predicted : "hidden";
    this.surface.setOffset(prediction === "next" ? this.nextOffset() : new Vector3());
    this.surface.show(isPosed && isBodyVisible, prediction, isTransparent);
    for (const { object, kind } of this.followers) object.visible = !this.hiddenKinds.has(kind);
    this.shownBox = this.box();
    this.shadow.isStale = true;
  }

  /** Return the weights of all states, of the pose and amount shown. */
  private weights(amount = this.state.amount): number[] {
    const pose = this.content.poses[this.state.pose!]!;
    const weights = new Array<number>(this.content.states.length).fill(0);
    const [, ...shown] = weightsAt([0, ...pose.at], amount);
    shown.forEach((weight, k) => (weights[pose.states[k]!] = weight));
    return weights;
  }

  /** Return the box that the camera must show; for a pose, it holds the whole movement. */
  private box(): Box3 {
    const box = new Box3();
    if (this.state.pose === null) for (const part of this.parts) box.union(part.box);
    else {
      box.copy(this.surface.reach(this.weights(1)));
      if (this.state.predicted === "next") box.union(box.clone().translate(this.surface.offset));
    }
    return box.applyMatrix4(this.turn);
  }

  /** Return the offset of the predicted surface: below a wide body, to the right of a tall one. */
  private nextOffset(): Vector3 {
    const reach = this.surface.reach(this.weights(1)).applyMatrix4(this.turn);
    const { x: width, z: height } = reach.getSize(new Vector3());
    const gap = GAP * this.content.size;
    const offset = new Vector3();
    if (width <= height) offset.x = 1.05 * width + gap;
    else offset.z = -1.05 * height - gap;
    return offset.applyMatrix4(this.turn.clone().invert());
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement!;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.rig.resize(width, height);
    for (const follower of this.followers) follower.setViewport(width, height);
  }

  private style(): void {
    const colors = sceneColors();
    for (const item of [...this.parts, ...this.followers]) item.style(colors, item === this.marked);
    this.surface.style(colors);
    this.shadow.strength = colors.shadow;
    // The gradient is not lit, so that its colors are those of the page.
    for (const name of ["sky", "ground"] as const) {
      const color = this.background.material.uniforms[name]!.value as Color;
      color.setStyle(colors[name], LinearSRGBColorSpace);
    }
    this.draw();
  }
}
