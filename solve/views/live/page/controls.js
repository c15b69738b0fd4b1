// Sliders, each with a field for a number with a unit.

const STEPS = 1000;

export function rounded(value, digits = 4) {
  return Number(value.toPrecision(digits));
}

// Text of a number that fits its field: rounded, and with an exponent where digits would have to be counted.
function written(value) {
  const short = rounded(value, 7), size = Math.abs(short);
  return size >= 1e6 || (size > 0 && size < 1e-3) ? short.toExponential().replace("e+", "e") : String(short);
}

// Values of all sliders; `moved` is called after each change, `typed` with the name and text of a field.
export class Controls {
  constructor(form, moved, typed) {
    this.form = form;
    this.moved = moved;
    this.typed = typed;
    this.rows = new Map();
    form.addEventListener("submit", (event) => event.preventDefault());
  }

  build(controls) {
    const further = document.createElement("details");
    const count = controls.filter((control) => control.further).length;
    further.innerHTML = `<summary>${count} further parameters, which are 0</summary>`;
    this.form.replaceChildren();
    this.rows.clear();
    for (const control of controls) (control.further && count > 2 ? further : this.form).append(this.row(control));
    if (count > 2) this.form.append(further);
  }

  row(control) {
    const row = document.createElement("div"), id = `control-${control.name}`;
    row.className = "control";
    row.dataset.name = control.name;
    row.innerHTML = `<label></label><span class="meaning"></span><span class="typed"><input spellcheck="false"><span class="unit"></span></span><input type="range" min="0" max="${STEPS}"><p class="refusal" role="alert" hidden></p>`;
    const [field, slider] = row.querySelectorAll("input");
    const state = { ...control, ...control.range, first: control.value, text: null, row, field, slider };
    row.querySelector("label").textContent = control.label;
    row.querySelector("label").htmlFor = field.id = id;
    row.querySelector(".meaning").textContent = control.meaning;
    row.title = `${control.meaning}${control.bound ? `; allowed: ${control.bound}` : ""}`;
    row.querySelector(".unit").textContent = control.unit;
    slider.setAttribute("aria-label", `${control.name}: ${control.meaning}`);
    slider.addEventListener("input", () => {
      this.put(control.name, this.value(state, slider.value / STEPS), null, slider);
      this.moved();
    });
    field.addEventListener("change", () => this.typed(control.name, field.value));
    field.addEventListener("input", () => this.refuse(control.name, ""));
    this.rows.set(control.name, state);
    this.put(control.name, control.value, null);
    return row;
  }

  value({ low, high, logarithmic, integer }, part) {
    const value = logarithmic ? low * (high / low) ** part : low + (high - low) * part;
    return integer ? Math.round(value) : Math.abs(value) < 1e-9 * (high - low) ? 0 : rounded(value);
  }

  // Set a value; a text with another unit is kept for commands. The range grows if it must.
  put(name, value, text, from = null) {
    const state = this.rows.get(name);
    state.value = value;
    state.text = text;
    if (value < state.low) state.low = value;
    if (value > state.high) state.high = value;
    if (state.low <= 0) state.logarithmic = false;
    const { low, high } = state;
    const part = state.logarithmic ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low || 1);
    if (from !== state.slider) state.slider.value = Math.round(part * STEPS);
    if (from !== state.field) state.field.value = written(value);
    state.row.classList.toggle("changed", value !== state.first);
    this.refuse(name, "");
  }

  refuse(name, message) {
    const { row, field } = this.rows.get(name), refusal = row.querySelector(".refusal");
    refusal.textContent = message;
    refusal.hidden = !message;
    field.setAttribute("aria-invalid", message ? "true" : "false");
  }

  reset() {
    for (const [name, state] of this.rows) {
      Object.assign(state, state.range); // A typed value may have extended it.
      this.put(name, state.first, null);
    }
  }

  // Speed, and texts of the parameters that differ from their first values.
  get state() {
    const values = {};
    let speed = "";
    for (const [name, state] of this.rows) {
      const text = state.text ?? String(state.value);
      if (name === "speed") speed = text;
      else if (state.value !== state.first) values[name] = text;
    }
    return { speed, values };
  }
}
