// The controls next to the view. Names from the device are set as text, not HTML.
import type { ViewName } from "../scene/types";
import { cssGradient } from "./color-maps";
import {
  describeItem,
  describeJoint,
  describePose,
  kindName,
  QUANTITY_LABELS,
} from "./descriptions";
import type { DeviceView, Item, ViewState } from "./device-view";
import { KIND_COLORS } from "./followers";
import { Playback } from "./playback";

const FOLLOWER_KINDS = ["cord", "wire", "pin", "seat"] as const;
/** A press that moves less is a click, not a drag of the camera. */
const CLICK_PX = 6;

export class Panel {
  private readonly playback: Playback;
  private readonly itemButtons = new Map<Item, HTMLButtonElement>();
  private selected: Item | null = null;

  constructor(
    private readonly section: HTMLElement,
    private readonly view: DeviceView,
  ) {
    this.playback = new Playback(
      () => view.state.amount,
      (amount) => this.set({ amount }),
      (isPlaying) => this.showPlaying(isPlaying),
    );
    this.listPoses();
    this.listKinds();
    this.listItems();
    this.listen();
    this.listenForClicks();
    this.update();
  }

  /** Stop the playback, and change the state of the view. */
  change(changes: Partial<ViewState>): void {
    this.playback.stop();
    this.set(changes);
  }

  look(name: ViewName): void {
    if (name === "home") this.change({ open: 0, pose: null, amount: 1 });
    this.view.look(name);
  }

  /** Open all joints, or close them. */
  toggleJoints(): void {
    this.change({ open: this.view.state.open < 0.5 ? 1 : 0, pose: null });
  }

  /** Play the pose, or pause it; without a pose, choose the first one. */
  togglePlayback(): void {
    if (!this.view.content.poses.length) return;
    if (this.view.state.pose === null) this.set({ open: 0, pose: 0 });
    this.playback.toggle();
  }

  /** Highlight and describe an item, or none. */
  select(item: Item | null): void {
    this.selected = item;
    this.view.mark(item);
    for (const [other, button] of this.itemButtons) {
      button.setAttribute("aria-pressed", String(other === item));
    }
    this.showSelected();
  }

  private set(changes: Partial<ViewState>): void {
    this.view.set(changes);
    this.update();
  }

  private update(): void {
    const { state } = this.view;
    const joint = describeJoint(this.view);
    this.input("open").value = String(state.open);
    this.input("open").setAttribute("aria-valuetext", joint);
    this.element("joint").textContent = joint;
    this.input("pose").value = String(state.pose ?? "");
    this.element("posed").hidden = state.pose === null;
    this.input("amount").value = String(state.amount);
    this.input("colors").value = state.colors;
    this.input("predicted").value = state.predicted;
    if (state.pose !== null) this.showPose(state.pose);
    if (this.selected) this.showSelected();
  }

  private showPose(index: number): void {
    const { colors } = this.view.state;
    this.element("scale").hidden = colors === "none";
    if (colors !== "none") {
      const top = this.view.surface.scaleTops[colors] * (colors === "strain" ? 100 : 1);
      this.element("gradient").style.background = cssGradient(colors);
      this.element("quantity").textContent = QUANTITY_LABELS[colors];
      this.element("top").textContent = String(Number(top.toPrecision(3)));
    }
    this.element("state").textContent = describePose(this.view, index);
  }

  private showSelected(): void {
    const box = this.element("selected");
    box.replaceChildren();
    if (!this.selected) return;
    const { title, facts } = describeItem(this.view, this.selected);
    const list = element("dl", ...facts.flatMap(([k, v]) => [element("dt", k), element("dd", v)]));
    box.append(element("strong", title), list);
  }

  private showPlaying(isPlaying: boolean): void {
    this.element("play").textContent = isPlaying ? "Pause" : "Play";
    this.element("play").setAttribute("aria-pressed", String(isPlaying));
    // Values that change with every frame are not read out.
    this.element("selected").setAttribute("aria-live", isPlaying ? "off" : "polite");
  }

  private listPoses(): void {
    const list = this.element("pose");
    list.append(new Option("At rest, as parts", ""));
    this.view.content.poses.forEach(({ name, held_out }, k) => {
      const note = held_out ? " (largest error, not designed for)" : "";
      list.append(new Option(name + note, String(k)));
    });
  }

  private listKinds(): void {
    const { view } = this;
    this.addBox("body", null, true, (isOn) => view.setKindVisible("body", isOn));
    for (const kind of FOLLOWER_KINDS) {
      if (!view.followers.some((follower) => follower.kind === kind)) continue;
      const label = `${kindName(kind, view.content.noun)}s`;
      this.addBox(label, KIND_COLORS[kind], true, (isOn) => view.setKindVisible(kind, isOn));
    }
    const { isTransparent } = view.state;
    this.addBox("transparent", null, isTransparent, (isOn) => this.set({ isTransparent: isOn }));
  }

  private addBox(
    label: string,
    color: string | null,
    isOn: boolean,
    onChange: (isOn: boolean) => void,
  ): void {
    const box = element("input");
    box.type = "checkbox";
    box.checked = isOn;
    box.addEventListener("change", () => onChange(box.checked));
    const swatches = color ? [swatch(color)] : [];
    this.element("kinds").append(element("label", box, ...swatches, label));
  }

  private listItems(): void {
    const { parts, followers } = this.view;
    for (const item of [...parts, ...followers.filter(({ kind }) => kind === "cord")]) {
      const dot = swatch(item.record.color ?? "", item.kind === "cord");
      const button = element("button", dot, item.record.name);
      button.type = "button";
      button.setAttribute("aria-pressed", "false");
      button.addEventListener("click", () => this.select(this.selected === item ? null : item));
      this.itemButtons.set(item, button);
      this.element("items").append(button);
    }
  }

  private listen(): void {
    const on = (name: string, type: string, action: (value: string) => void) =>
      this.element(name).addEventListener(type, () => action(this.input(name).value));
    for (const button of this.section.querySelectorAll<HTMLElement>("[data-look]")) {
      button.addEventListener("click", () => this.look(button.dataset.look as ViewName));
    }
    for (const row of this.section.querySelectorAll<HTMLElement>("[data-if=joints]")) {
      row.hidden = this.view.content.joints.length === 0;
    }
    on("open", "input", (value) => this.change({ open: Number(value), pose: null }));
    on("pose", "change", (value) =>
      this.change({ open: 0, amount: 1, pose: value === "" ? null : Number(value) }),
    );
    on("amount", "input", (value) => this.change({ amount: Number(value) }));
    on("colors", "change", (value) => this.set({ colors: value as ViewState["colors"] }));
    on("predicted", "change", (value) => this.set({ predicted: value as ViewState["predicted"] }));
    this.element("play").addEventListener("click", () => this.playback.toggle());
  }

  private listenForClicks(): void {
    const { canvas } = this.view;
    let press: PointerEvent | null = null;
    canvas.addEventListener("pointerdown", (event) => (press = event));
    canvas.addEventListener("pointerup", (event) => {
      const start = press;
      press = null;
      if (!start || start.pointerId !== event.pointerId || event.button !== 0) return;
      const distance = Math.hypot(event.clientX - start.clientX, event.clientY - start.clientY);
      if (distance < CLICK_PX) this.select(this.view.itemAt(event.clientX, event.clientY));
    });
  }

  private element(name: string): HTMLElement {
    return this.section.querySelector<HTMLElement>(`[data-${name}]`)!;
  }

  private input(name: string): HTMLInputElement | HTMLSelectElement {
    return this.element(name) as HTMLInputElement | HTMLSelectElement;
  }
}

function element<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag,
  ...content: (Node | string)[]
): HTMLElementTagNameMap[Tag] {
  const created = document.createElement(tag);
  created.append(...content);
  return created;
}

function swatch(color: string, isRound = false): HTMLElement {
  const dot = element("i");
  dot.style.background = color;
  dot.classList.toggle("view3d-round", isRound);
  return dot;
}
