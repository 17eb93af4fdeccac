// The camera: perspective or orthographic, its controls, and smooth changes of view.
import {
  type Box3,
  Matrix4,
  MOUSE,
  OrthographicCamera,
  PerspectiveCamera,
  Quaternion,
  Spherical,
  Vector3,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { Frame, Projection, ViewName } from "./types";

const FIELD_OF_VIEW_DEG = 28;
/** Field of view at which a perspective view is replaced by an orthographic one. */
const SMALLEST_FIELD_DEG = 1;
const CHANGE_MS = 320;
const FIT_MARGIN = 1.1;
const TOOLBAR_PX = 52;
const FIT_STEPS = 4;
/** Height of the view that shows a place, times the radius of the object. */
const PLACE_SHARE = 0.6;
const UP = new Vector3(0, 0, 1);
const TO_Y_UP = new Quaternion().setFromUnitVectors(UP, new Vector3(0, 1, 0));
const FROM_Y_UP = TO_Y_UP.clone().invert();
const IS_MOTION_REDUCED = matchMedia("(prefers-reduced-motion: reduce)");

const DIRECTIONS: Record<ViewName, [number, number, number]> = {
  home: [0.5, -0.85, 0.5],
  front: [0, -1, 0],
  back: [0, 1, 0],
  left: [-1, 0, 0],
  right: [1, 0, 0],
  top: [0, 0, 1],
  bottom: [0, 0, -1],
};

/** A view: what is in the middle, from where it is seen, and how much is seen. */
interface View {
  target: Vector3;
  turn: Quaternion;
  up: Vector3;
  /** Visible height at the target, mm. */
  height: number;
  fieldDeg: number;
}

interface Change {
  from: View;
  to: View;
  start: number;
}

export class CameraRig {
  readonly perspective = new PerspectiveCamera(FIELD_OF_VIEW_DEG);
  readonly orthographic = new OrthographicCamera();
  camera: PerspectiveCamera | OrthographicCamera = this.perspective;
  readonly controls: OrbitControls;
  /** Height at the upper edge that is left free, and the same at the lower edge, px. */
  marginHeight = TOOLBAR_PX;
  private width = 1;
  private height = 1;
  private readonly bounds = { center: new Vector3(), radius: 50 };
  private corners: Vector3[] = [];
  private change: Change | null = null;
  private leftView: View | null = null;
  /** Whether the view is one that shows the whole object, and not moved since. */
  private isFitted = false;

  constructor(
    element: HTMLElement,
    private readonly onChange: () => void,
  ) {
    this.perspective.up.copy(UP);
    this.orthographic.up.copy(UP);
    this.perspective.position.fromArray(DIRECTIONS.home).multiplyScalar(200);
    this.controls = new OrbitControls(this.perspective, element);
    this.controls.zoomToCursor = true;
    this.controls.mouseButtons = { LEFT: MOUSE.ROTATE, MIDDLE: MOUSE.PAN, RIGHT: MOUSE.PAN };
    this.controls.addEventListener("change", onChange);
    this.controls.addEventListener("start", () => {
      this.change = null;
      this.isFitted = false;
    });
  }

  get projection(): Projection {
    return this.camera === this.perspective ? "perspective" : "orthographic";
  }

  get isChanging(): boolean {
    return this.change !== null;
  }

  /** Whether a change of view does more than move the camera sideways or zoom. */
  get isTurning(): boolean {
    if (!this.change) return false;
    const { from, to } = this.change;
    return from.fieldDeg !== to.fieldDeg || from.turn.angleTo(to.turn) > 1e-6;
  }

  /** Whether the camera faces a plane and cannot be turned. */
  get isFacing(): boolean {
    return this.leftView !== null;
  }

  resize(width: number, height: number): void {
    const view = this.goal();
    this.width = width;
    this.height = height;
    if (this.isFitted) {
      this.change = null;
      this.show(this.fitted(view.turn, view.up, view.fieldDeg));
    } else this.show(this.view());
  }

  /** Set what Fit shows: a box in the rest frame, mm. */
  setBounds(box: Box3): void {
    box.getCenter(this.bounds.center);
    this.bounds.radius = Math.max(1, box.getSize(new Vector3()).length() / 2);
    this.corners = [0, 1, 2, 3, 4, 5, 6, 7].map(
      (i) =>
        new Vector3(
          i & 1 ? box.max.x : box.min.x,
          i & 2 ? box.max.y : box.min.y,
          i & 4 ? box.max.z : box.min.z,
        ),
    );
  }

  /** Show the whole object, from the present direction. */
  fit(isSmooth = true): void {
    const { turn, up, fieldDeg } = this.goal();
    this.go(this.fitted(turn, up, fieldDeg), isSmooth, true);
  }

  /** Fit the view again if it showed the whole object, which may have changed since. */
  fitAgain(): void {
    if (this.isFitted) this.fit();
  }

  /** Do so if a part of it has left the picture. */
  keepInView(): void {
    const { target, turn, height, fieldDeg } = this.goal();
    const inverse = turn.clone().invert();
    const flatness = fieldDeg < SMALLEST_FIELD_DEG ? 0 : (2 * tangent(fieldDeg)) / height;
    const isOutside = this.corners.some((corner) => {
      const { x, y, z } = corner.clone().sub(target).applyQuaternion(inverse);
      const half = (height / 2) * (1 - z * flatness);
      return Math.abs(y) > half || Math.abs(x) > (half * this.width) / this.height;
    });
    if (isOutside) this.fitAgain();
  }

  /** Show the whole object from a side. */
  look(name: ViewName, isSmooth = true): void {
    const turn = facing(upright(new Vector3(...DIRECTIONS[name])), UP);
    this.go(this.fitted(turn, UP, this.goal().fieldDeg), isSmooth, true);
  }

  /** Turn around the middle of the view, until it is seen from a direction. */
  turnTo(direction: Vector3): void {
    this.go({ ...this.goal(), turn: facing(upright(direction), UP), up: UP.clone() }, true);
  }

  /** Turn the camera around the middle, to the right and upward, degrees. */
  turnBy(right: number, up: number): void {
    if (this.isFacing) return;
    const view = this.goal();
    const from = new Spherical().setFromVector3(
      new Vector3(0, 0, 1).applyQuaternion(view.turn).applyQuaternion(TO_Y_UP),
    );
    from.theta += (right * Math.PI) / 180;
    from.phi = Math.min(Math.PI - 1e-5, Math.max(1e-5, from.phi - (up * Math.PI) / 180));
    const direction = new Vector3().setFromSpherical(from).applyQuaternion(FROM_Y_UP);
    this.go({ ...view, turn: facing(direction, UP) }, true);
  }

  /** Move the view by shares of its height, percent. */
  panBy(right: number, up: number): void {
    const view = this.goal();
    const shift = new Vector3(right, up, 0).multiplyScalar(view.height / 100);
    this.go({ ...view, target: view.target.clone().add(shift.applyQuaternion(view.turn)) }, true);
  }

  /** Multiply the visible height by a factor. */
  zoomBy(factor: number): void {
    const view = this.goal();
    this.go({ ...view, height: view.height * factor }, true);
  }

  setProjection(projection: Projection): void {
    const fieldDeg = projection === "perspective" ? FIELD_OF_VIEW_DEG : 0;
    this.go({ ...this.goal(), fieldDeg }, true);
  }

  /** Move a point to the middle, without turning, and show its surroundings. */
  flyTo(point: Vector3): void {
    const view = this.goal();
    const height = Math.min(view.height, this.bounds.radius * PLACE_SHARE);
    this.go({ ...view, target: point.clone(), height }, true);
  }

  /** Set what Fit shows, and keep the share of the picture that it fills. */
  follow(box: Box3): void {
    const view = this.goal();
    const before = this.fitted(view.turn, view.up, view.fieldDeg);
    this.setBounds(box);
    const after = this.fitted(view.turn, view.up, view.fieldDeg);
    const target = view.target.add(after.target).sub(before.target);
    this.change = null;
    this.show({ ...view, target, height: (view.height * after.height) / before.height });
  }

  /** Face a plane in an orthographic view, its x axis to the right, until `leave`. */
  face({ axes }: Frame): void {
    this.leftView ??= this.goal();
    const [, y, normal] = axes.map((axis) => new Vector3(...(axis as [number, number, number])));
    this.controls.enableRotate = false;
    this.controls.mouseButtons.LEFT = null;
    this.go(this.fitted(facing(normal!, y!), y!, 0), true, true);
  }

  /** Return to the view before `face`. */
  leave(): void {
    if (!this.leftView) return;
    this.go(this.leftView, true);
    this.leftView = null;
    this.controls.enableRotate = true;
    this.controls.mouseButtons.LEFT = MOUSE.ROTATE;
  }

  /** Return the present view. */
  view(): View {
    const { camera } = this;
    const target = this.controls.target.clone();
    const base = { target, turn: camera.quaternion.clone(), up: camera.up.clone() };
    if (camera instanceof OrthographicCamera) {
      return { ...base, height: (camera.top - camera.bottom) / camera.zoom, fieldDeg: 0 };
    }
    const distance = camera.position.distanceTo(target);
    return { ...base, height: 2 * distance * tangent(camera.fov), fieldDeg: camera.fov };
  }

  /** Show a view at once. */
  show({ target, turn, up, height, fieldDeg }: View): void {
    const isPerspective = fieldDeg >= SMALLEST_FIELD_DEG;
    const camera = isPerspective ? this.perspective : this.orthographic;
    const aspect = this.width / this.height;
    if (camera instanceof PerspectiveCamera) {
      camera.fov = fieldDeg;
      camera.aspect = aspect;
    } else {
      camera.top = height / 2;
      camera.bottom = -camera.top;
      camera.right = camera.top * aspect;
      camera.left = -camera.right;
      camera.zoom = 1;
    }
    const distance = isPerspective ? height / 2 / tangent(fieldDeg) : this.bounds.radius * 4;
    camera.up.copy(up);
    camera.quaternion.copy(turn);
    camera.position.set(0, 0, distance).applyQuaternion(turn).add(target);
    this.camera = camera;
    this.controls.object = camera;
    this.controls.target.copy(target);
    this.onChange();
  }

  /** Continue a change of view, and prepare the camera for a frame. */
  update(now: number): void {
    if (this.change) {
      const { from, to, start } = this.change;
      const t = Math.min(1, (now - start) / CHANGE_MS);
      const s = t * t * (3 - 2 * t);
      if (t < 1) this.show(between(from, to, s));
      else {
        this.change = null;
        this.show(to);
        this.controls.update();
      }
    }
    const toCenter = this.camera.position.distanceTo(this.bounds.center);
    const reach = this.bounds.radius * 5;
    const isFlat = this.camera === this.orthographic;
    this.camera.near = isFlat ? toCenter - reach : Math.max(toCenter - reach, toCenter / 200, 0.05);
    this.camera.far = toCenter + reach;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }

  /** Return how many mm a pixel covers at a point. */
  mmPerPixel(point: Vector3): number {
    const { camera } = this;
    if (camera instanceof OrthographicCamera) {
      return (camera.top - camera.bottom) / camera.zoom / this.height;
    }
    const depth = -point.clone().applyMatrix4(camera.matrixWorldInverse).z;
    return (2 * Math.max(depth, camera.near) * tangent(camera.fov)) / this.height;
  }

  dispose(): void {
    this.controls.dispose();
  }

  private goal(): View {
    return this.change?.to ?? this.view();
  }

  private go(to: View, isSmooth: boolean, isFitted = false): void {
    this.isFitted = isFitted;
    const isInstant = !isSmooth || IS_MOTION_REDUCED.matches;
    this.change = { from: this.view(), to, start: isInstant ? -Infinity : performance.now() };
    this.onChange();
  }

  /** Return the view from a direction that shows all corners of the bounds in the middle. */
  private fitted(turn: Quaternion, up: Vector3, fieldDeg: number): View {
    const inverse = turn.clone().invert();
    const isFlat = fieldDeg < SMALLEST_FIELD_DEG;
    const slope = tangent(Math.max(fieldDeg, SMALLEST_FIELD_DEG)) / FIT_MARGIN;
    const aspect = this.width / this.height;
    const crop = this.height / Math.max(this.height - 2 * this.marginHeight, this.height / 2);
    const points = this.corners.map((corner) =>
      corner.clone().sub(this.bounds.center).applyQuaternion(inverse),
    );
    const middle = new Vector3();
    let distance = this.bounds.radius * 4;
    let height = 1;
    for (let step = 0; step < FIT_STEPS; step++) {
      // Nearer points appear farther from the middle.
      const scales = points.map(({ z }) => (isFlat ? 1 : distance / (distance - z)));
      const xs = points.map(({ x }, i) => (x - middle.x) * scales[i]!);
      const ys = points.map(({ y }, i) => (y - middle.y) * scales[i]!);
      middle.x += (Math.min(...xs) + Math.max(...xs)) / 2;
      middle.y += (Math.min(...ys) + Math.max(...ys)) / 2;
      const halves = points.map(({ x, y }) =>
        Math.max(Math.abs(y - middle.y) * crop, Math.abs(x - middle.x) / aspect),
      );
      distance = Math.max(...points.map(({ z }, i) => halves[i]! / slope + z));
      height = isFlat ? 2 * FIT_MARGIN * Math.max(...halves) : 2 * distance * tangent(fieldDeg);
    }
    const target = middle.applyQuaternion(turn).add(this.bounds.center);
    return { target, turn, up: up.clone(), height, fieldDeg };
  }
}

function tangent(fieldDeg: number): number {
  return Math.tan((fieldDeg * Math.PI) / 360);
}

/** Return a direction from which the x axis is to the right also if it is vertical. */
function upright(direction: Vector3): Vector3 {
  const { x, y, z } = direction;
  return Math.hypot(x, y) < 1e-3 * Math.abs(z) ? new Vector3(0, -1e-5, Math.sign(z)) : direction;
}

function facing(from: Vector3, up: Vector3): Quaternion {
  return new Quaternion().setFromRotationMatrix(new Matrix4().lookAt(from, new Vector3(), up));
}

function between(from: View, to: View, share: number): View {
  const fields = [from.fieldDeg, to.fieldDeg].map((x) => Math.max(x, SMALLEST_FIELD_DEG));
  return {
    target: from.target.clone().lerp(to.target, share),
    turn: from.turn.clone().slerp(to.turn, share),
    up: to.up,
    height: from.height * (to.height / from.height) ** share,
    fieldDeg: fields[0]! * (fields[1]! / fields[0]!) ** share,
  };
}
