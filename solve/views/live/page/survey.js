// Sweeps and charts: requested by a form, drawn with a cursor that sets the sliders.

import { Frame, element, escaped, range } from "./plots.js";

const HEIGHT = 300;

export class Survey {
  // send: a message. controls: the sliders. moved: called after the cursor has set them.
  constructor(panel, send, controls, moved) {
    Object.assign(this, { panel, send, controls, moved });
    this.form = panel.querySelector("form");
    this.message = panel.querySelector(".message");
    this.host = panel.querySelector(".plot");
    this.result = null;
    this.number = 0; // Of the newest request.
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.request();
    });
    for (const axis of ["x", "y"]) this.field(axis).addEventListener("change", () => this.fill(axis));
    this.host.addEventListener("pointerdown", (event) => {
      if (!this.result) return;
      this.host.setPointerCapture(event.pointerId);
      this.follow(event);
    });
    this.host.addEventListener("pointermove", (event) => event.buttons && this.follow(event));
    this.host.addEventListener("keydown", (event) => this.step(event));
  }

  field(name) {
    return this.form.elements[name];
  }

  build(model) {
    const names = model.controls.map((control) => control.name);
    this.field("x").innerHTML = names.map((name) => `<option>${escaped(name)}</option>`).join("");
    this.field("y").innerHTML = `<option value="">(sweep)</option>${this.field("x").innerHTML}`;
    this.panel.querySelector("datalist").innerHTML = model.of.map((name) => `<option value="${escaped(name)}">`).join("");
    this.field("of").value = model.of.at(model.vibrates ? -1 : 0);
    this.fill("x");
    this.fill("y");
    this.result = null;
    this.host.replaceChildren();
  }

  // Range of the slider of the chosen quantity.
  fill(axis) {
    const name = this.field(axis).value;
    if (axis === "y") {
      this.panel.querySelector(".second").hidden = !name;
      if (name) this.field("x-count").value = Math.min(this.field("x-count").value, 40);
    }
    if (!name) return;
    const { low, high } = this.controls.rows.get(name);
    this.field(`${axis}-low`).value = low;
    this.field(`${axis}-high`).value = high;
  }

  axis(letter) {
    const name = this.field(letter).value;
    if (!name) return null;
    const [low, high, count] = ["low", "high", "count"].map((part) => this.field(`${letter}-${part}`).value.trim());
    return { name, low, high, count, logarithmic: this.controls.rows.get(name).logarithmic };
  }

  request() {
    this.say("");
    this.at = JSON.stringify(this.held());
    this.number += 1;
    this.send({ do: "survey", number: this.number, of: this.field("of").value, x: this.axis("x"), y: this.axis("y"), ...this.controls.state });
  }

  // Values that the survey holds, all but those of its axes.
  held(axes = [this.field("x").value, this.field("y").value]) {
    const { speed, values } = this.controls.state;
    const others = Object.entries(values).filter(([name]) => !axes.includes(name));
    return [axes.includes("speed") ? "" : speed, others.sort()];
  }

  say(text, fault = false) {
    this.message.textContent = text;
    this.message.classList.toggle("fault", fault);
  }

  receive(message) {
    if (message.outcome === "done") {
      this.result = message;
      this.result.at = this.at;
      const failed = message.failures.filter(Boolean);
      const missing = message.y && message.values.includes(null) ? "; grey: no result" : "";
      const colours = message.y ? [`Orange: unstable; darker: larger${missing}`] : [];
      const texts = [...colours, ...message.warnings, ...(failed.length ? [`${failed.length} of ${message.failures.length} points have no result, such as: ${failed[0]}`] : [])];
      this.notes = texts.join(". ");
      this.draw();
    } else if (message.outcome === "cancelled") this.say("Cancelled.");
    else if (message.outcome !== "progress") this.say(message.message, true);
  }

  draw() {
    const { result } = this;
    if (!result) return;
    this.frame = new Frame(this.host, HEIGHT);
    const xs = result.x.values, ends = [xs[0], xs.at(-1)], label = `${result.x.label}`;
    if (result.y) this.drawChart(ends, label);
    else this.drawSweep(xs, ends, label);
    this.cursors = [0, 1].map(() => element("line", { class: "cursor" }, this.frame.over));
    this.mark();
  }

  drawSweep(xs, ends, label) {
    const { frame, result } = this, ys = result.values;
    const limits = range(ys);
    if (Math.min(...ys.filter((y) => y !== null)) >= 0) limits[0] = 0;
    frame.scale(ends, limits, { logX: result.x.logarithmic });
    frame.drawAxes(label, result.label, { most: 10 });
    element("path", { class: "line", d: frame.path(xs, ys) }, frame.content);
    const dots = ys.map((y, k) => (y === null ? "" : `<circle class="dot${result.verdicts[k] === "unstable" ? " bad" : ""}" cx="${frame.x.to(xs[k]).toFixed(1)}" cy="${frame.y.to(y).toFixed(1)}" r="${xs.length > 150 ? 1.2 : 2.2}"/>`));
    element("g", {}, frame.content).innerHTML = dots.join("");
  }

  drawChart(ends, label) {
    const { frame, result } = this, ys = result.y.values, xs = result.x.values;
    frame.scale(ends, [ys[0], ys.at(-1)], { logX: result.x.logarithmic, logY: result.y.logarithmic });
    frame.drawAxes(label, result.y.label, { most: 10 });
    const { left, right, top, bottom } = frame.box;
    // Points are the centres of their rectangles, so that those of the edges are halved.
    const wide = (right - left) / (xs.length - 1), high = (bottom - top) / (ys.length - 1);
    const image = element("image", {
      x: left - wide / 2, y: top - high / 2, width: wide * xs.length, height: high * ys.length, preserveAspectRatio: "none",
      style: `image-rendering: pixelated; clip-path: inset(${50 / ys.length}% ${50 / xs.length}%)`, href: this.image(xs.length, ys.length),
    });
    frame.svg.prepend(image);
    for (const curve of result.boundaries) {
      element("path", { class: "boundary", d: frame.path(curve.points.map((point) => point[0]), curve.points.map((point) => point[1])) }, frame.content);
    }
  }

  // Picture of the values: blue where stable, orange where unstable, darker for larger values.
  image(width, height) {
    const { result } = this, canvas = document.createElement("canvas");
    Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d"), [low, high] = range(result.values, 0);
    for (let j = 0; j < height; j += 1) {
      for (let i = 0; i < width; i += 1) {
        const value = result.values[j * width + i], verdict = result.verdicts[j * width + i];
        const part = value === null ? 0 : (value - low) / (high - low || 1);
        const hue = verdict === "unstable" ? 25 : verdict === "failed" || value === null ? -1 : 205;
        context.fillStyle = hue < 0 ? "#999" : `hsl(${hue} 75% ${88 - 45 * part}%)`;
        context.fillRect(i, height - 1 - j, 1, 1);
      }
    }
    return canvas.toDataURL();
  }

  // Cursor at the position of the sliders.
  mark() {
    if (!this.result) return;
    const { frame, result } = this, { left, right, top, bottom } = frame.box;
    const value = (axis) => this.controls.rows.get(axis.name).value;
    const x = clamp(frame.x.to(value(result.x)), left, right);
    set(this.cursors[0], { x1: x, x2: x, y1: top, y2: bottom });
    if (result.y) {
      const y = clamp(frame.y.to(value(result.y)), top, bottom);
      set(this.cursors[1], { x1: left, x2: right, y1: y, y2: y });
    }
    this.host.setAttribute("aria-valuenow", value(result.x));
    this.host.setAttribute("aria-valuetext", `${result.x.name} ${value(result.x)}`);
    const axes = [result.x.name, result.y?.name ?? ""];
    const stale = JSON.stringify(this.held(axes)) !== result.at;
    this.say(stale ? `Computed with other values; compute again. ${this.notes}` : this.notes);
  }

  follow(event) {
    const { frame, result } = this, corner = frame.svg.getBoundingClientRect(), { left, right, top, bottom } = frame.box;
    const width = frame.width / corner.width;
    this.put(result.x, frame.x.of(clamp((event.clientX - corner.left) * width, left, right)));
    if (result.y) this.put(result.y, frame.y.of(clamp((event.clientY - corner.top) * width, top, bottom)));
    this.moved();
  }

  put(axis, value) {
    const { integer } = this.controls.rows.get(axis.name), [low, high] = [axis.values[0], axis.values.at(-1)];
    const taken = integer ? Math.round(value) : Number(value.toPrecision(5));
    this.controls.put(axis.name, clamp(taken, low, high), null);
  }

  // Arrow keys move the cursor by a hundredth of the axis.
  step(event) {
    const moves = { ArrowLeft: ["x", -1], ArrowRight: ["x", 1], ArrowDown: ["y", -1], ArrowUp: ["y", 1] }[event.key];
    const axis = moves && this.result?.[moves[0]];
    if (!axis) return;
    event.preventDefault();
    const [low, high] = [axis.values[0], axis.values.at(-1)], { value } = this.controls.rows.get(axis.name);
    const next = axis.logarithmic ? value * (high / low) ** (moves[1] / 100) : value + (moves[1] * (high - low)) / 100;
    this.put(axis, clamp(next, low, high));
    this.moved();
  }
}

function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

function set(line, attributes) {
  for (const [key, value] of Object.entries(attributes)) line.setAttribute(key, value);
}
