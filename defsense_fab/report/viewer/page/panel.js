// The controls next to the view, and their texts. Names from the device are set as text, not HTML.
const KINDS = ["body", "cord", "wire", "pin", "seat"];
const QUANTITIES = { error: "Error without noise, mm", strain: "Largest principal strain, %" };
const KIND_WORDS = { part: "part", wire: "wire", pin: "pin", seat: "marker seat" };
const ROUND_TRIP = 4; // s, from rest to the pose and back

class Panel {
  constructor(section, stage) {
    this.section = section;
    this.stage = stage;
    this.content = stage.content;
    this.picked = null;
    this._poses();
    this._open();
    this._posed();
    this._shown();
    this._names();
    section.querySelectorAll("[data-look]").forEach((button) =>
      button.addEventListener("click", () => this.look(button.dataset.look)));
    this._pick();
    this._keys();
    this.update();
  }

  get(name) {
    return this.section.querySelector(`[data-${name}]`);
  }

  // Change the state, and update the view and the texts.
  set(changes) {
    this.stage.set(changes);
    this.update();
  }

  look(name) {
    if (name === "reset") {
      this.play(false);
      this.set({ open: 0, pose: null, amount: 1 });
    }
    this.stage.eye.look(name, this.stage.box());
  }

  update() {
    const { state } = this.stage, posed = state.pose !== null;
    this.get("open").value = state.open;
    this.get("pose").value = posed ? state.pose : "";
    this.get("posed").hidden = !posed;
    for (const name of ["amount", "colors", "read"]) this.get(name).value = state[name];
    this.get("joint").textContent = this._joint();
    this.get("open").setAttribute("aria-valuetext", this._joint());
    if (posed) this._describePose();
    if (this.picked) this._describePicked();
  }

  play(on) {
    cancelAnimationFrame(this.frame);
    const button = this.get("play");
    button.textContent = on ? "Pause" : "Play";
    button.setAttribute("aria-pressed", String(on));
    this.playing = on;
    this.get("picked").setAttribute("aria-live", on ? "off" : "polite"); // not with every frame
    if (!on) return;
    const from = Math.acos(1 - 2 * this.stage.state.amount);
    let startedAt = null;
    const frame = (now) => {
      startedAt = startedAt ?? now;
      const phase = from + (2 * Math.PI * (now - startedAt)) / (1000 * ROUND_TRIP);
      this.set({ amount: (1 - Math.cos(phase)) / 2 });
      this.frame = requestAnimationFrame(frame);
    };
    this.frame = requestAnimationFrame(frame);
  }

  pick(follower) {
    this.picked = follower;
    this.stage.mark(follower);
    this.get("names").querySelectorAll("button").forEach((button) =>
      button.setAttribute("aria-pressed", String(Boolean(follower) && button.follower === follower)));
    this.get("picked").replaceChildren();
    if (follower) this._describePicked();
  }

  _poses() {
    const list = this.get("pose");
    list.append(new Option("At rest, as parts", ""));
    this.content.poses.forEach((pose, k) =>
      list.append(new Option(pose.name + (pose.held_out ? " (largest error, not designed for)" : ""), k)));
    list.addEventListener("change", () => {
      this.play(false);
      this.set({ open: 0, amount: 1, pose: list.value === "" ? null : Number(list.value) });
    });
  }

  _open() {
    if (!this.content.joints.length) {
      this.section.querySelectorAll("[data-if=joints]").forEach((each) => (each.hidden = true));
    }
    this.get("open").addEventListener("input", (event) => {
      this.play(false);
      this.set({ open: Number(event.target.value), pose: null });
    });
  }

  _joint() {
    const shares = this.stage.shares(this.stage.state.open), n = shares.length;
    const opening = shares.findIndex((share) => share > 0);
    if (opening < 0) return n ? `${n} joint${n > 1 ? "s" : ""}, all closed.` : "";
    const { join, cords } = this.content.joints[opening];
    const held = cords.length ? ` With ${cords.length > 1 ? "cords" : "cord"} ${cords.join(", ")}.` : "";
    return `Joint ${opening + 1} of ${n} in the order of assembly: ${join[0].join(" + ")} and ${join[1].join(" + ")}.${held}`;
  }

  _posed() {
    this.get("amount").addEventListener("input", (event) => {
      this.play(false);
      this.set({ amount: Number(event.target.value) });
    });
    this.get("play").addEventListener("click", () => this.play(!this.playing));
    this.get("colors").addEventListener("change", (event) => this.set({ colors: event.target.value }));
    this.get("read").addEventListener("change", (event) => this.set({ read: event.target.value }));
  }

  _describePose() {
    const { state, body } = this.stage, scale = this.get("scale");
    scale.hidden = state.colors === "none";
    if (!scale.hidden) {
      const top = body.tops[state.colors] * (state.colors === "strain" ? 100 : 1);
      this.get("ramp").style.background = cssRamp(state.colors);
      this.get("quantity").textContent = QUANTITIES[state.colors];
      this.get("top").textContent = String(Number(top.toPrecision(3)));
    }
    const pose = this.content.poses[state.pose];
    const solved = pose.at.map((at) => `${Math.round(100 * at)}\u00a0%`).join(", ");
    const between = pose.at.length > 1 ? "interpolated smoothly between them" : "interpolated linearly from rest";
    const unseen = pose.held_out ? " (of the states not designed for, the one with the largest error)" : "";
    this.get("state").textContent =
      `${Math.round(100 * state.amount)}\u00a0% of “${pose.name}”${unseen}: error ${body.rmse().toFixed(2)} mm (RMSE without noise). Simulated at ${solved}, ${between}.`;
  }

  _shown() {
    const row = this.get("shown");
    const there = KINDS.filter((kind) =>
      kind === "body" || this.content.followers.some((follower) => follower.kind === kind));
    for (const kind of there) {
      this._box(row, kind === "body" ? kind : `${this._word(kind)}s`, KIND_COLORS[kind], true, (on) => {
        this.stage.hidden[on ? "delete" : "add"](kind);
        this.set({});
      });
    }
    this._box(row, "transparent", null, this.stage.state.through, (on) => this.set({ through: on }));
  }

  _box(row, words, color, on, changed) {
    const label = document.createElement("label"), box = document.createElement("input");
    const dot = document.createElement("i");
    box.type = "checkbox";
    box.checked = on;
    box.addEventListener("change", () => changed(box.checked));
    dot.style.background = color;
    label.append(box, ...(color ? [dot] : []), words);
    row.append(label);
  }

  // What texts call a kind; sensors are cords or printed traces.
  _word(kind) {
    return kind === "cord" ? this.content.noun : KIND_WORDS[kind];
  }

  _names() {
    const { parts, followers } = this.stage;
    for (const follower of [...parts, ...followers.filter((each) => each.kind === "cord")]) {
      const button = document.createElement("button"), dot = document.createElement("i");
      button.type = "button";
      button.follower = follower;
      dot.style.background = follower.kind === "part" ? paler(follower.record.color) : follower.record.color;
      dot.classList.toggle("v3-round", follower.kind === "cord");
      button.append(dot, follower.record.name);
      button.addEventListener("click", () => this.pick(this.picked === follower ? null : follower));
      this.get("names").append(button);
    }
  }

  _describePicked() {
    const { record, kind } = this.picked, box = this.get("picked");
    const title = document.createElement("strong"), list = document.createElement("dl");
    const facts = [...record.facts];
    if (kind === "cord") {
      const cord = this.stage.followers.indexOf(this.picked);
      facts.push(["resistance in this view", `${Math.round(this.stage.resistances()[cord])} Ω`]);
    }
    title.textContent = kind === "surface" ? record.name : `${record.name} (${this._word(kind)})`;
    for (const [label, value] of facts) {
      const term = document.createElement("dt"), words = document.createElement("dd");
      term.textContent = label;
      words.textContent = value;
      list.append(term, words);
    }
    box.replaceChildren(title, list);
  }

  _pick() {
    const { canvas } = this.stage;
    let down = null;
    canvas.addEventListener("pointerdown", (event) => (down = event));
    canvas.addEventListener("pointerup", (event) => {
      const still = down && Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) < 6;
      if (still && down.pointerId === event.pointerId && event.button === 0) {
        this.pick(this.stage.at(event.clientX, event.clientY));
      }
      down = null;
    });
  }

  _keys() {
    const { eye, canvas, state } = this.stage;
    const keys = {
      ArrowLeft: () => eye.turn(0.12, 0), ArrowRight: () => eye.turn(-0.12, 0),
      ArrowUp: () => eye.turn(0, 0.12), ArrowDown: () => eye.turn(0, -0.12),
      "+": () => eye.nearer(1.15), "=": () => eye.nearer(1.15), "-": () => eye.nearer(1 / 1.15),
      0: () => this.look("reset"), Home: () => this.look("reset"),
      1: () => this.look("front"), 2: () => this.look("side"), 3: () => this.look("top"),
      o: () => {
        this.play(false);
        this.set({ open: state.open < 0.5 ? 1 : 0, pose: null });
      },
      p: () => {
        if (state.pose === null && this.content.poses.length) this.set({ open: 0, pose: 0 });
        if (state.pose !== null) this.play(!this.playing);
      },
      Escape: () => this.pick(null),
    };
    canvas.addEventListener("keydown", (event) => {
      const act = !event.ctrlKey && !event.metaKey && !event.altKey && keys[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });
  }
}
