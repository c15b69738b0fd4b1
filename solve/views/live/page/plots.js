// Plots as SVG elements: axes, curves, spectra and the unit circle.

const SPACE = "http://www.w3.org/2000/svg";
const LEFT = 52, RIGHT = 10, TOP = 8, BOTTOM = 32; // Room for labels, in pixels.

export function element(name, attributes = {}, parent = null) {
  const made = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent?.append(made);
  return made;
}

// Ticks at multiples of 1, 2 or 5 times a power of ten.
export function ticks(low, high, most) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const raw = span / most, power = 10 ** Math.floor(Math.log10(raw));
  const factors = [1, 2, 5, 10], least = factors.findIndex((factor) => factor * power >= raw * 0.999);
  const of = (step) => {
    const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
    return Array.from({ length: last - first + 1 }, (_, k) => (first + k) * step);
  };
  const values = of(power * factors[least]);
  // A single tick gives no scale.
  return values.length > 1 || least === 0 ? values : of(power * factors[least - 1]);
}

export function short(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e5 || size < 1e-3 ? value.toExponential(3).replace(/\.?0+e/, "e").replace("e+", "e") : String(Number(value.toPrecision(5)));
  return text.replace("-", "−");
}

// Axes with linear or logarithmic scales; `x` and `y` map values to pixels.
export class Frame {
  constructor(host, height) {
    this.host = host;
    this.height = height;
    this.svg = element("svg", { role: "img" }, null);
    host.replaceChildren(this.svg);
    this.axes = element("g", {}, this.svg);
    this.content = element("g", {}, this.svg);
    this.over = element("g", {}, this.svg);
  }

  get width() {
    return Math.max(this.host.clientWidth, 160);
  }

  scale([x0, x1], [y0, y1], { logX = false, logY = false } = {}) {
    const left = LEFT, right = this.width - RIGHT, top = TOP, bottom = this.height - BOTTOM;
    const map = (low, high, from, to, log) => {
      const f = log ? Math.log : (value) => value;
      const a = f(low), b = f(high) - a || 1;
      return {
        to: (value) => from + ((f(value) - a) / b) * (to - from),
        of: (pixel) => { const v = a + ((pixel - from) / (to - from)) * b; return log ? Math.exp(v) : v; },
      };
    };
    this.limits = [x0, x1, y0, y1];
    this.logX = logX;
    this.logY = logY;
    this.x = map(x0, x1, left, right, logX);
    this.y = map(y0, y1, bottom, top, logY);
    this.box = { left, right, top, bottom };
  }

  drawAxes(labelX, labelY, { ticksX = null, most = 6 } = {}) {
    const { left, right, top, bottom } = this.box, [x0, x1, y0, y1] = this.limits;
    this.svg.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    this.svg.style.height = `${this.height}px`;
    const parts = [];
    const xs = ticksX ?? (this.logX ? decades(x0, x1) : ticks(x0, x1, Math.min(most, this.width / 45)));
    for (const value of xs) {
      const at = this.x.to(value);
      parts.push(`<line class="grid" x1="${at}" x2="${at}" y1="${top}" y2="${bottom}"/><text x="${at}" y="${bottom + 13}" text-anchor="middle">${short(value)}</text>`);
    }
    for (const value of this.logY ? decades(y0, y1) : ticks(y0, y1, Math.max(4, (bottom - top) / 32))) {
      const at = this.y.to(value);
      parts.push(`<line class="${value === 0 ? "zero" : "grid"}" x1="${left}" x2="${right}" y1="${at}" y2="${at}"/><text x="${left - 4}" y="${at + 4}" text-anchor="end">${short(value)}</text>`);
    }
    parts.push(`<text x="${(left + right) / 2}" y="${bottom + 28}" text-anchor="middle">${escaped(labelX)}</text>`);
    parts.push(`<text transform="translate(11 ${(top + bottom) / 2}) rotate(-90)" text-anchor="middle">${escaped(labelY)}</text>`);
    this.axes.innerHTML = parts.join("");
  }

  path(xs, ys) {
    let text = "", pen = "M";
    for (let k = 0; k < xs.length; k += 1) {
      if (ys[k] === null || (this.logY && ys[k] <= 0)) { pen = "M"; continue; }
      text += `${pen}${this.x.to(xs[k]).toFixed(1)} ${this.y.to(ys[k]).toFixed(1)}`;
      pen = "L";
    }
    return text;
  }
}

function decades(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high) + 1e-9; power += 1) {
    for (const factor of high / low > 300 ? [1] : [1, 2, 5]) {
      const value = factor * 10 ** power;
      if (value >= low * 0.999 && value <= high * 1.001) found.push(value);
    }
  }
  return found;
}

export function escaped(text) {
  return text.replace(/[&<>"]/g, (sign) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[sign]);
}

export function range(values, margin = 0.08) {
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (value === null || !Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (!(low <= high)) return [-1, 1];
  const room = (high - low) * margin || Math.abs(high) * 0.5 || 1;
  return [low - room, high + room];
}

// Row with the curve of a quantity over the phase and its spectrum.
export class CurveRow {
  constructor(parent) {
    this.row = document.createElement("div");
    this.row.className = "curve";
    this.row.innerHTML = "<h3></h3><div class=\"plot\"></div><div class=\"plot\"></div>";
    parent.append(this.row);
    const [left, right] = this.row.querySelectorAll(".plot");
    this.left = new Frame(left, 128);
    this.right = new Frame(right, 128);
    this.line = element("path", { class: "line" }, this.left.content);
    this.cursor = element("line", { class: "cursor" }, this.left.over);
    this.stems = element("g", {}, this.right.content);
  }

  draw(curve, span, period) {
    this.row.querySelector("h3").innerHTML = `<b>${escaped(curve.label)}</b> ${escaped(curve.meaning)} <small>largest ${escaped(curve.largest)}</small>`;
    const { left, right } = this, unit = curve.label.length > 10 ? curve.unit : `${curve.label}${curve.unit && ` (${curve.unit})`}`;
    const count = curve.values.length - 1, xs = curve.values.map((_, k) => (k / count) * span);
    right.host.hidden = curve.spectrum.length === 0;
    left.scale([0, span], range(curve.values));
    let step = span > 1.5 * period ? period : period / 4;
    while (span / step > left.width / 45) step *= 2;
    left.drawAxes("phase φ (°)", unit, { ticksX: Array.from({ length: Math.floor(span / step + 1e-9) + 1 }, (_, k) => k * step) });
    this.line.setAttribute("d", left.path(xs, curve.values));
    this.cursor.setAttribute("y1", left.box.top);
    this.cursor.setAttribute("y2", left.box.bottom);
    this.span = span;
    if (!right.host.hidden) this.drawSpectrum(curve, 360 / period);
  }

  drawSpectrum(curve, order) {
    const { right } = this, sizes = curve.spectrum.slice(1);
    const highest = Math.max(...sizes.map((size) => size ?? 0)) || 1;
    right.scale([0, (sizes.length + 0.5) * order], [0, highest * 1.1]);
    right.drawAxes("order of rotation", "amplitude");
    const foot = right.y.to(0);
    this.stems.innerHTML = sizes.map((size, k) => {
      const x = right.x.to((k + 1) * order).toFixed(1), y = right.y.to(size ?? 0).toFixed(1);
      return `<line class="stem" x1="${x}" x2="${x}" y1="${foot}" y2="${y}"/><circle class="dot" cx="${x}" cy="${y}" r="2"/>`;
    }).join("");
  }

  mark(degrees) {
    if (!this.span) return;
    const x = this.left.x.to(degrees % this.span).toFixed(1);
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
  }
}

// Multipliers in the complex plane with the unit circle.
export class Circle {
  constructor(host) {
    this.frame = new Frame(host, 240);
  }

  draw(multipliers, small) {
    const { frame } = this, reach = 1.15 * Math.max(1, ...multipliers.map(([re, im]) => Math.hypot(re ?? 0, im ?? 0)));
    const inner = frame.height - TOP - BOTTOM, wide = ((frame.width - LEFT - RIGHT) / inner) * reach;
    frame.scale([-wide, wide], [-reach, reach]);
    frame.drawAxes("Re ρ", "Im ρ");
    const radius = frame.y.to(0) - frame.y.to(1), [x, y] = [frame.x.to(0), frame.y.to(0)];
    const dots = multipliers.map(([re, im]) => {
      const bad = Math.hypot(re, im) > 1 + 1e-9 ? " bad" : "";
      return `<circle class="dot${bad}" cx="${frame.x.to(re).toFixed(2)}" cy="${frame.y.to(im).toFixed(2)}" r="4"><title>${short(re)} ${im < 0 ? "−" : "+"} ${short(Math.abs(im))}i</title></circle>`;
    });
    if (small) dots.push(`<circle class="dot" cx="${x}" cy="${y}" r="2.5"><title>${small} multipliers below the round-off of the monodromy matrix</title></circle>`);
    frame.content.innerHTML = `<circle class="limit" cx="${x}" cy="${y}" r="${radius}"/>${dots.join("")}`;
  }
}
