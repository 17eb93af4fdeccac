// What one section shows, and what the server has answered: its values, and the body's shape.
import { batch, computed, effect, signal } from "@preact/signals";
import { type ArrayMessage, Refusal } from "../../protocol/connection";
import type { ColorMap, InsideState, PointNumbers, QuantityInfo, ShowSection } from "../../protocol/messages";
import type { Frame } from "../../scene/types";
import { connection } from "../../state/connection";
import { showProblem } from "../../state/toasts";
import { LatestRequest } from "../sensors/latest-request";
import { type ColorRange, ColorScale, joinRanges } from "./color-scale";
import { type BodyShape, shapeOf } from "./shapes";

export type QuantityName = ShowSection["quantity"];

/** Time without a change after which the fine section is requested, ms. */
const REST_MS = 150;
/** The same while the plane is dragged, when a coarse section is to follow soon. */
const DRAG_REST_MS = 600;

/** A section with its values. */
export interface SectionData {
  plane: Frame;
  quantity: QuantityName;
  /** Vertices (v, 3) in the shown state and at rest, mm. */
  vertices: Float32Array;
  rest: Float32Array;
  triangles: Uint32Array;
  /** Values (v,), NaN where unknown. */
  values: Float32Array;
  smallest: number | null;
  largest: number | null;
}

/** A point of the section under the pointer. */
export interface ProbedPoint {
  value: number;
  rest: number[];
  shown: number[];
}

type Content = Omit<ShowSection, "kind" | "id">;

export const inside = connection.event("inside-state");

export class SectionView {
  /** The plane in the body at rest; null before a simulation. */
  readonly plane = signal<Frame | null>(null);
  readonly state = signal(0);
  readonly quantity = signal<QuantityName>("largest");
  /** Direction in the plane, degrees from its x axis. */
  readonly angle = signal(0);
  /** Name of a cord whose direction replaces the angle; empty for none. */
  readonly cord = signal("");
  readonly isRangeFixed = signal(false);
  readonly section = signal<SectionData | null>(null);
  readonly shape = signal<BodyShape | null>(null);
  readonly range = signal<ColorRange | null>(null);
  /** Offsets from the body's middle at which the plane meets the body, mm. */
  readonly limits = signal<[number, number]>([-1, 1]);
  /** Why there is no section, such as a plane that misses the body; empty if there is one. */
  readonly problem = signal("");
  readonly hover = signal<ProbedPoint | null>(null);
  readonly picked = signal<PointNumbers | null>(null);

  readonly info = computed<QuantityInfo | null>(
    () => inside.value?.quantities.find(({ name }) => name === this.quantity.value) ?? null,
  );
  readonly scale = computed<ColorScale | null>(() => {
    const map = this.colorMap();
    return map && this.range.value ? new ColorScale(map, this.range.value) : null;
  });

  private readonly requests = new LatestRequest<ArrayMessage>();
  private readonly stops: (() => void)[] = [];
  private restTimer = 0;
  private revision = -1;
  private isDragged = false;
  /** The last plane that met the body. */
  private met: Frame | null = null;

  /**
   * @param start - Sets what is shown first after a simulation.
   * @param isMain - Whether the body is shown in the state, too, and a plane that was put outside
   * the body returns to where it last met it, since its handle is at the section.
   */
  constructor(
    private readonly start: (state: InsideState, view: SectionView) => void,
    private readonly isMain: boolean,
  ) {}

  /** Start to request what is shown; return a function to stop. */
  open(): () => void {
    this.stops.push(
      effect(() => this.follow(inside.value)),
      effect(() => this.request(this.content())),
    );
    if (this.isMain) this.stops.push(effect(() => this.requestShape()));
    return () => {
      for (const stop of this.stops.splice(0)) stop();
      clearTimeout(this.restTimer);
      this.requests.drop();
      this.hover.value = null;
    };
  }

  /** Set whether the plane is dragged; the fine section follows when it is dropped. */
  setDragged(isDragged: boolean): void {
    this.isDragged = isDragged;
    if (isDragged) return;
    if (this.section.peek()) this.refresh();
    else if (this.met) this.plane.value = this.met;
  }

  /** Request the same section again, as after the search has found a map. */
  refresh(): void {
    clearTimeout(this.restTimer);
    const content = this.content();
    if (content) this.load(content);
  }

  /** Get all numbers of a point (3,) at rest. */
  async pick(at: readonly number[]): Promise<void> {
    const content = this.content();
    if (!content) return;
    const { detail: _, isRangeFixed: __, ...common } = content;
    try {
      this.picked.value = await connection.send("probe-point", { ...common, at: [...at] });
    } catch (error) {
      this.fail(error);
    }
  }

  private colorMap(): ColorMap | null {
    const { info } = this;
    return inside.value?.colorMaps.find(({ name }) => name === info.value?.colorMap) ?? null;
  }

  private follow(state: InsideState | null): void {
    if (!state || state.revision === this.revision) {
      if (state && !state.isReady) this.clear();
      return;
    }
    this.revision = state.revision;
    batch(() => {
      this.clear();
      if (state.isReady) this.start(state, this);
    });
  }

  private clear(): void {
    batch(() => {
      this.section.value = this.shape.value = this.picked.value = this.met = null;
      if (!inside.peek()?.isReady) {
        this.plane.value = null;
        this.revision = -1;
      }
    });
  }

  private content(): Content | null {
    const plane = this.plane.value;
    if (!plane || !inside.value?.isReady) return null;
    return {
      origin: plane.origin,
      axes: plane.axes,
      state: this.state.value,
      quantity: this.quantity.value,
      angle: this.angle.value,
      cord: this.cord.value,
      detail: "fine",
      isRangeFixed: this.isRangeFixed.value,
    };
  }

  /** Request a coarse section at once, and the fine one when nothing changes any more. */
  private request(content: Content | null): void {
    clearTimeout(this.restTimer);
    if (!content) return;
    this.picked.value = null;
    this.load({ ...content, detail: "coarse" });
    this.restTimer = window.setTimeout(() => this.load(content), this.isDragged ? DRAG_REST_MS : REST_MS);
  }

  private load(content: Content): void {
    this.requests.ask(
      () => connection.fetch("show-section", content),
      (answer) => this.show(answer, content),
      (error) => this.fail(error),
    );
  }

  private requestShape(): void {
    const state = this.state.value;
    const revision = inside.value?.revision ?? 0;
    if (!inside.value?.isReady) return;
    shapeOf(state, revision).then(
      (shape) => {
        if (this.state.peek() === state) this.shape.value = shape;
      },
      (error: unknown) => this.fail(error),
    );
  }

  private show({ arrays, facts }: ArrayMessage, content: Content): void {
    const range: ColorRange = { low: facts["low"], high: facts["high"], step: facts["step"] };
    const last = this.section.peek();
    const isCoarse = content.detail === "coarse";
    // While the plane moves, colors keep their meaning: the range only grows.
    const isSame = last?.quantity === content.quantity && this.range.peek() !== null;
    batch(() => {
      this.problem.value = "";
      this.met = { origin: content.origin, axes: content.axes };
      this.range.value = isCoarse && isSame ? joinRanges(this.range.peek()!, range) : range;
      this.limits.value = [facts["lowest"], facts["highest"]];
      this.section.value = {
        plane: this.met,
        quantity: content.quantity,
        vertices: arrays["vertices"] as Float32Array,
        rest: arrays["rest"] as Float32Array,
        triangles: arrays["triangles"] as Uint32Array,
        values: arrays["values"] as Float32Array,
        smallest: facts["smallest"],
        largest: facts["largest"],
      };
    });
  }

  private fail(error: unknown): void {
    if (!(error instanceof Refusal)) {
      this.problem.value = error instanceof Error ? error.message : String(error);
    } else if (error.problem.code === "not-in-device") {
      this.cord.value = ""; // the cord was deleted
    } else if (error.problem.code === "plane-misses-body") {
      if (this.isMain && this.met && !this.isDragged) {
        this.plane.value = this.met;
        showProblem(error.problem);
        return;
      }
      batch(() => {
        this.section.value = null;
        this.problem.value = "The plane misses the body";
      });
    } else if (error.problem.code !== "not-simulated") {
      showProblem(error.problem);
    }
  }
}
