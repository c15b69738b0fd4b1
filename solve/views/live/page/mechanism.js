// Mechanism in motion on a canvas: grey the rigid motion, blue with the magnified vibration.

const PERIOD_SECONDS = 4; // Time that a period takes on the page: slow enough to follow.
const HEIGHT = 260;

export class Mechanism {
  constructor(panel, marked) {
    this.panel = panel;
    this.marked = marked; // Called with the phase as a fraction of the curves' span.
    this.canvas = panel.querySelector("canvas");
    this.button = panel.querySelector("button");
    this.slider = panel.querySelector("input[type=range]");
    this.fraction = 0;
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.last = null;
    this.periods = 1;
    this.changed = true; // Whether a picture at rest must be drawn again.
    this.button.textContent = this.playing ? "Pause" : "Play";
    this.button.addEventListener("click", () => {
      this.playing = !this.playing;
      this.button.textContent = this.playing ? "Pause" : "Play";
    });
    this.slider.addEventListener("input", () => {
      this.playing = false;
      this.button.textContent = "Play";
      this.fraction = this.slider.value / 1000;
      this.changed = true;
    });
    requestAnimationFrame((now) => this.tick(now));
  }

  // Lines from a message and its points, or null for a model without a sketch.
  show(message, points) {
    this.message = message;
    this.points = new Float32Array(points);
    this.changed = true;
    this.panel.hidden = false;
    this.panel.querySelector("small").textContent = message.scale === 1 ? "vibration at its true size" : `vibration magnified ${message.scale} times`;
  }

  tick(now) {
    if (this.playing && this.last !== null) {
      this.fraction = (this.fraction + (now - this.last) / (1000 * PERIOD_SECONDS * this.periods)) % 1;
      this.slider.value = Math.round(this.fraction * 1000);
    }
    this.last = now;
    if (this.playing || this.changed) {
      this.changed = false;
      this.marked(this.fraction);
      if (this.message) this.draw();
    }
    requestAnimationFrame((later) => this.tick(later));
  }

  draw() {
    const { canvas, message } = this, ratio = devicePixelRatio || 1;
    const width = canvas.clientWidth, size = [Math.round(width * ratio), Math.round(HEIGHT * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    canvas.style.height = `${HEIGHT}px`;
    const context = canvas.getContext("2d"), style = getComputedStyle(canvas);
    const colour = (name) => style.getPropertyValue(name);
    const [x0, y0] = message.low, [x1, y1] = message.high;
    const scale = Math.min((width - 24) / (x1 - x0 || 1), (HEIGHT - 24) / (y1 - y0 || 1));
    const at = (x, y) => [width / 2 + (x - (x0 + x1) / 2) * scale, HEIGHT / 2 - (y - (y0 + y1) / 2) * scale];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, HEIGHT);
    context.lineCap = context.lineJoin = "round";
    const lines = this.places();
    for (const line of lines) {
      if (line.fixed) this.stroke(context, line.moved, at, colour("--ink"), 1.2);
      else this.stroke(context, line.rigid, at, colour("--rigid"), 3);
    }
    for (const line of lines) if (!line.fixed) this.stroke(context, line.moved, at, colour("--line"), 1.8);
    for (const [name, end] of message.joints) {
      const { moved } = lines.find((line) => line.name === name), from = end === 0 ? 0 : moved.length - 2;
      this.dot(context, at(moved[from], moved[from + 1]), colour("--line"), 3);
    }
    for (const line of message.lines) for (const [x, y] of line.held) this.triangle(context, at(x, y), colour("--ink"));
  }

  // Points of each line at the present phase, interpolated between two frames.
  places() {
    const { frames, lines } = this.message, place = this.fraction * frames;
    const first = Math.floor(place) % frames, next = (first + 1) % frames, part = place - Math.floor(place);
    let start = 0;
    const between = (count) => {
      const mixed = new Float32Array(2 * count), a = start + first * 2 * count, b = start + next * 2 * count;
      for (let k = 0; k < mixed.length; k += 1) mixed[k] = this.points[a + k] * (1 - part) + this.points[b + k] * part;
      start += 2 * count * frames;
      return mixed;
    };
    return lines.map((line) => ({ ...line, rigid: between(line.points), moved: between(line.points) }));
  }

  stroke(context, points, at, colour, width) {
    context.beginPath();
    for (let k = 0; k < points.length; k += 2) context.lineTo(...at(points[k], points[k + 1]));
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
  }

  dot(context, [x, y], colour, radius) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = colour;
    context.fill();
  }

  triangle(context, [x, y], colour) {
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x - 5, y + 9);
    context.lineTo(x + 5, y + 9);
    context.fillStyle = colour;
    context.fill();
  }
}
