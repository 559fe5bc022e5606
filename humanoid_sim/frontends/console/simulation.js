// What only a simulation can be asked for: a push, a new beginning. The session refuses all
// of it for motors, and then nothing of it is shown.
"use strict";

const DIRECTIONS = { "+x": [1, 0], "−x": [-1, 0], "+y": [0, 1], "−y": [0, -1] }; // the world's; at its start a robot faces +x

const pushed = get("simulation").elements;
pushed.direction.replaceChildren(...Object.keys(DIRECTIONS).map((name) => new Option(name)));

function showSimulation(told) {
  get("simulation").hidden = told === null;
  if (told === null) return;
  if (pushed.body.length !== told.bodies.length) {
    pushed.body.replaceChildren(...told.bodies.map((name) => new Option(name)));
  }
}

get("simulation-reset").addEventListener("click", () => ask("reset"));
get("simulation").addEventListener("submit", (event) => {
  event.preventDefault();
  const [x, y] = DIRECTIONS[pushed.direction.value].map((sign) => sign * Number(pushed.speed.value));
  ask(`push ${x},${y} ${pushed.body.value}`);
});
