// The live page: messages to and from the program, and the parts of the page that they move.

import { Circle, CurveRow, short } from "./plots.js";
import { Controls } from "./controls.js";
import { Mechanism } from "./mechanism.js";
import { Survey } from "./survey.js";

const PATIENCE = 250; // Least number of milliseconds after which a newer request replaces the one under way.
const MOST_LATENCIES = 2000;

const by = (id) => document.getElementById(id);
const socket = new WebSocket(new URL("messages", location.href.replace(/^http/, "ws")));
socket.binaryType = "arraybuffer";

let patience = PATIENCE; // Grows with the time of solutions, so that slow ones are shown while a slider moves.
let number = 0, underWay = null, waiting = null, awaitsPoints = null, model = null, solution = null, rows = [];
const latencies = []; // Milliseconds from the move of a slider to the picture.
Object.assign(globalThis, { latencies });

const controls = new Controls(by("controls"), () => request(), (name, text) => send({ do: "check", name, text }));
const circle = new Circle(by("circle").querySelector(".plot"));
const mechanism = new Mechanism(by("motion"), (fraction) => {
  if (solution) for (const row of rows) row.mark(fraction * solution.span);
});
const survey = new Survey(by("survey"), (message) => {
  // The first calculation starts a process.
  showProgress(by("surveying"), { text: "starting", fraction: null });
  send(message);
}, controls, () => request());

function send(message) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

// Ask for the solution at the present values. One request is under way at a time, unless it takes long.
function request() {
  survey.mark();
  waiting = performance.now();
  if (underWay === null || waiting - underWay.since > patience) {
    if (underWay !== null) patience *= 2;
    ask();
  }
}

function ask() {
  number += 1;
  underWay = { number, since: performance.now(), moved: waiting };
  waiting = null;
  const scale = by("motion").querySelector(".scale").value;
  send({
    do: "solve", number, ...controls.state, shown: shown(),
    scale: scale === "" ? null : Number(scale), nonlinear: by("nonlinear").checked, rtol: by("rtol").value || null,
  });
}

function answered(message) {
  if (underWay === null || message.number !== underWay.number) return null;
  const answer = underWay;
  underWay = null;
  by("solving").hidden = true;
  if (waiting !== null) ask();
  return answer;
}

const receive = {
  model(message) {
    model = message;
    document.title = `${message.name}: solve explore`;
    by("title").textContent = message.title || message.name;
    by("case").textContent = `${message.name}${message.case ? `, case ${message.case}` : ""}`;
    by("circle").hidden = !message.vibrates;
    by("nonlinear").parentElement.hidden = !message.nonlinear;
    by("save").elements.file.value = message.file;
    by("motion").hidden = true;
    controls.build(message.controls);
    choose(message);
    survey.build(message);
    request();
  },

  solution(message) {
    const answer = answered(message);
    if (answer === null) return;
    solution = message;
    by("summary").classList.add("earlier");
    draw();
    by("command").textContent = message.command;
    by("command").nextElementSibling.hidden = by("command").hidden = !message.command;
    by("python").textContent = message.python;
    afterPaint(() => {
      const delay = performance.now() - answer.moved;
      latencies.push(delay);
      patience = Math.max(PATIENCE, 2 * delay);
      if (latencies.length > MOST_LATENCIES) latencies.shift();
      by("latency").textContent = `shown after ${delay.toFixed(0)} ms, solved in ${(1000 * message.seconds).toFixed(0)} ms`;
      document.documentElement.dataset.drawn = message.number;
    });
  },

  details(message) {
    if (message.number !== solution?.number) return;
    by("summary").classList.remove("earlier");
    by("summary").textContent = [message.summary, message.method && `Method: ${message.method}.`, ...message.notes].filter(Boolean).join(" ");
    document.documentElement.dataset.detailed = message.number;
  },

  motion(message) {
    awaitsPoints = message;
  },

  fault(message) {
    if (answered(message) === null) {
      if (message.number === solution?.number) by("summary").textContent = message.message;
      return;
    }
    fault(message.message);
    document.documentElement.dataset.drawn = message.number;
  },

  replaced(message) {
    if (answered(message) !== null && underWay === null) fault("Cancelled. Move a slider to compute again.");
  },

  checked({ name, value, text }) {
    controls.put(name, value, Number.isFinite(Number(text)) ? null : text);
    request();
  },

  refused({ name, message }) {
    controls.refuse(name, message);
  },

  progress(message) {
    if (message.number === underWay?.number) showProgress(by("solving"), message);
  },

  survey(message) {
    if (message.number !== survey.number) return;
    const bar = by("surveying");
    if (message.outcome === "progress") showProgress(bar, message);
    else bar.hidden = true;
    survey.receive(message);
  },

  saved({ message }) {
    by("said").textContent = message;
  },

  "not saved"({ message }) {
    by("said").textContent = message;
  },

  failed({ message }) {
    underWay = null;
    by("solving").hidden = by("surveying").hidden = true;
    fault(message);
  },
};

function showProgress(bar, { text, fraction }) {
  const progress = bar.querySelector("progress");
  bar.hidden = false;
  bar.querySelector("span").textContent = text;
  if (fraction === null) progress.removeAttribute("value");
  else progress.value = fraction;
}

function fault(text) {
  by("fault").textContent = text;
  by("fault").hidden = false;
  by("verdict").textContent = "no solution";
  by("verdict").className = "verdict bad";
  by("errors").textContent = "";
  by("warnings").replaceChildren();
  by("views").style.opacity = 0.45;
}

function draw() {
  const { verdict, errors, warnings, radius } = solution;
  by("fault").hidden = true;
  by("views").style.opacity = "";
  by("verdict").textContent = verdict || "rigid motion";
  by("verdict").className = `verdict ${verdict === "unstable" || verdict === "undetermined" ? "bad" : "good"}`;
  by("errors").textContent = [radius !== undefined && radius !== null ? `max|ρ| = ${short(radius)}` : "", errors && `errors: ${errors.replaceAll("-", "−")}`].filter(Boolean).join("; ");
  by("warnings").replaceChildren(...warnings.map((warning) => Object.assign(document.createElement("li"), { textContent: warning })));
  drawPictures();
}

function drawPictures() {
  const { curves, span, period, multipliers, small, free } = solution;
  const host = by("orbit").querySelector(".curves");
  while (rows.length > curves.length) rows.pop().row.remove();
  while (rows.length < curves.length) rows.push(new CurveRow(host));
  curves.forEach((curve, k) => rows[k].draw(curve, span, period));
  by("orbit").querySelector("small").textContent = free ? "no load: free vibration from rest at 1" : "";
  mechanism.periods = Math.round(span / period);
  mechanism.changed = true;
  if (model.vibrates) circle.draw(multipliers, small);
}

// Checkboxes of the quantities.
function choose(message) {
  by("quantities").replaceChildren(...message.quantities.map(({ name, unit, meaning }) => {
    const label = document.createElement("label"), box = document.createElement("input");
    Object.assign(box, { type: "checkbox", value: name, checked: message.shown.includes(name) });
    label.title = meaning;
    label.append(box, ` ${name}${unit && unit !== "1" ? ` (${unit})` : ""}`);
    box.addEventListener("change", () => {
      limit(message.most_shown);
      request();
    });
    return label;
  }));
  limit(message.most_shown);
}

// No more quantities can be chosen than are shown.
function limit(most) {
  const full = shown().length >= most;
  for (const box of by("quantities").querySelectorAll("input")) box.disabled = full && !box.checked;
}

function shown() {
  return [...by("quantities").querySelectorAll("input:checked")].map((box) => box.value);
}

function afterPaint(work) {
  requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = work;
    channel.port2.postMessage(null);
  });
}

async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // In a frame the clipboard may be closed to scripts, but not to a selection.
    const field = Object.assign(document.createElement("textarea"), { value: text });
    document.body.append(field);
    field.select();
    document.execCommand("copy");
    field.remove();
  }
}

socket.addEventListener("message", ({ data }) => {
  if (data instanceof ArrayBuffer) {
    if (awaitsPoints?.number === solution?.number) mechanism.show(awaitsPoints, data);
    awaitsPoints = null;
    return;
  }
  const message = JSON.parse(data);
  receive[message.is]?.(message);
});
socket.addEventListener("close", () => {
  fault("The program has ended. Start solve explore again.");
  by("solving").hidden = by("surveying").hidden = true;
});

for (const button of document.querySelectorAll("[data-copies]")) {
  button.addEventListener("click", async () => {
    await copy(by(button.dataset.copies).textContent);
    by("said").textContent = "Copied.";
  });
}
by("save").addEventListener("submit", (event) => {
  event.preventDefault();
  const { elements } = event.target;
  send({ do: "save", case: elements.case.value, file: elements.file.value, ...controls.state });
});
by("reset").addEventListener("click", () => { controls.reset(); request(); });
by("nonlinear").addEventListener("change", () => request());
for (const field of [by("rtol"), by("motion").querySelector(".scale")]) {
  field.addEventListener("change", () => field.reportValidity() && request());
}
by("quit").addEventListener("click", () => send({ do: "quit" }));
by("solving").querySelector("button").addEventListener("click", () => send({ do: "stop", number: number + 1 }));
by("surveying").querySelector("button").addEventListener("click", () => send({ do: "cancel" }));
new ResizeObserver(() => { if (solution) { drawPictures(); survey.draw(); } }).observe(by("views"));
