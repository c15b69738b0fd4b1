const paths = document.querySelectorAll("path.mover");
const label = document.getElementById("label");
const slider = document.getElementById("frame");
const button = document.getElementById("play");
const count = data.labels.length;
let frame = 0;
let timer = null;

function show(at) {
  frame = at;
  data.parts.forEach((part, k) => paths[k].setAttribute(part.name, part.values[at]));
  label.textContent = data.labels[at];
  slider.value = at;
}

function play(on) {
  clearInterval(timer);
  timer = on ? setInterval(() => show((frame + 1) % count), 40) : null;
  button.textContent = on ? "Pause" : "Play";
}

button.addEventListener("click", () => play(timer === null));
slider.addEventListener("input", () => { play(false); show(Number(slider.value)); });
show(0);
play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
