// A section in the scene: the cut body, its colors, the handle of the plane, and the probe.
import { effect } from "@preact/signals";
import { Box3, type Color, FrontSide, Group, Mesh } from "three";
import { PlaneHandle } from "../../scene/plane-handle";
import { Readout } from "../../scene/readout";
import { tubeMaterial } from "../../scene/shading";
import { Tube } from "../../scene/tube";
import type { Frame } from "../../scene/types";
import { areCordsShown, isBodyShown } from "../../scene/stage";
import type { Viewer } from "../../scene/viewer";
import { device } from "../../state/connection";
import { isHidden } from "../../state/selection";
import { formatValue } from "./color-scale";
import { CutBody } from "./cut-body";
import { CutCords } from "./cut-cords";
import { planeUniforms } from "./materials";
import type { NextCordTool } from "./next-cord";
import { carry, carryLine, normalOf, offsetOf, shownPlane } from "./plane";
import { SectionMesh } from "./section-mesh";
import { inside, type ProbedPoint, type SectionData, type SectionView } from "./section-view";

const CLICK_PX = 4;
/** How far the plane may leave its last section before that is hidden, times the body's size. */
const REACH = 0.02;
const DIRECTION_LENGTH = 0.15;
const DIRECTION_RADIUS = 0.003;
const CORD_RADIUS = 0.6;
const CANDIDATE_COLOR = "#e66101";

export interface SectionLayerOptions {
  /**
   * Whether the cut body, its cords, the handle of the plane and the value at the pointer are
   * shown, too; otherwise the section is drawn behind the cords of the scene.
   */
  hasBody: boolean;
}

export class SectionLayer {
  private readonly group = new Group();
  private readonly uniforms = planeUniforms();
  private readonly mesh = new SectionMesh(this.uniforms);
  private readonly body = new CutBody(this.uniforms);
  private readonly cords = new CutCords();
  /** The body in all states that were shown, mm. */
  private readonly bounds = new Box3();
  private readonly direction = line("#14181f");
  private readonly candidate = line(CANDIDATE_COLOR);
  private readonly readout: Readout;
  private readonly handle: PlaneHandle | null;
  private readonly stops: (() => void)[];
  private readonly stop = new AbortController();
  private press: [number, number] | null = null;
  /** The plane in the shown state, where the body may have moved. */
  private shown: Frame | null = null;
  /** The plane at rest and the shown one when a drag began. */
  private drag: { plane: Frame; shown: Frame } | null = null;

  constructor(
    private readonly viewer: Viewer,
    private readonly view: SectionView,
    private readonly tool: NextCordTool | null,
    private readonly options: SectionLayerOptions,
  ) {
    this.group.add(this.mesh.object, this.direction.object, this.candidate.object);
    viewer.scene.add(this.group);
    this.readout = new Readout(viewer);
    this.handle = options.hasBody ? this.addBody() : null;
    if (!options.hasBody) this.mesh.drawBehindCords();
    this.stops = [...this.follow(), viewer.onTheme((colors) => this.body.setTheme(colors))];
    this.listen();
  }

  /** Look at the section along its normal, or return to the view before. */
  face(isFacing: boolean): void {
    const { rig } = this.viewer;
    if (isFacing && this.shown) rig.face(this.shown);
    else rig.leave();
  }

  dispose(): void {
    this.stop.abort();
    for (const stop of this.stops) stop();
    this.readout.dispose();
    this.handle?.dispose();
    this.viewer.scene.remove(this.group);
    this.viewer.labels.set("inside", []);
    if (this.options.hasBody) {
      isBodyShown.value = areCordsShown.value = true;
      this.viewer.picker.isEnabled = true;
      this.viewer.setShadowVisible(true);
      if (!this.viewer.body.isEmpty) this.viewer.rig.setBounds(this.viewer.body.box);
      this.viewer.rig.leave();
    }
    for (const part of [this.mesh, this.body, this.cords, this.direction, this.candidate]) {
      part.dispose();
    }
    this.viewer.invalidate();
  }

  private addBody(): PlaneHandle {
    const { viewer } = this;
    this.group.add(this.body.object, this.cords.object);
    return new PlaneHandle(viewer, {
      onDrag: (frame, text, pixel) => this.dragPlane(frame, text, pixel),
      onDrop: () => this.drop(),
      onCancel: () => {
        if (this.drag) this.view.plane.value = this.drag.plane;
        this.drop();
      },
    });
  }

  private follow(): (() => void)[] {
    const { view, tool } = this;
    return [
      effect(() => {
        if (view.shape.value && this.options.hasBody) {
          this.hideBody();
          this.keepInView(view.shape.value.vertices);
        }
        if (!view.shape.value) this.bounds.makeEmpty(); // another body follows
        this.body.setShape(view.shape.value);
        this.viewer.invalidate();
      }),
      effect(() => {
        const shown = (view.shape.value?.cords ?? []).filter(
          ({ name }) => !isHidden({ kind: "cord", name }),
        );
        this.cords.set(shown, CORD_RADIUS * (device.value?.cordRadius ?? 1));
        this.viewer.invalidate();
      }),
      effect(() => this.setPlane(view.plane.value)),
      effect(() => this.setSection(view.section.value)),
      effect(() => {
        const { unknownColor = [150, 150, 150], size = 1 } = inside.value ?? {};
        this.mesh.setLook(unknownColor, this.options.hasBody ? REACH * size : Infinity);
        if (view.scale.value) this.mesh.setScale(view.scale.value);
        this.viewer.invalidate();
      }),
      effect(() => this.showDirection(view.section.value, view.angle.value)),
      effect(() => this.showCandidate(tool?.candidate.value ?? null, view.section.value)),
      effect(() => this.showPicked()),
    ];
  }

  private hideBody(): void {
    const { viewer } = this;
    isBodyShown.value = areCordsShown.value = false;
    viewer.picker.isEnabled = false;
    viewer.setShadowVisible(false);
  }

  private keepInView(vertices: Float32Array): void {
    const { rig } = this.viewer;
    rig.setBounds(this.bounds.union(new Box3().setFromArray(vertices)));
    rig.keepInView();
  }

  private setPlane(plane: Frame | null): void {
    this.group.visible = plane !== null;
    if (!plane) {
      this.handle?.show(null, []);
      return;
    }
    this.uniforms.planeOrigin.value.fromArray(plane.origin);
    this.uniforms.planeNormal.value.copy(normalOf(plane));
    this.body.setPlane(plane);
    this.cords.setPlane(plane);
    this.viewer.invalidate();
  }

  private setSection(data: SectionData | null): void {
    this.mesh.set(data);
    if (data) {
      this.shown = shownPlane(data.plane, data.rest, data.vertices);
      if (!this.drag) this.handle?.show(this.shown, [middleOf(data.vertices)]);
    }
    this.viewer.invalidate();
  }

  private dragPlane(frame: Frame, text: string, [x, y]: [number, number]): void {
    const { view } = this;
    const plane = view.plane.peek();
    if (!plane || !this.shown) return;
    if (!this.drag) view.setDragged(true);
    this.drag ??= { plane, shown: this.shown };
    const moved = carry(this.drag.plane, this.drag.shown, frame);
    view.plane.value = moved;
    const offset = offsetOf(moved, inside.peek()?.middle ?? [0, 0, 0]);
    const isTurn = text.endsWith("\u00b0");
    const turn = isTurn ? `Turned ${text.replace("-", "\u2212")}\n` : "";
    this.readout.show(x, y, `${turn}Offset ${offset.toFixed(1).replace("-", "\u2212")} mm`);
  }

  private drop(): void {
    this.drag = null;
    this.readout.hide();
    this.view.setDragged(false);
    const data = this.view.section.peek();
    if (data) this.setSection(data);
  }

  private showDirection(data: SectionData | null, angle: number): void {
    const info = this.view.info.value;
    const isShown = data && this.shown && info?.needsDirection && !this.view.cord.value;
    if (!isShown) {
      this.direction.set(null, 1);
      return;
    }
    const size = inside.peek()?.size ?? 1;
    const half = DIRECTION_LENGTH * size;
    const radians = (angle * Math.PI) / 180;
    const [c, s] = [half * Math.cos(radians), half * Math.sin(radians)];
    const { axes } = this.shown!;
    const middle = middleOf(data.vertices);
    const end = (sign: number) =>
      middle.map((v, k) => v + sign * (c * axes[0]![k]! + s * axes[1]![k]!));
    this.direction.set([end(-1), end(1)], DIRECTION_RADIUS * size);
    this.viewer.invalidate();
  }

  private showCandidate(ends: number[][] | null, data: SectionData | null): void {
    const path = ends && data && carryLine(ends, data.rest, data.vertices);
    this.candidate.set(path, device.peek()?.cordRadius ?? 1);
    this.viewer.invalidate();
  }

  private showPicked(): void {
    const picked = this.view.picked.value;
    const value = picked && this.view.hover.peek()?.value;
    const text = picked ? this.text(value ?? NaN, picked.rest) : "";
    const label = { id: "inside-point", text, at: picked?.position ?? [], priority: 5 };
    this.viewer.labels.set("inside", picked ? [{ ...label, tone: "accent" }] : []);
  }

  /** A value as text with its unit. */
  private text(value: number, rest: readonly number[]): string {
    const { range, info } = this.view;
    if (info.peek()?.name === "next-cord") {
      return this.tool?.textAt(rest) ?? "";
    }
    if (Number.isNaN(value) || !range.peek()) return "";
    return `${formatValue(value, range.peek()!, true)} ${info.peek()?.unit ?? ""}`;
  }

  private listen(): void {
    const { canvas } = this.viewer;
    const { signal } = this.stop;
    const hover = (point: ProbedPoint | null, event: PointerEvent) => {
      this.view.hover.value = point;
      if (!this.options.hasBody) return;
      const text = point ? this.text(point.value, point.rest) : "";
      const [x, y] = this.viewer.local(event);
      if (text && !this.drag) this.readout.show(x, y, text);
      else if (!this.drag) this.readout.hide();
    };
    canvas.addEventListener("pointermove", (e) => hover(this.probe(e), e), { signal });
    canvas.addEventListener("pointerleave", (e) => hover(null, e), { signal });
    canvas.addEventListener("pointerdown", (e) => (this.press = this.viewer.local(e)), { signal });
    canvas.addEventListener("pointerup", (event) => this.pick(event), { signal });
  }

  private pick(event: PointerEvent): void {
    const [x, y] = this.viewer.local(event);
    const { press } = this;
    this.press = null;
    if (!press || event.button !== 0 || Math.hypot(x - press[0], y - press[1]) > CLICK_PX) return;
    const point = this.probe({ ...pointer(event), buttons: 0 });
    this.view.hover.value = point;
    if (point) void this.view.pick(point.rest);
    else this.view.picked.value = null;
  }

  /** Return the point of the section under the pointer, unless it is seen from behind. */
  private probe(event: Pick<PointerEvent, "clientX" | "clientY" | "buttons">): ProbedPoint | null {
    if (event.buttons !== 0 || !this.shown) return null;
    const ray = this.viewer.rayAt(...this.viewer.local(event));
    const isBehind = this.options.hasBody && ray.direction.dot(normalOf(this.shown)) > 0;
    return isBehind ? null : this.mesh.probe(ray);
  }
}

function pointer({ clientX, clientY }: PointerEvent): { clientX: number; clientY: number } {
  return { clientX, clientY };
}

function middleOf(points: Float32Array): number[] {
  const sum = [0, 0, 0];
  for (let i = 0; i < points.length; i++) sum[i % 3]! += points[i]!;
  return sum.map((s) => (3 * s) / points.length);
}

/** A straight tube that is seen through the body. */
function line(color: string) {
  const tube = new Tube();
  const material = tubeMaterial("outline");
  (material.uniforms["base"]!.value as Color).set(color);
  material.side = FrontSide;
  material.stencilWrite = false;
  const object = new Mesh(tube.geometry, material);
  object.renderOrder = 8;
  object.frustumCulled = false;
  object.visible = false;
  return {
    object,
    set(path: number[][] | null, radius: number): void {
      object.visible = path !== null;
      if (path) tube.set(path, radius, []);
    },
    dispose(): void {
      tube.geometry.dispose();
      material.dispose();
    },
  };
}
