// The report's viewer: each chapter's scene in parallel projection, to rotate; painter.js draws it.
// Drawn when something changes, never in a loop. Text out of the data reaches the page as text only.
(() => {
const HOME = [-0.5, 0.8, 0.45], TURN = 0.008, STEP = 0.12, ZOOM = 1.25, NEAR_PX = 9, LABEL_PX = 24, FRAME_MS = 50;
const VIEWS = [[-1, 0, 0], [0, 1, 0], [0, 0.01, 1]]; // along each of the scene's axes
const HELP = "Drag to turn, with shift or two fingers to move; click first, then wheel or pinch to zoom.";
const KEYS = "View in space. Arrow keys turn, with shift they move; plus and minus zoom, 0 resets, escape lets go.";

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const added = (a, b, f = 1) => a.map((v, k) => v + f * b[k]);
const mixed = (f, axes) => [0, 1, 2].map((k) => f[0] * axes[0][k] + f[1] * axes[1][k] + f[2] * axes[2][k]);
const distance = (a, b) => Math.hypot(...added(a, b, -1));
function element(tag, parent, text = "", properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  made.textContent = text;
  parent?.append(made);
  return made;
}

class Viewer {
  constructor(figure, chapter, data) {
    this.canvas = document.createElement("canvas");
    this.painter = new Painter(this.canvas, data);
    Object.assign(this, { figure, chapter, data, chosen: null, shading: 0, frame: 0, pointers: new Map() });
    this.groups = ["points", ...data.strokes.map((each) => each.name), data.marks_are]; // what can be hidden
    this.shown = [true, ...data.strokes.map((each) => each.shown), true];
    this.places = this.some();
    this.build();
    this.listen();
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.resize();
    this.look(HOME);
  }

  some() { // a few thousand places that the first view must hold
    const places = this.data.marks.flatMap((mark) => mark.outline), steps = new Int16Array(bytes(this.data.points).buffer);
    let first = 0;
    for (const [x, y, z, step, count] of this.data.blocks) {
      for (let at = 3 * first; at < 3 * (first + count); at += 3 * 97) {
        places.push([x + step * steps[at], y + step * steps[at + 1], z + step * steps[at + 2]]);
      }
      first += count;
    }
    for (const strokes of this.data.strokes.filter((each) => each.shown)) {
      const xyz = new Float32Array(bytes(strokes.points).buffer), every = 3 * Math.ceil(xyz.length / 6000);
      for (let i = 0; i < xyz.length; i += every) places.push([...xyz.slice(i, i + 3)]);
    }
    this.middle = places.reduce((m, p) => added(m, p, 1 / places.length), [0, 0, 0]);
    this.reach = places.reduce((most, p) => Math.max(most, distance(p, this.middle)), 0) * 1.05 + 1;
    return places;
  }

  build() {
    this.figure.querySelector("p")?.remove();
    this.stage = element("div", null, "", { className: "stage" });
    const controls = element("div", null, "", { className: "controls" });
    this.legend = element("div", null, "", { className: "legend" });
    this.figure.prepend(this.stage, controls, this.legend);
    this.stage.append(this.canvas);
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    this.canvas.setAttribute("aria-label", KEYS);
    this.labels = this.data.marks.map((mark, k) => {
      const label = element("button", this.stage, mark.key, { className: "mark", type: "button", onclick: () => this.choose(k) });
      label.style.borderColor = mark.colour;
      return label;
    });
    this.bar = element("div", this.stage, "", { className: "bar" });
    this.facts = element("div", this.stage, "", { className: "facts-shown", hidden: true });
    this.facts.setAttribute("aria-live", "polite");
    const press = (text, onclick, title = text) => element("button", controls, text, { type: "button", title, onclick });
    press("Reset view", () => this.look(HOME));
    VIEWS.forEach((way, k) => press(`Along ${this.data.axes_names[k]}`, () => this.look(way)));
    press("+", () => this.zoom(ZOOM), "Nearer");
    press("−", () => this.zoom(1 / ZOOM), "Farther");
    if (this.data.shadings.length) this.buildColours(controls);
    if (this.data.frames.length) this.buildPlayback(controls);
    this.groups.forEach((name, k) => {
      if (k === 0 ? !this.data.blocks.length : k > this.data.strokes.length && !this.labels.length) return;
      if (this.groups.indexOf(name) < k) return; // a body of several parts: one tick for all of them
      const label = element("label", controls, name), tick = element("input", null, "", { type: "checkbox", checked: this.shown[k] });
      label.prepend(tick);
      tick.onchange = () => { this.groups.forEach((other, j) => { if (other === name) this.shown[j] = tick.checked; }); this.redraw(); };
    });
    element("span", controls, HELP, { className: "note" });
    this.rows = this.data.marks.map((mark, k) => [...this.chapter.querySelectorAll("tr[data-mark]"), ...(this.chapter.classList.contains("certified") ? document.querySelectorAll(".certificate tr[data-mark]") : [])].filter((row) => {
      if (row.dataset.mark !== mark.key) return false;
      row.onclick = () => { this.choose(k); this.approach(k); this.stage.scrollIntoView({ block: "nearest" }); };
      row.onkeydown = (event) => { if (event.key === "Enter") row.onclick(); };
      return Object.assign(row, { tabIndex: 0, title: "Show in the view" });
    }));
  }

  buildColours(controls) {
    const select = element("select", element("label", controls, "Colour: "));
    this.data.shadings.forEach((each, k) => element("option", select, each.name, { value: k }));
    select.onchange = () => {
      this.shading = Number(select.value);
      this.legend.replaceChildren();
      for (const [text, colour] of this.data.shadings[this.shading].legend) {
        const key = element("span", this.legend, "", { className: "key" });
        element("i", key).style.background = colour;
        key.append(text);
      }
      this.redraw();
    };
    select.onchange();
  }

  buildPlayback(controls) { // drawn while it plays, and where somebody moves the slider
    const last = this.data.frames.length - 1, said = element("div", this.stage, "", { className: "facts-shown played" });
    const play = element("button", controls, "Play", { type: "button" });
    const slider = element("input", controls, "", { type: "range", min: 0, max: last, value: 0, ariaLabel: "Place along the program" });
    const show = (frame) => {
      this.frame = frame;
      slider.value = frame;
      said.textContent = this.data.frames[frame];
      this.redraw();
    };
    const stop = () => { clearInterval(this.playing); this.playing = 0; play.textContent = "Play"; };
    slider.oninput = () => { stop(); show(Number(slider.value)); };
    play.onclick = () => {
      if (this.playing) return stop();
      play.textContent = "Pause";
      if (this.frame === last) show(0);
      this.playing = setInterval(() => (this.frame < last ? show(this.frame + 1) : stop()), FRAME_MS);
    };
    show(0);
  }

  listen() {
    const canvas = this.canvas, on = (name, act, how) => canvas.addEventListener(name, act, how);
    const at = (event) => [event.offsetX - canvas.clientWidth / 2, canvas.clientHeight / 2 - event.offsetY];
    on("pointerdown", (event) => {
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, at(event));
      this.moved = this.pointers.size > 1 ? Infinity : 0;
    });
    on("pointermove", (event) => { if (this.pointers.has(event.pointerId)) this.drag(event, at(event)); });
    on("pointercancel", (event) => this.pointers.delete(event.pointerId));
    on("pointerup", (event) => {
      if (this.pointers.delete(event.pointerId) && this.moved < 4) this.choose(this.under(at(event)));
    });
    on("contextmenu", (event) => event.preventDefault());
    on("wheel", (event) => {
      if (document.activeElement !== canvas && !event.ctrlKey) return; // the page scrolls until the view is clicked
      event.preventDefault();
      this.zoom(Math.exp(-0.0015 * event.deltaY), at(event));
    }, { passive: false });
    on("keydown", (event) => this.key(event));
    on("webglcontextlost", (event) => event.preventDefault());
    on("webglcontextrestored", () => { this.painter.prepare(); this.redraw(); });
  }

  drag(event, to) {
    const from = this.pointers.get(event.pointerId), [dx, dy] = added(to, from, -1);
    this.moved += Math.abs(dx) + Math.abs(dy);
    this.pointers.set(event.pointerId, to);
    if (this.pointers.size > 1) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
      this.zoom(Math.max(1, distance(to, other)) / Math.max(1, distance(from, other)), added(other, to).map((v) => v / 2));
      this.move(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) this.move(dx, dy);
    else this.turn(-TURN * dx, -TURN * dy);
  }

  key(event) {
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (arrow && event.shiftKey) this.move(-40 * arrow[0], -40 * arrow[1]);
    else if (arrow) this.turn(STEP * arrow[0], STEP * arrow[1]);
    else if (event.key === "+" || event.key === "=") this.zoom(ZOOM);
    else if (event.key === "-") this.zoom(1 / ZOOM);
    else if (event.key === "0") this.look(HOME);
    else if (event.key === "Escape") this.choose(null);
    else return;
    event.preventDefault();
  }

  // The camera: yaw and pitch of the viewer about m, a target in the middle of the picture, pixels a millimetre.
  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.pitch + pitch));
    this.redraw();
  }

  move(dx, dy) {
    const [right, up] = this.screen();
    this.target = added(added(this.target, right, -dx / this.scale), up, -dy / this.scale);
    this.redraw();
  }

  zoom(factor, [x, y] = [0, 0]) { // what lies under (x, y) stays there
    this.move(-x, -y);
    this.scale = Math.min(2000, Math.max(0.01, this.scale * factor));
    this.move(x, y);
  }

  look(way) {
    this.yaw = Math.atan2(way[1], way[0]);
    this.pitch = Math.asin(way[2] / Math.hypot(...way));
    this.fit(this.places, 0.9);
  }

  fit(places, share) {
    const screen = this.screen(), ends = screen.map((axis) => places.reduce(([low, high], p) =>
      [Math.min(low, dot(axis, p)), Math.max(high, dot(axis, p))], [Infinity, -Infinity]));
    const [width, height] = ends.map(([low, high]) => high - low + 1);
    this.target = mixed(ends.map(([low, high]) => (low + high) / 2), screen);
    this.scale = share * Math.min(this.canvas.clientWidth / width, this.canvas.clientHeight / height);
    this.redraw();
  }

  screen() { // right, up and towards the viewer, in the base
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[-sy, cy, 0], [-sp * cy, -sp * sy, cp], [cp * cy, cp * sy, sp]].map((f) => mixed(f, this.data.axes));
  }

  onScreen(place) { // pixels from the middle, and towards the viewer
    return this.screen().map((axis) => this.scale * dot(axis, added(place, this.target, -1)));
  }

  // Marks: sections or layers.
  choose(k) {
    const parts = (at) => (at === null ? [] : [this.labels[at], ...this.rows[at]]);
    for (const each of parts(this.chosen)) each.classList.remove("chosen");
    for (const each of parts(k)) each.classList.add("chosen");
    this.chosen = k;
    this.facts.hidden = k === null;
    this.facts.replaceChildren();
    if (k !== null) {
      element("button", this.facts, "×", { type: "button", title: "Close", onclick: () => this.choose(null) });
      const list = element("dl", this.facts);
      for (const [name, value] of this.data.marks[k].facts) element("dt", list, name), element("dd", list, value);
    }
    this.redraw();
  }

  approach(k) {
    const { outline } = this.data.marks[k];
    this.fit(outline, distance(outline[0], outline.at(-1)) < 1e-6 ? 0.45 : 0.9);
  }

  under([x, y]) { // the mark whose outline holds a place on the screen, else the one whose outline is near
    let best = null, least = NEAR_PX;
    this.data.marks.forEach((mark, k) => {
      const seen = mark.outline.map((p) => this.onScreen(p).slice(0, 2));
      let inside = distance(seen[0], seen.at(-1)) < 1e-3 && seen.length > 2 ? 0 : NaN, near = Infinity;
      for (let i = 1; i < seen.length; i++) {
        const [a, b] = [seen[i - 1], seen[i]], [u, v] = added(b, a, -1);
        if (a[1] > y !== b[1] > y && x < a[0] + u * (y - a[1]) / v) inside = 1 - inside;
        const f = Math.min(1, Math.max(0, ((x - a[0]) * u + (y - a[1]) * v) / (u * u + v * v || 1)));
        near = Math.min(near, distance([x, y], [a[0] + f * u, a[1] + f * v]));
      }
      const away = inside === 1 ? -near : near;
      if (away < least) [best, least] = [k, away];
    });
    return best;
  }

  // Drawing.
  resize() {
    this.painter.resize(this.canvas.clientWidth, this.canvas.clientHeight);
    this.redraw();
  }

  redraw() {
    if (this.target) this.waiting ||= requestAnimationFrame(() => { this.waiting = 0; this.draw(); });
  }

  draw() {
    const depth = this.reach + distance(this.target, this.middle), { target, scale, shading, chosen, shown, frame } = this;
    this.painter.draw({ screen: this.screen(), target, scale, depth, shading, chosen, shown, frame });
    this.arrange();
    this.figure.dataset.drawn = "yes";
  }

  arrange() { // the numbers at their places, none over another; the scale bar
    const taken = [], { clientWidth: width, clientHeight: height } = this.canvas;
    const order = this.labels.map((_, k) => k).sort((a, b) => (b === this.chosen) - (a === this.chosen));
    for (const k of order) {
      const at = this.onScreen(this.data.marks[k].place).slice(0, 2), label = this.labels[k];
      const inside = Math.abs(at[0]) < width / 2 - 12 && Math.abs(at[1]) < height / 2 - 12;
      label.hidden = !(inside && this.shown.at(-1) && taken.every((other) => distance(at, other) > LABEL_PX));
      if (!label.hidden) taken.push(at);
      Object.assign(label.style, { left: `${at[0] + width / 2}px`, top: `${height / 2 - at[1]}px` });
    }
    const about = 120 / this.scale, decade = 10 ** Math.floor(Math.log10(about));
    const length = [5, 2, 1].map((f) => f * decade).find((mm) => mm <= about);
    this.bar.style.width = `${length * this.scale}px`;
    this.bar.textContent = `${Number(length.toPrecision(1))} mm`;
  }
}

for (const stored of document.querySelectorAll("script.scene")) {
  const chapter = stored.closest(".chapter"), figure = chapter?.querySelector("figure.space");
  if (!figure) continue;
  try {
    new Viewer(figure, chapter, JSON.parse(stored.textContent));
  } catch (error) { // no WebGL 2: the words that stand in the figure say so
    figure.dataset.drawn = "no";
    figure.title = error.message;
  }
}
})();
