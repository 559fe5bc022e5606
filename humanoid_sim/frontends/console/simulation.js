// What only a simulation can be asked for: to pause and pace its time, a push, a new beginning. The session refuses all
// of it for motors, and then nothing of it is shown.
"use strict";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4]; // times real time
const DIRECTIONS = { "+x": [1, 0], "−x": [-1, 0], "+y": [0, 1], "−y": [0, -1] }; // the world's; at its start a robot faces +x
const SETTLED = 1000; // ms after which the speed that is shown is what the session says again

let isPaused = false;
let chosen = -Infinity; // when a speed was chosen

const pushed = get("simulation").elements;
get("simulation-speed").replaceChildren(...SPEEDS.map((speed) => new Option(`${speed} ×`, speed)));
pushed.direction.replaceChildren(...Object.keys(DIRECTIONS).map((name) => new Option(name)));

function showSimulation(told) {
  get("simulation").hidden = told === null;
  isPaused = told !== null && told.paused;
  const pace = isPaused ? "PAUSED" : told !== null && told.speed !== 1 ? `${told.speed} × real time` : "";
  if (get("pace").textContent !== pace) get("pace").textContent = pace;
  if (told === null) return;
  get("simulation-pause").textContent = isPaused ? "Resume" : "Pause";
  get("simulation-pause").classList.toggle("paused", isPaused);
  const speed = get("simulation-speed");
  if (performance.now() - chosen > SETTLED) speed.value = told.speed;
  for (const [part, problem] of [[speed, told.problems.speed], [get("simulation-reset"), told.problems.reset]]) {
    part.disabled = problem !== undefined;
    part.title = problem || "";
  }
  if (pushed.body.length !== told.bodies.length) {
    pushed.body.replaceChildren(...told.bodies.map((name) => new Option(name)));
  }
}

get("simulation-pause").addEventListener("click", () => ask(isPaused ? "resume" : "pause"));
get("simulation-reset").addEventListener("click", () => ask("reset"));
get("simulation-speed").addEventListener("change", (event) => {
  chosen = performance.now();
  ask(`speed ${event.target.value}`);
});
get("simulation").addEventListener("submit", (event) => {
  event.preventDefault();
  const [x, y] = DIRECTIONS[pushed.direction.value].map((sign) => sign * Number(pushed.speed.value));
  ask(`push ${x},${y} ${pushed.body.value}`);
});
